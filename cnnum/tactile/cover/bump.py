"""The cover with hemispherical bumps, by the coefficients that finite elements gave."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib import resources

import numpy as np
from numpy.typing import ArrayLike

from cnnum.arrays import Floats
from cnnum.errors import ArrayError, PhysicsError
from cnnum.tactile import checks, halfspace
from cnnum.tactile.checks import Array, finite
from cnnum.tactile.cover.protocol import Profiles, arguments, to_components

DEPTHS = (0.5, 0.75, 1.0, 1.25, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0)
"""Depths of the taxels under the surface, in bump radii."""

STRETCH = np.concatenate([np.arange(0, 2, 0.05), np.arange(2, 8.01, 0.25)])
"""Distances from the axis over 1 + depth, all in bump radii."""
STRETCH.setflags(write=False)

PATCH = math.sin(5 * math.pi / 32)
"""Radius of the bonded patch on top, in bump radii: 0.47, that of a rigid plate pressed 0.25 in.

A mesh has a node at its rim if its fineness is a multiple of eight.
"""

PROFILES = 7
"""σ_zz, σ_rz, Eε_zz pressed; σ_zz, σ_rz, σ_θz, Eε_zz dragged."""


@dataclass(frozen=True, slots=True)
class BumpTables:
    """Stress for unit force and radius, and also strain for unit modulus, at ν = 0.5.

    Attributes
    ----------
    depths : (depths,) float, bump radii
    lever : float, bump radii
        Height over the surface at which a drag's force makes the moment it does.
    half_space, rigid_base : (depths, 7, distances) float
        Profiles along STRETCH * (1 + depth). One is within a thick block at the depth. The other is
        on the rigid base of a layer that is as thick as the depth.
    """

    depths: Array
    lever: float
    half_space: Array
    rigid_base: Array

    def __post_init__(self) -> None:
        wanted = (np.size(finite("depths", self.depths)), PROFILES, STRETCH.size)
        for name in ("half_space", "rigid_base"):
            shape = finite(name, getattr(self, name)).shape
            if shape != wanted:
                raise ArrayError(f"'{name}': expected shape {wanted}, got {shape}.")


def load_tables() -> BumpTables:
    """Return the tables that ship with the package.

    They come from `cnnum.tactile.cover.fem.generate.regenerate`.
    """
    tables = load_arrays()
    return BumpTables(
        tables["depths"], float(tables["lever"]), tables["half_space"], tables["rigid_base"]
    )


def load_arrays() -> dict[str, Array]:
    """Return every array of the shipped file, by name."""
    file = resources.files("cnnum.tactile.cover") / "bump.npz"
    with file.open("rb") as stream, np.load(stream, allow_pickle=False) as arrays:
        return {name: np.asarray(arrays[name], dtype=np.float64) for name in arrays.files}


@dataclass(frozen=True, slots=True, eq=False)
class Spline:
    """A cubic spline whose end pieces go on over the knots next to the ends ("not a knot").

    Attributes
    ----------
    knots : (n,) float
        Rising.
    pieces : (4, n − 1, ...) float
        Polynomial coefficients of each piece, from the constant to the cubic term.
    """

    knots: Floats
    pieces: Floats

    def __call__(self, places: Floats) -> Floats:
        """Return the values at places, (places, ...); beyond the ends the end pieces go on."""
        at = np.asarray(places, dtype=float)
        piece = np.clip(np.searchsorted(self.knots, at, side="right") - 1, 0, len(self.knots) - 2)
        value, slope, square, cube = self.pieces[:, piece]
        away = (at - self.knots[piece]).reshape(at.shape + (1,) * (value.ndim - at.ndim))
        return np.asarray(value + away * (slope + away * (square + away * cube)))


def spline(knots: Floats, values: Floats) -> Spline:
    """Return the spline through values, (n, ...), at knots: a line at two, a parabola at three.

    The slopes solve the usual system: the curvature has no step at the inner knots. The third
    derivative has none at the second knot and the last but one. The source is de Boor, A Practical
    Guide to Splines (1978), chapter IV.
    """
    gaps = np.diff(knots)
    gap = gaps.reshape(-1, *(1,) * (values.ndim - 1))
    rise = np.diff(values, axis=0) / gap
    if len(knots) < 4:
        curvature = np.diff(rise, axis=0).sum(axis=0) / gaps.sum()
        slopes = np.concatenate([rise[:1] - gap[:1] * curvature, rise + gap * curvature])
    else:
        slopes = _slopes(gaps, gap, rise)
    bend = slopes[:-1] + slopes[1:] - 2.0 * rise
    square = (rise - slopes[:-1] - bend) / gap
    return Spline(knots, np.stack([values[:-1], slopes[:-1], square, bend / gap**2]))


def _slopes(gaps: Floats, gap: Floats, rise: Floats) -> Floats:
    """Return the slopes at four knots or more; `gap` are the gaps in the shape of `rise`."""
    count = len(gaps) + 1
    system, wanted = np.zeros((count, count)), np.empty((count, *rise.shape[1:]))
    inner = np.arange(1, count - 1)
    system[inner, inner - 1], system[inner, inner + 1] = gaps[1:], gaps[:-1]
    system[inner, inner] = 2.0 * (gaps[1:] + gaps[:-1])
    wanted[1:-1] = 3.0 * (gap[1:] * rise[:-1] + gap[:-1] * rise[1:])
    for end, (near, far) in ((0, (0, 1)), (-1, (-1, -2))):  # the gap at the end, and the next one
        both = gaps[near] + gaps[far]
        system[end, near], system[end, far] = gaps[far], both
        first = (gaps[near] + 2.0 * both) * gaps[far] * rise[near]
        wanted[end] = (first + gaps[near] ** 2 * rise[far]) / both
    solved = np.linalg.solve(system, wanted.reshape(count, -1))
    return np.asarray(solved.reshape(wanted.shape), dtype=np.float64)


COUPLE = 0.25
"""Half the distance between the forces of a bump's moment seen from afar, bump radii."""


