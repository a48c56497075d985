"""Trigger waves: plane fronts, against a refined solution of one line of cells across the front."""

import numpy as np

from cnnum.arrays import Floats, Shape
from cnnum.templating.checks.analytic.refined import refined
from cnnum.templating.checks.parameters import number
from cnnum.templating.checks.pictures import with_even
from cnnum.templating.checks.records import Case, ClosedForm
from cnnum.templating.template import Template

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


FORMS = (
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
