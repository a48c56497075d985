"""The geometry of covers for finite elements, and their sections.

The section of a bump on its block, cut into quadrangles.

Lengths are in bump radii. The first axis runs sideways from the bump's middle. The second runs into
the material, 0 on the surface of the block: the bump's top is at -1.

The kinds of section: plane stress, or one Fourier mode of a body of revolution.

A strain is a row of (field, part, factor); `space.PARTS` names the parts. In a body of revolution
the displacement is (u_r cos mθ, u_θ sin mθ, u_z cos mθ). For m = 1 the second field is s = u_r +
u_θ, zero on the axis. So a sideways push is u_r = 1, s = 0, u_z = 0.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import asin, sqrt

import numpy as np
from numpy.typing import NDArray

from cnnum.errors import PhysicsError
from cnnum.tactile.checks import Array

Cells = NDArray[np.int64]

CORE = 0.5
"""Side of the square core of the bump's mesh."""


@dataclass(frozen=True, slots=True)
class Shape:
    """A hemisphere on a block, with a straight 45° fillet between them.

    Attributes
    ----------
    half_width, depth : float
        Half the width and the depth of the block, in bump radii.
    fillet : float
        Height of the fillet, in bump radii: it takes the sharpness from the inner corner, as
        the additional element of the dissertation's model does.
    growth : float
        From cell to cell away from the bump.
    """

    half_width: float
    depth: float
    fillet: float = 0.1
    growth: float = 1.1

    def __post_init__(self) -> None:
        if not 0 < self.fillet < 0.5:
            raise PhysicsError(
                f"'fillet': expected above 0 and below 0.5 radii, got {self.fillet:g}."
            )
        if not 1 < self.growth <= 2:
            raise PhysicsError(f"'growth': expected above 1, at most 2, got {self.growth:g}.")
        if self.half_width < 2 * self.foot or self.depth <= 0:
            raise PhysicsError(
                f"Expected a block at least {2 * self.foot:.2f} radii to each side and above 0 "
                f"deep, got {self.half_width:g} and {self.depth:g}."
            )

    @property
    def foot(self) -> float:
        """Half-width of bump and fillet on the surface of the block, in bump radii."""
        return sqrt(1 - self.fillet**2) + self.fillet


@dataclass(frozen=True, slots=True)
class QuadMesh:
    """Quadrangles; `round_points` names the corners that lie on the hemisphere.

    Attributes
    ----------
    points : (n, 2) float, bump radii
    cells : (m, 4) int
        Corners of each, counter-clockwise or all clockwise.
    """

    points: Array
    cells: Cells

    def round_points(self) -> NDArray[np.bool_]:
        """(n,) bool. Which corners lie on the hemisphere."""
        away = np.hypot(*self.points.T)
        return np.asarray((np.abs(away - 1) < 1e-9) & (self.points[:, 1] < 0))


def half_section(shape: Shape, fineness: int) -> QuadMesh:
    """Return the mesh of the section right of the axis.

    Parameters
    ----------
    shape : Shape
    fineness : int
        Cells along an eighth of the circle; four and more.

    Raises
    ------
    PhysicsError
        If the fineness is below four.
    """
    if fineness < 4:
        raise PhysicsError(f"'fineness': expected 4 cells or more, got {fineness}.")
    inner = np.linspace(0, CORE, fineness + 1)
    outer = np.linspace(CORE, shape.foot, fineness + 1)[1:]
    beyond = _graded(shape.foot, shape.half_width, (shape.foot - CORE) / fineness, shape.growth)
    columns = np.concatenate([inner, outer, beyond])
    rows = _graded(0.0, shape.depth, CORE / fineness, shape.growth)
    block = _patch(*np.meshgrid(columns, np.concatenate([[0.0], rows]), indexing="ij"))
    return _joined([block, *_bump(shape, fineness)])


def full_section(shape: Shape, fineness: int) -> QuadMesh:
    """Return the mesh of the whole section, its left half the mirror of `half_section`."""
    right = half_section(shape, fineness)
    left = QuadMesh(right.points * [-1.0, 1.0], right.cells[:, ::-1])
    return _joined([right, left])


def _bump(shape: Shape, n: int) -> list[QuadMesh]:
    """Return a square core, and two patches between it and the outline."""
    t = np.linspace(0, 1, n + 1)
    middle, corner = np.zeros(2), np.array([0.42, -0.42])
    right, low = np.array([CORE, 0.0]), np.array([0.0, -CORE])
    ceiling = _line(low, corner, t)
    core = _between(_line(middle, right, t), ceiling)
    side = _between(_line(right, corner, t), _outline(shape, n))
    top = _between(ceiling, _arc(np.pi / 2 - np.pi / 4 * t))
    return [core, side, top]


def _outline(shape: Shape, n: int) -> Array:
    """Return n + 1 points from the foot of the fillet to 45° of the circle."""
    steps = max(1, round(n * shape.fillet * sqrt(2) / (shape.fillet * sqrt(2) + np.pi / 4)))
    start = np.array([shape.foot, 0.0])
    joint = np.array([sqrt(1 - shape.fillet**2), -shape.fillet])
    fillet = _line(start, joint, np.linspace(0, 1, steps + 1))
    rest = np.linspace(asin(shape.fillet), np.pi / 4, n - steps + 1)[1:]
    return np.concatenate([fillet, _arc(rest)])


def _arc(angle: Array) -> Array:
    """Return points of the circle at angles over the surface."""
    return np.stack([np.cos(angle), -np.sin(angle)], axis=-1)


def _line(start: Array, end: Array, t: Array) -> Array:
    return np.asarray(start + t[:, None] * (end - start))


def _between(first: Array, second: Array) -> QuadMesh:
    """Return the ruled patch between two rows of equally many points."""
    t = np.linspace(0, 1, len(first))[:, None, None]
    grid = first + t * (second - first)
    return _patch(grid[..., 0], grid[..., 1])


def _patch(x: Array, z: Array) -> QuadMesh:
    number = np.arange(x.size).reshape(x.shape)
    corners = [number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]]
    cells = np.stack([c.reshape(-1) for c in corners], axis=-1)
    return QuadMesh(np.stack([x.reshape(-1), z.reshape(-1)], axis=-1), cells)


def _joined(parts: Sequence[QuadMesh]) -> QuadMesh:
    """Return one mesh, points at the same place taken as one, all cells turned one way."""
    shift = np.cumsum([0, *(len(p.points) for p in parts[:-1])])
    points = np.concatenate([p.points for p in parts])
    cells = np.concatenate([p.cells + s for p, s in zip(parts, shift, strict=True)])
    _, first, place = np.unique(
        np.rint(points * 1e9).astype(np.int64), axis=0, return_index=True, return_inverse=True
    )
    cells = place.reshape(-1)[cells]
    merged = points[first]
    turned = _signed_area(merged[cells]) < 0
    cells[turned] = cells[turned, ::-1]
    return QuadMesh(merged, cells)


def _signed_area(corners: Array) -> Array:
    first, second = corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1]
    return np.asarray(first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0])


def _graded(start: float, end: float, first: float, growth: float) -> Array:
    """Return the points after `start` up to `end`: cells that begin with `first` and grow."""
    count = max(1, round(np.log1p((end - start) * (growth - 1) / first) / np.log(growth)))
    places = np.cumsum(growth ** np.arange(count))
    return np.append(start + places[:-1] * ((end - start) / places[-1]), end)


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
