"""The kinds of section: plane stress, or one Fourier mode of a body of revolution.

A strain is a row of (field, part, factor); `space.PARTS` names the parts. In a body of revolution
the displacement is (u_r cos mθ, u_θ sin mθ, u_z cos mθ). For m = 1 the second field is s = u_r +
u_θ, zero on the axis. So a sideways push is u_r = 1, s = 0, u_z = 0.
"""

from dataclasses import dataclass

import numpy as np

from cnnum.tactile.checks import Array

Row = tuple[tuple[int, str, float], ...]


@dataclass(frozen=True, slots=True)
class Section:
    """Fields, strains and conditions on the axis.

    Attributes
    ----------
    fields : int
    strains : dict of Row
        Engineering shear strains are named with two different letters.
    on_axis : tuple of int
        Fields that are zero on the axis of revolution.
    turn : float
        ∫ dθ of the mode: 2π, π, or 1 in the plane.
    """

    fields: int
    strains: dict[str, Row]
    on_axis: tuple[int, ...]
    turn: float

    @property
    def round(self) -> bool:
        """Whether the section turns about an axis."""
        return "tt" in self.strains


PLANE = Section(
    fields=2,
    strains={
        "rr": ((0, "d/dr", 1.0),),
        "zz": ((1, "d/dz", 1.0),),
        "rz": ((0, "d/dz", 1.0), (1, "d/dr", 1.0)),
    },
    on_axis=(),
    turn=1.0,
)
"""In the plane; r is x there."""

PUSHED = Section(
    fields=2,
    strains={
        "rr": ((0, "d/dr", 1.0),),
        "tt": ((0, "1/r", 1.0),),
        "zz": ((1, "d/dz", 1.0),),
        "rz": ((0, "d/dz", 1.0), (1, "d/dr", 1.0)),
    },
    on_axis=(0,),
    turn=2 * np.pi,
)
"""m = 0: pressed along the axis."""

DRAGGED = Section(
    fields=3,
    strains={
        "rr": ((0, "d/dr", 1.0),),
        "tt": ((1, "1/r", 1.0),),
        "zz": ((2, "d/dz", 1.0),),
        "rz": ((0, "d/dz", 1.0), (2, "d/dr", 1.0)),
        "rt": ((1, "d/dr", 1.0), (0, "d/dr", -1.0), (1, "1/r", -1.0)),
        "tz": ((1, "d/dz", 1.0), (0, "d/dz", -1.0), (2, "1/r", -1.0)),
    },
    on_axis=(1, 2),
    turn=np.pi,
)
"""m = 1: dragged sideways."""


@dataclass(frozen=True, slots=True)
class Hooke:
    """Stress of a section over its strain, Young's modulus 1.

    Attributes
    ----------
    section : Section
    poisson : float
        Above 0 and at most 0.5. Plane stress does not lock; a body of revolution gets its own field
        for the pressure. Its equation is div u = -p/λ, and 1/λ = 0 at 0.5.
    """

    section: Section
    poisson: float

    @property
    def shear_modulus(self) -> float:
        """G/E."""
        return 0.5 / (1 + self.poisson)

    @property
    def bulk_compliance(self) -> float:
        """E/λ."""
        return (1 + self.poisson) * (1 - 2 * self.poisson) / self.poisson

    def matrix(self) -> Array:
        """Return stress over strain, in the order of the section's strains, without pressure."""
        shear = self.shear_modulus
        names = self.section.strains
        diagonal = np.diag([2 * shear if name[0] == name[1] else shear for name in names])
        if self.section.round:
            return diagonal
        coupling = self.poisson / (1 - self.poisson**2)
        normal = 1 / (1 - self.poisson**2)
        diagonal[:2, :2] = [[normal, coupling], [coupling, normal]]
        return diagonal
