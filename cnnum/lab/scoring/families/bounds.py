"""Closed forms that the generator needs: how far a pull and a twist must go."""

from dataclasses import dataclass

from cnnum.tactile.contact import (
    Hertz,
    contact_modulus,
    hertz,
    shear_compliance,
    sliding_torque,
    tangential_displacement,
    torsion_slip,
)

POISSON = 0.5
"""Of the cover: rubber keeps its volume."""

LOOSE_TORQUE = 0.89734
"""Share of the sliding torque at which the stick radius is half the contact radius: the root of
Lubkin's c/a = 1/2, to which the tests hold it."""


@dataclass(frozen=True, slots=True)
class Bounds:
    """A sphere under a load on a cover.

    Attributes
    ----------
    radius : float, m
    load : float, N
    friction : float
    youngs_modulus : float, Pa
    """

    radius: float
    load: float
    friction: float
    youngs_modulus: float

    @property
    def contact(self) -> Hertz:
        """Its contact."""
        modulus = contact_modulus(self.youngs_modulus, POISSON)
        return hertz(self.load, self.radius, modulus)

    @property
    def shear_modulus(self) -> float:
        """G, Pa."""
        return self.youngs_modulus / (2.0 * (1.0 + POISSON))

    def travel(self, share: float = 1.0) -> float:
        """Return how far the sphere moves until the force is a share of μP, m (Mindlin)."""
        limit = self.friction * self.load
        compliance = shear_compliance(self.youngs_modulus, POISSON)
        moved = tangential_displacement(
            self.contact, self.load, share * limit, self.friction, compliance
        )
        return float(moved)

    def turn(self, share: float = LOOSE_TORQUE) -> float:
        """Return the angle at which the torque is a share of the sliding one, rad (Lubkin)."""
        a = float(self.contact.contact_radius)
        torque = share * float(sliding_torque(self.load, a, self.friction))
        return torsion_slip(self.load, a, torque, self.friction).twist(self.shear_modulus)


def load_of(contact_radius: float, radius: float, youngs_modulus: float) -> float:
    """Return the load (N) under which a sphere makes a contact of that radius (Hertz)."""
    modulus = float(contact_modulus(youngs_modulus, POISSON))
    return 4.0 * modulus * contact_radius**3 / (3.0 * radius)