@dataclass(frozen=True, slots=True)
class BumpCover:
    """Bumps on a square lattice, each pressed and dragged by a patch that sticks to its top.

    Only bumps are touched: a load anywhere on the square of a bump is taken by its top. The
    material is incompressible. See `protocol.Cover`.

    Attributes
    ----------
    depth : float, m
        Depth of the taxels below the foot of the bumps: 0.5 to 5 bump radii.
    youngs_modulus : float, Pa
    bump_radius : float, m
        Ø 0.4 mm in the dissertation.
    pitch : float, m, or None
        From bump to bump; None for a single bump.
    origin : (x, y) float, m
        Position of one of the bumps.
    rigid_base : bool
        False for taxels within a thick cover, as in the dissertation's model. True for taxels on
        the rigid base of a layer as thick as their depth, where ε_zz is zero.
    tables : BumpTables, optional
        Others than the shipped ones.

    References
    ----------
    Vásárhelyi, dissertation (2007), 6.4.
    """

    depth: float
    youngs_modulus: float
    bump_radius: float = 0.2e-3
    pitch: float | None = None
    origin: tuple[float, float] = (0.0, 0.0)
    rigid_base: bool = False
    tables: BumpTables = field(default_factory=load_tables, repr=False, compare=False)
    _spline: Spline = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        checks.positive("youngs_modulus", self.youngs_modulus)
        radius = checks.scalar("bump_radius", checks.positive("bump_radius", self.bump_radius))
        checks.vector("origin", self.origin, 2)
        if (
            self.pitch is not None
            and checks.scalar("pitch", checks.positive("pitch", self.pitch)) < 2 * radius
        ):
            raise PhysicsError(
                f"'pitch': expected at least the bumps' diameter, {2 * radius:g} m, "
                f"got {self.pitch:g}."
            )
        object.__setattr__(self, "_spline", self._at_depth())

    @property
    def relative_depth(self) -> float:
        """Depth in bump radii."""
        return self.depth / self.bump_radius

    def stress(self, load_at: ArrayLike, taxel_at: ArrayLike, force: ArrayLike) -> Array:
        """Return σ_xz, σ_yz, σ_zz at taxels, (..., 3) Pa."""
        return self._components(load_at, taxel_at, force, strain=False)

    def strain(self, load_at: ArrayLike, taxel_at: ArrayLike, force: ArrayLike) -> Array:
        """Return ε_xz, ε_yz, ε_zz at taxels, (..., 3)."""
        return self._components(load_at, taxel_at, force, strain=True)

    def _components(
        self, load_at: ArrayLike, taxel_at: ArrayLike, force: ArrayLike, *, strain: bool
    ) -> Array:
        load, taxel, push = arguments(load_at, taxel_at, force)
        away = taxel - self.touched(load)
        rows = self._rows(np.hypot(away[..., 0], away[..., 1]) / self.bump_radius)
        scale = 1 / self.bump_radius**2
        if not strain:
            parts = Profiles(rows[0], rows[1], rows[3], rows[4], rows[5])
            return scale * to_components(parts, away, push)
        if self.rigid_base:  # nothing incompressible can get thinner on a base it sticks to
            rows[2] = rows[6] = 0.0
        # Eε is 3σ/2 of the shear components; the tables hold that of the normal one
        parts = Profiles(rows[2], 1.5 * rows[1], rows[6], 1.5 * rows[4], 1.5 * rows[5])
        return scale / self.youngs_modulus * to_components(parts, away, push)

    def touched(self, load_at: ArrayLike) -> Array:
        """Return the axis of the bump that takes a load, (..., 2) m."""
        load = checks.vector("load_at", load_at, 2)
        origin = np.asarray(self.origin)
        if self.pitch is None:
            return np.broadcast_to(origin, load.shape)
        return np.asarray(origin + self.pitch * np.rint((load - origin) / self.pitch))

    def _at_depth(self) -> Spline:
        """Return the seven profiles over the stretched distance, times (1 + depth)²."""
        tables, depth = self.tables, checks.scalar("depth", checks.positive("depth", self.depth))
        low, high = tables.depths[0], tables.depths[-1]
        place = depth / self.bump_radius
        if not low * (1 - 1e-9) <= place <= high * (1 + 1e-9):
            raise PhysicsError(
                f"'depth': expected {low:g} to {high:g} bump radii, that is "
                f"{low * self.bump_radius:g} to {high * self.bump_radius:g} m, got {depth:g}."
            )
        profiles = tables.rigid_base if self.rigid_base else tables.half_space
        flattened = profiles * ((1 + tables.depths) ** 2)[:, None, None]
        if len(tables.depths) > 1:
            flattened = spline(np.log(tables.depths), flattened)(np.log(place))
        else:
            flattened = flattened[0]
        return spline(STRETCH, flattened.T)

    def _rows(self, distance: Array) -> Array:
        """Return the seven profiles at distances, unit force and radius, (7, ...)."""
        spread = 1 + self.relative_depth
        stretched = distance / spread
        values = self._spline(np.minimum(stretched, STRETCH[-1])) / spread**2
        near = np.moveaxis(values, -1, 0).copy()  # written to below, row by row
        beyond = stretched > STRETCH[-1]
        if self.rigid_base:
            return np.where(beyond, 0.0, near)
        if beyond.any():
            near[:, beyond] = self._afar(distance[beyond])
        return np.asarray(near)

    def _afar(self, distance: Array) -> Array:
        """Return the profiles of a point load, with the couple that a drag's lever makes."""
        z, lever = self.relative_depth, self.tables.lever
        zero = np.zeros_like(distance)

        def both(x: Array, y: Array, force: list[float]) -> tuple[Array, Array]:
            stress = halfspace.stress(x, y, z, force)
            strain = halfspace.strain(x, y, z, force, youngs_modulus=1.0)
            return stress[..., 2], strain[..., 2]

        def dragged(x: Array, y: Array) -> tuple[Array, Array]:
            pair = lever / (2 * COUPLE)
            parts = both(x, y, [1, 0, 0])
            front = both(x - COUPLE, y, [0, 0, pair])
            back = both(x + COUPLE, y, [0, 0, -pair])
            return parts[0] + front[0] + back[0], parts[1] + front[1] + back[1]

        pushed, pushed_strain = both(distance, zero, [0, 0, 1])
        along, strain = dragged(distance, zero)
        across, _ = dragged(zero, distance)
        rows = [pushed[..., 2], pushed[..., 0], pushed_strain[..., 2]]
        rows += [along[..., 2], along[..., 0], -across[..., 0], strain[..., 2]]
        return np.stack(rows)


