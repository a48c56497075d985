"""Finite elements of a body in space."""

from collections.abc import Callable
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.linalg import SuperLU, splu

from cnnum.tactile.checks import Array
from cnnum.tactile.cover.fem.geometry import Hooke, QuadMesh
from cnnum.tactile.cover.fem.library import load_skfem

Matrix = sparse.csr_array
Part = Callable[[Any, Any], Any]

PARTS: dict[str, Part] = {
    "d/dr": lambda u, w: u.grad[0],
    "d/dz": lambda u, w: u.grad[1],
    "1/r": lambda u, w: u / w.x[0],
    "1": lambda u, w: u,
}
"""The parts of a strain: derivatives, and the value over the distance from the axis."""


@dataclass(frozen=True, slots=True)
class Space:
    """Functions on one mesh.

    Attributes
    ----------
    straight : scikit-fem mesh
        The cells with straight sides, in which places are looked up.
    displacement, pressure : scikit-fem basis
        Biquadratic and bilinear on the same points of integration (Taylor–Hood: stable, and
        free of locking up to ν = 0.5).
    round : bool
        Whether the section turns about its axis: integrals are then weighted with r.
    """

    straight: Any
    displacement: Any
    pressure: Any
    round: bool

    @property
    def nodes(self) -> Array:
        """(n, 2) float. Places of the biquadratic functions."""
        return np.asarray(self.displacement.doflocs.T, dtype=np.float64)

    def matrix(self, test: str, trial: str, *, pressure: bool = False) -> Matrix:
        """Return ∫ test(v) trial(u), v bilinear if `pressure`, else biquadratic."""
        first = self.pressure if pressure else self.displacement

        def product(u: Any, v: Any, w: Any) -> Any:
            return PARTS[trial](u, w) * PARTS[test](v, w) * self._weight(w)

        form = load_skfem().BilinearForm(product)
        return sparse.csr_array(form.assemble(self.displacement, first))

    def pressure_mass(self) -> Matrix:
        """Return ∫ q p of bilinear functions."""

        def product(u: Any, v: Any, w: Any) -> Any:
            return u * v * self._weight(w)

        form = load_skfem().BilinearForm(product)
        return sparse.csr_array(form.assemble(self.pressure))

    def part(self, name: str, values: Array) -> Array:
        """Return a derivative of a biquadratic function at the points of integration."""
        field = self.displacement.interpolate(values)
        points = SimpleNamespace(x=np.asarray(self.displacement.global_coordinates()))
        return np.asarray(PARTS[name](field, points))

    def pressure_at_points(self, values: Array) -> Array:
        """Return a bilinear function at the points of integration."""
        return np.asarray(self.pressure.interpolate(values))

    def smoothed(self, fields: Array, places: Array) -> Array:
        """Return fields at places, from their best biquadratic approximation.

        Best in the plane of the section: a weight r would leave the axis to chance.

        Parameters
        ----------
        fields : (n, cells, points) float
            At the points of integration.
        places : (m, 2) float

        Returns
        -------
        (n, m) float
        """
        skfem, basis = load_skfem(), self.displacement

        def against(v: Any, w: Any) -> Any:
            return w["field"] * v

        def product(u: Any, v: Any, w: Any) -> Any:
            return u * v

        form = skfem.LinearForm(against)
        loads = [form.assemble(basis, field=field) for field in fields]
        mass = skfem.BilinearForm(product).assemble(basis)
        values = splu(sparse.csc_array(mass)).solve(np.stack(loads, axis=-1))
        return np.asarray((self._values_at(places) @ values).T)

    def at(self, values: Array, places: Array) -> Array:
        """Return a biquadratic function (nodes, ...) at places (m, 2)."""
        return np.asarray(self._values_at(places) @ values)

    def _values_at(self, places: Array) -> Matrix:
        """Return (places, nodes): the biquadratic functions at places."""
        basis, points = self.displacement, places.T
        cells = self.straight.element_finder()(*points)
        inside = basis.mapping.invF(points[:, :, None], tind=cells)
        shapes = [
            np.asarray(basis.elem.gbasis(basis.mapping, inside, n, tind=cells)[0])[:, 0]
            for n in range(basis.Nbfun)
        ]
        rows = np.tile(np.arange(len(places)), basis.Nbfun)
        columns = np.concatenate(list(basis.element_dofs[:, cells]))
        table = sparse.coo_array(
            (np.concatenate(shapes), (rows, columns)), shape=(len(places), basis.N)
        )
        return sparse.csr_array(table)

    def _weight(self, w: Any) -> Any:
        return w.x[0] if self.round else 1.0


def make_space(mesh: QuadMesh, *, round_section: bool) -> Space:
    """Return the functions on a mesh whose sides on the hemisphere are curved."""
    skfem = load_skfem()
    straight = skfem.MeshQuad(mesh.points.T.copy(), mesh.cells.T.copy())
    curved = skfem.MeshQuad2.from_mesh(straight)
    places = curved.doflocs.copy()
    on_circle = mesh.round_points()[straight.facets].all(axis=0)
    middles = curved.dofs.facet_dofs[0, on_circle]
    places[:, middles] /= np.hypot(*places[:, middles])
    curved = skfem.MeshQuad2(places, curved.t)
    displacement = skfem.Basis(curved, skfem.ElementQuad2(), intorder=6)
    pressure = displacement.with_element(skfem.ElementQuad1())
    return Space(straight, displacement, pressure, round_section)


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
        Factors of the matrix of the free unknowns.
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
