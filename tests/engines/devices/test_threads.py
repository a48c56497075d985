"""One engine, one plan and its streams give several threads the same as one thread."""

import sys
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

import cnnum
from cnnum.engine import Engine

THREADS = 6
NAMES = ("DIFFUS", "EDGE", "HOLE", "AVERAGE")


def by_threads(work, jobs):
    with ThreadPoolExecutor(THREADS) as pool:
        return list(pool.map(work, jobs))


def differing(work, jobs):
    """How many results of threads are not to the bit those of one thread."""
    want, got = [work(job) for job in jobs], by_threads(work, jobs)
    return sum(not np.array_equal(a, b) for a, b in zip(want, got, strict=True))


# without turns, a fifth to nine tenths of the runs of each shape were wrong
@pytest.mark.parametrize(("shape", "count"), [((8, 8), 400), ((64, 64), 100), ((300, 300), 20)])
def test_runs_of_one_template(fast, shape, count):
    template = cnnum.get_template("DIFFUS")
    jobs = np.random.default_rng(0).uniform(-1, 1, (count, *shape))
    assert not differing(lambda u: fast.run(template, input=u, duration=1.0).state, list(jobs))


def test_batches_of_one_template(fast):
    template = cnnum.get_template("DIFFUS")
    jobs = np.random.default_rng(0).uniform(-1, 1, (100, 40, 8, 8))
    assert not differing(lambda u: fast.run(template, input=u, duration=1.0).state, list(jobs))


def test_plans_that_threads_build_at_once(fast):
    """The engine of the threads has built nothing before."""
    rng = np.random.default_rng(1)
    jobs = [(cnnum.get_template(NAMES[n % 4]), rng.uniform(-1, 1, (8, 8))) for n in range(64)]

    def run(engine, job):
        return engine.run(job[0], input=job[1], duration=1.0).state

    want, new = [run(fast, job) for job in jobs], Engine(fast.name)
    got = by_threads(lambda job: run(new, job), jobs)
    for a, b in zip(want, got, strict=True):
        np.testing.assert_array_equal(a, b)


@cnnum.program
def remembering(frame):
    before = frame.previous(frame.normal)
    return {"half": frame.normal + 0.5 * before, "sum": (frame.normal * before).sum()}


@pytest.mark.parametrize("lead", [(), (2,)], ids=["single", "side by side"])
def test_streams_of_one_plan(fast, lead):
    plan = fast.compile(remembering, (8, 8))

    def stream(frames):
        session = plan.stream(lead)
        return np.array(
            [session.push(np.broadcast_to(f, (*lead, *f.shape)))["half"] for f in frames]
        )

    jobs = np.random.default_rng(2).normal(size=(8, 200, 8, 8, 3))
    assert not differing(stream, list(jobs))


def test_streams_that_threads_open_at_once(fast):
    """PyOpenCL writes Python for every kernel; it warned of a name that two threads had taken."""
    plan, frame = fast.compile(remembering, (8, 8)), np.ones((8, 8, 3))
    between = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    try:
        by_threads(lambda _: plan.stream().push(frame), range(200))
    finally:
        sys.setswitchinterval(between)


@cnnum.program
def summing(frame):
    total = frame.memory("total", scalar=True)
    total.store(total.value + frame.normal.sum())
    return {"total": total.value}


def test_one_stream_pushed_by_threads_takes_every_frame_once(fast):
    session = fast.compile(summing, (4, 4)).stream()
    by_threads(session.push, [np.ones((4, 4, 3))] * 600)
    assert session.push(np.zeros((4, 4, 3)))["total"] == 600 * 16
