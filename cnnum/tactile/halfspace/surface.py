"""From surface tractions to what taxels under the cover see: cell by cell, or wave by wave.

The half-space as a spatial filter: its response to a traction of one wave vector.

A traction q exp(i(k_x x + k_y y)) gives stress of the same wave vector; the factors between them
are here. k = |k| and depth z meet as kz alone, in three shapes. They are the harmonic extension
e^{-kz}, the low-pass (1 + kz) e^{-kz} and the band-pass kz e^{-kz}. Normal stress is the low-pass,
and normal strain is the band-pass at ν = 0.5.
"""

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from functools import partial

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cnnum.errors import ArrayError, UnknownNameError, name_error
from cnnum.tactile import checks
from cnnum.tactile.checks import Array, broadcasting
from cnnum.tactile.grid import Grid, make_grid
from cnnum.tactile.halfspace import influence
from cnnum.tactile.halfspace.influence import AXES, COMPONENTS
from cnnum.tactile.halfspace.rectangle import parity, rectangle_functions

Complex = NDArray[np.complex128]


@broadcasting
def harmonic_extension(k: ArrayLike, depth: ArrayLike) -> Array:
    """Return e^{-kz}: how a harmonic field of wave number k fades with depth.

    Parameters
    ----------
    k : (...) float, rad/m
        Wave number, 0 or more.
    depth : (...) float, m
        Depth z, 0 or more.

    Raises
    ------
    PhysicsError
        If a number is negative or not finite.
    """
    return np.asarray(np.exp(-_reach(k, depth)))


@broadcasting
def low_pass(k: ArrayLike, depth: ArrayLike) -> Array:
    """Return (1 + kz) e^{-kz}: normal stress at depth divided by surface pressure, times -1.

    Parameters and errors are those of `harmonic_extension`; valid for any ν.
    """
    reach = _reach(k, depth)
    return np.asarray((1 + reach) * np.exp(-reach))


@broadcasting
def band_pass(k: ArrayLike, depth: ArrayLike) -> Array:
    """Return kz e^{-kz}: normal strain at depth divided by pressure, times -2E/3, for ν = 0.5.

    Parameters and errors are those of `harmonic_extension`. The filter peaks at k = 1/z and removes
    the mean: the "Mexican hat" of Vásárhelyi's dissertation (2007), 4.2.4.
    """
    reach = _reach(k, depth)
    return np.asarray(reach * np.exp(-reach))


@broadcasting
def stress_transfer(kx: ArrayLike, ky: ArrayLike, depth: ArrayLike) -> Complex:
    """Return the factors from surface traction to the stress that taxels measure.

    Parameters
    ----------
    kx, ky : (...) float, rad/m
        Wave vector.
    depth : (...) float, m
        Depth z, 0 or more.

    Returns
    -------
    (..., 3, 3) complex
        Rows σ_xz, σ_yz, σ_zz; columns q_x, q_y, p. They are the same for every Poisson ratio.

    Raises
    ------
    PhysicsError
        If the depth is negative or a number not finite.

    References
    ----------
    Fourier transform of Boussinesq's and Cerruti's solutions (Johnson, Contact Mechanics, 3.2).
    """
    kx, ky = checks.finite("kx", kx), checks.finite("ky", ky)
    z = checks.not_negative("depth", depth)
    k = np.hypot(kx, ky)
    ex, ey = _direction(kx, ky, k)
    reach = k * z
    rows = [
        [-1 + reach * ex * ex, reach * ex * ey, 1j * reach * ex],
        [reach * ex * ey, -1 + reach * ey * ey, 1j * reach * ey],
        [1j * reach * ex, 1j * reach * ey, -1 - reach],
    ]
    return _matrix(rows, np.exp(-reach))


