"""The four bridges of a taxel and the three signals that they make (4.14)."""

from collections.abc import Sequence

import numpy as np

from cnnum.arrays import Floats, frozen
from cnnum.errors import ArrayError, name_error
from cnnum.frame import FORCE_AXES

SIDES = ("left", "right", "top", "bottom")
"""Order of the bridges in the last axis of volts: at −x, +x, +y, −y (Fig. 3.16).

On a map whose rows run along y, "top" is the side of the larger row number.
"""

COMBINE = frozen([[1.0, -1.0, 0.0, 0.0], [0.0, 0.0, -1.0, 1.0], [-0.5, -0.5, -0.5, -0.5]])
"""(T_x, T_y, S_n) = COMBINE @ volts (4.14); the sign makes a push read positive."""


def rows_of(wanted: Sequence[str]) -> list[int]:
    """Return the rows of `COMBINE` that the wanted channels need.

    Raises
    ------
    UnknownNameError
        If a name is not one of ("shear_x", "shear_y", "normal").
    """
    names = (wanted,) if isinstance(wanted, str) else tuple(wanted)
    for name in names:
        if name not in FORCE_AXES:
            raise name_error("channel", name, FORCE_AXES)
    return [FORCE_AXES.index(name) for name in names]


def trailing(name: str, array: Floats, length: int, meaning: str) -> Floats:
    """Return `array` if its last axis has that length.

    Raises
    ------
    ArrayError
        If it has not.
    """
    if array.ndim == 0 or array.shape[-1] != length:
        raise ArrayError(
            f"'{name}' must have the shape (..., {length}), {meaning}, got {array.shape}."
        )
    return array


def apply_matrix(matrix: Floats, vectors: Floats) -> Floats:
    """Return matrix @ vector over the last axes; the matrix may differ from taxel to taxel."""
    if matrix.ndim == 2:
        return np.asarray(vectors @ matrix.T, dtype=np.float64)
    return np.asarray(np.einsum("...ij,...j->...i", matrix, vectors), dtype=np.float64)
