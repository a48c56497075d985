"""Pads of one-axial pressure taxels under bumps, read as three-axial ones (dissertation 6.4.3).

A sideways load on a bump presses one edge of it down and lifts the other: four taxels under a
bump distinguish it from a normal load.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import sqrt

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cnnum.errors import ArrayError, name_error
from cnnum.frame import FORCE_AXES
from cnnum.tactile import checks
from cnnum.tactile.checks import Array

_HALF = sqrt(2.0) / 2.0
_MIX = np.array(
    [[-_HALF, _HALF, -_HALF, _HALF], [_HALF, _HALF, -_HALF, -_HALF], [0.5, 0.5, 0.5, 0.5]]
)
_MIX.setflags(write=False)

Places = NDArray[np.intp]


@dataclass(frozen=True, slots=True, eq=False)
class Pad:
    """Which four taxels lie under which bump.

    Attributes
    ----------
    shape : (rows, cols) int
        Shape of the one-axial pad; columns run along x, rows along y.
    corners : (bump_rows, bump_cols, 4, 2) int
        Row and column of S1, S2, S3, S4 of each bump: (−x, +y), (+x, +y), (−x, −y), (+x, −y)
        of its centre, as in Fig. 6.13, whose y points up.
    shear_gain, normal_gain : float
        Factors of the components; the normal response of a bump is about four times its shear
        response.

    References
    ----------
    Vásárhelyi 2007, (6.1), (6.2). The printed T_y, S1 − S2 − S3 − S4, gives shear under a
    uniform load; rotating (6.1) by 45° gives S1 + S2 − S3 − S4.
    """

    shape: tuple[int, int]
    corners: Places
    shear_gain: float = 1.0
    normal_gain: float = 1.0
    _flat: Places = field(init=False, repr=False)

    def __post_init__(self) -> None:
        corners = np.asarray(self.corners)
        whole = corners.dtype.kind in "iu" and corners.ndim == 4 and corners.shape[2:] == (4, 2)
        if not whole or corners.size == 0:
            raise ArrayError(
                "'corners' must be whole numbers with the shape (bump_rows, bump_cols, 4, 2), "
                f"got {corners.dtype} {corners.shape}."
            )
        rows, cols = corners[..., 0], corners[..., 1]
        if (
            min(rows.min(), cols.min()) < 0
            or rows.max() >= self.shape[0]
            or cols.max() >= self.shape[1]
        ):
            raise ArrayError(
                f"A bump lies outside the pad: expected corners within {self.shape[0]} rows and "
                f"{self.shape[1]} columns, got up to ({rows.max()}, {cols.max()})."
            )
        object.__setattr__(self, "corners", corners.astype(np.intp))
        object.__setattr__(self, "_flat", (rows * self.shape[1] + cols).astype(np.intp))

    @classmethod
    def regular(
        cls,
        shape: tuple[int, int],
        *,
        pitch: int = 2,
        origin: tuple[int, int] = (0, 0),
        bumps: tuple[int, int] | None = None,
        shear_gain: float = 1.0,
        normal_gain: float = 1.0,
    ) -> "Pad":
        """Return a pad with bumps on a square grid; 9×9 taxels give 4×4 bumps.

        Parameters
        ----------
        shape : (rows, cols) int
        pitch : int
            Taxels from bump to bump.
        origin : (row, col) int
            Smallest row and column under the first bump.
        bumps : (bump_rows, bump_cols) int, optional
            By default, as many as fit.
        shear_gain, normal_gain : float

        Raises
        ------
        ArrayError
            If the pitch is below 1 or no bump fits.
        """
        if pitch < 1:
            raise ArrayError(f"'pitch' must be 1 or more taxels, got {pitch}.")
        fit = tuple((shape[k] - origin[k] - 2) // pitch + 1 for k in (0, 1))
        count = fit if bumps is None else bumps
        if min(count) < 1:
            raise ArrayError(
                f"No bump fits a pad of {shape[0]} rows and {shape[1]} columns from {origin}: "
                "expected room for 2 by 2 taxels."
            )
        row = origin[0] + pitch * np.arange(count[0])[:, np.newaxis]
        col = origin[1] + pitch * np.arange(count[1])[np.newaxis, :]
        return cls(shape, _square(row, col), shear_gain, normal_gain)

    @classmethod
    def from_centres(
        cls,
        shape: tuple[int, int],
        centres: ArrayLike,
        *,
        spacing: float,
        shear_gain: float = 1.0,
        normal_gain: float = 1.0,
    ) -> "Pad":
        """Return a pad with bumps anywhere; each takes the four taxels around its centre.

        Parameters
        ----------
        shape, shear_gain, normal_gain
            As in `regular`.
        centres : (bump_rows, bump_cols, 2) or (bumps, 2) float, m
            Places (x, y) of the bumps; taxel (0, 0) is the origin. A list makes one row.
        spacing : float, m
            Spacing of the taxels.

        Raises
        ------
        ArrayError
            If a bump has not four taxels around it.
        PhysicsError
            If the spacing is not positive.
        """
        place = checks.vector("centres", centres, 2)
        grid = place[np.newaxis] if place.ndim == 2 else place
        if grid.ndim != 3:
            raise ArrayError(
                "'centres' must have the shape (bumps, 2) or (bump_rows, bump_cols, 2), got "
                f"{place.shape}."
            )
        size = checks.scalar("spacing", checks.positive("spacing", spacing))
        cell = np.floor(grid / size).astype(np.intp)
        return cls(shape, _square(cell[..., 1], cell[..., 0]), shear_gain, normal_gain)

    @property
    def bumps(self) -> tuple[int, int]:
        """Bump rows and columns."""
        return self.corners.shape[0], self.corners.shape[1]

    @property
    def used(self) -> NDArray[np.bool_]:
        """(rows, cols) bool: the taxels under a bump; the others need no scanning."""
        mask = np.zeros(self.shape, dtype=np.bool_)
        mask.reshape(-1)[self._flat] = True
        return mask

    def to_three_axial(self, pressure: ArrayLike, wanted: Sequence[str] = FORCE_AXES) -> Array:
        """Return the three-axial frame of a one-axial one.

        Parameters
        ----------
        pressure : (..., rows, cols) float
            Readings of the taxels, compression positive.
        wanted : sequence of str
            The channels to compute, in that order: "shear_x", "shear_y", "normal".

        Returns
        -------
        (..., bump_rows, bump_cols, len(wanted)) float
            Positive shear pushes towards larger columns (x) and rows (y).

        Raises
        ------
        ArrayError
            If the frame does not have the shape of the pad.
        PhysicsError
            If a value is not finite.
        UnknownNameError
            If a wanted channel is not one of the three.
        """
        frame = checks.finite("pressure", pressure)
        if frame.ndim < 2 or frame.shape[-2:] != tuple(self.shape):
            raise ArrayError(
                f"'pressure' must have the shape (..., {self.shape[0]}, {self.shape[1]}), got "
                f"{frame.shape}."
            )
        weights = self._weights(wanted)
        four = frame.reshape(*frame.shape[:-2], -1)[..., self._flat]
        return np.asarray(four @ weights.T, dtype=np.float64)

    def _weights(self, wanted: Sequence[str]) -> Array:
        """Return (len(wanted), 4) weights of S1…S4."""
        for name in wanted:
            if name not in FORCE_AXES:
                raise name_error("channel", name, FORCE_AXES)
        gains = np.array([self.shear_gain, self.shear_gain, self.normal_gain])
        rows = [FORCE_AXES.index(name) for name in wanted]
        return np.asarray((gains[:, np.newaxis] * _MIX)[rows], dtype=np.float64)


def _square(row: NDArray[np.intp], col: NDArray[np.intp]) -> Places:
    """Return S1…S4 of bumps whose smallest row and column are given."""
    top, left = np.broadcast_arrays(row, col)
    corners = [(top + 1, left), (top + 1, left + 1), (top, left), (top, left + 1)]
    return np.stack([np.stack(pair, axis=-1) for pair in corners], axis=-2).astype(np.intp)