@broadcasting
def strain_transfer(
    kx: ArrayLike,
    ky: ArrayLike,
    depth: ArrayLike,
    *,
    youngs_modulus: ArrayLike,
    poisson: ArrayLike = 0.5,
) -> Complex:
    """Return the factors from surface traction to the strain that taxels measure.

    Parameters
    ----------
    kx, ky, depth
        As in `stress_transfer`.
    youngs_modulus, poisson : (...) float
        Young's modulus, Pa, and Poisson's ratio, above -1 and at most 0.5.

    Returns
    -------
    (..., 3, 3) complex, 1/Pa
        Rows ε_xz, ε_yz, ε_zz (tensor strains); columns q_x, q_y, p. At k = 0 and ν < 0.5, they are
        means over all directions of a vanishing wave vector, as for a very large loaded disc.

    Raises
    ------
    PhysicsError
        If E <= 0, the depth is negative, ν is out of range, or a number not finite.
    """
    modulus = checks.positive("youngs_modulus", youngs_modulus)
    ratio = checks.poisson_ratio(poisson)
    kx, ky, depth = (
        checks.finite(name, part) for name, part in (("kx", kx), ("ky", ky), ("depth", depth))
    )
    shape = np.broadcast_shapes(*(np.shape(part) for part in (kx, ky, depth, modulus, ratio)))
    factors = np.broadcast_to(stress_transfer(kx, ky, depth), (*shape, 3, 3)).copy()
    k = np.hypot(kx, ky)
    ex, ey = _direction(kx, ky, k)
    fade = 2 * ratio * np.exp(-k * checks.not_negative("depth", depth))
    for column, trace in enumerate((1j * ex, 1j * ey, -np.ones_like(k))):
        factors[..., 2, column] -= fade * trace
    return np.asarray(((1 + ratio) / modulus)[..., None, None] * factors)


def _reach(k: ArrayLike, depth: ArrayLike) -> Array:
    return checks.not_negative("k", k) * checks.not_negative("depth", depth)


def _direction(kx: Array, ky: Array, k: Array) -> tuple[Array, Array]:
    """Return k's direction, 0 at k = 0."""
    safe = np.where(k > 0, k, 1.0)
    return kx / safe, ky / safe


def _matrix(rows: Sequence[Sequence[NDArray[np.generic]]], factor: Array) -> Complex:
    parts = np.broadcast_arrays(*(part for row in rows for part in row))
    flat = np.stack(parts, axis=-1).astype(np.complex128)
    return flat.reshape(*flat.shape[:-1], 3, 3) * factor[..., None, None]


TAXEL = ("xz", "yz", "zz")
_CHUNK_BYTES = 1e6  # the working set stays in the cache


