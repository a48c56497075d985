"""Large arrays are read and written where the host has them: nothing is lost, nothing let through.

One step of Euler has the closed form x + h (−x + A∗f(x) + B∗u + z), computed here with NumPy.
"""

import numpy as np
import pytest

from cnnum import Template
from cnnum.engines.opencl.launching import KeptBlock
from cnnum.errors import ArrayError

SHAPE = (260, 257)  # more cells than one work item takes, and no whole vectors
STEP = 0.25
TEMPLATE = Template(
    "one step",
    A=[[0.0, 0.3, 0.0], [0.2, 1.1, -0.1], [0.0, 0.4, 0.0]],
    B=[[0.0, 0.0, 0.0], [0.0, 0.7, 0.0], [0.0, 0.0, 0.0]],
    z=0.05,
    duration=STEP,
)
ENGINES = ("opencl-float32", "opencl-float64", "numba-float32")
ROUNDING = {"float32": 1e-6, "float64": 1e-14}  # ten operations between numbers below 4


def maps(seed, *lead):
    rng = np.random.default_rng(seed)
    return rng.uniform(-2.0, 2.0, (*lead, *SHAPE)), rng.uniform(-1.0, 1.0, (*lead, *SHAPE))


def stepped(state, given):
    y = np.pad(np.clip(state, -1.0, 1.0), [(0, 0)] * (state.ndim - 2) + [(1, 1), (1, 1)])
    rows, cols = SHAPE
    near = sum(
        TEMPLATE.A[0, 0, r, c] * y[..., r : r + rows, c : c + cols]
        for r in range(3)
        for c in range(3)
    )
    return state + STEP * (-state + near + 0.7 * given + 0.05)


def run(engine, state, given):
    return engine.run(TEMPLATE, input=given, state=state, dt=STEP)


@pytest.mark.parametrize("label", ENGINES[:2])
def test_a_step_is_its_closed_form(engines, label):
    state, given = maps(1)
    result = run(engines[label], state, given)
    expected = stepped(state, given)
    tolerance = ROUNDING[engines[label].precision]
    assert np.abs(result.state - expected).max() <= tolerance
    assert np.abs(result.output - np.clip(expected, -1.0, 1.0)).max() <= tolerance
    assert result.state.dtype == result.output.dtype == np.float64
    assert (result.time, result.steps) == (STEP, 1)


def read_only(array):
    array = array.copy()
    array.setflags(write=False)
    return array


def shifted(array):
    """Return the numbers where no double begins at a multiple of its size."""
    numbers = np.frombuffer(b"\0" + array.tobytes(), np.uint8)[1:].view(array.dtype)
    return numbers.reshape(array.shape)


FORMS = {
    "single precision": lambda array: array,
    "double precision": lambda array: array.astype(np.float64),
    "read only": read_only,
    "column by column": np.asfortranarray,
    "every second": lambda array: np.repeat(array, 2, axis=1)[:, ::2],
    "backwards": lambda array: array[::-1].copy()[::-1],
    "other bytes first": lambda array: array.astype(">f8"),
    "between bytes": shifted,
    "nested lists": lambda array: array.tolist(),
    "a layer of one": lambda array: array[np.newaxis],
}


@pytest.mark.parametrize("form", FORMS)
def test_every_form_of_the_same_numbers_gives_the_same_bits(engines, form):
    engine = engines["opencl-float32"]
    state, given = (array.astype(np.float32) for array in maps(2))
    plain = run(engine, state.astype(np.float64), given.astype(np.float64))
    found = run(engine, FORMS[form](state), FORMS[form](given))
    assert np.array_equal(found.state.reshape(SHAPE), plain.state)
    assert np.array_equal(found.output.reshape(SHAPE), plain.output)


@pytest.mark.parametrize("label", ["opencl-float32", "opencl-float64"])
def test_a_batch_shares_what_has_no_leading_axes(engines, label):
    state, _ = maps(3, 2, 1)
    _, given = maps(4, 3)
    result = run(engines[label], state, given)
    assert result.state.shape == (2, 3, *SHAPE)
    expected = stepped(np.broadcast_to(state, (2, 3, *SHAPE)), given)
    assert np.abs(result.state - expected).max() <= ROUNDING[engines[label].precision]
    alone = run(engines[label], state, given[0])
    assert np.array_equal(alone.state[:, 0], result.state[:, 0])


