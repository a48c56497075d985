"""The cover as an elastic lattice.

The weak fading of short waves on a lattice, made up for in its loads.

A wave of number k fades with depth as exp(−kz). On a lattice of cells of 1 it fades as exp(−κz),

    (2/s) sinh(κs/2) = √(4 sin²(k_x/2) + 4 sin²(k_y/2)),

which is less: κ < k. A template of 3×3 gives loads the difference, exp(−(k − κ)z). It does so as
near as nine weights come on the waves that reach the taxels.

The equilibrium of an elastic solid on a staggered lattice of cellular layers.

(1 − 2ν) Δu + grad div u = 0, equation (4.8) of Vásárhelyi's dissertation (2007), is divergence of
stress. The lattice is staggered (Harlow & Welch 1965; for solids Virieux 1986). Normal stress lies
in the middle of a cell, displacement on its faces, shear stress on its edges. So every difference
is central, of second order, and nothing locks as ν nears 1/2: an incompressible solid is a place
like any other. Columns run along x, rows along y, slabs along z. u_x and u_y of slab s lie between
the planes s and s + 1, u_z lies on the planes. The traction on plane 0 is the input; the last plane
is held. Lengths are cells, displacements are times the shear modulus.
"""

from dataclasses import dataclass

import numpy as np

from cnnum.arrays import Floats
from cnnum.errors import ProgramError
from cnnum.templating.template import Template

WAVES = 48
"""Wave numbers to each axis at which the weights are fitted."""


def fading_error(k_x: Floats, k_y: Floats, depth: float, slab: float) -> Floats:
    """Return the ratio by which waves fade more in depth than on the lattice.

    Parameters
    ----------
    k_x, k_y : (...) float
        Per cell.
    depth, slab : float
        Depth of the plane and of a slab, cells.

    Returns
    -------
    (...) float
        From 0 to 1.
    """
    seen = np.sqrt(4.0 * np.sin(k_x / 2) ** 2 + 4.0 * np.sin(k_y / 2) ** 2)
    slower = 2.0 * np.arcsinh(seen * slab / 2) / slab
    return np.asarray(np.exp((slower - np.hypot(k_x, k_y)) * depth), dtype=np.float64)


def matched(depth: float, slab: float) -> Template:
    """Return the template for loads whose effect is read at a depth, in cells."""
    turn = np.asarray(2.0 * np.pi * np.fft.fftfreq(WAVES), dtype=np.float64)
    k_x, k_y = np.meshgrid(turn, turn)
    wanted = fading_error(k_x, k_y, depth, slab).ravel()
    # half of the waves that reach the depth: errors of short waves count less, but do
    weight = np.exp(-0.5 * depth * np.hypot(k_x, k_y)).ravel()
    cosines = np.cos(k_x), np.cos(k_y)
    shapes = np.stack(
        [np.ones(weight.size), (cosines[0] + cosines[1]).ravel(), (cosines[0] * cosines[1]).ravel()]
    )
    middle, edge, across = np.linalg.lstsq((weight * shapes).T, weight * wanted, rcond=None)[0]
    side, corner = edge / 2.0, across / 4.0
    weights = [[corner, side, corner], [side, middle, side], [corner, side, corner]]
    return Template(
        f"matched to {depth:g} cells", [[0.0]], weights, boundary="periodic", output="linear"
    )


Key = tuple[str, int, int, int]
"""A quantity, its slab or plane, and the offset of a neighbour along rows and columns."""

INPUTS = ("q_x", "q_y", "p")


class Form:
    """A sum of weighted neighbours: a difference of displacements and tractions."""

    __slots__ = ("terms",)

    def __init__(self, terms: dict[Key, float]) -> None:
        self.terms = terms

    def __add__(self, other: "Form") -> "Form":
        total = dict(self.terms)
        for key, weight in other.terms.items():
            total[key] = total.get(key, 0.0) + weight
        return Form(total)

    def __mul__(self, factor: float) -> "Form":
        return Form({key: factor * weight for key, weight in self.terms.items()})

    __rmul__ = __mul__

    def __sub__(self, other: "Form") -> "Form":
        return self + other * -1.0

    def moved(self, axis: str, by: int) -> "Form":
        """Return it at the neighbour along "x" or "y"."""
        rows, columns = (0, by) if axis == "x" else (by, 0)
        return Form({(q, s, r + rows, c + columns): w for (q, s, r, c), w in self.terms.items()})

    def ahead(self, axis: str) -> "Form":
        """Return the difference to the next neighbour."""
        return self.moved(axis, 1) - self

    def behind(self, axis: str) -> "Form":
        """Return the difference from the neighbour before."""
        return self - self.moved(axis, -1)

    def centred(self, axis: str) -> "Form":
        """Return the mean with the neighbour before: from faces to the middle."""
        return 0.5 * (self + self.moved(axis, -1))


