"""What the bumps of a cover carry of a sphere, each that of its square, and what taxels read of it.

Half of every integral over a square is closed: both Hertz's pressure and the traction of a sphere
that turns without slip come from √(a² − ρ²). Lengths are in pitches, tractions in units of G.
"""

from dataclasses import dataclass
from math import pi

import numpy as np

from cnnum.programs.fields import Field, maximum, sqrt
from cnnum.programs.transients import apply
from cnnum.tactile.bumps_felt import BumpsFelt
from cnnum.templates.tactile.loads import square
from cnnum.templates.tactile.unblur import filter_template

POINTS = 5
"""Lines through a square that stand for it: the root's edge is off by some 1 % of a load."""

LINES = ((np.arange(POINTS) + 0.5) / POINTS - 0.5).tolist()


@dataclass(frozen=True, slots=True)
class Turned:
    """Shear strain under a sphere that turns by 1 rad without slip, along rows and columns."""

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
    across = [square(columns + line) for line in LINES]
    left = [square(radius) - square(rows + line) for line in LINES]
    heights = [_height(rest, way) for rest in left for way in across]
    load = sum(heights[1:], start=heights[0]) / (POINTS**2 * radius)
    return apply(filter_template("pressed on bumps", felt.normal, "Normal strain."), input=load)


def turned_on_bumps(rows: Field, columns: Field, radius: Field, felt: BumpsFelt) -> Turned:
    """Return the shear readings; parameters are those of `pressed_on_bumps`."""
    along_y = _pulled(columns, rows, radius)
    along_x = -1.0 * _pulled(rows, columns, radius)

    def read(component: int) -> Field:
        names = ("x", "y")
        parts = [
            apply(
                filter_template(
                    f"{names[load]} on bumps, {names[component]}",
                    felt.shear[load, component],
                    "Shear strain.",
                ),
                input=traction,
            )
            for load, traction in enumerate((along_x, along_y))
        ]
        return parts[0] + parts[1]

    return Turned(read(0), read(1))


def _pulled(ahead: Field, aside: Field, radius: Field) -> Field:
    """Return the mean over squares of (4/π) u/√(a² − u² − v²), u ahead, v aside."""
    near, far = square(ahead - 0.5), square(ahead + 0.5)
    left = [square(radius) - square(aside + line) for line in LINES]
    drops = [_height(rest, near) - _height(rest, far) for rest in left]
    return 4.0 / (pi * POINTS) * sum(drops[1:], start=drops[0])


def _height(rest: Field, way: Field) -> Field:
    return sqrt(maximum(rest - way, 0.0))
