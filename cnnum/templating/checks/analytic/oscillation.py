"""Cells of two layers that oscillate, and the waves that they make."""

from dataclasses import dataclass
from functools import cache, partial

import numpy as np
from scipy.integrate import OdeSolution, solve_ivp

from cnnum.arrays import Floats, Shape
from cnnum.templating.checks.analytic.operators import neighbours
from cnnum.templating.checks.analytic.refined import PRECISION, refined
from cnnum.templating.checks.parameters import number
from cnnum.templating.checks.pictures import with_even
from cnnum.templating.checks.records import Case, ClosedForm, time_constant
from cnnum.templating.template import Template

RTOL = 1e-6
TOLERANCE = 5e-3
REASON = (
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


FORMS = (
    ClosedForm(
        "oscillator",
        _phases,
        _same,
        TOLERANCE,
        REASON,
        "every cell is back where it was after the period of the limit cycle, solved to 1e-10",
        needs=("own", "other"),
        compares="state",
        rtol=RTOL,
    ),
    ClosedForm(
        "autowave",
        _anywhere,
        _autowave,
        TOLERANCE,
        REASON,
        "two layers that oscillate and diffuse, the whole array solved to 1e-7",
        needs=("mu", "s1", "s2", "i1", "i2", "diffusion"),
        compares="state",
        rtol=RTOL,
    ),
)
