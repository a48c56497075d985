"""Biquadratic and bilinear functions on a mesh, and the matrices between their derivatives."""

from collections.abc import Callable
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu

from cnnum.tactile.checks import Array
from cnnum.tactile.cover.fem.geometry import QuadMesh
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
