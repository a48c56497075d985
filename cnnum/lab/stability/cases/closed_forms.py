"""Closed forms of the cover and of contact at the ends of their ranges, against their limits."""

from collections.abc import Callable, Iterator

import numpy as np

from cnnum.arrays import Floats
from cnnum.lab.stability.record import Case, Solved
from cnnum.tactile import contact, halfspace

E = 0.87e6
PUSH = np.array([0.0, 0.0, 1.0])


def cases() -> Iterator[Case]:
    """Return the cases of closed forms; they are the same on every engine."""
    for depth in (1e-12, 1e-6, 1.0, 1e9):
        yield _axis(depth)
    yield _form("zero-strain-ring", "ε_zz where ρ = √2 z", _ring_strain, lambda: np.zeros(3), 1e-15)
    for poisson in (-0.999, 0.0, 0.5):
        yield _surface(poisson)
    yield _form("no-force", "stress under no load", _no_force, lambda: np.zeros((3, 3)), 0.0)
    for load in (1e-30, 1e-6, 1e12):
        yield _hertz(load)
    for friction in (1e-12, 100.0):
        yield _partial_slip(friction)
    yield _refused("no-friction", "partial slip without friction", _no_friction, "friction")
    yield _refused("load-itself", "stress at the point load itself", _load_itself, "load")
    yield _refused("poisson-beyond", "Poisson's ratio of 0.51", _beyond, "poisson|Poisson")


def _form(
    name: str,
    title: str,
    value: Callable[[], Floats],
    truth: Callable[[], Floats],
    tolerance: float,
    refusal: str = "",
) -> Case:
    return Case(
        f"form-{name}",
        "extreme",
        title,
        lambda _: Solved(np.asarray(value(), dtype=np.float64)),
        truth,
        tolerance,
        tolerance,
        "roundings of double precision, of a share of the value",
        refusal,
    )


def _axis(depth: float) -> Case:
    """Under the load σ_zz = −3F/(2πz²) (Boussinesq; Johnson, Contact Mechanics, 3.19)."""

    def value() -> Floats:
        result = halfspace.stress(0.0, 0.0, depth, PUSH)
        return np.asarray(result[2, 2] * (2.0 * np.pi * depth**2 / 3.0), dtype=np.float64)

    title = f"σ_zz under a point load, {depth:g} m deep"
    return _form(f"axis-{depth:g}", title, value, lambda: np.array(-1.0), 1e-14)


def _ring_strain() -> Floats:
    """ε_zz of an incompressible cover is 0 at ρ = √2 z (dissertation, section 4.3.3)."""
    places = np.array([1e-6, 1.0, 1e6])
    result = halfspace.strain(np.sqrt(2.0) * places, 0.0, places, PUSH, youngs_modulus=1.0)
    return np.asarray(result[..., 2, 2] * places**2)


def _surface(poisson: float) -> Case:
    """The surface sinks by F (1 − ν²)/(πEr)."""

    def value() -> Floats:
        result = halfspace.displacement(2e-3, 0.0, 0.0, PUSH, youngs_modulus=E, poisson=poisson)
        return np.asarray(result[2] * np.pi * E * 2e-3)

    title = f"displacement of the surface for ν = {poisson:g}"
    return _form(f"surface-{poisson:g}", title, value, lambda: np.array(1.0 - poisson**2), 1e-13)


def _no_force() -> Floats:
    return np.asarray(halfspace.stress(1e-3, 0.0, 1e-3, np.zeros(3)))


def _hertz(load: float) -> Case:
    """The mean pressure of a Hertz contact is two thirds of its peak."""

    def value() -> Floats:
        result = contact.hertz(load, 1e-2, E)
        mean = load / (np.pi * result.contact_radius**2)
        return np.asarray(1.5 * mean / result.peak_pressure)

    return _form(
        f"hertz-{load:g}", f"Hertz contact of {load:g} N", value, lambda: np.array(1.0), 1e-13
    )


def _partial_slip(friction: float) -> Case:
    """At half of the sliding force the stick radius is a (1/2)^⅓, at any friction."""

    def value() -> Floats:
        hertz = contact.hertz(1.0, 1e-2, E)
        slip = contact.partial_slip(hertz, 1.0, 0.5 * friction, friction)
        return np.asarray(slip.stick_radius / slip.contact_radius)

    title = f"partial slip with a friction of {friction:g}"
    return _form(
        f"friction-{friction:g}", title, value, lambda: np.array(0.5 ** (1.0 / 3.0)), 1e-13
    )


def _refused(name: str, title: str, value: Callable[[], Floats], sentence: str) -> Case:
    """Only a refusal passes: no number is near."""
    return _form(name, title, value, lambda: np.array(np.nan), 0.0, sentence)


def _no_friction() -> Floats:
    result = contact.hertz(1.0, 1e-2, E)
    return np.asarray(contact.partial_slip(result, 1.0, 0.0, 0.0).stick_radius)


def _load_itself() -> Floats:
    return np.asarray(halfspace.stress(0.0, 0.0, 0.0, PUSH)[2, 2])


def _beyond() -> Floats:
    return np.asarray(halfspace.stress(0.0, 0.0, 1.0, PUSH, poisson=0.51)[2, 2])
