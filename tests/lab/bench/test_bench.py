"""Benchmarks: timing that can be trusted, peers that do the same work, pages that stand alone."""

import itertools
import json
import time

import numpy as np
import pytest
from own_process import in_own_process, peer_answer

from cnnum.engine import Engine
from cnnum.errors import MissingExtraError
from cnnum.lab.bench import scaling, work_precision
from cnnum.lab.bench.charts import CHARTS
from cnnum.lab.bench.page import write_report
from cnnum.lab.bench.peers import PEERS, Work
from cnnum.lab.bench.programs import program_rungs
from cnnum.lab.bench.records import as_row
from cnnum.lab.bench.samples import full_template, generator
from cnnum.lab.bench.timing import Timing, interleaved
from cnnum.lab.commands import bench
from cnnum.report import work_precision as report
from cnnum.report.work_precision import WorkPrecision


def test_interleaved_calls_take_turns():
    """A turn each to warm up and four more; a short call comes more than once in a turn."""
    order = []
    calls = [lambda: order.append("a"), lambda: (order.append("b"), time.sleep(0.06))]
    first, second = interleaved(calls, budget=5.0, runs=4)
    turns = [(name, len(list(calls))) for name, calls in itertools.groupby(order)]
    assert [name for name, _ in turns] == ["a", "b"] * 5
    assert all(count > 1 for name, count in turns[2:] if name == "a")
    assert all(count == 1 for name, count in turns if name == "b")
    assert first.runs == second.runs == 4
    assert first.median < 0.05 <= second.median


def test_a_long_call_runs_once():
    runs = []
    (timing,) = interleaved([lambda: (runs.append(1), time.sleep(0.02))], budget=0.01)
    assert len(runs) == timing.runs == 1
    assert timing.least >= 0.02


def test_a_long_call_does_not_keep_a_short_one_from_more_runs():
    long, short = interleaved([lambda: time.sleep(0.02), lambda: None], budget=0.01, runs=5)
    assert long.runs == 1
    assert short.runs == 5


def test_timing_sums_up():
    timing = Timing.of([3.0, 1.0, 2.0, 4.0, 5.0])
    assert (timing.least, timing.median, timing.spread) == (1.0, 3.0, 2.0)


@pytest.mark.parametrize("peer", PEERS, ids=lambda peer: peer.name)
@pytest.mark.parametrize("boundary", [0.4, "zero-flux"])
def test_peers_do_the_same_work(peer, boundary):
    """Euler's steps agree to single precision; vode is as near the truth as its tolerance."""
    rng, template = generator(), full_template(boundary=boundary)
    start, given = rng.uniform(-1, 1, (2, 9, 11))
    work = Work(template, start, given, 1.0, 0.05, 1e-6, np.dtype(np.float32))
    step = work.step if peer.fixed else None
    wanted = Engine("reference").run(template, state=start, input=given, duration=1.0, dt=step)
    try:
        found = in_own_process(peer_answer, peer, work)
    except MissingExtraError as missing:
        pytest.skip(str(missing))
    # OpenCV rounds its own way, 20 steps of values of order 1; vode's local errors add up
    tolerance = 5e-6 if peer.fixed else 1e-4
    assert np.abs(found - wanted.state).max() <= tolerance


def test_a_missing_peer_is_named(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "celnn", None)
    monkeypatch.delitem(
        __import__("sys").modules, "cnnum.lab.bench.peers.celnn_network", raising=False
    )
    with pytest.raises(MissingExtraError, match=r"'\.\[peers\]'"):
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
    from cnnum.lab.commands.bench import command

    assert set(command.commands) - {"all"} == set(CHARTS)


def _place(point, ns_per_update):
    """A row of `cnnum bench scaling` without a measurement."""
    about = (point.case, "a device", point.shape, point.batch, point.radius, point.layers)
    return scaling.Scaling(*about, 1e9 / ns_per_update, ns_per_update, None, 1.0, 0.0, 0.0)


