"""Cells that see only themselves with weights around 1, held to 50 digits of the closed form.

A weight a near 1 leaves 0/0 in (e^{mt} − 1)/m and in ln(1 + …)/m, m = a − 1. That cost float32 all
its digits: cells of 0.2 and 0.9 ended at ±1.1 instead of at 0.7 and 0.4.
"""

from decimal import Decimal, localcontext

import numpy as np
import pytest

import cnnum

TIME = 5.0
NEAR = (-1, 0, 1, 3, 6, 7, 8, 12, 15, 16)
"""Digits that 1 and a weight share: none to all, more steps around those of each precision."""

SLOPES = (0.0, *((-1.0) ** n * 10.0**-k for n, k in enumerate(NEAR)))
"""Of every layer its own, the sign by turns, so that one kernel holds them all."""

STEEPEST = SLOPES.index(10.0)

ROUNDINGS = 8
"""Of numbers up to 6, of which each adds half an eps on the way to the end."""


def template():
    layers = len(SLOPES)
    A, B = np.zeros((layers, layers, 1, 1)), np.ones((layers, 1, 1, 1))
    A[range(layers), range(layers), 0, 0] = 1.0 + np.array(SLOPES)
    return cnnum.Template("slopes", A, B, [0.0] * layers, initial=0.0, duration=TIME)


def closed(a, drive, start, time):
    """Return x(time) of x' = −x + a f(x) + drive, piece by piece."""
    m, x, w, left = (Decimal(v) for v in (a, start, drive, time))
    m -= 1
    if abs(x) > 1:
        side = Decimal(1).copy_sign(x)
        target = w + (m + 1) * side
        enters = ((x - target) / (side - target)).ln() if side * target < 1 else left
        if enters >= left:
            return target + (x - target) * (-left).exp()
        x, left = side, left - enters
    rate = m * x + w
    if rate == 0:
        return x
    to = Decimal(1).copy_sign(rate)
    there = m * to + w
    if to * there > 0:
        leaves = (there / rate).ln() / m if m else (to - x) / rate
        if leaves < left:
            return to + there * (1 - (leaves - left).exp())
    return x + rate * (((m * left).exp() - 1) / m if m else left)


@pytest.fixture(scope="module")
def cells():
    """Starts and drives that float32 holds, in all pieces, and the states at the end."""
    rng = np.random.default_rng(5)
    start = np.array([0.2, 0.9, 1.0, -1.0, 0.0, 3.0, *rng.uniform(-3, 3, 6)], dtype=np.float32)
    weak = rng.uniform(-2, 2, 6) * [1.0, 0.01, 1e-4, 1.0, 0.1, 1.0]
    drive = np.array([0.1, -0.1, 0.1, -0.1, 0.0, -0.3, *weak], dtype=np.float32)
    with localcontext() as context:
        context.prec = 50
        pairs = list(zip(drive.tolist(), start.tolist(), strict=True))
        own = template().A[range(len(SLOPES)), range(len(SLOPES)), 0, 0]
        ends = [[[float(closed(a, w, x, TIME)) for w, x in pairs]] for a in own]
    return start[np.newaxis].astype(float), drive[np.newaxis].astype(float), np.array(ends)


@pytest.mark.parametrize("frames", [1, 64])
def test_states_are_those_of_the_closed_form(engines, cells, frames):
    start, drive, ends = cells
    maps = {
        "state": np.broadcast_to(start, (frames, *ends.shape)),
        "input": np.broadcast_to(drive, (frames, *drive.shape)),
    }
    if frames == 1:
        maps = {name: values[0] for name, values in maps.items()}
    for label, engine in engines.items():
        got = engine.run(template(), **maps)
        assert got.method == "propagator"
        eps = float(np.finfo(label.partition("-")[2]).eps)
        off = np.abs(got.state - ends)
        # e^{mt} is up to 1e22 in the steepest layer: the effect of a rounding there is in `error`
        assert np.delete(off, STEEPEST, axis=-3).max() <= ROUNDINGS * 6.0 * eps
        assert np.all(got.error >= off.max(axis=(-3, -2, -1)))
        assert np.all(got.error <= 1e3 * eps)


