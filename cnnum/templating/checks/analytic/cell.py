"""One uncoupled cell, x' = −x + a f(x) + b: piecewise linear, so exact at any time.

Such an equation of one variable moves one way only. So a cell visits each of the three linear
pieces of f at most once. Its crossing times are logarithms (Chua & Yang 1988).
"""

import numpy as np

from cnnum.arrays import Floats, Shape
from cnnum.templating.checks.analytic.linear import ANALOG_REASON, ANALOG_TOLERANCE
from cnnum.templating.checks.parameters import number
from cnnum.templating.checks.pictures import with_even
from cnnum.templating.checks.records import Case, ClosedForm, time_constant
from cnnum.templating.template import Template


def state_after(start: Floats, feedback: float, bias: float, time: float) -> Floats:
    """Return the state of uncoupled cells after a time.

    Parameters
    ----------
    start : (...) float
    feedback, bias : float
        a and b of x' = −x + a f(x) + b.
    time : float
        Time constants.
    """
    state, left = start, np.full_like(start, time)
    for _ in range(3):
        state, left = _through_piece(state, left, feedback, bias)
    return state


def switching_time(start: Floats, feedback: float, bias: float) -> Floats:
    """Return the time until a cell from within (−1, 1) saturates; infinite where it never does."""
    rate, drift = feedback - 1.0, np.full_like(start, bias)
    return _time_to(np.sign(rate * start + drift), start, rate, drift)


def _through_piece(
    state: Floats, left: Floats, feedback: float, bias: float
) -> tuple[Floats, Floats]:
    slope = -state + feedback * np.clip(state, -1.0, 1.0) + bias
    # A cell on a corner of f belongs to the piece that it moves into.
    outward = state * slope > 0.0
    side = np.sign(state) * ((np.abs(state) > 1.0) | ((np.abs(state) == 1.0) & outward))
    rate = np.where(side == 0.0, feedback - 1.0, -1.0)
    drift = side * feedback + bias
    inward = np.where(side * slope < 0.0, side, np.inf)
    border = np.where(side == 0.0, np.sign(slope), inward)
    spent = np.minimum(left, _time_to(border, state, rate, drift))
    moved = np.where(spent < left, border, _move(state, rate, drift, spent))
    return moved, left - spent


def _time_to(goal: Floats, state: Floats, rate: Floats | float, drift: Floats) -> Floats:
    """Return when x' = rate·x + drift reaches the goal, infinite where it does not."""
    speed = rate * state + drift
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        # log1p, because a rate near 0 leaves only roundings of the quotient of the speeds
        curved = np.log1p(rate * (goal - state) / speed) / rate
        time = np.where(np.equal(rate, 0.0), (goal - state) / speed, curved)
    return np.where(np.isfinite(time) & (time >= 0.0), time, np.inf)


def _move(state: Floats, rate: Floats, drift: Floats, time: Floats) -> Floats:
    still = rate == 0.0
    growth = np.where(still, time, np.expm1(rate * time) / np.where(still, 1.0, rate))
    return state + (rate * state + drift) * growth


def _case(template: Template, rng: np.random.Generator, shape: Shape) -> Case:
    """Draw states on all three pieces of f, and stop while some cells are still on their way."""
    states = with_even(rng.uniform(-1.6, 1.6, (4, *shape)), -1.5)
    return Case(state=states, duration=number(template, "time") * time_constant(template))


def _cells(template: Template, case: Case) -> Floats:
    return state_after(
        case.states, number(template, "feedback"), number(template, "bias"), case.time(template)
    )


FORMS = (
    ClosedForm(
        "uncoupled-cell",
        _case,
        _cells,
        ANALOG_TOLERANCE,
        ANALOG_REASON,
        "x(t) of a piecewise linear cell, through its crossings of -1 and 1",
        needs=("feedback", "bias", "time"),
        compares="state",
    ),
)
