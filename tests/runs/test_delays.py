"""Runs with a delay keep their tolerance and their stated error: SciPy by the method of steps."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import cnnum
from cnnum.runs import growth
from cnnum.templating.couplings import DelayedCoupling
from cnnum.templating.template import Template

SHAPE = (4, 5)
NOW = np.array([[0.0, 0.3, 0.0], [0.2, 1.4, -0.3], [0.0, 0.1, 0.1]])
LATE = np.array([[0.1, 0.0, 0.0], [-0.7, -0.9, 0.5], [0.0, 0.2, 0.0]])


def late(delay=0.37, duration=3.0, output="standard", late=LATE):
    coupling = DelayedCoupling(delay, late[None, None], np.full((1, 1, 1, 1), 0.6))
    return Template(
        "late", NOW, [[0.5]], -0.1, boundary="zero-flux", output=output, initial=0.0,
        duration=duration, delayed=coupling,
    )  # fmt: skip


def f(state):
    return 0.5 * (np.abs(state + 1.0) - np.abs(state - 1.0))


def summed(kernel, outputs):
    """The sum over the neighbourhood, by shifted copies of a padded map."""
    around, total = np.pad(outputs, 1, mode="edge"), np.zeros(SHAPE)
    for r in range(3):
        for c in range(3):
            total += kernel[r, c] * around[r : r + SHAPE[0], c : c + SHAPE[1]]
    return total


def by_steps(template, start, now, before, rtol=1e-11):
    """The state at the end: DOP853 over one delay after the other."""
    delay, end, time, past, x = template.delayed.delay, template.duration, 0.0, None, start
    while time < end - 1e-12:
        drive = 0.5 * now - 0.1 + 0.6 * (before if past is None else now)

        def rate(t, flat, past=past, drive=drive):
            state = flat.reshape(SHAPE)
            seen = start if past is None else past(t - delay).reshape(SHAPE)
            return (summed(NOW, f(state)) + summed(LATE, f(seen)) + drive - state).ravel()

        stop = min(time + delay, end)
        solved = solve_ivp(
            rate, (time, stop), x.ravel(), "DOP853", rtol=rtol, atol=1e-12, dense_output=True,
            max_step=0.01,
        )  # fmt: skip
        past, time, x = solved.sol, stop, solved.y[:, -1].reshape(SHAPE)
    return x


@pytest.fixture(scope="module")
def known():
    rng = np.random.default_rng(7)
    start, now, before = (rng.uniform(-1, 1, (6, *SHAPE)) for _ in range(3))
    maps = {"state": start, "input": now, "previous": before}
    truth = np.stack([by_steps(late(), *each) for each in zip(start, now, before, strict=True)])
    return maps, truth


@pytest.mark.parametrize("tolerance", [1e-3, 1e-4, 1e-6])
@pytest.mark.parametrize("label", ["numba", "opencl"])
def test_the_state_is_within_the_tolerance_and_the_stated_error(label, tolerance, known):
    maps, truth = known
    engine = cnnum.Engine(label, precision="float64")
    found = engine.run(late(), **maps, rtol=tolerance, atol=0.1 * tolerance)
    off = np.abs(found.state - truth)
    assert np.all(off <= tolerance * np.abs(truth) + 0.1 * tolerance)
    worst = off.max(axis=(1, 2))
    assert np.all(found.error >= worst)
    # four times the true error, where its order shows; corners of f may hide a part
    assert np.median(found.error / worst) < 30.0
    assert found.reason.endswith(growth.REASON)


def test_steps_are_shorter_where_the_tolerance_is(known):
    maps, _ = known
    engine = cnnum.Engine("numba", precision="float64")
    loose, tight = (engine.run(late(), **maps, rtol=rtol, atol=rtol) for rtol in (1e-3, 1e-6))
    # of order 2: a thousandth of the tolerance takes some 32 times the steps, or a power of 2 less
    assert np.all(tight.steps >= 15 * loose.steps)
    assert tight.error.max() < 0.01 * loose.error.max()


def test_a_frame_is_the_same_alone_and_in_a_batch(known):
    maps, _ = known
    engine = cnnum.Engine("numba")
    all_of_them = engine.run(late(), **maps)
    assert len(set(all_of_them.steps.tolist())) > 1
    for n in range(6):
        alone = engine.run(late(), **{role: values[n] for role, values in maps.items()})
        assert alone.state.shape == SHAPE
        np.testing.assert_array_equal(alone.state, all_of_them.state[n])
        assert alone.error == all_of_them.error[n]
        assert alone.steps == all_of_them.steps[n]


def test_templates_side_by_side_keep_the_tolerance_too(known):
    maps, truth = known
    batch = cnnum.TemplateBatch(late(), z=np.full((6, 1), -0.1))
    found = cnnum.Engine("opencl", precision="float64").run(batch, **maps)
    off = np.abs(found.state - truth)
    assert np.all(off <= 1e-4 * np.abs(truth) + 1e-5)
    assert np.all(found.error >= off.max(axis=(1, 2)))


def test_growth_that_single_precision_does_not_follow_is_stated():
    """x' = x + 2 x(t − 1) grows by e^{1.37 t}, and so does every rounding."""
    coupling = DelayedCoupling(1.0, np.full((1, 1, 1, 1), 2.0), np.zeros((1, 0, 1, 1)))
    grows = Template("grows", [[2.0]], output="linear", delayed=coupling, duration=12.0)
    start = np.random.default_rng(3).uniform(-1, 1, SHAPE)
    how = {"rtol": 1e-7, "atol": 1e-7}
    truth = cnnum.Engine("numba", precision="float64").run(grows, state=start, rtol=1e-8, atol=1e-8)
    found = cnnum.Engine("numba").run(grows, state=start, **how)
    assert np.abs(truth.state).max() > 1e6
    assert found.error >= np.abs(found.state - truth.state).max() - truth.error
    assert found.error > 1e-7 * np.abs(truth.state).max()


def test_steps_that_were_asked_for_are_not_halved(known):
    maps, _ = known
    found = cnnum.Engine("numba").run(late(), **maps, dt=0.05)
    assert np.all(np.isinf(found.error))
    assert np.all(found.steps == found.steps[0])


def test_the_method_of_steps_measures_its_own_error(known):
    maps, truth = known
    found = cnnum.Engine("reference").run(late(), **maps)
    off = np.abs(found.state - truth).max(axis=(1, 2))
    assert np.all(found.error < 1e-5)
    # the truth itself is off by its tolerance of 1e-11 a step
    assert np.all(found.error >= off - 1e-10)
