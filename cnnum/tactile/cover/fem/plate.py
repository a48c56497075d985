"""A rigid flat plate on the bump, with friction that never slips."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cnnum.errors import PhysicsError
from cnnum.tactile.checks import Array
from cnnum.tactile.cover.fem.body import Body, Numbers

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
        Of a unit displacement.
    forces : (n,) float
        That hold the patch, on `unknowns`, for the unit displacement.
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
        Of two fields: sideways and down.
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
