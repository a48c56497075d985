"""Benchmarks: timing that can be trusted, peers that do the same work, pages that stand alone."""

import json
import time

import numpy as np
import pytest

from cnnum.bench.charts import CHARTS
from cnnum.bench.page import write_report
from cnnum.bench.peers import PEERS, Work
from cnnum.bench.records import as_row
from cnnum.bench.samples import full_template, generator
from cnnum.bench.timing import Timing, interleaved
from cnnum.engine import Engine
from cnnum.errors import MissingExtraError
from cnnum.report.work_precision import WorkPrecision


def test_interleaved_calls_take_turns():
    order = []
    calls = [lambda: order.append("a"), lambda: order.append("b")]
    first, second = interleaved(calls, budget=5.0, runs=4)
    assert order == ["a", "b"] * 5
    assert first.runs == second.runs == 4


def test_a_long_call_runs_once():
    runs = []
    (timing,) = interleaved([lambda: (runs.append(1), time.sleep(0.02))], budget=0.01)
    assert len(runs) == timing.runs == 1
    assert timing.least >= 0.02


def test_timing_sums_up():
    timing = Timing.of([3.0, 1.0, 2.0, 4.0, 5.0])
    assert (timing.least, timing.median, timing.spread) == (1.0, 3.0, 2.0)


@pytest.mark.parametrize("peer", PEERS, ids=lambda peer: peer.name)
@pytest.mark.parametrize("boundary", [0.4, "zero-flux"])
def test_peers_do_the_same_work(peer, boundary):
    """Euler's steps agree to single precision; vode is as near the truth as its tolerance."""
    try:
        run = peer.load()
    except MissingExtraError as missing:
        pytest.skip(str(missing))
    rng, template = generator(), full_template(boundary=boundary)
    start, given = rng.uniform(-1, 1, (2, 9, 11))
    work = Work(template, start, given, 1.0, 0.05, 1e-6, np.dtype(np.float32))
    step = work.step if peer.fixed else None
    wanted = Engine("reference").run(template, state=start, input=given, duration=1.0, dt=step)
    # OpenCV rounds its own way, 20 steps of values of order 1; vode's local errors add up
    tolerance = 5e-6 if peer.fixed else 1e-4
    assert np.abs(run(work) - wanted.state).max() <= tolerance


def test_a_missing_peer_is_named(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "celnn", None)
    monkeypatch.delitem(__import__("sys").modules, "cnnum.bench.peers.celnn_network", raising=False)
    with pytest.raises(MissingExtraError, match=r"cnnum\[peers\]"):
        PEERS[0].load()


def test_rows_have_no_infinities():
    row = as_row(
        WorkPrecision("EDGE", "opencl", "float32", "euler", None, 0.1, np.inf, 4, 0.1, 0.0, 50)
    )
    assert row["error"] is None
    assert row["case"] == "EDGE"


def test_pages_hold_their_data(tmp_path):
    points = [("DIFFUS", "opencl", "float32", "rk4", None, dt, dt**4) for dt in (0.1, 0.2)]
    rows = [as_row(WorkPrecision(*point, 4, 0.5, 0.0, 9)) for point in points]
    picture, data, page = write_report(tmp_path, "work-precision", rows, "a device", ["one thing"])
    assert picture.read_bytes().startswith(b"\x89PNG")
    kept = json.loads(data.read_text())
    assert kept["rows"] == rows
    assert kept["environment"]["device"] == "a device"
    text = page.read_text()
    assert "one thing" in text
    assert "http" not in text.split("<script")[0]


def test_every_benchmark_has_a_picture():
    from cnnum.cli.bench import command

    assert set(command.commands) == set(CHARTS)


def test_growth_ends_in_its_time_on_a_slow_machine(monkeypatch):
    """Builds and slow places use up what later places may take, and never make the run longer."""
    from cnnum.bench import scaling

    now, budgets = [0.0], []

    def slow(engine, point, budget):
        budgets.append(budget)
        now[0] += 4.0 + budget  # a build of 4 s, and then what it may take
        return point

    monkeypatch.setattr(scaling, "_measure", slow)
    monkeypatch.setattr(scaling.time, "perf_counter", lambda: now[0])
    found = list(scaling.measure_scaling(Engine("reference")))
    assert found == list(scaling.points())
    # builds alone take 4 s a place, and the bench has promised to end in 3 minutes
    assert now[0] < 180.0
    assert budgets[0] > budgets[-1] >= 0.0


@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_results_are_the_same_to_the_bit_from_run_to_run(precision):
    """What is timed: adaptive and fixed steps, in a plan built anew each time."""
    rng, template = generator(), full_template()
    start, given = rng.uniform(-1, 1, (2, 5, 9, 11))
    for how in ({"method": "bogacki-shampine"}, {"dt": 0.05}):
        runs = [
            Engine(precision=precision).run(template, state=start, input=given, **how)
            for _ in range(3)
        ]
        for again in runs[1:]:
            assert again.state.tobytes() == runs[0].state.tobytes()
            assert again.error.tobytes() == runs[0].error.tobytes()