def test_growth_ends_in_its_time_on_a_slow_machine(monkeypatch):
    """Builds and slow places use up the time of later places, and never make the run longer."""
    now, budgets = [0.0], []

    def slow(engine, point, budget):
        budgets.append(budget)
        now[0] += 4.0 + budget  # a build of 4 s, and then the time it may take
        return _place(point, 1.0)

    monkeypatch.setattr(scaling, "_measure", slow)
    monkeypatch.setattr(scaling.time, "perf_counter", lambda: now[0])
    found = list(scaling.measure_scaling(Engine("reference")))
    names = ("case", "shape", "batch", "radius", "layers")
    places = [scaling.Point(*(getattr(row, name) for name in names)) for row in found]
    assert places == list(scaling.points())
    assert len(budgets) == len(places)  # the base too is measured once
    # builds alone take 4 s a place; the bench has promised to end in 3 minutes
    assert now[0] < 180.0
    assert budgets[0] > budgets[-1] >= 0.0


@pytest.mark.parametrize("quick", [True, False])
def test_growth_is_the_time_of_a_cell_over_that_of_64_squared(monkeypatch, quick):
    """A cell takes as many ns as the array has rows, more in other curves: rows over 64."""
    monkeypatch.setattr(
        scaling, "_measure", lambda engine, point, budget: _place(point, 1.0 * point.shape[0])
    )
    found = list(scaling.measure_scaling(Engine("reference"), quick=quick))
    arrays = {row.shape: row.growth for row in found if row.case == "array"}
    assert arrays.keys() >= {(8, 8), (64, 64), (2048, 2048)}
    # divisions by a power of two are exact
    assert arrays == {shape: shape[0] / 64 for shape in arrays}
    others = [row for row in found if row.case != "array"]
    assert others
    assert all(row.growth is None for row in others)


class _Clock:
    """A clock that only tasks move."""

    def __init__(self, monkeypatch):
        self.now = 0.0
        monkeypatch.setattr(work_precision.time, "perf_counter", lambda: self.now)

    def takes(self, seconds, row):
        def measure():
            self.now += seconds
            return row

        return measure


def test_what_there_is_no_time_for_is_named(monkeypatch):
    clock = _Clock(monkeypatch)
    tasks = {
        "slow": [(f"rung {n}", clock.takes(4.0, f"row {n}")) for n in range(5)],
        "quick": [(f"rung {n}", clock.takes(1.0, f"row {n}")) for n in range(5)],
    }
    found = list(work_precision.shared_out(list(tasks), tasks.__getitem__, 20.0))
    # 10 s of 20 for the first: its third rung begins at 8 s and is finished; 8 s for the second
    assert found[:3] == ["row 0", "row 1", "row 2"]
    assert found[3].startswith("slow: not run")
    assert "rung 3; rung 4" in found[3]
    assert found[4:] == [None, *(f"row {n}" for n in range(5))]
    assert clock.now == 17.0


def test_time_that_a_case_leaves_over_is_there_for_the_next(monkeypatch):
    clock = _Clock(monkeypatch)
    tasks = {"quick": [("one", clock.takes(1.0, 1))], "slow": [("all", clock.takes(9.0, 2))] * 2}
    assert list(work_precision.shared_out(list(tasks), tasks.__getitem__, 12.0)) == [1, 2, 2]


def test_without_time_every_rung_is_named_and_none_is_run():
    engines = [Engine("numba", precision="float64")]
    names = ["DIFFUS", "contact"]
    found = list(work_precision.measure_cases(names, engines, seconds=0.0))
    assert len(found) == work_precision.count(names, engines)
    stated = [item for item in found if item is not None]
    assert len(stated) == len(names)
    for rung in work_precision.LADDER:
        assert f"numba float64 {rung}" in stated[0]
    for rung in program_rungs.LADDER:
        assert f"numba float64 {rung}" in stated[1]