PLACES = [(0, 0), (130, 100), (259, 256)]


@pytest.mark.parametrize("label", ENGINES)
@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("role", ["input", "state"])
def test_what_is_not_finite_is_refused_wherever_it_is(engines, label, bad, role):
    for place in PLACES:
        for dtype in (np.float32, np.float64):
            given = {"state": np.zeros(SHAPE, dtype), "input": np.zeros(SHAPE, dtype)}
            given[role][place] = bad
            with pytest.raises(ArrayError, match=f"'{role}' must be finite, got 1 NaN or inf"):
                engines[label].run(TEMPLATE, **given, dt=STEP)


def test_a_choice_that_looks_at_the_input_first_refuses_it_too(engines):
    """Whether the array stays linear hangs on its input, which is infinite here."""
    calm = Template("calm", A=[[0.1]], B=[[0.0, 0.0, 0.0], [0.0, 0.2, 0.0], [0.0, 0.0, 0.0]])
    state, given = maps(5)
    given[7, 7] = np.inf
    with pytest.raises(ArrayError, match="'input' must be finite"):
        engines["opencl-float32"].run(calm, input=given, state=0.4 * state, duration=1.0)


def test_one_bad_frame_of_a_batch_is_refused(engines):
    state, given = maps(6, 3)
    state[2, 250, 250] = np.nan
    with pytest.raises(ArrayError, match="'state' must be finite, got 1 "):
        run(engines["opencl-float32"], state, given)


@pytest.mark.parametrize("label", ["opencl-float32", "numba-float32"])
def test_numbers_beyond_single_precision_are_refused_in_it(engines, label):
    state, given = maps(7)
    given[3, 5] = -1e39
    with pytest.raises(ArrayError, match=r"reaches 1e\+39, more than float32 can represent"):
        run(engines[label], state, given)


def test_a_result_beyond_single_precision_is_refused(engines):
    steep = Template("steep", A=[[0.0]], B=[[1e38]], duration=STEP)
    state, given = maps(8)
    given[200, 100] = 100.0
    with pytest.raises(ArrayError, match=r"is not finite"):
        engines["opencl-float32"].run(steep, input=given, state=state, dt=STEP)


def test_results_stay_as_they_are_while_the_engine_goes_on(engines):
    engine = engines["opencl-float32"]
    state, given = maps(9)
    first = run(engine, state, given)
    kept, corner = first.state.copy(), first.output[-1:, -1:]
    value = corner.copy()
    del first
    second = run(engine, -state, given)
    third = run(engine, state, given)
    assert np.array_equal(corner, value)
    assert not np.shares_memory(second.state, third.state)
    assert np.array_equal(third.state, kept)
    assert not np.array_equal(second.state, kept)


def test_a_result_may_be_given_back_and_kept_without_the_others(engines):
    engine = engines["opencl-float32"]
    state, given = maps(11)
    twice = run(engine, run(engine, state, given).state, given)
    expected = stepped(stepped(state, given), given)
    assert np.abs(twice.state - expected).max() <= 2 * ROUNDING["float32"]
    assert twice.state.base is not twice.output.base
    assert twice.time.base is None or twice.time.base.size == 1


def test_a_block_is_used_again_once_nobody_holds_a_part_of_it():
    kept = KeptBlock()
    part = kept.take(1000)[10:20]
    place = part.ctypes.data - 80
    assert kept.take(1000).ctypes.data != place
    again = kept.take(1000).ctypes.data
    assert kept.take(1000).ctypes.data == again
    assert kept.take(999).size == 999


def test_the_device_itself_looks_at_what_it_takes(engines):
    engine = engines["opencl-float32"]
    state, given = maps(10)
    run(engine, state, given)
    plan = next(plan for plan in engine._open.plans.values() if plan.schedule.shape == SHAPE)
    planes = [given[np.newaxis], state[np.newaxis]]
    outputs = plan.run_large(planes, ())
    assert outputs is not None
    assert np.abs(outputs["state 0"] - stepped(state, given)).max() <= ROUNDING["float32"]
    planes[1][0, 50, 60] = np.nan
    assert plan.run_large(planes, ()) is None
