"""Waves, oscillations and delays, and the centre and surround of a retina.

Receptors, a slower and wider surround, and cells that adapt to their difference: wave by wave.

A linear array without ends parts into waves, and each wave is a chain of three leaky cells behind a
signal that rises steadily. Its course is the exponential of a matrix of 5×5.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, partial

import numpy as np
from scipy.integrate import OdeSolution, solve_ivp
from scipy.linalg import expm

from cnnum.arrays import Floats, Shape
from cnnum.templating.boundary import Boundary
from cnnum.templating.checks.analytic.courses import PRECISION, refined
from cnnum.templating.checks.analytic.linear import modes, neighbours
from cnnum.templating.checks.pictures import with_even
from cnnum.templating.checks.records import Case, ClosedForm, number, time_constant
from cnnum.templating.template import Template

OSCILLATION_RTOL = 1e-6
OSCILLATION_TOLERANCE = 5e-3
OSCILLATION_REASON = (
    "an oscillation forgets errors of its size but never those of its phase: those of 800 steps a "
    "period, 1e-6 of states up to 3 each, add up to 2.4e-3 at the most. Roundings of float32 add "
    "up to 5e-4"
)
_TRANSIENT = 40.0
_WAVE_PRECISION = 1e-7  # every kink of every cell costs steps


@dataclass(frozen=True, slots=True, eq=False)
class Orbit:
    """A limit cycle.

    Attributes
    ----------
    period : float
    path : OdeSolution
        The states from time 0 to the period.
    """

    period: float
    path: OdeSolution

    def at(self, phase: Floats) -> Floats:
        """Return the states at phases from 0 to 1, as (2, ...)."""
        flat = self.path(self.period * phase.ravel())
        return np.asarray(flat).reshape(2, *phase.shape)


@cache
def limit_cycle(own: float, other: float) -> Orbit:
    """Return the limit cycle of x₁' = −x₁ + p·y₁ − s·y₂, x₂' = −x₂ + s·y₁ + p·y₂.

    Parameters
    ----------
    own, other : float
        p and s; it oscillates where p > 1 and s > p − 1.
    """

    def slope(_: float, x: Floats) -> Floats:
        y = np.clip(x, -1.0, 1.0)
        return np.array([own * y[0] - other * y[1], other * y[0] + own * y[1]]) - x

    def rises(_: float, x: Floats) -> float:
        return float(x[1])

    rises.direction = 1.0  # type: ignore[attr-defined]
    solve = partial(solve_ivp, slope, method="DOP853", rtol=PRECISION, atol=PRECISION)
    settling = solve((0.0, _TRANSIENT), [0.5, 0.0], max_step=0.05, events=rises)
    assert settling.t_events is not None
    assert settling.y_events is not None
    begin, end = (float(time) for time in settling.t_events[0][-2:])
    start = np.asarray(settling.y_events[0][-1], dtype=np.float64)
    # short steps, because between them the path is a polynomial, which knows no kink of f
    once = solve((0.0, end - begin), start, max_step=0.01, dense_output=True)
    assert once.sol is not None
    return Orbit(end - begin, once.sol)


def _phases(template: Template, rng: np.random.Generator, shape: Shape) -> Case:
    """Start every cell somewhere on the cycle, and stop after one period."""
    orbit = limit_cycle(number(template, "own"), number(template, "other"))
    state = np.moveaxis(orbit.at(with_even(rng.random((2, *shape)), 0.0)), 0, 1)
    return Case(state=state, duration=orbit.period * time_constant(template))


def _same(template: Template, case: Case) -> Floats:
    return case.states


def _anywhere(template: Template, rng: np.random.Generator, shape: Shape) -> Case:
    return Case(state=with_even(rng.uniform(-1.0, 1.0, (1, 2, *shape)), -0.5))


def _autowave(template: Template, case: Case) -> Floats:
    """Solve x₁' = −x₁ + (1+μ)y₁ − s₁y₂ + i₁ + D∇²y₁ and its like for x₂ on the whole array."""
    gain, spread = 1.0 + number(template, "mu"), number(template, "diffusion")
    s1, s2 = number(template, "s1"), number(template, "s2")
    bias = np.array([number(template, "i1"), number(template, "i2")])[:, np.newaxis, np.newaxis]

    def slope(x: Floats) -> Floats:
        y = np.clip(x, -1.0, 1.0)
        at = neighbours(y, template.boundary)
        laplacian = at(0, 1) + at(0, -1) + at(1, 0) + at(-1, 0) - 4.0 * y
        crossed = np.stack([-s1 * y[:, 1], s2 * y[:, 0]], axis=1)
        rate = -x + gain * y + crossed + bias + spread * laplacian
        return np.asarray(rate, dtype=np.float64)

    return refined(slope, case.states, case.time(template), _WAVE_PRECISION)


OSCILLATION_FORMS = (
    ClosedForm(
        "oscillator",
        _phases,
        _same,
        OSCILLATION_TOLERANCE,
        OSCILLATION_REASON,
        "every cell is back where it was after the period of the limit cycle, solved to 1e-10",
        needs=("own", "other"),
        compares="state",
        rtol=OSCILLATION_RTOL,
    ),
    ClosedForm(
        "autowave",
        _anywhere,
        _autowave,
        OSCILLATION_TOLERANCE,
        OSCILLATION_REASON,
        "two layers that oscillate and diffuse, the whole array solved to 1e-7",
        needs=("mu", "s1", "s2", "i1", "i2", "diffusion"),
        compares="state",
        rtol=OSCILLATION_RTOL,
    ),
)


