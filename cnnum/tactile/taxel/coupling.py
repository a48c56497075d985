"""Coupling of the elastic cover to a taxel: the strain at its foot to the force on silicon."""

from dataclasses import dataclass, field
from math import pi

import numpy as np
from numpy.typing import ArrayLike

from cnnum.arrays import Floats, finite, frozen
from cnnum.errors import PhysicsError
from cnnum.safety.values import is_real
from cnnum.tactile.taxel.bridge import Bridge
from cnnum.tactile.taxel.signals import apply_matrix, trailing


@dataclass(frozen=True, slots=True, eq=False)
class Coupling:
    """Linear link from the bottom strain (or stress) of the cover to the force on a taxel.

    The taxel is the body below, so a traction of the cover acts on it with the sign turned:
    force = −cross · (shear ε_xz, shear ε_yz, normal ε_zz).

    Attributes
    ----------
    shear, normal : float, N (per unit strain; m² for a stress sensor)
        Stiffness of the link.
    cross : (3, 3) or (rows, cols, 3, 3) float
        Cross sensitivity: how much of each component lands on the others.

    References
    ----------
    Vásárhelyi 2007, (4.14), (4.15).
    """

    shear: float
    normal: float
    cross: Floats = field(default_factory=lambda: np.eye(3))

    def __post_init__(self) -> None:
        if not all(is_real(one) and one > 0.0 for one in (self.shear, self.normal)):
            raise PhysicsError(
                "A coupling needs positive finite stiffnesses, got "
                f"shear {self.shear} and normal {self.normal}."
            )
        cross = frozen(finite("cross", self.cross))
        if cross.ndim not in (2, 4) or cross.shape[-2:] != (3, 3):
            raise PhysicsError(
                "'cross' must have the shape (3, 3) or (rows, cols, 3, 3), got "
                f"{cross.shape}; leave it out for none."
            )
        object.__setattr__(self, "cross", cross)

    @classmethod
    def nominal(
        cls,
        *,
        depth: float = 200e-6,
        youngs_modulus: float = 0.87e6,
        reduction: float = 10.0,
        beta_ns: float = 1.5,
        bridge: Bridge | None = None,
        cross: ArrayLike | None = None,
    ) -> "Coupling":
        """Return the coupling with a given loss of sensitivity under a cover.

        Parameters
        ----------
        depth : float, m
            Thickness of the cover.
        youngs_modulus : float, Pa
            Young's modulus of the cover.
        reduction : float
            A point load above the centre reads this many times less than on bare silicon;
            Table 3.II: 5–30, growing with the thickness.
        beta_ns : float
            Normal-to-shear sensitivity α_s/α_n (4.19).
        bridge : Bridge, optional
        cross : (3, 3) or (rows, cols, 3, 3) float, optional

        Raises
        ------
        PhysicsError
            If a parameter is not positive.
        """
        if not min(depth, youngs_modulus, reduction, beta_ns) > 0.0:
            raise PhysicsError(
                "Depth, Young's modulus, reduction and β_ns must be positive, got "
                f"{depth} m, {youngs_modulus} Pa, {reduction} and {beta_ns}."
            )
        silicon = Bridge() if bridge is None else bridge
        normal = 2.0 * pi * youngs_modulus * depth**2 / (3.0 * reduction)  # 1/A of (4.18)
        shear = normal * abs(silicon.normal / silicon.shear) / beta_ns
        mixing = np.eye(3) if cross is None else np.asarray(cross, dtype=np.float64)
        return cls(shear, normal, mixing)

    def force(self, strain: ArrayLike) -> Floats:
        """Return the force (..., 3), N, on the silicon under a strain (or stress) at its surface.

        Parameters
        ----------
        strain : (..., 3) float
            ε_xz, ε_yz, ε_zz (or σ, Pa), tension positive; an ArrayError refuses another last axis.
        """
        rows = trailing("strain", finite("strain", strain), 3, "(ε_xz, ε_yz, ε_zz)")
        stiffness = np.array([self.shear, self.shear, self.normal])
        return apply_matrix(-self.cross * stiffness, rows)
