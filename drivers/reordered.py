"""Numbers of a frame in another order or unit, or with other signs, than their source has them.

What a layout says of a file, a scene says in its table ``[frames]`` of any array, and a descriptor
of its own: which channel is which, whether a sign is turned, in which order the numbers follow each
other, which axes count from the other end, and in which unit they are.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from cnnum.arrays import Floats, Shape
from cnnum.drivers.driver import Closing, Counters, Driver
from cnnum.drivers.options import require, require_channels
from cnnum.errors import SceneError
from cnnum.frame import Frame, Limits, limits_of
from cnnum.recordings.recording import channel_names
from cnnum.safety.names import checked_name

AXES = ("rows", "cols", "channels")


@dataclass(frozen=True, slots=True)
class Reading:
    """How the numbers of a frame are meant.

    Attributes
    ----------
    channels : tuple of str
        Names of a taxel's numbers in their order; a minus turns the sign. None are as they came.
    order : str
        Axes of the numbers from the slowest to the fastest, as in "frames cols rows channels"; ""
        where they lie as the source says.
    flip : tuple of "rows" and "cols"
        Axes that are counted from the other end.
    unit : str
        Unit of the numbers; "" where it is the one that the source names.
    """

    channels: tuple[str, ...] = ()
    order: str = ""
    flip: tuple[Literal["rows", "cols"], ...] = ()
    unit: str = ""

    def __post_init__(self) -> None:
        if self.unit:
            checked_name("a unit", self.unit, SceneError)
        if self.channels:
            require_channels(self.plain)
        parts = self.order.split()
        holds = not parts or (parts[0] == "frames" and sorted(parts[1:]) == sorted(AXES))
        said = "axes from the slowest to the fastest, as in 'frames cols rows channels'"
        require("order", holds, said, self.order)

    def __bool__(self) -> bool:
        return bool(self.channels or self.order or self.flip or self.unit)

    @property
    def plain(self) -> tuple[str, ...]:
        """The names of the channels without a sign."""
        return tuple(name.removeprefix("-") for name in self.channels)

    def names(self, known: tuple[str, ...]) -> tuple[str, ...]:
        """Return the full names of an array's channels.

        Raises
        ------
        SceneError
            If they are more or fewer.
        """
        if not self.channels:
            return known
        said = f"a name for each of the {len(known)} channels, as in ['x', 'y', '-z']"
        require("channels", len(self.channels) == len(known), said, list(self.channels))
        return channel_names(self.plain, len(known))

    def of(self, values: Floats) -> Floats:
        """Return the numbers of a frame, (rows, cols, channels), as they are meant."""
        if self.order:
            sizes: dict[str, int] = dict(zip(AXES, values.shape, strict=True))
            parts = self.order.split()[1:]
            whole = values.reshape([sizes[name] for name in parts])
            values = whole.transpose([parts.index(name) for name in AXES])
        back = tuple(axis for axis, name in enumerate(AXES) if name in self.flip)
        return np.asarray(np.flip(values, back) * self._signs, np.float64)

    @property
    def _signs(self) -> Any:
        return [-1.0 if n.startswith("-") else 1.0 for n in self.channels] if self.channels else 1.0

    def frame(self, frame: Frame) -> Frame:
        """Return a frame as it is meant."""
        marks = frame.saturated
        if marks is not None and (self.order or self.flip):
            plain = replace(self, channels=(), unit="")
            each = np.repeat(marks[..., np.newaxis].astype(float), frame.values.shape[2], axis=2)
            marks = np.asarray(plain.of(each).any(axis=2))
        values, names = self.of(frame.values), self.names(frame.channels)
        unit = self.unit or frame.unit
        return replace(frame, values=values, channels=names, saturated=marks, unit=unit)

    def limits(self, known: Limits | None, channels: int) -> Limits | None:
        """Return the limits of sound taxels with the signs of the channels."""
        if known is None or not self.channels:
            return known
        ends = np.sort(limits_of(known, channels) * self._signs, axis=0)
        return tuple((float(low), float(high)) for low, high in ends.T)


class Reordered(Closing):
    """A driver whose frames are read as a `Reading` says; all else of it stays.

    Raises
    ------
    SceneError
        If the channels are not those of the driver.
    """

    def __init__(self, driver: Driver, reading: Reading) -> None:
        self._driver, self._reading = driver, reading
        self.channels = reading.names(driver.channels)
        known = getattr(driver, "limits", None)
        self.limits = reading.limits(known, len(driver.channels))

    @property
    def shape(self) -> Shape:
        """That of the driver."""
        return self._driver.shape

    @property
    def unit(self) -> str:
        """That of the driver, unless the reading names another."""
        return self._reading.unit or self._driver.unit

    @property
    def rate(self) -> float:
        """That of the driver."""
        return self._driver.rate

    @property
    def counters(self) -> Counters:
        """Those of the driver."""
        return self._driver.counters

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):
            raise AttributeError(name)
        return getattr(self._driver, name)

    def frames(self) -> Iterator[Frame]:
        """Yield the frames of the driver as they are meant."""
        for frame in self._driver.frames():
            yield self._reading.frame(frame)

    def close(self) -> None:
        """Close the driver."""
        self._driver.close()