@dataclass(frozen=True, slots=True)
class SurfaceToDepth:
    """The map from surface tractions to stress or strain at one depth; computes its kernels once.

    Every cell carries a uniform traction. A zero-padded FFT sums its exact influence (Love,
    Cerruti) on the point below each cell's centre. The surface around the map is therefore free of
    load, and nothing wraps around.

    Parameters
    ----------
    shape : (rows, cols) int
        Cells of the map; columns run along x, rows along y.
    spacing : float or (dy, dx) float, m
        Size of a cell.
    depth : float, m
        Depth of the plane, 0 or more.
    poisson : float
        Poisson's ratio, above -1 and at most 0.5. σ_xz, σ_yz and σ_zz do not depend on it.
    components : sequence of str
        Which of "xx", "yy", "zz", "yz", "xz", "xy" to compute, in the order of the result.
    youngs_modulus : float, Pa, or None
        None for stress; a number for the tensor strain of a solid with that modulus.

    Raises
    ------
    ArrayError
        If the shape or spacing is not that of a grid.
    PhysicsError
        If a spacing, the depth, Poisson's ratio or Young's modulus is out of range.
    UnknownNameError
        If a component is not one of the six.
    """

    shape: tuple[int, int]
    spacing: float | tuple[float, float]
    depth: float
    poisson: float = 0.5
    components: Sequence[str] = TAXEL
    youngs_modulus: float | None = None
    _kernels: NDArray[np.complex128] = field(init=False, repr=False, compare=False)
    _padded: tuple[int, int] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        from scipy import fft

        _check_components(self.components)
        object.__setattr__(self, "components", tuple(self.components))
        grid = make_grid(self.shape, self.spacing)
        rows, cols = (fft.next_fast_len(2 * n - 1, real=True) for n in grid.shape)
        object.__setattr__(self, "_padded", (rows, cols))
        kernels = _wrapped(self._influence(grid), (rows, cols))
        object.__setattr__(self, "_kernels", fft.rfft2(kernels))

    def __call__(self, traction: ArrayLike) -> Array:
        """Return the chosen components at the grid's points.

        Parameters
        ----------
        traction : (..., rows, cols, 3) float, Pa
            (q_x, q_y, p) of each cell, the pressure p pushing into the material.

        Returns
        -------
        (..., rows, cols, len(components)) float
            Stress, Pa (tension positive), or strain.

        Raises
        ------
        ArrayError
            If the map has another shape.
        PhysicsError
            If a traction is not finite.
        """
        load = self._checked(traction)
        frames = load.reshape(-1, *load.shape[-3:])
        result = np.empty((*frames.shape[:-1], len(self.components)))
        step = self._frames_at_once()
        for start in range(0, len(frames), step):
            part = slice(start, start + step)
            result[part] = self._convolve(frames[part])
        return result.reshape(*load.shape[:-1], len(self.components))

    def _convolve(self, frames: Array) -> Array:
        from scipy import fft

        rows, cols = self.shape
        loads = np.ascontiguousarray(np.moveaxis(frames, -1, 0))
        waves = fft.rfft2(loads, s=self._padded)
        result = np.empty((*frames.shape[:-1], len(self.components)))
        for n, kernel in enumerate(self._kernels):
            mixed = waves[0] * kernel[0]
            mixed += waves[1] * kernel[1]
            mixed += waves[2] * kernel[2]
            result[..., n] = fft.irfft2(mixed, s=self._padded)[:, :rows, :cols]
        return result

    def _frames_at_once(self) -> int:
        return max(1, int(_CHUNK_BYTES // (8 * 6 * math.prod(self._padded))))

    def _influence(self, grid: Grid) -> Array:
        """Return the influence of one cell at every offset, (component, load, rows, cols)."""
        depth = np.asarray(checks.scalar("depth", checks.not_negative("depth", self.depth)))
        ratio = np.asarray(checks.scalar("poisson", checks.poisson_ratio(self.poisson)))
        evaluate = partial(_at_all_offsets, grid=grid, depth=depth)
        table = self._table(evaluate, ratio)
        parts = [table(ij, k) for ij in self.components for k in AXES]
        return np.stack(parts).reshape(len(self.components), 3, *parts[0].shape)

    def _table(self, evaluate: influence.Evaluate, ratio: Array) -> influence.Influence:
        if self.youngs_modulus is None:
            return influence.stress_table(self.components, evaluate, ratio)
        modulus = checks.positive("youngs_modulus", self.youngs_modulus)
        return influence.strain_table(self.components, evaluate, modulus, ratio)

    def _checked(self, traction: ArrayLike) -> Array:
        load = checks.finite("traction", traction)
        if load.ndim < 3 or load.shape[-3:] != (*self.shape, 3):
            rows, cols = self.shape
            raise ArrayError(
                f"'traction': expected shape (..., {rows}, {cols}, 3), got {load.shape}."
            )
        return load


def _at_all_offsets(names: Collection[str], grid: Grid, depth: Array) -> influence.Integrals:
    """Return the functions of one cell at the offsets 1 - n to n - 1, from a quarter of them."""
    x = np.arange(grid.cols, dtype=np.float64) * grid.dx
    y = np.arange(grid.rows, dtype=np.float64)[:, None] * grid.dy
    quarter = rectangle_functions(names, x, y, depth, grid.dx, grid.dy)
    return {name: _mirrored(quarter[name], *parity(name)) for name in names}


def _mirrored(quarter: Array, odd_x: bool, odd_y: bool) -> Array:
    left, sign = quarter[:, :0:-1], -1 if odd_x else 1
    half = np.concatenate([sign * left, quarter], axis=1)
    top, sign = half[:0:-1], -1 if odd_y else 1
    return np.concatenate([sign * top, half], axis=0)


def surface_load_stress(
    traction: ArrayLike,
    *,
    spacing: float | tuple[float, float],
    depth: float,
    poisson: float = 0.5,
) -> Array:
    """Return the full stress tensor under a map of surface tractions.

    Parameters
    ----------
    traction : (..., rows, cols, 3) float, Pa
        (q_x, q_y, p), uniform on each cell; columns run along x, rows along y.
    spacing : float or (dy, dx) float, m
        Size of a cell.
    depth : float, m
        Depth below the surface, 0 or more.
    poisson : float
        Poisson's ratio, above -1 and at most 0.5.

    Returns
    -------
    (..., rows, cols, 3, 3) float, Pa
        Stress below the centre of each cell, tension positive. `SurfaceToDepth` gives chosen
        components, and keeps its kernels from frame to frame.

    Raises
    ------
    ArrayError, PhysicsError
        As `SurfaceToDepth`.
    """
    return _tensor(traction, spacing, depth, poisson, None)


@broadcasting
def surface_load_strain(
    traction: ArrayLike,
    *,
    spacing: float | tuple[float, float],
    depth: float,
    youngs_modulus: float,
    poisson: float = 0.5,
) -> Array:
    """Return the full strain tensor under a map of surface tractions.

    Parameters
    ----------
    traction, spacing, depth, poisson
        As in `surface_load_stress`.
    youngs_modulus : float, Pa
        Young's modulus.

    Returns
    -------
    (..., rows, cols, 3, 3) float
        Strain below the centre of each cell; its shear components are half the engineering ones.

    Raises
    ------
    ArrayError, PhysicsError
        As `SurfaceToDepth`.
    """
    return _tensor(traction, spacing, depth, poisson, youngs_modulus)


def _tensor(
    traction: ArrayLike,
    spacing: float | tuple[float, float],
    depth: float,
    poisson: float,
    youngs_modulus: float | None,
) -> Array:
    """Return the strain under a map of tractions, or the stress without Young's modulus."""
    load = _map(traction)
    shape = (load.shape[-3], load.shape[-2])
    cover = SurfaceToDepth(shape, spacing, depth, poisson, COMPONENTS, youngs_modulus)
    values = cover(load)
    return influence.tensor({ij: values[..., n] for n, ij in enumerate(COMPONENTS)})


def _map(traction: ArrayLike) -> Array:
    load = checks.vector("traction", traction)
    if load.ndim < 3:
        raise ArrayError(f"'traction': expected (..., rows, cols, 3), got shape {load.shape}.")
    return load


def _wrapped(kernels: Array, padded: tuple[int, int]) -> Array:
    """Put offset zero first and negative offsets last, with zeros between."""
    rows, cols = kernels.shape[-2:]
    result = np.zeros((*kernels.shape[:-2], *padded))
    result[..., :rows, :cols] = kernels
    return np.roll(result, (-(rows // 2), -(cols // 2)), axis=(-2, -1))


def _check_components(components: Sequence[str]) -> None:
    unknown: UnknownNameError | None = None
    for name in components:
        if name not in COMPONENTS:
            unknown = name_error("component", name, COMPONENTS)
    if unknown is not None:
        raise unknown
    if not components:
        raise ArrayError(f"'components': expected one or more of {', '.join(COMPONENTS)}.")
