"""What taxels under a flat cover feel of a sphere: pressed on it, and turned without slip.

The cover takes e^(−kz) of the waves of Hertz's pressure and of Reissner and Sagoci's traction, so
that what is left of them at the depth z are elementary functions of w = √((z − ia)² + ρ²). Lengths
are in pitches, ν = 0.5.
"""

from dataclasses import dataclass
from math import pi
from math import sqrt as root

from cnnum.programs.fields import Field, sqrt
from cnnum.tactile.indenters import Reads

ARCSINE = (1.5707288, -0.2121144, 0.0742610, -0.0187293)
"""arcsin x = π/2 − √(1 − x) (…): within 7e-5 (Abramowitz and Stegun 4.4.45)."""


@dataclass(frozen=True, slots=True)
class Root:
    """w = u − iv, and what it is made of.

    Attributes
    ----------
    square : Field
        Real part of w².
    size : Field
        |w|².
    u, v : Field
    """

    square: Field
    size: Field
    u: Field
    v: Field


@dataclass(frozen=True, slots=True)
class Pushed:
    """Normal signal under Hertz's pressure, over the largest pressure, a map.

    That is −(2E/3) ε_zz for strain, and −σ_zz for stress.

    Attributes
    ----------
    signal : Field
    by_radius, by_away : Field
        Its derivatives by the contact radius and by the square distance from its centre.
    """

    signal: Field
    by_radius: Field
    by_away: Field


def pushed_by(away: Field, radius: Field, depth: float, reads: Reads = "strain") -> Pushed:
    """Return what a sphere pressed on the cover makes.

    Parameters
    ----------
    away : Field
        Square distance of each taxel from the contact's centre.
    radius : Field
        Contact radius.
    depth : float
        Of the taxels.
    reads : "strain" or "stress"
        What they read.
    """
    w = _root(away, radius, depth)
    flat = w.u / w.size
    cube = w.size * w.size * w.size
    real = w.u * (w.u * w.u - 3.0 * w.v * w.v) / cube
    imaginary = w.v * (3.0 * w.u * w.u - w.v * w.v) / cube
    # the wave of a flat punch, by which a Hertzian pressure grows as its contact does
    grows = depth * (depth * imaginary - radius * real)
    if reads == "stress":
        signal = w.v / radius - depth * flat
        falls = -0.5 * w.v / w.size
        grows = grows + w.v / w.size
    else:
        whole = away + radius * radius + depth * depth + w.size
        sine = root(2.0) * radius / sqrt(whole)
        signal = depth * (arcsine(sine) / radius - flat)
        falls = -0.5 * sine * (1.0 + w.square / w.size) / (whole * sqrt(1.0 - sine * sine))
        falls = depth * falls
    return Pushed(
        signal=signal,
        by_radius=grows - signal / radius,
        by_away=falls / radius + 0.5 * depth * real,
    )


def turned_by(away: Field, radius: Field, depth: float) -> Field:
    """Return the moment of the shear strain under a sphere that sticks, for a turn of 1 rad, a map.

    Parameters are those of `pushed_by`. Over an endless array it adds up to 8 a³/3.
    """
    w = _root(away, radius, depth)
    return (2.0 / pi) * (radius * (depth * w.u + radius * w.v) / w.size - w.v)


def _root(away: Field, radius: Field, depth: float) -> Root:
    square = away + (depth * depth - radius * radius)
    cross = 2.0 * depth * radius
    size = sqrt(square * square + cross * cross)
    u = sqrt(0.5 * (size + square))
    return Root(square, size, u, 0.5 * cross / u)


def arcsine(sine: Field) -> Field:
    """Return the angle, 0 to π/2, of a sine from 0 to 1."""
    first, second, third, fourth = ARCSINE
    left = first + sine * (second + sine * (third + sine * fourth))
    return pi / 2.0 - sqrt(1.0 - sine) * left
