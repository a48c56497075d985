"""No time stepping where cells see only themselves: three linear pieces, one after the other.

τ x' = −x + a f(x) + w with f(x) = (|x + 1| − |x − 1|)/2 is linear below −1, between, and above 1.
A state moves one way only, so that it passes each piece once at most, and all is said with
d = e^{−t/τ}, what is left of a decay:

* outside, towards e = w + a s (s = ±1 the side): x = e + (x₀ − e) d. It comes to s, if e lies
  inside of s, when d = (s − e)/(x₀ − e).
* between, with the rate g(x) = (a − 1) x + w: x = x₀ + g(x₀) (d^{1−a} − 1)/(a − 1). It comes to
  b = sign g, if g(b) has g's sign, when d = (g(x₀)/g(b))^{1/(a−1)}; for a = 1, e^{−(b−x₀)/g}.
"""

from dataclasses import dataclass

import numpy as np

from cnnum.arrays import Floats
from cnnum.template import Template

LONGEST = 60.0
"""Time constants up to which what is left of a decay, e^{−60} = 9e-27, is far from what a device
takes for 0; longer runs that are not to equilibrium take steps."""

STEEPEST = 1e30
"""Largest growth that is written out: a cell that would grow more has left the middle piece,
unless it began nearer to its rest than any number but 0 is."""

ROUNDED = 8
"""Rounded operations from one end of a cell's way to the other, at the most."""


@dataclass(frozen=True, slots=True, eq=False)
class Separate:
    """Cells that see only themselves, with the standard output function.

    Attributes
    ----------
    own : (layers,) float
        a of every layer.
    left : (layers,) float
        e^{−t/τ} at the end of every layer; 0 at equilibrium.
    """

    own: Floats
    left: Floats


def separate(template: Template, duration: float) -> Separate | None:
    """Return the exact answer after `duration` (infinite: equilibrium), None where there is none.

    There is none where a cell sees another one or f is another, where a run is too long, and at
    equilibrium for a = 1, whose cells may rest anywhere.
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
    with np.errstate(under="ignore"):
        return Separate(own, np.exp(-duration / template.tau))


def evaluate(scheme: Separate, start: Floats, drive: Floats) -> Floats:
    """Return x(t) of (..., layers, rows, cols) initial states and drives."""
    end = np.empty_like(start)
    with np.errstate(all="ignore"):  # of what is computed for all cells, some have no use
        for layer, (own, left) in enumerate(zip(scheme.own, scheme.left, strict=True)):
            x, w = start[..., layer, :, :], drive[..., layer, :, :]
            end[..., layer, :, :] = _end(float(own), float(left), x, w)
    return end


def _end(own: float, left: float, start: Floats, drive: Floats) -> Floats:
    side = np.sign(start) * (np.abs(start) > 1.0)
    target = drive + own * side
    # d when it comes to its edge; 0 where it never does, or is within it
    edge = np.where(side * target < side * side, (side - target) / (start - target), 0.0)
    inner = np.where(edge > left, left / edge, left)
    away = (side != 0.0) & (edge <= left)
    inside = _from_inside(own, inner, np.clip(start, -1.0, 1.0), drive, rests=left == 0.0)
    return np.where(away, target + left * (start - target), inside)


def _from_inside(own: float, left: Floats, now: Floats, drive: Floats, *, rests: bool) -> Floats:
    """Return the end of cells that are in the middle piece while `left` is 1."""
    slope = own - 1.0
    rate = slope * now + drive
    to = np.where(rate < 0.0, -1.0, 1.0)
    rate_there = slope * to + drive
    leaves = to * rate_there > 0.0
    if rests:
        return np.where(leaves, to + rate_there, np.where(rate == 0.0, now, -drive / slope))
    if slope == 0.0:
        ends, moved = np.exp((now - to) / rate), -rate * np.log(left)
    else:
        ends = (rate / rate_there) ** (1.0 / slope)
        moved = rate * (np.minimum(left**-slope, STEEPEST) - 1.0) / slope
    over = to + rate_there * (1.0 - left / ends)
    return np.where(leaves & (left < ends), over, now + moved)
