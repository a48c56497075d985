"""A section assembled and factorised once; loads and prescribed displacements are then cheap."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.linalg import SuperLU, splu

from cnnum.tactile.checks import Array
from cnnum.tactile.cover.fem.geometry import QuadMesh
from cnnum.tactile.cover.fem.section import Hooke
from cnnum.tactile.cover.fem.space import Matrix, Space, make_space

Numbers = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Body:
    """A section, fixed below.

    Unknown number `field * nodes + node` is one field at one node; pressures follow.

    Attributes
    ----------
    space : Space
    hooke : Hooke
    system : sparse matrix
        Without any fixed value.
    free : (n,) int
        Unknowns that are not fixed.
    factors : SuperLU
        Of the free part.
    """

    space: Space
    hooke: Hooke
    system: Matrix
    free: Numbers
    factors: SuperLU

    @property
    def nodes(self) -> Array:
        """(n, 2) float. Places of the nodes, in bump radii."""
        return self.space.nodes

    def solve(self, unknowns: Numbers, forces: Array) -> Array:
        """Return all unknowns under forces.

        Parameters
        ----------
        unknowns : (n,) int
            Where forces act.
        forces : (n, k) float
            k cases of load, of the whole turn.
        """
        right = np.zeros((self.system.shape[0], forces.shape[1]))
        right[unknowns] = forces / self.hooke.section.turn
        result = np.zeros_like(right)
        result[self.free] = self.factors.solve(right[self.free])
        return result

    def compliance(self, unknowns: Numbers) -> Array:
        """Return (n, n): displacement of some unknowns under unit forces on them."""
        return np.asarray(self.solve(unknowns, np.eye(len(unknowns)))[unknowns])

    def field(self, number: int, solution: Array) -> Array:
        """Return one displacement field of a solution, (nodes,)."""
        count = len(self.nodes)
        return np.asarray(solution[number * count : (number + 1) * count])

    def energy(self, solution: Array) -> float:
        """Return the elastic energy of a solution: half the work of its forces."""
        return float(solution @ (self.system @ solution)) / 2 * self.hooke.section.turn

    def strains(self, solution: Array) -> dict[str, Array]:
        """Return the strains at the points of integration, by name."""
        fields = [self.field(n, solution) for n in range(self.hooke.section.fields)]
        rows = self.hooke.section.strains.items()
        return {
            name: sum(
                (factor * self.space.part(part, fields[n]) for n, part, factor in row),
                start=np.zeros(()),
            )
            for name, row in rows
        }

    def stresses(self, solution: Array) -> dict[str, Array]:
        """Return the stresses at the points of integration, by name, Young's modulus 1."""
        strains = self.strains(solution)
        values = np.tensordot(self.hooke.matrix(), np.stack(list(strains.values())), axes=1)
        stresses = dict(zip(strains, values, strict=True))
        if self.hooke.section.round:
            pressure = solution[self.hooke.section.fields * len(self.nodes) :]
            at_points = self.space.pressure_at_points(pressure)
            for name in ("rr", "tt", "zz"):
                stresses[name] = stresses[name] - at_points
        return stresses


def make_body(mesh: QuadMesh, hooke: Hooke) -> Body:
    """Assemble and factorise a section that is fixed at its lowest nodes.

    Parameters
    ----------
    mesh : QuadMesh
    hooke : Hooke
    """
    space = make_space(mesh, round_section=hooke.section.round)
    system = _stiffness(space, hooke)
    if hooke.section.round:
        system = _with_pressure(system, space, hooke)
    free = _free(space, hooke, system.shape[0])
    # symmetric: pivots that stay on the diagonal, unless they are small, take a third of the fill
    factors = splu(
        sparse.csc_array(system[free][:, free]),
        permc_spec="MMD_AT_PLUS_A",
        diag_pivot_thresh=0.01,
        options={"SymmetricMode": True},
    )
    return Body(space, hooke, system, free, factors)


def _stiffness(space: Space, hooke: Hooke) -> Matrix:
    rows = list(hooke.section.strains.values())
    stress = hooke.matrix()
    parts = {part for row in rows for _, part, _ in row}
    pairs = {(a, b): space.matrix(a, b) for a in parts for b in parts}
    blocks: dict[tuple[int, int], Matrix] = {}
    for i, first in enumerate(rows):
        for j, second in enumerate(rows):
            if stress[i, j] == 0:
                continue
            for n, part, factor in first:
                for m, other, times in second:
                    term = stress[i, j] * factor * times * pairs[part, other]
                    blocks[n, m] = blocks[n, m] + term if (n, m) in blocks else term
    count = range(hooke.section.fields)
    empty = sparse.csr_array((len(space.nodes), len(space.nodes)))
    table = [[blocks.get((n, m), empty) for m in count] for n in count]
    return sparse.csr_array(sparse.vstack([sparse.hstack(row) for row in table]))


def _with_pressure(stiffness: Matrix, space: Space, hooke: Hooke) -> Matrix:
    """Border the stiffness with -p div u and -p²/(2λ)."""
    count = len(space.nodes)
    columns = [sparse.csr_array((space.pressure.N, count)) for _ in range(hooke.section.fields)]
    for name in ("rr", "tt", "zz"):
        for n, part, factor in hooke.section.strains[name]:
            columns[n] = columns[n] - factor * space.matrix("1", part, pressure=True)
    border = sparse.hstack(columns)
    mass = hooke.bulk_compliance * space.pressure_mass()
    upper, lower = sparse.hstack([stiffness, border.T]), sparse.hstack([border, -mass])
    return sparse.csr_array(sparse.vstack([upper, lower]))


def _free(space: Space, hooke: Hooke, size: int) -> Numbers:
    nodes = space.nodes
    count = len(nodes)
    held = np.zeros(size, dtype=np.bool_)
    bottom = np.flatnonzero(nodes[:, 1] > nodes[:, 1].max() - 1e-9)
    axis = np.flatnonzero(np.abs(nodes[:, 0]) < 1e-9)
    for field in range(hooke.section.fields):
        held[field * count + bottom] = True
        if field in hooke.section.on_axis:
            held[field * count + axis] = True
    return np.flatnonzero(~held)
