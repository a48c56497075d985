"""Rows of benchmarks carry an error that is seen, against the reference engine."""

import numpy as np
import pytest

from cnnum.engine import Engine
from cnnum.lab.bench import compile_time, denormals, errors, scene_costs
from cnnum.lab.bench.samples import maps
from cnnum.programs.library import get_program


@pytest.mark.in_full("test_a_programs_stream_is_judged_by_the_truth_that_it_is_given")
def test_cold_and_warm_starts_give_the_reference_engines_answer():
    *starts, row = compile_time.measure_compile(Engine(), repeats=1)
    assert starts == compile_time.STARTS * [None]
    # float32, and DIFFUS follows its error to 1e-4 of values of order 1
    assert 0.0 < row.error < 1e-4
    assert row.warm_s < row.cold_s


def test_one_wrong_start_is_seen():
    true = {name: np.zeros((8, 8)) for name in compile_time.NAMES}
    wrong = true | {"HOLE": np.eye(8)}
    assert compile_time.largest_difference([true, true], true) == 0.0
    assert compile_time.largest_difference([true, wrong], true) == 1.0


@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_runs_next_to_zero_are_held_to_the_reference_engines(precision):
    case = denormals.CASES[0]
    engine = Engine(precision=precision)
    row = denormals.measure_case(engine, case, denormals.case_truths(case), budget=0.01)
    # 4000 steps of numbers of order 1, each rounded twice
    assert 0.0 < row.ordinary_error < 8000 * np.finfo(precision).eps
    # a denormal of a hundredth of the smallest normal number has 17 of 23 bits; where denormals are
    # flushed, as PoCL does when it is asked to, there are none
    assert row.error == 1.0 or (row.error < 1e-3 and "Portable" not in row.device)
    near, ordinary = denormals.case_truths(case)
    # the error is below the smallest normal number, and the run begins e^10 above it
    assert row.error_of_start < 1e-4
    row = denormals.measure_case(engine, case, (1.5 * near, 1.5 * ordinary), budget=0.01)
    assert row.ordinary_error == pytest.approx(1 / 3, abs=1e-3)
    assert row.error == 1.0 or row.error == pytest.approx(1 / 3, abs=1e-3)


def test_errors_next_to_zero_are_stated_as_they_are_and_over_what_the_run_begins_with(opencl):
    """Adaptive steps keep an absolute tolerance alone: over a truth of nothing, all is large."""
    (case,) = (case for case in denormals.CASES if case.dt is None)
    # as if the truth were nothing: then all that is left of a state is an error
    near, ordinary = denormals.case_truths(case)
    row = denormals.measure_case(opencl, case, (1e-30 * near, ordinary), budget=0.01)
    state, given = denormals.near_zero(maps(case.batch, *case.shape), denormals.smallest("float32"))
    left = opencl.run(denormals.decaying(), input=given, state=state, method=case.method).state
    largest = np.abs(left[[0, -1]]).max()
    assert row.absolute_error == pytest.approx(largest, rel=1e-6)
    assert row.error_of_start == pytest.approx(largest / np.abs(state).max(), rel=1e-6)
    # a default tolerance, of which such numbers are nothing
    assert 0.0 < row.absolute_error < 1e-5


def test_a_programs_stream_is_judged_by_the_truth_that_it_is_given(opencl):
    plan = opencl.compile(get_program("contact"), (8, 8), ["contact_area", "load_normal"])
    true = errors.truths("contact", (8, 8), 60.0, needs=("contact_area", "load_normal"))
    ten = [{name: 10.0 * value for name, value in answer.items()} for answer in true]
    wrong = [answer | {"load_normal": 1.5 * answer["load_normal"]} for answer in true]
    # a third of the wrong value is missing, and a twentieth of ten times the right one
    assert errors.stream_error(plan, wrong) == pytest.approx(1 / 3, rel=1e-3)
    assert errors.stream_error(plan, wrong, over=ten) == pytest.approx(0.05, rel=1e-3)


def test_the_truth_next_to_zero_is_that_of_steps_next_to_zero():
    """In float64, to which float32's smallest normal number is like any other."""
    case = denormals.CASES[0]
    near, _ = denormals.case_truths(case)
    least = denormals.smallest("float32")
    state, given = denormals.near_zero(maps(case.batch, *case.shape), least)
    template, how = denormals.decaying(), {"method": case.method, "dt": case.dt}
    stepped = Engine("reference").run(template, input=given, state=state, **how)
    # rounding of 4000 steps
    np.testing.assert_allclose(least * near, stepped.state, rtol=1e-9)


@pytest.mark.in_full("test_a_programs_stream_is_judged_by_the_truth_that_it_is_given")
def test_a_program_next_to_zero_is_held_to_the_reference_engines():
    row = denormals.measure_program(Engine(), budget=0.01)
    # float32 through some hundred operations; strengths of slip are ratios of small differences
    assert 0.0 < row.ordinary_error < 5e-3
    # squares of such numbers are 0 in float32 and not in float64: the one sees no contact. Places
    # of edges are -1 where there is none and 1 at most: they differ by up to 2
    assert 1.0 <= row.error <= 2.0


def test_a_scene_that_answers_otherwise_is_seen(opencl):
    scene = scene_costs.opened_scene("edges", opencl)
    with scene.driver as driver:
        frames = scene_costs.compared(list(driver.frames()), 200)
    found = scene_costs.answers(scene, frames)
    assert scene_costs.error_of(scene, found, found) == (0.0, 0)
    # the scene's sphere has no edge: one frame is given one
    at = len(found) // 2
    found[at] = {**found[at], "edge_row": found[at]["edge_row"] + 3.0}
    moved = [dict(each) for each in found]
    moved[at]["edge_row"] = moved[at]["edge_row"] + 0.3
    error, flips = scene_costs.error_of(scene, moved, found)
    assert (error, flips) == (pytest.approx(0.1), 0)
    moved[at]["edges"] = 1.0 - moved[at]["edges"]
    assert scene_costs.error_of(scene, moved, found) == (0.0, 1)