def test_a_quick_case_has_rows_of_every_engine_and_one_truth(monkeypatch):
    truths = []
    run = report._truth
    monkeypatch.setattr(report, "_truth", lambda *given: truths.append(given) or run(*given))
    few = (report.Rung("propagator"), report.Rung("rk4", dt=0.1))  # each builds a kernel
    monkeypatch.setattr(work_precision, "QUICK", few)
    engines = [Engine("opencl", precision="float64"), Engine("reference")]
    found = list(work_precision.measure_cases(["DIFFUS"], engines, quick=True))
    assert len(found) == work_precision.count(["DIFFUS"], engines, quick=True)
    rows = [row for row in found if row is not None]
    assert {row.engine for row in rows} == {"opencl", "reference"}
    assert len(truths) == 1
    # Runge-Kutta of fourth order at dt = 0.1 on rates below 1: far below the tolerance of 1e-4
    (rk4,) = [r for r in rows if r.method == "rk4" and r.engine == "opencl"]
    assert rk4.error < 1e-5


def test_a_run_that_is_stopped_leaves_its_rows(tmp_path, capsys):
    """Ctrl-C ends the measurement: its rows are on the page, and a sentence says that it ended."""
    row = WorkPrecision("DIFFUS", "opencl", "float32", "rk4", None, 0.1, 1e-4, 4, 0.1, 0.0, 50)
    lines = []

    def measured():
        yield row
        yield "one thing is left out"
        lines.extend((tmp_path / "work-precision.jsonl").read_text().splitlines())
        raise KeyboardInterrupt

    code = bench._report("work-precision", measured(), 9, "a device", tmp_path, False, True)
    assert code == 130
    assert [json.loads(line)["case"] for line in lines] == ["DIFFUS"]  # there before the end
    kept = json.loads((tmp_path / "work-precision.json").read_text())
    assert [r["case"] for r in kept["rows"]] == ["DIFFUS"]
    assert kept["omissions"][0] == "one thing is left out"
    assert "stopped" in kept["omissions"][1]
    assert not (tmp_path / "work-precision.jsonl").exists()
    printed = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert [r["kind"] for r in printed] == ["work-precision", "omissions"]


@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_results_are_the_same_to_the_bit_from_run_to_run(precision):
    """The steps that are timed: adaptive and fixed ones, in a plan built anew each time."""
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


def test_states_of_the_denormals_benchmark_do_become_denormal():
    """Else it would compare ordinary numbers with ordinary ones."""
    import cnnum
    from cnnum.lab.bench import denormals
    from cnnum.lab.bench.samples import maps

    ordinary = maps(1, 8, 8)
    for precision in ("float32", "float64"):
        least = denormals.smallest(precision)
        state, given = denormals.near_zero(ordinary, least)
        assert np.median(np.abs(state)) > least
        # float64 shows the rest that float32 would have
        engine = cnnum.Engine("reference")
        left = engine.run(
            denormals.decaying(), input=0 * given, state=state, method="euler", dt=0.1
        )
        assert 0 < np.median(np.abs(left.state)) < least
        assert np.abs(given).max() < least


def test_streams_that_are_compared_have_a_contact():
    """Else errors of programs would be those of nothing."""
    from cnnum.lab.bench import errors
    from cnnum.lab.bench.samples import TOUCHED, touch
    from cnnum.programs.library import get_program

    plan = Engine("opencl").compile(
        get_program("contact").bind(rate=200.0), (8, 8), needs=["contact", "contact_area"]
    )
    stream = plan.stream()
    found = [stream.push(frame) for frame in touch()]
    assert not any(answer["contact"] for answer in found[:TOUCHED])
    assert all(answer["contact"] for answer in found[TOUCHED + 2 :])
    assert errors.stream_error(plan, found) == 0.0
    found[-1] = found[-1] | {"contact_area": 1.1 * found[-1]["contact_area"]}
    assert errors.stream_error(plan, found) >= 0.09


def test_errors_of_steps_are_seen():
    from cnnum.lab.bench.errors import ends_error
    from cnnum.lab.bench.samples import maps

    def states(engine, frames, wrong=0.0):
        template = full_template()
        result = engine.run(template, input=frames, duration=0.4, dt=0.02)
        return result.state + wrong * (engine.name != "reference")

    u = maps(3, 8, 8)
    # 20 steps of values of order 1 in float32
    assert 0 < ends_error(states, Engine("opencl"), u) < 2e-6
    assert ends_error(lambda *a: states(*a, wrong=1e-3), Engine("opencl"), u) > 1e-4
