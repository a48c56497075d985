"""The plane bump of the dissertation: Ø 0.4 mm on a block of 4 × 2 mm, ν = 0.499.

Lengths are in bump radii (0.2 mm), stress in Young's moduli.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cnnum.errors import PhysicsError
from cnnum.tactile.checks import Array
from cnnum.tactile.cover.fem.body import Body, make_body
from cnnum.tactile.cover.fem.geometry import Shape, full_section
from cnnum.tactile.cover.fem.plate import Contact, Movement, move, press
from cnnum.tactile.cover.fem.section import PLANE, Hooke

BLOCK = Shape(half_width=10.0, depth=10.0)
"""4 × 2 mm under a bump of Ø 0.4 mm."""

POISSON = 0.499
WORKING = 0.25
"""The dissertation's indentation of 50 µm, in bump radii."""


@dataclass(frozen=True, slots=True)
class PlaneBump:
    """The section with a rigid plate that sticks to its top.

    Attributes
    ----------
    body : Body
    contacts : tuple of Contact
        Of the pressed plate, at growing indentations.
    drag : Movement
        Of the contact at the working indentation, sideways by one radius.
    """

    body: Body
    contacts: tuple[Contact, ...]
    drag: Movement

    @property
    def working(self) -> Contact:
        """The contact at the working indentation."""
        return next(c for c in self.contacts if abs(c.indentation - WORKING) < 1e-9)

    def solutions(self) -> tuple[Array, Array]:
        """Return the displacements of pressing and of dragging by the working indentation."""
        return self.working.solution, WORKING * self.drag.solution

    def displacement(self, solution: Array, places: Array) -> Array:
        """Return (2, n) u_x and u_z at (n, 2) places of the block."""
        fields = np.stack([self.body.field(0, solution), self.body.field(1, solution)], axis=-1)
        return np.asarray(self.body.space.at(fields, places).T)

    def stress(self, solution: Array, places: Array) -> Array:
        """Return (2, n) σ_xz and σ_zz at (n, 2) places of the block."""
        stresses = self.body.stresses(solution)
        return self.body.space.smoothed(np.stack([stresses["rz"], stresses["zz"]]), places)

    def strain(self, solution: Array, places: Array) -> Array:
        """Return (2, n) ε_xz (tensor) and ε_zz at (n, 2) places of the block."""
        strains = self.body.strains(solution)
        return self.body.space.smoothed(np.stack([strains["rz"] / 2, strains["zz"]]), places)


def make_plane_bump(
    fineness: int = 12,
    *,
    shape: Shape = BLOCK,
    poisson: float = POISSON,
    indentations: Sequence[float] = (0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.35, 0.4, 0.45, 0.5),
) -> PlaneBump:
    """Return the plane bump, pressed step by step and then dragged.

    Parameters
    ----------
    fineness : int
        Cells along an eighth of the circle.
    shape : Shape
    poisson : float
    indentations : sequence of float, bump radii
        Growing, with the working indentation 0.25 among them.

    Raises
    ------
    PhysicsError
        If the working indentation is not among them.
    """
    if not any(abs(depth - WORKING) < 1e-9 for depth in indentations):
        raise PhysicsError(f"'indentations': expected {WORKING} among them, got {indentations}.")
    body = make_body(full_section(shape, fineness), Hooke(PLANE, poisson))
    contacts = tuple(press(body, indentations))
    touching = next(c.nodes for c in contacts if abs(c.indentation - WORKING) < 1e-9)
    return PlaneBump(body, contacts, move(body, touching, (1.0, 0.0)))
