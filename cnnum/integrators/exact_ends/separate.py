"""No time stepping where cells see only themselves: three linear pieces, one after the other.

τ x' = −x + a f(x) + w with f(x) = (|x + 1| − |x − 1|)/2 is linear below −1, between, and above 1.
A state moves one way only, so that it passes each piece once at most. Times are in τ:

* outside, towards e = w + a s (s = ±1 the side): x = e + (x₀ − e) d, d = e^{−t}. It comes to s,
  if e lies inside of s, when d = (s − e)/(x₀ − e).
* between, with the slope m = a − 1 and the rate g(x) = m x + w: x = x₀ + g(x₀) (e^{mt} − 1)/m. It
  comes to b = sign g, if g(b) has g's sign, at t = ln(1 + m (b − x₀)/g(x₀))/m. For m < 0 both terms
  cancel near the rest: x = x₀ e^{mt} + w (e^{mt} − 1)/m then.

Both quotients by m are those of `expm1` and `log1p`, as they cancel where a is near 1. For m = 0
they are t and (b − x₀)/g(x₀).
"""

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from cnnum.arrays import Floats
from cnnum.integrators.estimate import LOST
from cnnum.templating.template import Template

LONGEST = 60.0
"""Time constants up to which no device takes the rest of a decay, e^{−60} = 9e-27, for 0. Longer
runs that are not to equilibrium take steps."""

STEEPEST = 1e30
"""Largest growth that is written out: a cell that would grow more has left the middle piece. Else
it began nearer to its rest than any number but 0 is."""

ROUNDED = 8
"""Rounded operations from one end of a cell's way to the other, at the most; the drive apart."""


@dataclass(frozen=True, slots=True, eq=False)
class Separate:
    """Cells that see only themselves, with the standard output function.

    Attributes
    ----------
    own : (layers,) float
        a of every layer.
    time : (layers,) float
        t/τ at the end of every layer; infinite at equilibrium.
    """

    own: Floats
    time: Floats

    rounding: ClassVar[float] = 0.0


def separate(template: Template, duration: float) -> Separate | None:
    """Return the exact answer after `duration` (infinite: equilibrium), None where there is none.

    There is none where a cell sees another one, f is another, or a run is too long. Nor is there
    one at equilibrium for a = 1, whose cells may rest anywhere.
    """
    middle = template.A.shape[-1] // 2
    own = np.array([template.A[n, n, middle, middle] for n in range(template.layers)])
    alone = np.count_nonzero(template.A) == np.count_nonzero(own)
    if not (alone and template.plain and template.output.name == "standard"):
        return None
    settles = bool(np.isinf(duration))
    if (settles and (own == 1.0).any()) or (
        not settles and duration > LONGEST * template.tau.min()
    ):
        return None
    return Separate(own, duration / template.tau)


def roundings(template: Template) -> float:
    """Return how many roundings there are at most, those of its drive counted."""
    return float(ROUNDED + np.count_nonzero(template.B))


def growth(slope: float, time: float) -> float:
    """Return e^{mt}, by which a cell goes away from its rest between; `STEEPEST` at the most."""
    return math.exp(min(slope * time, math.log(STEEPEST))) if math.isfinite(time) else 1.0


def moved(slope: float, time: float) -> float:
    """Return (e^{mt} − 1)/m, by which a rate between moves its cell."""
    return math.expm1(min(slope * time, math.log(STEEPEST))) / slope if slope else time


def tips_over(own: float, time: float) -> bool:
    """Return whether cells fall to one side or the other of an equilibrium, and how far: to a rest.

    A cell whose rate is no more than its roundings may fall to either, and at a rate of 0 to none.
    """
    return math.isinf(time) and own > 1.0


def evaluate(
    scheme: Separate, start: Floats, drive: Floats, rounding: float
) -> tuple[Floats, Floats]:
    """Return x(t) of (..., layers, rows, cols) initial states and drives, and the rounded numbers.

    Roundings of that size are made up to `roundings` times: of time, of the end, and of the numbers
    in a rate. These grow along the way as the rate does. The numbers of a cell that may fall to
    either side are so large that nothing is known of the error.

    Parameters
    ----------
    scheme : Separate
    start, drive : (..., layers, rows, cols) float
    rounding : float
        All roundings together, as a part of those numbers.
    """
    end, rounded = np.empty_like(start), np.empty_like(start)
    with np.errstate(all="ignore"):  # some results, computed for all cells, have no use
        for layer, (own, time) in enumerate(zip(scheme.own, scheme.time, strict=True)):
            at = (..., layer, slice(None), slice(None))
            end[at], rounded[at] = _end(float(own), float(time), start[at], drive[at], rounding)
    return end, rounded


def _end(
    own: float, time: float, start: Floats, drive: Floats, rounding: float
) -> tuple[Floats, Floats]:
    side = np.sign(start) * (np.abs(start) > 1.0)
    target, left = drive + own * side, math.exp(-time)
    # d when it comes to its edge; 0 where it never does, or is within it
    edge = np.where(side * target < side * side, (side - target) / (start - target), 0.0)
    away = (side != 0.0) & (edge <= left)
    entered = np.where(edge > left, edge, 1.0)
    now = np.clip(start, -1.0, 1.0)
    inside = _from_inside(own - 1.0, time, entered, now, drive)
    end = np.where(away, target + left * (start - target), inside)
    slope, seen = own - 1.0, np.clip(end, -1.0, 1.0)
    before, after = slope * now + drive, np.abs(slope * seen + drive + (seen - end))
    grown = np.where(before == 0.0, growth(slope, time), after / np.abs(before))
    rounded = np.abs(drive) + np.abs(start) + np.abs(own * now)
    late = 0.0 if left == 0.0 else time * after
    numbers = np.abs(end) + np.where(away, left, grown) * rounded + late
    if tips_over(own, time):
        either = (np.abs(before) <= rounding * rounded) & (np.abs(drive) < slope) & ~away
        numbers = np.where(either, 2.0 * LOST / rounding, numbers)
    return end, numbers


def _from_inside(slope: float, time: float, entered: Floats, now: Floats, drive: Floats) -> Floats:
    """Return the end of cells in the middle piece, which they entered when d was `entered`."""
    rate = slope * now + drive
    to = np.where(rate < 0.0, -1.0, 1.0)
    rate_there = slope * to + drive
    # without a rate a cell stays, though it would leave from beside
    leaves = (to * rate_there > 0.0) & ((rate != 0.0) | (slope <= 0.0))
    if math.isinf(time):
        return np.where(leaves, to + rate_there, np.where(rate == 0.0, now, -drive / slope))
    # as a quotient of decays, which is exact where the end is near
    left = np.where(entered < 1.0, np.log(entered / math.exp(-time)), time)
    if slope == 0.0:
        ends, along = (to - now) / rate, left
    else:
        ends = np.log1p(slope * (to - now) / rate) / slope
        along = np.expm1(np.minimum(slope * left, math.log(STEEPEST))) / slope
    over = to + rate_there * (1.0 - np.exp(ends - left))
    between = now * np.exp(slope * left) + drive * along if slope < 0.0 else now + rate * along
    return np.where(leaves & (ends < left), over, between)
