"""A frame: one scan of a tactile array, as its driver hands it on."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import IntFlag
from typing import Literal, cast

import numpy as np
from numpy.typing import NDArray

from cnnum import sharing
from cnnum.arrays import Floats
from cnnum.errors import ArrayError
from cnnum.values import ByContent, read_only

FORCE_AXES = ("shear_x", "shear_y", "normal")
"""The channels of a three-axial frame, in the order of its last axis."""

NORMAL = FORCE_AXES[2]
"""The channel in which strain and stress count a push as negative."""


class Quality(IntFlag):
    """Faults of a frame that its driver reports; 0 means a good frame."""

    GOOD = 0
    DROPPED_BEFORE = 1
    """Frames between the one before and this one never arrived."""
    REPEATED = 2
    """The same scan as the one before: the log is faster than the sensor."""
    SATURATED = 4
    """A taxel stands at an end of its range."""
    CORRUPT = 8
    """The check over the bytes failed; the values cannot be trusted."""
    STALE = 16
    """The frame waited for its reader for longer than its driver allows."""


BAD = Quality.CORRUPT
"""Flags under which a frame must not become an event."""


@dataclass(frozen=True, slots=True, eq=False)
class Truth(ByContent):
    """Ground truth of a frame from a simulated or labelled source.

    Attributes
    ----------
    values : mapping of str to float
        Names are the source's: "contact", "slip", "stick_radius" (m), "contact_radius" (m), "twist"
        (rad), "normal_force" (N), "shear_x" and "shear_y" (N), "torque" (N m) and so on. Names that
        begin with "device_" are an array's own reports, apart from its taxels.
    """

    values: dict[str, float] = field(default_factory=dict[str, float])

    def __getitem__(self, name: str) -> float:
        return self.values[name]

    def get(self, name: str, default: float = 0.0) -> float:
        """Return the value of that name, or `default`."""
        return self.values.get(name, default)


def shown_maps(
    values: NDArray[np.float64], channels: tuple[str, ...], unit: str
) -> dict[str, NDArray[np.float64]]:
    """Return the (rows, cols) maps that pictures show, by the channel's name.

    A push is positive in all of them, so normal strain is shown as compression.
    """
    shown = {name: values[..., n] for n, name in enumerate(channels)}
    if unit != "strain":
        return shown
    return {
        f"{name}, compressive" if name == NORMAL else name: -part if name == NORMAL else part
        for name, part in shown.items()
    }


OFF = 1.25
"""Factor from which two rates contradict each other: more than the clock of any array drifts."""

SLOWEST, FASTEST_STEP = 1.0, 1e-5
"""s from frame to frame beyond which times are in another unit than s: arrays have 10 to 1000
frames a second, so that ms read as s are a thousand times as far apart."""


UNITS = {"ms": 1e-3, "us": 1e-6, "ns": 1e-9}
"""Units of times other than s, in s."""

TimeUnit = Literal["", "s", "ms", "us", "ns"]
"""Unit of the times of a file or recording; "" for seconds that nobody has named."""


def differ(rate: float, other: float) -> bool:
    """Return whether two rates contradict each other."""
    return not other / OFF <= rate <= other * OFF


def contradicted(rate: float, times: NDArray[np.float64]) -> float | None:
    """Return the rate that times give, where it contradicts another one; else None.

    Both the median step and the mean one must contradict it on the same side. So neither a pause
    does, which the mean leaves out, nor frames that come in bursts.

    Parameters
    ----------
    rate : float, Hz
    times : (frames,) float, s
    """
    steps = np.sort(np.diff(times))
    steps = steps[np.isfinite(steps)]
    if len(steps) < 2 or not steps[-1] > 0.0:
        return None
    kept = steps[: len(steps) - max(1, len(steps) // 100)]
    middle, mean = float(np.median(steps)), float(kept.mean())
    off = [rate * step < 1.0 / OFF for step in (middle, mean)]
    slow = [rate * step > OFF for step in (middle, mean)]
    return 1.0 / middle if middle > 0.0 and (all(off) or all(slow)) else None


def _middle_step(times: NDArray[np.float64]) -> float:
    """Return the median step of times, or of a clock coarser than the frames the mean one."""
    steps = np.diff(times)
    ahead = steps[steps > 0.0]
    if not len(ahead):
        return 0.0
    coarse = len(ahead) > 1 and 2 * int((steps == 0.0).sum()) > len(steps)
    return float(steps[steps >= 0.0].mean() if coarse else np.median(ahead))


def time_unit_of(times: NDArray[np.float64]) -> str:
    """Return "ms", "us" or "ns" where times seem to be in that unit instead of s; else "".

    Parameters
    ----------
    times : (frames,) float
    """
    middle = _middle_step(times)
    units = (unit for unit, size in UNITS.items() if middle * size < SLOWEST)
    return next(units, "ns") if middle >= SLOWEST else ""


def unit_fault(times: NDArray[np.float64]) -> str:
    """Return in words that times may be in another unit than s; empty where they are not.

    Parameters
    ----------
    times : (frames,) float, s
    """
    middle = _middle_step(times)
    if unit := time_unit_of(times):
        return (
            f"{middle:g} s from frame to frame: if they are in {unit}, set time_unit = '{unit}' in "
            "the layout, and if in s, time_unit = 's'"
        )
    if 0.0 < middle < FASTEST_STEP:
        return f"{middle:g} s from frame to frame: is their unit a larger one?"
    return ""


Limits = tuple[float, float] | tuple[tuple[float, float], ...]
"""The least and the largest raw value that a sound taxel gives: of all channels, or of each."""


def limits_of(limits: Limits, channels: int) -> NDArray[np.float64]:
    """Return the least and the largest raw value of each channel, (2, channels).

    Raises
    ------
    ArrayError
        If they are no pair, nor one a channel, or a least one is not below its largest.
    """
    result = np.asarray(limits, dtype=np.float64)
    if result.shape == (2,):
        result = np.tile(result, (channels, 1))
    if result.shape != (channels, 2) or not (result[:, 0] < result[:, 1]).all():
        raise ArrayError(
            "'limits' must be the smallest and largest raw values of a working taxel, as in [1, "
            f"65534], or such a pair for each of the {channels} channels, got "
            f"{np.asarray(limits).tolist()}."
        )
    return result.T


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Frame(ByContent):
    """One scan of an array.

    Attributes
    ----------
    values : (rows, cols, channels) float
        Raw counts, volts or calibrated quantities, according to `unit`. Read-only.
    channels : tuple of str
        Names along the last axis: ("shear_x", "shear_y", "normal"), or the sides of a bridge.
    unit : str
        "count", "V", "Pa", "N"…
    sequence : int
        Number of the scan, as counted by the device if it does.
    time : float
        Time in s since the first frame, by the clock of the device, or of the host if the device
    has none.
    quality : Quality
    truth : Truth or None
    monotonic_ns : int or None
        Arrival on the host's monotonic clock; None for frames that did not just arrive.
    wall_ns : int or None
        Arrival in wall-clock time, ns since 1970. Recordings keep it.
    saturated : (rows, cols) bool, optional
        Taxels at an end of their range, if the driver knows which.
    calibration : str
        Id of the calibration of the values (`Calibration.identity`); empty if there is none.
    """

    values: NDArray[np.float64]
    channels: tuple[str, ...]
    unit: str
    sequence: int
    time: float
    quality: Quality = Quality.GOOD
    truth: Truth | None = None
    monotonic_ns: int | None = None
    wall_ns: int | None = None
    calibration: str = ""
    saturated: NDArray[np.bool_] | None = None

    def __post_init__(self) -> None:
        if not isinstance(cast(object, self.values), np.ndarray) or not isinstance(
            cast(object, self.channels), tuple
        ):
            raise ArrayError(
                "A frame needs an array of values and a tuple of channel names, got "
                f"{type(self.values).__name__} and {type(self.channels).__name__}."
            )
        if self.values.ndim != 3 or self.values.shape[2] != len(self.channels):
            raise ArrayError(
                f"A frame with the channels {self.channels} must have the shape "
                f"(rows, cols, {len(self.channels)}), got {self.values.shape}."
            )
        if self.saturated is not None and self.saturated.shape != self.shape:
            raise ArrayError(
                f"The saturated taxels of a frame must have the shape {self.shape}, got "
                f"{self.saturated.shape}."
            )
        if self.saturated is not None:
            object.__setattr__(self, "saturated", read_only(self.saturated))
        object.__setattr__(self, "values", read_only(self.values))

    def __repr__(self) -> str:
        rows, cols = self.shape
        flags = f", {self.quality.name}" if self.quality else ""
        return (
            f"Frame({self.sequence} at {self.time:.4f} s, {rows}×{cols}, "
            f"{', '.join(self.channels)} in {self.unit}{flags})"
        )

    def _repr_html_(self) -> str:
        top = float(np.nanmax(np.abs(self.values), initial=0.0))
        shown = [sharing.picture(name, values, top) for name, values in self.maps().items()]
        pairs = [("time", f"{self.time:.4f} s"), ("unit", self.unit)]
        return sharing.facts(f"Frame {self.sequence}", pairs, shown)

    def maps(self) -> dict[str, NDArray[np.float64]]:
        """Return the values of each channel, (rows, cols), by the name of the channel."""
        return shown_maps(self.values, self.channels, self.unit)

    def plot(self, ax: object = None) -> object:
        """Draw one map per channel with Matplotlib, and return the axes."""
        from cnnum import sharing

        return sharing.maps(self.maps(), ax, self.unit)

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return self.values.shape[0], self.values.shape[1]

    @property
    def bad(self) -> bool:
        """Whether the frame is too faulty to be processed."""
        return bool(self.quality & BAD)

    @property
    def repeated(self) -> bool:
        """Whether the frame repeats the previous scan."""
        return bool(self.quality & Quality.REPEATED)


def truth_columns(truths: Sequence[Truth | None]) -> dict[str, Floats]:
    """Return (frames,) arrays of the ground truth by name; NaN in frames without."""
    names = dict.fromkeys(name for truth in truths if truth for name in truth.values)
    return {
        name: np.array([truth.get(name, np.nan) if truth else np.nan for truth in truths])
        for name in names
    }
