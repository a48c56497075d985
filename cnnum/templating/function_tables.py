"""Function tables: piecewise constant or piecewise linear functions of one number, as data."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np

from cnnum.arrays import Floats, finite
from cnnum.errors import TemplateError

Interpolation = Literal["constant", "linear"]


@dataclass(frozen=True, slots=True)
class Table:
    """A function given by points (v_k, f_k), as the CNN Software Library writes them.

    * "constant": f_k holds for v_{k−1} < v ≤ v_k; f_1 before the first point, the last beyond.
    * "linear": straight lines between the points, the end values beyond them.

    Attributes
    ----------
    interpolation : "constant" or "linear"
    points : tuple of (v, f)
        v strictly increasing; at least one point.

    Raises
    ------
    TemplateError
        If there is no point, or v does not increase.
    """

    interpolation: Interpolation
    points: tuple[tuple[float, float], ...]

    def __post_init__(self) -> None:
        if str(self.interpolation) not in ("constant", "linear"):
            raise TemplateError(
                f"A function table must be 'constant' or 'linear', got {self.interpolation!r:.60}."
            )
        pairs = finite("points of a function table", self.points)
        if pairs.ndim != 2 or pairs.shape[1] != 2:
            raise TemplateError(
                "The points of a function table must be pairs (argument, value), got "
                f"{pairs.shape}."
            )
        places = pairs[:, 0].tolist()
        if not places or any(b <= a for a, b in pairwise(places)):
            raise TemplateError(
                f"The points of a function table must have increasing arguments, got {places}."
            )

    @classmethod
    def of(cls, interpolation: str, points: Sequence[Sequence[float]]) -> "Table":
        """Return the table of a list of pairs.

        Raises
        ------
        TemplateError
            If the points are not pairs of numbers.
        """
        array = finite("points of a function table", points)
        if array.ndim != 2 or array.shape[1] != 2:
            raise TemplateError(
                f"The points of a function table must be pairs (argument, value), got {points!r}."
            )
        pairs = tuple((float(v), float(f)) for v, f in array)
        return cls(interpolation, pairs)  # type: ignore[arg-type]

    def __call__(self, v: Floats) -> Floats:
        """Return the function of every number."""
        places = np.array([place for place, _ in self.points])
        values = np.array([value for _, value in self.points])
        if self.interpolation == "linear":
            return np.asarray(np.interp(v, places, values))
        at = np.searchsorted(places, v, side="left")
        return np.asarray(values[np.minimum(at, len(values) - 1)])

    def mean(self, begin: float, end: float) -> float:
        """Return the mean of the function between two numbers, the first below the second."""
        total = self.points[0][1]
        for (low, before), (high, after) in pairwise(self.points):
            if self.interpolation == "constant":
                share = min(max((end - low) / (end - begin), 0.0), 1.0)
            else:
                first, last = (begin - low) / (high - low), (end - low) / (high - low)
                least, most = min(max(first, 0.0), 1.0), min(max(last, 0.0), 1.0)
                inside = 0.5 * (most - least) * (most + least)
                share = (inside + max(last, 1.0) - max(first, 1.0)) / (last - first)
            total += (after - before) * share
        return total

    @property
    def steepest(self) -> float:
        """The largest slope of the straight lines; 0 for steps, which have none to speak of."""
        if self.interpolation == "constant" or len(self.points) < 2:
            return 0.0
        places, values = np.array(self.points).T
        return float(np.abs(np.diff(values) / np.diff(places)).max())

    @property
    def largest(self) -> float:
        """The largest size of the function's values."""
        return max(abs(f) for _, f in self.points)