@pytest.mark.parametrize("seed", range(12))
def test_errors_are_stated_beside_an_unstable_rest(engines, reference, seed):
    """There the rate is a rounding error, and its sign decides where a cell ends.

    Starts are the rests themselves and as many rounding errors beside them as `far` says.
    """
    rng = np.random.default_rng((5, seed))
    a = float(rng.choice([1.001, 1.1, 2.5, 2.7, 5.0, 1.0 + 4.0 * rng.random()]))
    time = float(rng.choice([0.25, 2.0, 10.0, 50.0]))
    own = cnnum.Template("own", [[a]], [[1.0 - a]], duration=time)
    far = np.array([0, 0, 0, 1, -1, 2, -3, 4, -6, 9, -12, 17, -33, 100, 1e3, -1e5])
    u = rng.uniform(-1.0, 1.0, far.size).astype(np.float32).astype(float)
    for label, engine in {**engines, "reference-float64": reference}.items():
        precision = label.partition("-")[2]
        start = (u * (1.0 + far * float(np.finfo(precision).eps))).astype(precision).astype(float)
        got = engine.run(own, input=u.reshape(-1, 1, 1), state=start.reshape(-1, 1, 1))
        with localcontext() as context:
            context.prec = 100
            pairs = zip(u.tolist(), start.tolist(), strict=True)
            drives = [(Decimal(1.0 - a) * Decimal(x), begin) for x, begin in pairs]
            ends = [closed(a, drive, begin, time) for drive, begin in drives]
            off = [
                float(abs(Decimal(x) - end))
                for x, end in zip(got.state.ravel().tolist(), ends, strict=True)
            ]
        # SciPy's solution has an error of its own where the rate is far from one of rounding
        tried = np.abs(far) < (20.0 if engine is reference else np.inf)
        assert np.all((got.error >= off)[tried]), label
        # a thousand roundings from a rest that they grow away from by at most e
        if (a - 1.0) * time < 1.0:
            assert np.all(got.error < 1e3 * np.finfo(precision).eps + 1e-8 * (engine is reference))


def test_the_reference_states_how_far_it_is_off(reference, cells):
    """It solves the equation as it stands: no quotient, but kinks that steps may miss."""
    start, drive, ends = cells
    got = reference.run(template(), state=np.broadcast_to(start, ends.shape), input=drive)
    # a tenth of other engines' tolerance
    assert np.abs(got.state - ends).max() <= got.error <= 1e-5 * np.abs(ends).max()


def test_a_sum_that_misses_one_by_a_rounding_is_as_one(engines):
    """On every engine, in a run and in a program."""
    near = cnnum.Template("t", [[0.7 + 0.2 + 0.1]], [[1.0]], duration=TIME)
    drive, start = np.array([[0.1, -0.1]]), np.array([[0.2, 0.9]])

    @cnnum.program
    def moves(frame):
        run = cnnum.transient(near, input=frame.channel("input"), state=frame.channel("state"))
        return {"state": run.states[0], "error": run.error}

    for label, engine in engines.items():
        # four roundings of numbers up to 1
        tolerance = 4.0 * float(np.finfo(label.partition("-")[2]).eps)
        alone = engine.run(near, input=drive, state=start)
        np.testing.assert_allclose(alone.state, [[0.7, 0.4]], atol=tolerance)
        plan = engine.compile(moves, shape=(1, 2), channels=("input", "state"))
        out = plan(np.stack([drive, start], axis=-1))
        np.testing.assert_allclose(out["state"], [[0.7, 0.4]], atol=tolerance)
        assert out["error"] >= np.abs(out["state"] - [[0.7, 0.4]]).max()
