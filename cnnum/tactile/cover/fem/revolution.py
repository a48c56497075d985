"""The real bump, a body of revolution: stress under a bonded patch that is pressed or dragged."""

from dataclasses import dataclass

import numpy as np

from cnnum.tactile.checks import Array
from cnnum.tactile.cover.fem.body import Body, make_body
from cnnum.tactile.cover.fem.geometry import Shape, half_section
from cnnum.tactile.cover.fem.plate import Movement, cap, move
from cnnum.tactile.cover.fem.section import DRAGGED, PUSHED, Hooke
from cnnum.tactile.cover.tables import PATCH

NEAR_AXIS = 1e-7  # bump radii: the axis itself belongs to no cell's inside


@dataclass(frozen=True, slots=True)
class Bodies:
    """One bump, ready to be pressed and dragged.

    Attributes
    ----------
    pushed, dragged : Body
        Modes 0 and 1.
    press, drag : Movement
        Of the patch, by one radius, down and sideways, without turning.
    """

    pushed: Body
    dragged: Body
    press: Movement
    drag: Movement

    @property
    def lever(self) -> float:
        """Height over the surface at which the drag's force would make its moment, bump radii.

        The plate does not turn, so it is less than the height of the patch.
        """
        side, down = self._drag_forces()
        nodes = self.dragged.nodes
        return -float(side @ nodes[:, 1] - down @ nodes[:, 0]) / self.drag.stiffness

    def _drag_forces(self) -> tuple[Array, Array]:
        count = len(self.dragged.nodes)
        forces = np.zeros(self.dragged.system.shape[0])
        forces[self.drag.unknowns] = self.drag.forces
        return forces[:count], forces[2 * count : 3 * count]

    def profiles(self, depth: float, distance: Array) -> Array:
        """Return stress and strain at a depth, for a unit force, Young's modulus and radius.

        Parameters
        ----------
        depth : float, bump radii
        distance : (n,) float, bump radii
            From the axis.

        Returns
        -------
        (7, n) float
            σ_zz, σ_rz, ε_zz under a press; σ_zz, σ_rz (cos θ), σ_θz (sin θ), ε_zz (cos θ) under
            a drag towards θ = 0.
        """
        places = np.stack([np.maximum(distance, NEAR_AXIS), np.full_like(distance, depth)], axis=1)
        press = _at(self.pushed, self.press, ("zz", "rz"), places)
        drag = _at(self.dragged, self.drag, ("zz", "rz", "tz"), places)
        return np.concatenate([press, drag])


def make_bodies(
    shape: Shape, fineness: int, *, poisson: float = 0.5, patch: float = PATCH
) -> Bodies:
    """Return the bump in both modes.

    Parameters
    ----------
    shape : Shape
    fineness : int
    poisson : float
    patch : float, bump radii
        Radius of the bonded patch on top; its rim is the last node within.
    """
    mesh = half_section(shape, fineness)
    pushed = make_body(mesh, Hooke(PUSHED, poisson))
    dragged = make_body(mesh, Hooke(DRAGGED, poisson))
    return Bodies(
        pushed,
        dragged,
        move(pushed, cap(pushed, patch), (0.0, 1.0)),
        move(dragged, cap(dragged, patch), (1.0, 0.0, 0.0)),
    )


def _at(body: Body, movement: Movement, names: tuple[str, ...], places: Array) -> Array:
    stresses = body.stresses(movement.solution)
    strain = body.strains(movement.solution)["zz"]
    fields = np.stack([*(stresses[name] for name in names), strain])
    return np.asarray(body.space.smoothed(fields, places) / movement.stiffness)