RADIUS = 0.2e-3
"""Radius of the bump, m."""

MODULUS = 0.87e6
"""Young's modulus of the dissertation's rubber, Pa."""


@dataclass(frozen=True, slots=True)
class PlaneFigures:
    """Plane stress, Ø 0.4 mm on 4 × 2 mm, ν = 0.499, under a rigid plate that does not slip.

    First axis of pairs: pressed down by 50 µm; dragged sideways by 50 µm with the contact of then.
    Second axis of pairs: the component along x, then along z.

    Attributes
    ----------
    x, z : (81,), (51,) float, m
        Places across, and depths below the surface.
    field : (2, 2, 51, 81) float, m
        Displacement in the block (Fig. 6.9).
    axis : (2, 2, 51) float, m
        Displacement below the middle, over z (Fig. 6.10).
    line : (2, 2, 81) float, m
        Displacement at 200 µm, over x.
    stress : (2, 2, 81) float, Pa
        σ_xz and σ_zz at 200 µm, over x (Fig. 6.12).
    strain : (2, 2, 81) float
        ε_xz (tensor) and ε_zz at 200 µm, over x.
    force : (2,) float, N/m
        Force of the plate, for each metre along the third axis.
    indentation : (10,) float, m
        Steps of the pressed plate up to 100 µm (Fig. 6.11, 6.14).
    growth : (10, 4) float, m
        Under the pressed plate at 200 µm: u_x and u_z below the middle, u_z 260 µm to its left
        and right.
    """

    x: Array
    z: Array
    field: Array
    axis: Array
    line: Array
    stress: Array
    strain: Array
    force: Array
    indentation: Array
    growth: Array

    @property
    def normal_to_shear(self) -> float:
        """FzUz over FxUx below the middle at 200 µm, equal indentations; "about two" (6.11)."""
        middle = self.x.size // 2
        return float(self.line[0, 1, middle] / self.line[1, 0, middle])

    @property
    def cross_talk(self) -> float:
        """The larger of FzUx/FzUz and FxUz/FxUx below the middle at 200 µm; "zero" (6.11)."""
        middle = self.line[:, :, self.x.size // 2]
        return float(max(abs(middle[0, 0] / middle[0, 1]), abs(middle[1, 1] / middle[1, 0])))

    @property
    def stress_extrema(self) -> tuple[float, float]:
        """Where the dragged plate's σ_zz at 200 µm is lowest and highest, m (6.12)."""
        values = self.stress[1, 1]
        return float(self.x[values.argmin()]), float(self.x[values.argmax()])

    @property
    def pad_ratio(self) -> float:
        """T_z over T_x of (6.1) at 50 µm, taxels at the extrema of the dragged u_z; "about 4".

        Fig. 6.14 names deformations, so u_z stands for the taxels' signals; of stress the ratio
        is `pad_stress_ratio`.
        """
        place = int(self.line[1, 1].argmax())
        return float(self.line[0, 1, place] / self.line[1, 1, place])

    @property
    def pad_stress_ratio(self) -> float:
        """The same of σ_zz, at the extrema of the dragged σ_zz."""
        place = int(self.stress[1, 1].argmin())
        return float(self.stress[0, 1, place] / self.stress[1, 1, place])

    @property
    def nonlinearity(self) -> float:
        """Largest deviation of FzUz(indentation) from the best straight line, over its range."""
        line = np.polyval(np.polyfit(self.indentation, self.growth[:, 1], 1), self.indentation)
        return float(np.abs(line - self.growth[:, 1]).max() / np.ptp(self.growth[:, 1]))

    @classmethod
    def of_tables(cls, tables: Mapping[str, Array]) -> "PlaneFigures":
        """Return the figures in SI units.

        Parameters
        ----------
        tables : mapping of str to array
            As `cnnum.tactile.cover.fem.generate.plane_tables` gives them: lengths in bump radii,
            stress in Young's moduli.
        """
        return cls(
            x=RADIUS * tables["plane_x"],
            z=RADIUS * tables["plane_z"],
            field=RADIUS * tables["plane_field"],
            axis=RADIUS * tables["plane_axis"],
            line=RADIUS * tables["plane_line"],
            stress=MODULUS * tables["plane_stress"],
            strain=tables["plane_strain"],
            force=MODULUS * RADIUS * tables["plane_force"],
            indentation=RADIUS * tables["plane_indentation"],
            growth=RADIUS * tables["plane_growth"],
        )


def plane_figures() -> PlaneFigures:
    """Return the plane model in SI units, from the data that ships with the package.

    It comes from `cnnum.tactile.cover.fem.generate.regenerate`.
    """
    return PlaneFigures.of_tables(load_arrays())
