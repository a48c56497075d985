"""Stress and strain under an elastic cover by relaxing a stack of depth layers.

The elastic half-space is a stack of cellular layers, one per depth, that relaxes to a harmonic
function. Layer j represents the plane at depth z_j. Its equilibrium is F = exp(−kz)/k u, the
harmonic function of slope −u on the surface. Between two planes, a wave is a sum of cosh and sinh.
The planes of equal slabs of thickness d therefore obey, without any discretisation error in depth,

    2 cosh(kd) F_j = F_{j−1} + F_{j+1},       cosh(kd) F_0 − F_1 = (sinh(kd)/k) u,

and where slabs begin to be twice as thick, with c = cosh(kd) and C = cosh(2kd),

    (1 + 2C) F_j = 2c F_{j−1} + F_{j+1}.

With k² = −Laplacian, the series of cosh to k² is a 3×3 template, to k⁴ a 5×5 one: the error falls
as d² or d⁴. Each row is divided by the largest weight of its own layer. That makes it the
equilibrium of a CNN layer.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.signal import convolve2d

from cnnum.arrays import Floats
from cnnum.errors import ProgramError
from cnnum.graph.nodes import RunSpec
from cnnum.programs import program
from cnnum.programs.fields import Field
from cnnum.programs.machine import FrameFields
from cnnum.programs.parameters import refuse_outside
from cnnum.programs.transients import apply, transient
from cnnum.templates.tactile.cover_model.fields import Surface, depth_in_cells
from cnnum.templating.library import get_template
from cnnum.templating.template import Template

COARSER = 4
"""Slabs of equal thickness below the taxels, after which the thickness doubles. With three of
them, the error of doubling exceeds 1e-5; five add layers without any gain."""

ORDERS = (2, 4)

HIGHEST = 8.0
"""Largest k² of the five-point Laplacian."""

PATIENCE = 1e6
"""Time constants after which a relaxation gives up: far above the slowest of 64×64 cells."""


@dataclass(frozen=True, slots=True)
class Stack:
    """Slabs of a half-space.

    Attributes
    ----------
    slabs : tuple of float
        Thicknesses from the surface down, cells; below the last one nothing moves.
    taxels : int
        Number of slabs above the plane of the taxels. These and the one below have the same
        thickness.
    order : 2 or 4
        Order of the error in the slabs' thickness.
    """

    slabs: tuple[float, ...]
    taxels: int
    order: int

    @property
    def depth(self) -> float:
        """Depth of the taxels, cells."""
        return self.slabs[0] * self.taxels

    def template(self) -> Template:
        """Return the CNN with one layer per plane, whose input is u."""
        layers, size = len(self.slabs), self.order + 1
        A, B = np.zeros((layers, layers, size, size)), np.zeros((layers, 1, size, size))
        for row, (own, above, below) in enumerate(self._rows()):
            scale = np.polynomial.polynomial.polyval(HIGHEST, own)
            A[row, row] = _kernel([1.0], size) - _kernel(own, size) / scale
            (A[row, row - 1] if row else B[0, 0])[:] = _kernel(above, size) / scale
            if row + 1 < layers:
                A[row, row + 1] = _kernel(below, size) / scale
        return Template(
            f"{layers} depth layers of order {self.order}",
            A,
            B,
            boundary="zero-flux",
            duration="settle",
            output="linear",
        )

    def _rows(self) -> list[tuple[list[float], list[float], list[float]]]:
        """Return the series in k² of each plane: its own, that of the one above, and below."""
        first = self.slabs[0]
        rows = [(self._cosh(first), [first * part for part in self._sinh(first)], [1.0])]
        for above, below in zip(self.slabs, self.slabs[1:], strict=False):
            own, upper = ([2.0 * part for part in self._cosh(slab)] for slab in (below, above))
            own[0] += below != above
            rows.append((own, [1.0] if below == above else upper, [1.0]))
        return rows

    def _cosh(self, slab: float) -> list[float]:
        return [1.0, slab**2 / 2, slab**4 / 24][: self.order // 2 + 1]

    def _sinh(self, slab: float) -> list[float]:
        """Return the series of sinh(kd)/(kd)."""
        return [1.0, slab**2 / 6][: self.order // 2]


def stack_of(
    depth: float, shape: tuple[int, int], layers: int, order: int, tolerance: float
) -> Stack:
    """Return a stack for taxels `depth` cells deep under an array of that shape.

    It ends where the array's longest wave, reflected there and back at the taxels, is below
    `tolerance`.

    Raises
    ------
    ProgramError
        If the number of layers, the order or the tolerance is out of range.
    """
    if not (layers >= 1 and int(layers) == layers and order in ORDERS and 1e-9 < tolerance < 0.1):
        raise ProgramError(
            "Expected a whole number of layers, the order 2 or 4 and a tolerance between 1e-9 and "
            f"0.1; got {layers}, {order} and {tolerance}."
        )
    slowest = 2 * math.sin(math.pi / (2 * max(2, *shape)))
    end = depth - math.log(tolerance) / (2 * slowest)
    slab = depth / layers
    slabs, reached = [slab] * (layers + 1), depth + slab
    while reached < end:
        if (len(slabs) - layers) % COARSER == 0:
            slab *= 2
        slabs.append(slab)
        reached += slab
    return Stack(tuple(slabs), layers, order)


@dataclass(frozen=True, slots=True)
class LayerExtension:
    """The harmonic extension of one map, read off three planes of a relaxed stack."""

    stack: Stack
    above: Field
    own: Field
    below: Field
    mean: Field

    def harmonic(self) -> Field:
        """Return exp(−kz) u, the slope of F at the taxels."""
        slab = self.stack.slabs[0]
        slope = (self.above - self.below) * (0.5 / slab)
        if self.stack.order > 2:
            # sinh(kd)/kd = 1 + (kd)²/6 is the factor of a central difference on a slope
            slope = slope + slab * slab / 6 * _laplacian(slope)
        return slope + self.mean

    def potential(self) -> Field:
        """Return exp(−kz)/k u."""
        return self.own

    def low_pass(self) -> Field:
        """Return (1 + kz) exp(−kz) u."""
        return self.harmonic() + self.band_pass()

    def band_pass(self) -> Field:
        """Return kz exp(−kz) u = z k² F."""
        return -self.stack.depth * _laplacian(self.own)


def relaxed(value: Field, stack: Stack, method: str, rtol: float) -> LayerExtension:
    """Relax the stack under a map; the mean, which does not decay, is kept separately."""
    mean = value.mean()
    spec = RunSpec(method=method, rtol=rtol, atol=rtol, settle_limit=PATIENCE)
    states = transient(stack.template(), input=value - mean, spec=spec).states
    at = stack.taxels
    return LayerExtension(stack, states[at - 1], states[at], states[at + 1], mean)


def _laplacian(value: Field) -> Field:
    return apply(get_template("laplacian"), input=value)


def _kernel(series: list[float], size: int) -> Floats:
    """Return the template of a series in k² = −Laplacian."""
    minus = np.array([[0.0, -1.0, 0.0], [-1.0, 4.0, -1.0], [0.0, -1.0, 0.0]])
    total, power = np.zeros((size, size)), np.ones((1, 1))
    for part in series:
        total += part * np.pad(power, (size - len(power)) // 2)
        power = convolve2d(power, minus)
    return total


@program
def halfspace_layers(
    frame: FrameFields,
    *,
    thickness: float = 1.0e-3,
    pitch: float = 1.5e-3,
    cells: int = 1,
    youngs_modulus: float = 0.87e6,
    layers: int = 8,
    order: int = 4,
    tolerance: float = 1e-6,
    method: str = "auto",
) -> Mapping[str, Field]:
    """Compute stress and strain under a load on an incompressible cover, from a stack of layers.

    The lattice and its boundary are those of `halfspace_stress`, but the depth is divided into
    slabs, and the error falls with the second or fourth power of their thickness.

    Parameters
    ----------
    frame, thickness, pitch, cells
        As in `halfspace_stress`.
    youngs_modulus : float, Pa
        Young's modulus of the cover.
    layers : int
        Number of slabs between surface and taxels; below the taxels, slabs become thicker.
    order : 2 or 4
        Order of the error in the slab thickness: 2 with 3×3 templates, 4 with 5×5 templates.
    tolerance : float
        Tolerance of the reflection at the end of the stack, as a share of the load.
    method : str
        How the layers reach equilibrium: "auto" needs no time steps if the engine supports that,
        and "runge-kutta-chebyshev" relaxes in steps.

    Returns
    -------
    mapping
        `stress_xz`, `stress_yz`, `stress_zz`, Pa, and `strain_xz`, `strain_yz`, `strain_zz`.

    Raises
    ------
    ProgramError
        If a size, the layers, the order or the tolerance is out of range.
    """
    refuse_outside(youngs_modulus=(youngs_modulus, 1e-9, 1e15), layers=(layers, 0, 256))
    depth = depth_in_cells(thickness, pitch, cells)
    stack = stack_of(depth, frame.shape, layers, order, tolerance)
    x, y, p = (
        relaxed(frame.channel(c), stack, method, tolerance)
        for c in ("shear_x", "shear_y", "normal")
    )
    surface = Surface(x, y, p, depth)
    return {**surface.stress(), **surface.strain(youngs_modulus)}
