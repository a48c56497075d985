"""The range of a frame's values: a frame with a value beyond it is a bad one."""

from dataclasses import dataclass

import numpy as np

from cnnum.arrays import HELD, Floats, held, magnitude
from cnnum.errors import FrameError
from cnnum.frame import Frame

UNITS: dict[str, tuple[float, str]] = {
    "strain": (10.0, "no rubber stretches to eleven times its length"),
    "V": (120.0, "the end of extra-low voltage, which an array under a hand may be fed with"),
    "N": (1e4, "the weight of a tonne on one taxel"),
    "Pa": (1e9, "beyond the strength of every polymer that a cover is made of"),
}
"""By unit, the largest magnitude that a taxel can give, and why."""

WHOLE = {"float32": 2.0**24, "float64": 2.0**53}
"""By precision, the largest count up to which all whole numbers are exact."""


@dataclass(frozen=True, slots=True)
class FrameRange:
    """The largest magnitude of a frame's values, and why that.

    Attributes
    ----------
    limit : float
        In the frame's unit.
    why : str
        Where the limit comes from.
    precision : "float32" or "float64"
        Values are rounded to it before they are compared.
    """

    limit: float
    why: str = ""
    precision: str = "float64"

    def size(self, frame: Frame) -> float:
        """Return a bound of the magnitudes in a frame.

        Raises
        ------
        FrameError
            If a value is NaN, infinite or out of range; the sentence names the first one.
        """
        values = frame.values
        size = magnitude(values)
        if size <= self.limit:
            return size
        bad = self._outside(values)
        if not bad.any():
            return size
        row, col, channel = (int(n) for n in np.argwhere(bad)[0])
        count = int(bad.sum())
        more = f" ({count - 1} more values are out of range)" if count > 1 else ""
        error = FrameError(
            f"taxel ({row}, {col}) reads {values[row, col, channel]:g} {frame.unit} in the channel "
            f"'{frame.channels[channel]}', expected within ±{self.limit:g} {frame.unit}, "
            f"{self.why}{more}"
        )
        error.cells = tuple((int(r), int(c)) for r, c in np.argwhere(bad.any(axis=2)))
        raise error

    def _outside(self, values: Floats) -> np.ndarray:
        """Return where a value, rounded, is beyond the limit."""
        with np.errstate(over="ignore", invalid="ignore"):
            rounded = values.astype(self.precision).astype(np.float64)
        return np.asarray(~(np.abs(rounded) <= self.limit))


ANY = FrameRange(HELD["float64"])
"""Every finite number."""


def unit_range(unit: str, precision: str) -> FrameRange:
    """Return the range of a unit, for arrays about which nothing better is known.

    Parameters
    ----------
    unit : str
        As a driver says it: "strain", "V", "N", "Pa", "count", or another one.
    precision : "float32" or "float64"
        The engine's.
    """
    if unit in UNITS:
        return FrameRange(*UNITS[unit], precision)
    if unit == "count":
        why = f"beyond which {precision} does not hold every whole number"
        return FrameRange(WHOLE[precision], why, precision)
    return FrameRange(held(precision) ** 0.5, f"whose square {precision} holds", precision)


def range_for(
    unit: str,
    precision: str,
    *,
    given: float | None = None,
    full_scale: float | None = None,
    saturated: float = float("inf"),
) -> FrameRange:
    """Return the range of an array's frames, by the best that is known of it.

    Parameters
    ----------
    unit : str
        Unit of the driver's frames.
    precision : "float32" or "float64"
        The engine's.
    given : float, optional
        Limit in the scene; it stands above all else.
    full_scale : float, optional
        Limit of the driver: no value of its array is larger.
    saturated : float
        Limit of the calibration: the magnitude from which a value counts as saturated. The end of
        the converter's range is taken to be within twice that.
    """
    if given is not None:
        return FrameRange(given, "as 'frames.range' of the scene says", precision)
    if full_scale is not None:
        return FrameRange(full_scale, "the full scale of the array", precision)
    if saturated < float("inf"):
        return FrameRange(2.0 * saturated, "twice the calibration's 'limit'", precision)
    return unit_range(unit, precision)
