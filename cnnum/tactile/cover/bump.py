"""The cover with hemispherical bumps, by the coefficients that finite elements gave."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from cnnum.errors import PhysicsError
from cnnum.tactile import checks, halfspace
from cnnum.tactile.checks import Array
from cnnum.tactile.cover.axial import Profiles, to_components
from cnnum.tactile.cover.protocol import arguments
from cnnum.tactile.cover.spline import Spline, spline
from cnnum.tactile.cover.tables import STRETCH, BumpTables, load_tables

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
        Of one of the bumps.
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
        found = self._spline(np.minimum(stretched, STRETCH[-1])) / spread**2
        near = np.moveaxis(found, -1, 0).copy()  # written to below, row by row
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
