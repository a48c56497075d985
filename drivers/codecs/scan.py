"""A scan: the numbers that an array sent, before the host gives them a place in its run."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from cnnum.arrays import Floats
from cnnum.errors import CodecError
from cnnum.frame import Limits, limits_of

U16, U32, U64 = 1 << 16, 1 << 32, 1 << 64


def numbers_or_none(values: Floats) -> bool:
    """Return whether most taxels have numbers in all channels, and no number is infinite.

    A chip of an array that is lost sends NaN, in all its channels or but for its temperature. Other
    packets of numbers that are not finite are none of the array's.
    """
    if np.isfinite(values).all():
        return True
    lost = np.isnan(values).any(axis=2)
    return not np.isinf(values).any() and 2 * int(lost.sum()) < lost.size


def within(values: Floats, limits: Limits | None) -> bool:
    """Return whether no number, (…, channels), is beyond some limits."""
    if limits is None:
        return True
    low, high = limits_of(limits, values.shape[-1])
    return not ((values < low) | (values > high)).any()


@dataclass(frozen=True, slots=True, eq=False)
class Scan:
    """One scan as its device sent it.

    Attributes
    ----------
    values : (rows, cols, channels) array
    channels : tuple of str
        Names of the last axis.
    unit : str
    sequence : int or None
        The device's own count of its scans, modulo `sequence_wrap`; None where it does not count.
    time_us : int or None
        µs on the device's clock, modulo `time_wrap`; None where it has none.
    period_us : int
        µs from scan to scan; 0 where the device does not say.
    saturated : bool
        Whether a cell stands at an end of its range.
    at_end : (rows, cols) bool, optional
        Which do, where that is known.
    arrived_ns : int, optional
        When it came by the host's monotonic clock, of a scan that was held back since.
    extras : mapping of str to float
        Reports of the device apart from its taxels, by names that begin with "device_".
    """

    values: NDArray[np.generic]
    channels: tuple[str, ...]
    unit: str
    sequence: int | None = None
    time_us: int | None = None
    sequence_wrap: int = U32
    time_wrap: int = U64
    period_us: int = 0
    saturated: bool = False
    at_end: NDArray[np.bool_] | None = None
    arrived_ns: int | None = None
    extras: Mapping[str, float] = field(default_factory=dict[str, float])

    def __post_init__(self) -> None:
        if self.values.ndim != 3 or self.values.shape[2] != len(self.channels):
            raise CodecError(
                f"A scan of the channels {self.channels} must have the shape "
                f"(rows, cols, {len(self.channels)}), got {self.values.shape}."
            )

    @property
    def kind(self) -> str:
        """The array that it is of, in words."""
        rows, cols, _ = self.values.shape
        return f"{rows}×{cols} taxels of {', '.join(self.channels)} in {self.unit}"
