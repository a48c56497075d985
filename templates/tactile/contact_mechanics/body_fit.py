"""Fits of two bodies to a contact: a sphere, or a rigid flat punch that is round.

The pressure under the cover's blur is compared with Hertz's, √(1 − ρ²/a²), and with Boussinesq's,
1/√(1 − ρ²/a²), on the taxels' cells. The centre comes from the moments of the load, the radius from
the best of some. A body is reported if it leaves little of the pressure, and clearly less than the
other one does: no bar, ring, square, uniform disc or pair of bodies is taken for either.
"""

from collections.abc import Callable, Mapping
from math import pi
from typing import NamedTuple

from cnnum.programs import program
from cnnum.programs.fields import Field, maximum, mean, most, sqrt, square, where
from cnnum.programs.machine import FrameFields
from cnnum.programs.parameters import refuse_outside
from cnnum.tactile.indenters import Reads
from cnnum.templates.tactile.cover_model.fields import DEPTH, READS
from cnnum.templates.tactile.shared.loads import PUSH, loads_of
from cnnum.templates.tactile.shared.pressure import pressed_of

SHARE = 0.1
"""Share of the peak pressure from which a taxel counts as touched."""

INSIDE = (-1 / 3, 0.0, 1 / 3)
"""Places in a cell, of its side, at which a pressure is averaged over it."""

SCALES = (0.85, 0.925, 1.0, 1.075, 1.15)
"""Radii that are tried, over that of the second moment: 2.5 ⟨ρ²⟩ = a² and 1.5 ⟨ρ²⟩ = a²."""

RIM = 0.1
"""Least 1 − ρ²/a² of a punch, whose pressure has no bound at its rim."""

LEFT, CLEARLY = (0.13, 0.23), (0.75, 0.6)
"""Of a sphere and a punch: share of the pressure that it leaves at most, and over that of the other
body. Spheres leave 0.05 to 0.13 and punches 0.14 to 0.2, what the filter and 1 % of noise leave."""

NARROWEST = (1.92, 1.7)
"""Least contact radius of a sphere and a punch, cells: below, they and an even load look alike."""


@program
def body_fit(
    frame: FrameFields,
    *,
    push: float = PUSH,
    depth: float = DEPTH,
    reads: Reads = READS,
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
    sphere = _best(weight, away, sqrt(2.5 * spread), _hertz)
    flat = _best(weight, away, sqrt(1.5 * spread), _punch)
    whole = frame.within_range(loads.contact)  # a clipped pressure has another body's shape
    is_sphere, is_flat = whole & _fits(sphere, flat, 0), whole & _fits(flat, sphere, 1)
    found = is_sphere | is_flat
    round_one = 2.0 * modulus / pi * sphere.radius / maximum(sphere.peak, 1e-30)
    return {
        "sphere_fits": is_sphere,
        "flat_fits": is_flat,
        "body_row": where(found, row, 0.0),
        "body_column": where(found, column, 0.0),
        "contact_radius": where(is_sphere, sphere.radius, where(is_flat, flat.radius, 0.0)),
        "sphere_radius": where(is_sphere, round_one, 0.0),
        "body_left": where(sphere.left < flat.left, sphere.left, flat.left),
    }


class _Fit(NamedTuple):
    """A body's fit: share of the pressure left, contact radius (cells), and pressure scale."""

    left: Field
    radius: Field
    peak: Field


def _fits(body: _Fit, other: _Fit, kind: int) -> Field:
    """Return whether a body explains the contact; kind 0 is a sphere, 1 a punch."""
    little = (body.left < LEFT[kind]) & (body.left < CLEARLY[kind] * other.left)
    return little & (body.radius > NARROWEST[kind])


def _best(weight: Field, away: list[Field], radius: Field, shape: Callable[[Field], Field]) -> _Fit:
    """Return the fit of the radius that leaves least."""
    fits = list[tuple[Field, ...]]()
    whole = maximum(square(weight).sum(), 1e-30)
    for scale in SCALES:
        tried = scale * radius
        body = mean([shape(1.0 - each / square(tried)) for each in away])
        peak = (weight * body).sum() / maximum(square(body).sum(), 1e-30)
        left = sqrt(square(weight - peak * body).sum() / whole)
        fits.append((-left, tried, peak))
    least, best, peak = most(fits)
    return _Fit(-least, best, peak)


def _hertz(inside: Field) -> Field:
    return sqrt(maximum(inside, 0.0))


def _punch(inside: Field) -> Field:
    return where(inside > 0.0, 1.0 / sqrt(maximum(inside, RIM)), 0.0)