RTOL = 1e-6
TOLERANCE = 0.02
REASON = (
    "a front never forgets that it is late: a cell leaves its colour at 0.25 a time constant and "
    "then moves at 4. So it is off by 17 times the errors of 70 steps, 1e-6 of states up to 8 "
    "each: 0.01 at the most. Float32's roundings make 2e-3; one late by a cell is off by 2"
)
_LINES = 3


def line_after(start: Floats, weights: tuple[float, float], bias: float, time: float) -> Floats:
    """Return the states across a plane front of x' = −x + c·y + r·(eight neighbours) + z.

    Parameters
    ----------
    start : (lines, cells) float
        Zero flux at both ends.
    weights : (centre c, ring r)
    bias : float
    time : float
        Time constants.
    """
    centre, ring = weights

    def slope(x: Floats) -> Floats:
        y: Floats = np.clip(np.concatenate([x[:, :1], x, x[:, -1:]], axis=1), -1.0, 1.0)
        sides = 3.0 * ring * (y[:, :-2] + y[:, 2:])
        return (centre + 2.0 * ring) * y[:, 1:-1] + sides + bias - x

    return refined(slope, start, time)


def _fronts(length: int, grows: float) -> Floats:
    """Return lines with the growing colour on a quarter, at either end, and nowhere."""
    quarter = np.where(np.arange(length) < 1 + length // 4, grows, -grows)
    return with_even(np.stack([quarter, quarter[::-1]]), -grows)


def _case(template: Template, rng: np.random.Generator, shape: Shape) -> Case:
    """Lay a front along the columns and one along the rows, moving both ways."""
    grows = float(np.sign(number(template, "bias")))
    across = np.broadcast_to(_fronts(shape[1], grows)[:, np.newaxis, :], (_LINES, *shape))
    down = np.broadcast_to(_fronts(shape[0], grows)[:, :, np.newaxis], (_LINES, *shape))
    return Case(input=np.concatenate([across, down]))


def _expected(template: Template, case: Case) -> Floats:
    weights = number(template, "centre"), number(template, "ring")
    shape = case.pictures.shape[-2:]
    across, down = case.pictures[:_LINES, 0, :], case.pictures[_LINES:, :, 0]
    bias, time = number(template, "bias"), case.time(template)
    moved_across = line_after(across, weights, bias, time)[:, np.newaxis, :]
    moved_down = line_after(down, weights, bias, time)[:, :, np.newaxis]
    both = [np.broadcast_to(moved, (_LINES, *shape)) for moved in (moved_across, moved_down)]
    return np.concatenate(both)


WAVES_FORMS = (
    ClosedForm(
        "trigger-wave",
        _case,
        _expected,
        TOLERANCE,
        REASON,
        "plane fronts of a bistable array, from one line of cells solved to 1e-10",
        needs=("centre", "ring", "bias"),
        compares="state",
        rtol=RTOL,
    ),
)


LAYERS = 4


def wave_after(
    eigenvalue: float, time: float, widths: Sequence[float], taus: Sequence[float]
) -> Floats:
    """Return the layers of one wave under a ramp of slope 1 that began at rest.

    Parameters
    ----------
    eigenvalue : float
        Eigenvalue of the five-point Laplacian, 0 or below, 1/cells².
    time : float
    widths : (near, far), cells²
        Coupling of receptors and of the surround.
    taus : (receptor, surround, adapting)

    Returns
    -------
    (4,) float
        Signal, receptors, surround, and what has adapted.
    """
    near, far = (1.0 - width * eigenvalue for width in widths)
    rates = np.zeros((LAYERS + 1, LAYERS + 1))
    rates[0, LAYERS] = 1.0
    rates[1, [0, 1]] = 1.0 / taus[0], -near / taus[0]
    rates[2, [1, 2]] = 1.0 / taus[1], -far / taus[1]
    rates[3, [1, 2, 3]] = np.array([1.0, -1.0, -1.0]) / taus[2]
    return np.asarray(expm(rates * time)[:LAYERS, LAYERS], dtype=np.float64)


def layers_after(
    slope: Floats, boundary: Boundary, time: float, widths: Sequence[float], taus: Sequence[float]
) -> Floats:
    """Return all layers under ramps of one slope per cell, (..., 4, rows, cols)."""
    basis = modes(boundary, (slope.shape[-2], slope.shape[-1]))
    values = np.asarray(basis.laplacian)
    waves = np.array([wave_after(float(value), time, widths, taus) for value in values.ravel()])
    parts = [basis.apply(slope, waves[:, k].reshape(values.shape)) for k in range(LAYERS)]
    return np.asarray(np.stack(parts, axis=-3))


def _ramp(template: Template, rng: np.random.Generator, shape: Shape) -> Case:
    longest = number(template, "adapting")
    slope = with_even(rng.uniform(-1.0, 1.0, (2, *shape)), 0.5) / longest
    state = np.zeros((len(slope), LAYERS, *shape))
    return Case(input=slope, state=state, duration=0.7 * longest)


def _risen(template: Template, case: Case) -> Floats:
    widths = [number(template, name) for name in ("near", "far")]
    taus = [number(template, name) for name in ("receptor", "surround", "adapting")]
    slope = case.pictures / template.tau[0]  # of the layer that is the signal
    return layers_after(slope, template.boundary, case.length(template), widths, taus)


CENTRE_SURROUND_FORMS = (
    ClosedForm(
        "centre-surround",
        _ramp,
        _risen,
        1e-5,
        "layers are differences of signals of order 1, in single precision",
        "receptors, surround and adaptation behind ramps, an exponential of 5×5 a wave",
        needs=("near", "far", "receptor", "surround", "adapting"),
        compares="state",
    ),
)

FORMS = (*OSCILLATION_FORMS, *WAVES_FORMS, *CENTRE_SURROUND_FORMS)
