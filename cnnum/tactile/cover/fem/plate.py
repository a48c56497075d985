"""Finite elements of covers: in the plane, around an axis, and on a plate.

The plane bump of the dissertation: Ø 0.4 mm on a block of 4 × 2 mm, ν = 0.499.

Lengths are in bump radii (0.2 mm), stress in Young's moduli.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cnnum.errors import PhysicsError
from cnnum.tactile.checks import Array
from cnnum.tactile.cover.bump import PATCH
from cnnum.tactile.cover.fem.body import Body, Numbers, make_body
from cnnum.tactile.cover.fem.geometry import (
    DRAGGED,
    PLANE,
    PUSHED,
    Hooke,
    Shape,
    full_section,
    half_section,
)

ROUNDS = 60
"""Changes of contact tried for one indentation; a dozen is usual."""


@dataclass(frozen=True, slots=True)
class Contact:
    """The plate at one indentation.

    Attributes
    ----------
    indentation : float, bump radii
    nodes : (n,) int
        Nodes of the body that touch.
    force : float
        On the plate: over E R² of a body of revolution, over E R t of a plate of thickness t.
    solution : (unknowns,) float
        Displacements (and pressures) of the whole body.
    """

    indentation: float
    nodes: Numbers
    force: float
    solution: Array


@dataclass(frozen=True, slots=True)
class Movement:
    """A bonded patch of the bump moved rigidly.

    Attributes
    ----------
    stiffness : float
        Force over displacement, over E R, or over E t in the plane.
    solution : (unknowns,) float
        Solution for a unit displacement.
    forces : (n,) float
        Forces on `unknowns` that hold the patch, for the unit displacement.
    unknowns : (n,) int
    """

    stiffness: float
    solution: Array
    forces: Array
    unknowns: Numbers


def cap(body: Body, radius: float) -> Numbers:
    """Return the nodes on the bump's top within a distance from its axis, bump radii."""
    nodes = body.nodes
    round_ = np.abs(np.hypot(*nodes.T) - 1) < 1e-9
    near = (np.abs(nodes[:, 0]) < radius + 1e-9) & (nodes[:, 1] < 0)
    return np.flatnonzero(round_ & near)


def move(body: Body, nodes: Numbers, direction: Sequence[float]) -> Movement:
    """Return the response to a unit movement of bonded nodes.

    Parameters
    ----------
    body : Body
    nodes : (n,) int
    direction : sequence of float
        The value of each field on the patch.
    """
    count = len(body.nodes)
    unknowns = np.concatenate([field * count + nodes for field in range(len(direction))])
    wanted = np.repeat(np.asarray(direction, dtype=np.float64), len(nodes))
    free = np.isin(unknowns, body.free)
    unknowns, wanted = unknowns[free], wanted[free]
    forces = np.asarray(np.linalg.solve(body.compliance(unknowns), wanted), dtype=np.float64)
    solution = body.solve(unknowns, forces[:, None])[:, 0]
    return Movement(float(forces @ wanted), solution, forces, unknowns)


def press(body: Body, indentations: Sequence[float]) -> Iterator[Contact]:
    """Yield the contact at growing indentations; touched nodes stay in place.

    Parameters
    ----------
    body : Body
        A body with two fields, sideways and downwards.
    indentations : sequence of float, bump radii
        Growing; the smaller the steps, the truer the place where each point got stuck.

    Raises
    ------
    PhysicsError
        If no contact is found that neither pulls nor overlaps.
    """
    rim = _Rim(body, cap(body, np.sin(0.45 * np.pi)))
    touching = np.zeros(len(rim.nodes), dtype=np.bool_)
    stuck = np.zeros(len(rim.nodes))
    sideways = np.zeros(len(rim.nodes))
    for depth in indentations:
        touching, forces = rim.settle(depth, touching, stuck, sideways)
        moved = rim.compliance @ forces
        fresh = touching & (stuck == 0)
        stuck = np.where(fresh, sideways, stuck)
        sideways = rim.sideways(moved)
        solution = body.solve(rim.unknowns, forces[:, None])[:, 0]
        down = float(forces[: len(rim.nodes)].sum())
        yield Contact(depth, rim.nodes[touching], down, solution)


class _Rim:
    """The bump's round rim: its nodes' displacement under forces on them."""

    def __init__(self, body: Body, nodes: Numbers) -> None:
        count = len(body.nodes)
        side = nodes[np.isin(nodes, body.free)]
        self.nodes = nodes
        self.unknowns = np.concatenate([count + nodes, side])
        self.gap = 1 + body.nodes[nodes, 1]
        self.compliance = body.compliance(self.unknowns)
        self._side = np.searchsorted(nodes, side)

    def sideways(self, moved: Array) -> Array:
        result = np.zeros(len(self.nodes))
        result[self._side] = moved[len(self.nodes) :]
        return result

    def settle(
        self, depth: float, touching: NDArray[np.bool_], stuck: Array, sideways: Array
    ) -> tuple[NDArray[np.bool_], Array]:
        """Return who touches, and the forces, at an indentation."""
        wanted = depth - self.gap
        touching = touching | (self.gap == self.gap.min())
        for _ in range(ROUNDS):
            held = np.where(touching & (stuck == 0), sideways, stuck)
            forces = self._hold(touching, wanted, held)
            down = (self.compliance @ forces)[: len(self.nodes)]
            pulls = touching & (forces[: len(self.nodes)] < 0)
            overlaps = ~touching & (down < wanted - 1e-12)
            if not (pulls | overlaps).any():
                return touching, forces
            touching = (touching & ~pulls) | overlaps
        raise PhysicsError(
            f"No contact was found at an indentation of {depth:g} radii: indent in smaller steps, "
            "or take a finer mesh."
        )

    def _hold(self, touching: NDArray[np.bool_], wanted: Array, held: Array) -> Array:
        active = np.concatenate([touching, touching[self._side]])
        target = np.concatenate([wanted, held[self._side]])
        forces = np.zeros(len(self.unknowns))
        part = self.compliance[np.ix_(active, active)]
        forces[active] = np.linalg.solve(part, target[active])
        return forces


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
        Contacts of the pressed plate at increasing indentations.
    drag : Movement
        Sideways movement by one radius of the contact at the working indentation.
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


NEAR_AXIS = 1e-7  # bump radii: the axis itself belongs to no cell's inside


@dataclass(frozen=True, slots=True)
class Bodies:
    """One bump, ready to be pressed and dragged.

    Attributes
    ----------
    pushed, dragged : Body
        Modes 0 and 1.
    press, drag : Movement
        Movements of the patch by one radius, down and sideways, without rotation.
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
