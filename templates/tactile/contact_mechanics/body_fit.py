"""Fits of two bodies to a contact: a sphere, or a rigid flat punch that is round.

The pressure under the cover's blur is compared with Hertz's, √(1 − ρ²/a²), and with Boussinesq's,
1/√(1 − ρ²/a²), on the taxels' cells, each as it would come back through the filter that takes the
blur off. The centre comes from the moments of the load, the radius from a parabola through the best
of some. A body is reported if it leaves little of the pressure, and clearly less than the
other one does: no bar, ring, square, uniform disc or pair of bodies is taken for either.
"""

from collections.abc import Callable, Mapping
from math import pi
from typing import NamedTuple

from cnnum.programs import program
from cnnum.programs.fields import Field, maximum, mean, minimum, most, sqrt, square, where
from cnnum.programs.machine import FrameFields
from cnnum.programs.parameters import refuse_outside
from cnnum.programs.transients import apply
from cnnum.tactile.bump_loads import left_kernel
from cnnum.tactile.indenters import Reads
from cnnum.templates.tactile.cover_model.fields import DEPTH, READS, Carries, filter_template
from cnnum.templates.tactile.shared.loads import PUSH, loads_of
from cnnum.templates.tactile.shared.pressure import pressed_of

SHARE = 0.1
"""Share of the peak pressure from which a taxel counts as touched."""

INSIDE = (-1 / 3, 0.0, 1 / 3)
"""Places in a cell, of its side, at which a pressure is averaged over it."""

SCALES, STEP = (0.85, 0.925, 1.0, 1.075, 1.15), 0.075
"""Radii that are tried, over that of the second moment (2.5 ⟨ρ²⟩ = a² and 1.5 ⟨ρ²⟩ = a²), and
their distance."""

RIM = 0.3
"""1 − ρ²/a² up to which a punch, whose pressure has no bound at its rim, has the mean of that rim:
2/√RIM of the pressure in its middle. The rim of a radius of 2 cells is then as wide as the places
in a cell lie apart."""

LEFT, CLEARLY = (0.095, 0.2), (0.75, 0.6)
"""Of a sphere and a punch: share of the pressure that it leaves at most, and over that of the other
body. With 1 % of noise spheres leave 0.02 to 0.08 and most punches 0.06 to 0.2; uniform discs of at
least `NARROWEST` leave 0.1 or more of a sphere, and rings 0.2 or more of a punch."""

NARROWEST = (1.92, 1.7)
"""Least contact radius of a sphere and a punch, cells: below, they and an even load look alike."""


@program
def body_fit(
    frame: FrameFields,
    *,
    push: float = PUSH,
    depth: float = DEPTH,
    reads: Carries = READS,
    modulus: float = 2.0,
) -> Mapping[str, Field]:
    """Fit a sphere and a round flat punch to the contact.

    Parameters
    ----------
    frame : FrameFields
        Strain or stress. The stream must begin without contact.
    push, depth, reads
        As in `contact`.
    modulus : float
        E* = E/(1 − ν²) in the unit of the surface load: 2 for strain, whose load is p over 2E/3,
        under a cover of ν = ½; Pa for stress.

    Returns
    -------
    mapping
        `sphere_fits`, `flat_fits` (flags: that body explains the contact), `body_row`,
        `body_column` (its centre, cells), `contact_radius` (cells), `sphere_radius` (cells, by
        Hertz's R = 2 a E*/(π p₀)), `body_left` (share of the pressure that the better one leaves).
        Where neither fits, places and radii are 0.

    Raises
    ------
    ProgramError
        If the modulus is not positive.
    """
    refuse_outside(modulus=(modulus, 1e-12, 1e15))
    loads = frame.once(loads_of, push=push)
    weight = pressed_of(loads, SHARE, depth, reads, 1.0).weight
    load = maximum(weight.sum(), 1e-30)
    row, column = frame.centroid(weight)
    away = [
        square(frame.row + y - row) + square(frame.column + x - column)
        for y in INSIDE
        for x in INSIDE
    ]
    spread = maximum((weight * away[4]).sum() / load, 1e-6)

    def seen(radius: Field, shape: Callable[[Field], Field]) -> Field:
        body = mean([shape(1.0 - distance / square(radius)) for distance in away])
        back = body if reads == "force" else body - _left(body, depth, reads)
        return where(back > SHARE * back.max(), back, 0.0)

    sphere = _best(weight, sqrt(2.5 * spread), lambda radius: seen(radius, _hertz))
    flat = _best(weight, sqrt(1.5 * spread), lambda radius: seen(radius, _punch))
    whole = frame.within_range(loads.contact)  # a clipped pressure has another body's shape
    is_sphere, is_flat = whole & _fits(sphere, flat, 0), whole & _fits(flat, sphere, 1)
    result = is_sphere | is_flat
    round_one = 2.0 * modulus / pi * sphere.radius / maximum(sphere.peak, 1e-30)
    return {
        "sphere_fits": is_sphere,
        "flat_fits": is_flat,
        "body_row": where(result, row, 0.0),
        "body_column": where(result, column, 0.0),
        "contact_radius": where(is_sphere, sphere.radius, where(is_flat, flat.radius, 0.0)),
        "sphere_radius": where(is_sphere, round_one, 0.0),
        "body_left": where(sphere.left < flat.left, sphere.left, flat.left),
    }


def _left(body: Field, depth: float, reads: Reads) -> Field:
    """Return what unblurring leaves of a pressure."""
    kernel = left_kernel(float(depth), reads)
    left = filter_template(f"left {reads} {depth:g}", kernel, "The residual of unblur.")
    return apply(left, input=body)


class _Fit(NamedTuple):
    """A body's fit: share of the pressure left, contact radius (cells), and pressure scale."""

    left: Field
    radius: Field
    peak: Field


def _fits(body: _Fit, other: _Fit, kind: int) -> Field:
    """Return whether a body explains the contact; kind 0 is a sphere, 1 a punch."""
    little = (body.left < LEFT[kind]) & (body.left < CLEARLY[kind] * other.left)
    return little & (body.radius > NARROWEST[kind])


def _best(weight: Field, radius: Field, seen: Callable[[Field], Field]) -> _Fit:
    """Return the fit that leaves least, by a parabola through the radii that are tried."""
    whole = maximum(square(weight).sum(), 1e-30)

    def fit(tried: Field) -> tuple[Field, Field]:
        body = seen(tried)
        peak = (weight * body).sum() / maximum(square(body).sum(), 1e-30)
        return square(weight - peak * body).sum() / whole, peak

    left = [fit(scale * radius)[0] for scale in SCALES]
    best = radius * most([(-residual, _lowest(left, n)) for n, residual in enumerate(left)])[1]
    least, peak = fit(best)
    return _Fit(sqrt(least), best, peak)


def _lowest(left: list[Field], n: int) -> Field:
    """Return the scale at the lowest point of the parabola through three, near the middle one."""
    here = left[n]
    scale = 0.0 * here + SCALES[n]
    if not 0 < n < len(left) - 1:
        return scale
    before, behind = left[n - 1], left[n + 1]
    off = 0.5 * (before - behind) / maximum(before - 2.0 * here + behind, 1e-30)
    return scale + STEP * minimum(maximum(off, -0.5), 0.5)


def _hertz(inside: Field) -> Field:
    return sqrt(maximum(inside, 0.0))


def _punch(inside: Field) -> Field:
    within = where(inside > RIM, 1.0 / sqrt(maximum(inside, RIM)), 2.0 / RIM**0.5)
    return where(inside > 0.0, within, 0.0)