@dataclass(frozen=True, slots=True)
class ElasticLattice:
    """A block of an elastic solid, a torus along the surface, held at its base.

    Attributes
    ----------
    slabs : int
    slab : float
        Their thickness, cells.
    poisson : float
        Poisson's ratio, from 0 up to below 1/2.

    Raises
    ------
    ProgramError
        If one of them is out of range.
    """

    slabs: int
    slab: float
    poisson: float

    def __post_init__(self) -> None:
        if not (self.slabs >= 2 and self.slab > 0 and 0.0 <= self.poisson < 0.5):
            raise ProgramError(
                "A block needs at least 2 slabs of positive thickness, and a Poisson ratio from "
                f"0 to below 0.5, got {self.slabs}, {self.slab} and {self.poisson}."
            )

    def displacement(self, axis: str, place: int) -> Form:
        """Return u_x or u_y of a slab, or u_z of a plane, where it lies."""
        held = axis == "z" and place == self.slabs
        return Form({} if held else {(f"u_{axis}", place, 0, 0): 1.0})

    def normal_stress(self, axis: str, slab: int) -> Form:
        """Return σ_xx, σ_yy or σ_zz in the middle of the cells of a slab."""
        return 2.0 * self._stretch(axis, slab) + self._squeeze * self._volume(slab)

    def level_stress(self, plane: int) -> Form:
        """Return σ_zz in the middle of the cells' faces on a plane inside."""
        return 0.5 * (self.normal_stress("z", plane - 1) + self.normal_stress("z", plane))

    def shear_stress(self, axis: str, plane: int) -> Form:
        """Return σ_xz or σ_yz on a plane, half a cell ahead along x or y."""
        if plane == 0:
            load = Form({(f"q_{axis}", 0, 0, 0): -0.5})
            return load + load.moved(axis, 1)  # halfway between two cells
        if plane == self.slabs:
            return (-2.0 / self.slab) * self.displacement(axis, plane - 1)
        rise = self.displacement(axis, plane) - self.displacement(axis, plane - 1)
        return (1.0 / self.slab) * rise + self.displacement("z", plane).ahead(axis)

    def forces(self) -> dict[tuple[str, int], Form]:
        """Return the force on every displacement, of unit volume; 0 in equilibrium."""
        result: dict[tuple[str, int], Form] = {}
        for slab in range(self.slabs):
            result["u_x", slab] = self._sideways("x", "y", slab)
            result["u_y", slab] = self._sideways("y", "x", slab)
            result["u_z", slab] = self._down(slab)
        return result

    def template(self) -> Template:
        """Return the CNN that relaxes to the equilibrium, its layers in the order of `forces`."""
        forces = self.forces()
        layer = {key: n for n, key in enumerate(forces)}
        A = np.zeros((len(layer), len(layer), 3, 3))
        B = np.zeros((len(layer), len(INPUTS), 3, 3))
        for (name, place), force in forces.items():
            to = layer[name, place]
            pace = -1.0 / force.terms[name, place, 0, 0]
            A[to, to, 1, 1] = 1.0
            for (quantity, at, row, column), weight in force.terms.items():
                if quantity in INPUTS:
                    B[to, INPUTS.index(quantity), 1 + row, 1 + column] += pace * weight
                else:
                    A[to, layer[quantity, at], 1 + row, 1 + column] += pace * weight
        return Template(
            f"elastic block of {self.slabs} slabs, ν = {self.poisson:g}",
            A,
            B,
            boundary="periodic",
            duration="settle",
            output="linear",
        )

    @property
    def _squeeze(self) -> float:
        """Lamé's λ over the shear modulus."""
        return 2.0 * self.poisson / (1.0 - 2.0 * self.poisson)

    def _stretch(self, axis: str, slab: int) -> Form:
        if axis != "z":
            return self.displacement(axis, slab).behind(axis)
        rise = self.displacement("z", slab + 1) - self.displacement("z", slab)
        return (1.0 / self.slab) * rise

    def _volume(self, slab: int) -> Form:
        x, y, z = (self._stretch(axis, slab) for axis in "xyz")
        return x + y + z

    def _sideways(self, axis: str, other: str, slab: int) -> Form:
        along = self.normal_stress(axis, slab).ahead(axis)
        turned = self.displacement(axis, slab).ahead(other)
        turned = turned + self.displacement(other, slab).ahead(axis)
        down = self.shear_stress(axis, slab + 1) - self.shear_stress(axis, slab)
        return along + turned.behind(other) + (1.0 / self.slab) * down

    def _down(self, plane: int) -> Form:
        sides = self.shear_stress("x", plane).behind("x")
        sides = sides + self.shear_stress("y", plane).behind("y")
        if plane == 0:  # half a slab hangs on the surface
            load = Form({("p", 0, 0, 0): 1.0})
            return sides + (2.0 / self.slab) * (self.normal_stress("z", 0) + load)
        down = self.normal_stress("z", plane) - self.normal_stress("z", plane - 1)
        return sides + (1.0 / self.slab) * down
