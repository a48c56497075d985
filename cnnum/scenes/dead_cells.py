"""Dead taxels, as a scene declares them: their values come from their neighbours."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import count

import numpy as np

from cnnum.arrays import Floats, Shape
from cnnum.errors import SceneError
from cnnum.frame import Frame

Cell = tuple[int, int]
"""Row and column, from 0."""


class DeadCells:
    """Gives dead taxels the mean of their nearest living neighbours.

    Parameters
    ----------
    cells : sequence of (row, column)
        At least one.
    shape : (rows, cols)
    fills : bool
        Whether they take a value; not where their neighbours are known by their places.

    Raises
    ------
    SceneError
        If a cell lies outside the array, or none is left.
    """

    __slots__ = ("_cols", "_fills", "_rows", "_weights")

    def __init__(self, cells: Sequence[Cell], shape: Shape, *, fills: bool = True) -> None:
        self._fills = fills
        dead = np.zeros(shape, dtype=bool)
        for row, col in cells:
            if not (0 <= row < shape[0] and 0 <= col < shape[1]):
                raise SceneError(
                    f"'frames.dead' names the taxel [{row}, {col}], expected rows 0 to "
                    f"{shape[0] - 1} and columns 0 to {shape[1] - 1}."
                )
            dead[row, col] = True
        if dead.all():
            raise SceneError("'frames.dead' names every taxel: at least one must be alive.")
        self._rows, self._cols = np.nonzero(dead)
        places = zip(self._rows.tolist(), self._cols.tolist(), strict=True)
        self._weights = np.array([_nearest_living(dead, place) for place in places])

    def without(self, frame: Frame) -> Frame:
        """Return a frame whose dead taxels read 0."""
        values = frame.values.copy()
        values[self._rows, self._cols] = 0.0
        return replace(frame, values=values)

    def filled(self, values: Floats) -> Floats:
        """Return (rows, cols, channels) values with those of the neighbours in dead taxels."""
        if not self._fills:
            return values
        made = values.copy()
        channels = values.shape[2]
        made[self._rows, self._cols] = self._weights @ values.reshape(-1, channels)
        return made


def _nearest_living(dead: np.ndarray, place: Cell) -> Floats:
    """Return the weights of all taxels, flat: equal in the nearest ring with a living one."""
    away = np.indices(dead.shape) - np.array(place)[:, None, None]
    ring = np.abs(away).max(axis=0)
    for distance in count(1):
        living = (ring == distance) & ~dead
        if living.any():
            return np.asarray(living.ravel() / living.sum(), dtype=np.float64)
    raise AssertionError("a taxel lives")
