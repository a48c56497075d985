"""What the bumps of a cover carry of a sphere, each that of its square, and what taxels read of it.

Half of every integral over a square is closed: both Hertz's pressure and the traction of a sphere
that turns without slip come from √(a² − ρ²). The other half is a sum over lines. Lengths are in
pitches, tractions in units of G.
"""

from dataclasses import dataclass
from math import pi

import numpy as np
from numpy.polynomial.legendre import leggauss

from cnnum.programs.fields import Field, maximum, minimum, sqrt, where
from cnnum.programs.transients import apply
from cnnum.tactile.bumps_felt import BumpsFelt
from cnnum.templates.tactile.contact_mechanics.sphere_response import arcsine
from cnnum.templates.tactile.cover_model.deconvolution import filter_template
from cnnum.templates.tactile.shared.loads import square

POINTS = 5
"""Lines through a square that stand for its traction, which ends in a root: to 2 %."""

LINES = ((np.arange(POINTS) + 0.5) / POINTS - 0.5).tolist()

CHORDS = [(0.5 * at, 0.5 * weight) for at, weight in np.transpose(leggauss(4)).tolist()]
"""Lines, and their weights, through what of a square the contact covers, for its pressure: to
0.1 %."""

TINY = 1e-12


@dataclass(frozen=True, slots=True)
class Sideways:
    """What acts along x (columns) and y (rows) at every bump or taxel."""

    x: Field
    y: Field


def pressed_on_bumps(rows: Field, columns: Field, radius: Field, felt: BumpsFelt) -> Field:
    """Return the normal readings under Hertz's pressure, up to a factor.

    Parameters
    ----------
    rows, columns : Field
        From the contact's centre, maps.
    radius : Field
        Contact radius.
    felt : BumpsFelt
    """
    rims = [minimum(maximum(rows + side, -radius), radius) for side in (-0.5, 0.5)]
    middle, wide = 0.5 * (rims[0] + rims[1]), rims[1] - rims[0]
    ends = (columns - 0.5, columns + 0.5)
    sides = [where(end < 0.0, -1.0, 1.0) for end in ends]
    areas = list[Field]()
    for line, weight in CHORDS:
        rest = maximum(square(radius) - square(middle + line * wide), TINY)
        half = sqrt(rest)
        near, far = (
            side * _area(minimum(abs(end) / half, 1.0))
            for side, end in zip(sides, ends, strict=True)
        )
        areas.append(weight * rest * (far - near))
    load = wide * sum(areas[1:], start=areas[0]) / (2.0 * radius)
    return apply(filter_template("pressed on bumps", felt.normal, "Normal strain."), input=load)


def turned_on_bumps(rows: Field, columns: Field, radius: Field) -> Sideways:
    """Return the tractions under a disc that turns by 1 rad without slip, means over squares.

    Parameters
    ----------
    rows, columns : Field
        From the disc's centre, maps.
    radius : Field
        Of the disc.
    """
    return Sideways(x=-1.0 * _pulled(rows, columns, radius), y=_pulled(columns, rows, radius))


def levers_on_bumps(x: Field, y: Field, felt: BumpsFelt) -> Sideways:
    """Return what a traction on each bump adds to a sum of shear readings.

    Parameters
    ----------
    x, y : Field
        What each taxel's reading along either axis is multiplied by in that sum.
    felt : BumpsFelt
        Its kernels look the same from the taxel and from the bump, so they serve for both ways.
    """
    names = ("x", "y")

    def lever(load: int) -> Field:
        parts = [
            apply(
                filter_template(
                    f"{names[load]} on bumps, {names[component]}",
                    felt.shear[load, component],
                    "Shear strain.",
                ),
                input=weight,
            )
            for component, weight in enumerate((x, y))
        ]
        return parts[0] + parts[1]

    return Sideways(lever(0), lever(1))


def _pulled(ahead: Field, aside: Field, radius: Field) -> Field:
    """Return the mean over squares of (4/π) u/√(a² − u² − v²), u ahead, v aside."""
    near, far = square(ahead - 0.5), square(ahead + 0.5)
    left = [square(radius) - square(aside + line) for line in LINES]
    drops = [_height(rest, near) - _height(rest, far) for rest in left]
    return 4.0 / (pi * POINTS) * sum(drops[1:], start=drops[0])


def _area(share: Field) -> Field:
    """Return twice the area under a unit circle from its middle up to a share of its radius."""
    return share * sqrt(maximum(1.0 - share * share, 0.0)) + arcsine(share)


def _height(rest: Field, way: Field) -> Field:
    return sqrt(maximum(rest - way, 0.0))
