"""The traction all over the cover from a whole frame: regularised least squares."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import inf, log
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import linalg, optimize

from cnnum.errors import ArrayError, PhysicsError, name_error
from cnnum.frame import FORCE_AXES
from cnnum.tactile import checks, halfspace
from cnnum.tactile.checks import Array
from cnnum.tactile.grid import Grid, make_grid
from cnnum.tactile.inverse.moments import NORMAL_95, Noise, shear_and_normal


def pushing_only(square: Array, pull: Array, positive: NDArray[np.bool_]) -> Array:
    """Return u with the least ½ uᵀ H u − gᵀ u and u ≥ 0 where it is asked for.

    The free unknowns are eliminated (Schur complement). So the rest is a non-negative least squares
    problem for its Cholesky factor.

    Parameters
    ----------
    square : (n, n) float
        H, symmetric positive definite.
    pull : (n,) float
        g.
    positive : (n,) bool
        At least one.

    References
    ----------
    Lawson and Hanson, Solving Least Squares Problems (1974), ch. 23.
    """
    free = ~positive
    coupling = square[np.ix_(free, positive)]
    carried = _solved(square[np.ix_(free, free)], np.column_stack([coupling, pull[free]]))
    rest = square[np.ix_(positive, positive)] - coupling.T @ carried[:, :-1]
    root = np.linalg.cholesky(rest)
    aim = linalg.solve_triangular(root, pull[positive] - coupling.T @ carried[:, -1], lower=True)
    result = np.empty_like(pull)
    result[positive] = cast(Any, optimize.nnls(root.T, aim))[0]
    result[free] = carried[:, -1] - carried[:, :-1] @ result[positive]
    return result


def _solved(square: Array, right: Array) -> Array:
    """Return square⁻¹ right; nothing for nothing."""
    if not len(square):
        return right
    return np.asarray(
        cast(Any, linalg.cho_solve(linalg.cho_factor(square), right)), dtype=np.float64
    )


_PRIORS = (1e-3, 1e9)  # likely tractions, from far under the noise to far over a taxel's limit
_STEPS = 84


@dataclass(frozen=True, slots=True, eq=False)
class SurfaceLoad:
    """A map of tractions, and how it was regularised.

    Attributes
    ----------
    traction : (..., rows, cols, loads) float, Pa
        The requested components of (q_x, q_y, p).
    regularisation : (...) float, Pa
        RMS traction that was assumed beforehand: detail finer or weaker than noise / regularisation
        was left out.
    residual : (...) float
        RMS of the unexplained signal, in units of the noise. If it is well above 1, the frame does
        not come from tractions on this map.
    """

    traction: Array
    regularisation: Array
    residual: Array


@dataclass(frozen=True, slots=True, eq=False)
class LoadMap:
    """Inverse of the cover for one array, factored once and then applied to many frames.

    Attributes
    ----------
    taxels : (n, 2) float, m
        Places of the taxels, relative to the middle of the grid.
    shape : (rows, cols) int
        Cells of the map.
    spacing : float or (dy, dx) float, m
        Size of a cell.
    depth : float, m
    youngs_modulus : float, Pa
    noise : float or (float, float)
        RMS noise of the shear and the normal strain; above 0, because it sets the resolution.
    loads : sequence of str
        Tractions to find: "shear_x", "shear_y", "normal".
    channels : sequence of str
        Strains that are measured.

    Notes
    -----
    A uniform pressure causes no strain in an incompressible half-space, so the total of a map shows
    only at its edges; see `push_only`.
    """

    taxels: Array
    shape: tuple[int, int]
    spacing: float | tuple[float, float]
    depth: float
    youngs_modulus: float
    noise: Noise
    loads: Sequence[str] = FORCE_AXES
    channels: Sequence[str] = FORCE_AXES
    _left: Array = field(init=False, repr=False)
    _sizes: Array = field(init=False, repr=False)
    _right: Array = field(init=False, repr=False)

    def __post_init__(self) -> None:
        place = checks.vector("taxels", self.taxels, 2).reshape(-1, 2)
        if not len(place):
            raise ArrayError("'taxels': expected the positions of at least one taxel, got none.")
        object.__setattr__(self, "taxels", place)
        if min(shear_and_normal(self.noise)) <= 0.0:
            raise PhysicsError(
                f"A load map needs a 'noise' above 0, got {self.noise}; it determines the "
                "resolution of the map."
            )
        matrix = self._influence() / self._spread()[:, np.newaxis]
        left, sizes, right = np.linalg.svd(matrix, full_matrices=False)
        for name, value in (("_left", left), ("_sizes", sizes), ("_right", right)):
            object.__setattr__(self, name, value)

    @property
    def condition(self) -> float:
        """Signal-to-noise ratio of the best measured pattern of tractions over that of the worst.

        Without `regularisation`, the worst pattern is noisier by this factor. It is infinite if a
        pattern is not measured at all.
        """
        best, worst = float(self._sizes[0]), float(self._sizes[-1])
        unseen = (
            len(self._sizes) < self._right.shape[1]
            or worst <= len(self._sizes) * float(np.finfo(np.float64).eps) * best
        )
        return inf if unseen else best / worst

    @property
    def grid(self) -> Grid:
        """Places of the cells."""
        return make_grid(self.shape, self.spacing)

    def __call__(
        self,
        strain: ArrayLike,
        regularisation: ArrayLike | None = None,
        *,
        push_only: bool = False,
    ) -> SurfaceLoad:
        """Return the likeliest traction behind the strain, given a likely size of tractions.

        Parameters
        ----------
        strain : (..., n, channels) float
            Strain rows at the taxels, tension positive.
        regularisation : (...) float, Pa, optional
            RMS traction taken as likely. If not given, the one under which the frame itself is most
            probable (evidence; MacKay, Neural Computation 4 (1992) 415).
        push_only : bool
            Let no pressure be negative. The strain hardly sees a uniform pressure. That nothing
            pulls where nothing touches pins it down, and the map comes nearer. Noise then can only
            add, so the total force comes out too large rather than too small. Each frame is a
            problem of its own, solved one after the other.

        Returns
        -------
        SurfaceLoad

        Raises
        ------
        ArrayError
            If the strain is not that of the taxels.
        PhysicsError
            If a value is not finite, or the regularisation is not positive.
        """
        target, lead = self._target(strain)
        amount = target @ self._left
        # not from sums of squares, whose difference is rounding where the noise is very small
        outside = np.sum((target - amount @ self._left.T) ** 2, axis=-1)
        if regularisation is None:
            prior = self._likeliest(amount)
        else:
            given = checks.positive("regularisation", regularisation)
            prior = np.broadcast_to(given, lead).reshape(-1)
        if push_only and "normal" in self.loads:
            traction = self._pushing(target, prior)
        else:
            traction = (amount * self._kept(prior) / self._sizes) @ self._right
        left = np.sum((amount - (traction @ self._right.T) * self._sizes) ** 2, axis=-1) + outside
        return SurfaceLoad(
            traction.reshape(*lead, *self.shape, len(self.loads)),
            prior.reshape(lead),
            np.sqrt(left / target.shape[-1]).reshape(lead),
        )

    def _pushing(self, target: Array, prior: Array) -> Array:
        """Return (frames, unknowns) tractions without negative pressure."""
        matrix = (self._left * self._sizes) @ self._right
        square, pull = matrix.T @ matrix, target @ matrix
        positive = np.tile(np.array([name == "normal" for name in self.loads]), self._cells)
        rows: list[Array] = []
        for aim, likely in zip(pull, prior, strict=True):
            scaled = likely**2 * square + np.eye(len(square))
            rows.append(likely * pushing_only(scaled, likely * aim, positive))
        return np.stack(rows)

    @property
    def _cells(self) -> int:
        return self.shape[0] * self.shape[1]

    def noise_error(self, regularisation: float) -> Array:
        """Return the half-width that contains the noise of each cell in 95 % of cases.

        It does not include the detail that the regularisation smooths away; see `resolution`.

        Parameters
        ----------
        regularisation : float, Pa

        Returns
        -------
        (rows, cols, loads) float, Pa
        """
        gain = self._kept(np.array([float(regularisation)]))[0] / self._sizes
        spread = np.sqrt(np.sum((gain[:, np.newaxis] * self._right) ** 2, axis=0))
        return np.asarray(NORMAL_95 * spread.reshape(*self.shape, len(self.loads)))

    def resolution(self, regularisation: float) -> Array:
        """Return the width over which the load on a cell is smeared.

        Parameters
        ----------
        regularisation : float, Pa

        Returns
        -------
        (rows, cols, loads) float, m
            Side of the square over which the answer to a load on one cell is spread: the side of
            the cell where the map is sharp, infinite where the taxels measure nothing.
        """
        kept = self._kept(np.array([float(regularisation)]))[0]
        own = np.sum(kept[:, np.newaxis] * self._right**2, axis=0)
        area = np.divide(self.grid.cell_area, own, out=np.full_like(own, np.inf), where=own > 1e-12)
        return np.asarray(np.sqrt(area).reshape(*self.shape, len(self.loads)), dtype=np.float64)

    def _kept(self, prior: Array) -> Array:
        """Return (frames, k) Tikhonov filter factors; an infinite prior keeps the signal."""
        strength = (prior[:, np.newaxis] * self._sizes) ** 2
        return np.asarray(strength / (1.0 + strength), dtype=np.float64)

    def _likeliest(self, amount: Array) -> Array:
        """Return the prior under which the frame is most probable, for its known noise.

        With tractions and noise normal, each amount has the variance 1 + (prior · size)². The grid
        is refined once, to 1 %, far finer than the maximum is wide.
        """
        low, high = (log(factor / float(self._sizes[0])) for factor in _PRIORS)
        step = (high - low) / _STEPS
        coarse = low + step * np.arange(_STEPS + 1, dtype=np.float64)
        best = coarse[np.argmax(self._evidence(amount, coarse[:, np.newaxis]), axis=0)]
        fine = best + step * np.linspace(-1.0, 1.0, 65)[:, np.newaxis].astype(np.float64)
        choice = np.argmax(self._evidence(amount, fine), axis=0)
        return np.asarray(np.exp(fine[choice, np.arange(len(amount))]), dtype=np.float64)

    def _evidence(self, amount: Array, log_prior: Array) -> Array:
        """Return (priors, frames) twice the log probability, up to a constant."""
        rows: list[Array] = []
        for prior in np.broadcast_to(log_prior, (len(log_prior), len(amount))):
            variance = 1.0 + (np.exp(prior)[:, np.newaxis] * self._sizes) ** 2
            rows.append(-np.sum(amount**2 / variance + np.log(variance), axis=-1))
        return np.stack(rows)

    def _target(self, strain: ArrayLike) -> tuple[Array, tuple[int, ...]]:
        rows = checks.finite("strain", strain)
        wanted = (len(self.taxels), len(self.channels))
        if rows.ndim < 2 or rows.shape[-2:] != wanted:
            raise ArrayError(
                f"'strain' must have the shape (..., {wanted[0]}, {wanted[1]}), one row per "
                f"taxel, got {rows.shape}."
            )
        lead = rows.shape[:-2]
        return rows.reshape(-1, wanted[0] * wanted[1]) / self._spread(), lead

    def _spread(self) -> Array:
        """Return the noise of each row."""
        shear, normal = shear_and_normal(self.noise)
        spreads = [normal if name == "normal" else shear for name in self.channels]
        return np.tile(np.array(spreads), len(self.taxels))

    def _influence(self) -> Array:
        """Return strain rows per traction of a cell (Love, Cerruti), both flat."""
        channels, loads = _indices(self.channels), _indices(self.loads)
        grid = self.grid
        y, x = np.meshgrid(grid.y, grid.x, indexing="ij")
        matrix = np.empty((len(self.taxels), len(channels), grid.rows, grid.cols, len(loads)))
        for k, load in enumerate(loads):
            tensor = halfspace.rectangle_strain(
                self.taxels[:, 0, np.newaxis, np.newaxis] - x,
                self.taxels[:, 1, np.newaxis, np.newaxis] - y,
                self.depth,
                np.eye(3)[load],
                size=(grid.dx, grid.dy),
                youngs_modulus=self.youngs_modulus,
            )
            matrix[..., k] = np.moveaxis(tensor[..., 2, channels], -1, 1)
        return matrix.reshape(len(self.taxels) * len(channels), -1)


def _indices(names: Sequence[str]) -> list[int]:
    for name in names:
        if name not in FORCE_AXES:
            raise name_error("channel", name, FORCE_AXES)
    if not names:
        raise ArrayError(
            f"Expected at least one of the channels {', '.join(FORCE_AXES)}, got none."
        )
    return [FORCE_AXES.index(name) for name in names]
