"""The box of states that an array never leaves, whatever inputs within [−1, 1] it is given.

A cell moves by τ dx/dt = −x + s with |s| ≤ K(R) while all states lie within [−R, R], where K sums
the weights times the largest output there. So a box with K(R) ≤ R holds every transient that starts
in it (Chua & Yang 1988, theorem 1, is the case |f| ≤ 1).
"""

import math

import numpy as np

from cnnum.arrays import Floats
from cnnum.templating.output_functions import OUTPUT_FUNCTIONS, OutputFunction
from cnnum.templating.template import Template

INTERVALS = 4096
"""Intervals of a box in which an output function of one's own is sampled."""

WIDER = 1.001
"""Factor between a box that is too small and the next that is tried, so that one is reached."""

MOST = 200
"""Boxes that are tried: where none holds by then, outputs grow about as fast as states."""

FARTHEST = 1e12
"""Box beyond which none is looked for."""

BEYOND = 64.0
"""Up to which |x| an output is sampled where no box is known."""

ROUNDINGS = 1e-9
"""Part of the steepest slope by which the slope between two samples may be off: they are some
1/1000 apart, and each is rounded to 1e-16 of its own size or so; float32 forms are not sampled."""


def state_bound(template: Template) -> float:
    """Return a bound on |x|, infinite where none is known.

    Parameters
    ----------
    template : Template
        Inputs within [−1, 1], starts within [−1, 1] or at the template's own initial state.

    Notes
    -----
    Of an output function of one's own, |f| between samples follows from its declared slopes.
    """
    output = template.output
    if not template.plain:
        return math.inf
    if output.limited:
        return 1.0
    start = max(1.0, 0.0 if template.initial == "input" else abs(template.initial))
    seen = max(1.0, abs(template.input_boundary.constant or 0.0))
    weights: Floats = np.abs(template.A).sum(axis=(1, 2, 3))
    drive: Floats = np.abs(template.B).sum(axis=(1, 2, 3)) * seen + np.abs(template.z)
    rim = template.boundary.constant
    virtual = 0.0 if rim is None else _size(output, [rim])
    if not output.discrete and (pull := weights * output.steepest).max() < 1.0:
        # |f(x)| ≤ |f(0)| + d |x|, and R = K(R)
        known = weights * max(_size(output, [0.0]), virtual) + drive
        return max(start, float((known / (1.0 - pull)).max()))
    if output.linear:
        return math.inf

    def needed(reach: float) -> float:
        return float((weights * max(_largest(output, reach), virtual) + drive).max())

    for _ in range(MOST):
        if (wider := needed(start)) <= start:
            return start
        if not wider < FARTHEST:
            break
        if needed(wider) <= wider:
            return wider
        start = wider * WIDER
    return math.inf


def _largest(output: OutputFunction, reach: float) -> float:
    """Return a bound on |f| for |x| ≤ reach."""
    if OUTPUT_FUNCTIONS.get(output.name) is output:
        return 1.0
    half = reach / INTERVALS
    return _size(output, np.linspace(-reach, reach, INTERVALS + 1)) + output.steepest * half


def _size(output: OutputFunction, x: Floats | list[float]) -> float:
    return float(np.abs(output.numpy(np.asarray(x, dtype=np.float64))).max())


def sampled_slopes(output: OutputFunction, reach: float) -> tuple[float, float]:
    """Return the least and the largest slope between neighbouring samples of an output function.

    Parameters
    ----------
    output : OutputFunction
    reach : float
        Largest |x|; where it is infinite, some tens.

    Returns
    -------
    (float, float)
        Each the mean slope of an interval, so that the function's own slopes reach as far at least.
        Those of the package are known and not sampled.
    """
    if OUTPUT_FUNCTIONS.get(output.name) is output:
        return output.slope
    ends = {min(reach, BEYOND), min(reach, 4.0)}
    slopes: list[Floats] = []
    for end in ends:
        x = np.linspace(-end, end, INTERVALS + 1)
        slopes.append(np.diff(np.asarray(output.numpy(x), dtype=np.float64)) / np.diff(x))
    found = np.concatenate(slopes)
    return float(found.min()), float(found.max())


def refuted(output: OutputFunction, sampled: tuple[float, float]) -> bool:
    """Return whether samples show slopes beyond those that an output function declares."""
    allowed = ROUNDINGS * max(output.steepest, 1.0)
    # written so that a function that is not a number somewhere is refuted, too
    within = sampled[0] >= output.slope[0] - allowed and sampled[1] <= output.slope[1] + allowed
    return not within
