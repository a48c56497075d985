"""The layout of a data file in a small TOML: the place and meaning of its numbers."""

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, Literal

from cnnum.drivers.geometry import Positions, checked_positions
from cnnum.drivers.options import (
    read_options_file,
    require,
    require_channels,
    require_limits,
)
from cnnum.drivers.text_table import THOUSANDS, TextForm
from cnnum.errors import SceneError
from cnnum.frame import Limits, TimeUnit, limits_of
from cnnum.recordings.recording import channel_names
from cnnum.recordings.times import FASTEST

EXAMPLE = 'shape = [4, 4], channels = ["x", "y", "z"], rate = 60.0, unit = "count"'
"""The least that a layout says, for the sentence of an error."""

SECONDS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}

MOST_CELLS = 1 << 20
"""Taxels of an array."""

MOST_SKIPPED = 1000
"""Lines before the numbers of a CSV file."""

ORDERS = {
    "channels-last": "frames rows cols channels",
    "channels-first": "frames channels rows cols",
}
AXES = (
    ("frames", "rows", "cols", "channels"),
    ("frames", "taxels", "channels"),
    ("frames", "rows", "pads", "cols", "channels"),
)
"""Names of the axes of an array."""

_PLACE = re.compile(r"\{(row|col|n|channel|axis)\}")


@dataclass(frozen=True, slots=True)
class DataLayout:
    """The layout of a data file.

    Attributes
    ----------
    shape : (rows, cols)
    channels : tuple of str
        Names of a taxel's numbers in their order, as the file writes them. "x", "y" and "z" are the
        shear to the right, the shear downwards and the normal load; a minus before a name turns the
        sign of its numbers.
    names : tuple of str
        The words that stand for the channels in the names of columns, where these are others.
    values : str or tuple of str
        Of a table a pattern of its columns, as in "t{n}_{channel}" or "r{row}c{col}{channel}", or
        all columns row by row. Of other files the name of the array, of messages a field.
    order : str
        The axes of an array from the slowest to the fastest, as in "frames rows cols channels" or
        "rows cols channels frames"; neighbours may be one axis. "channels-last" and
        "channels-first" stand for "frames rows cols channels" and "frames channels rows cols".
        Unless given it is the one that fits the shape.
    flip : tuple of "rows" and "cols"
        Axes that the file counts from the other end.
    first : int
        The first number that {row}, {col} and {n} stand for.
    unit : str
    rate : float, optional
        Hz; by the times unless given.
    time : str
        Column, array or field of the times; empty if there is none. In text files these may be
        dates and times of day, too.
    time_unit : "s", "ms", "us" or "ns"
        Seconds unless given; then frames that are seconds apart are not questioned.
    time_format : str
        Format of dates that are not in a usual form: as `datetime.strptime` takes it.
    truth : tuple of str
        Columns or arrays of the ground truth of every frame.
    pads : int
        Pads that lie side by side in the columns; an array may have an axis "pads" of its own.
    pitch : float, optional
        Distance of the taxels, m; of taxels at positions, the size of a cell of their grid.
    limits : (low, high), or one pair per channel, optional
        The least and the largest number of a sound taxel, as the file has them: one beyond has
        dropped out.
    bandwidth : float, optional
        Highest frequency of loads on the array, Hz, as the page on bad frames has it.
    positions : sequence of (x, y)
        Places of the taxels, mm, row by row, where these lie on no square grid
        (`cnnum.drivers.geometry`).
    separator : str
        Between the fields of a table.
    decimal : "." or ","
        In the numbers of a table.
    thousands : str
        Between groups of three digits in the numbers of a table, as in "16,300"; "" for none.
    header : bool
        Whether the first line of a table names the columns; if not, they are "1", "2", …
    skip : int
        Lines of a table before that.
    comment : str
        Lines of a table that begin with it are left out; "" for none.
    block : bool
        Whether a text file has a block of lines a frame, one line a row of taxels.
    topic : str
        Topic of the messages in an MCAP file or a bag.
    protocol : str
        Protocol of a file that holds what an array sent: its name, as of the driver "serial".
    """

    RENAMED: ClassVar = {
        "axes": "channels",
        "order=axis-last": "channels-last",
        "order=axis-first": "channels-first",
    }

    shape: tuple[int, int]
    channels: tuple[str, ...] = ("x", "y", "z")
    names: tuple[str, ...] = ()
    values: str | tuple[str, ...] = ""
    order: str = ""
    flip: tuple[Literal["rows", "cols"], ...] = ()
    first: int = 0
    unit: str = "count"
    rate: float | None = None
    time: str = ""
    time_unit: TimeUnit = ""
    time_format: str = ""
    truth: tuple[str, ...] = ()
    pads: int = 1
    pitch: float | None = None
    positions: Positions = ()
    limits: Limits | None = None
    bandwidth: float | None = None
    separator: str = ","
    decimal: Literal[".", ","] = "."
    thousands: str = ""
    header: bool = True
    skip: int = 0
    comment: str = "#"
    block: bool = False
    topic: str = ""
    protocol: str = ""

    def __post_init__(self) -> None:
        rows, cols = self.shape
        holds = min(rows, cols) >= 1 and rows * cols <= MOST_CELLS
        require("shape", holds, "rows and columns from 1 up", list(self.shape))
        holds = self.rate is None or 0 < self.rate < FASTEST
        require("rate", holds, f"Hz above 0, below {FASTEST:g}", self.rate)
        timed = bool(self.time or self.topic or self.protocol)
        require("rate", self.rate is not None or timed, "given, or 'time'", self.rate)
        require("pads", 1 <= self.pads <= cols, f"1 to the {cols} columns", self.pads)
        holds = "pads" not in self.order or cols % self.pads == 0
        require("pads", holds, f"a divisor of the {cols} columns, as 'order' has them", self.pads)
        holds = self.pitch is None or 1e-7 <= self.pitch <= 1.0
        require("pitch", holds, "1e-7 to 1 m", self.pitch)
        if self.positions:
            checked_positions(self.positions, rows * cols, self.pitch)
            require("pads", self.pads == 1, "1 with 'positions', which place all", self.pads)
        # numbers with decimal commas between commas stand in quotes
        holds = len(self.separator) == 1 and self.separator not in '\r\n".'
        require("separator", holds, "one sign, which no number has", self.separator)
        holds = self.thousands in ("", *THOUSANDS) and self.thousands != self.decimal
        require("thousands", holds, "',', '.', \"'\" or ' ', other than 'decimal'", self.thousands)
        require("skip", 0 <= self.skip <= MOST_SKIPPED, f"0 to {MOST_SKIPPED}", self.skip)
        require_channels(self.plain)
        require_limits(self.limits, len(self.channels))
        known = self.bandwidth
        holds = known is None or 0.0 < known < math.inf
        require("bandwidth", holds, "a positive number of Hz", known)
        holds = len(self.names) in (0, len(self.channels))
        require("names", holds, "one word per channel", list(self.names))
        parts = self.order.split()
        holds = self.order in ("", *ORDERS) or (
            parts.count("frames") == 1 and any(sorted(parts) == sorted(known) for known in AXES)
        )
        said = "axes from the slowest to the fastest, as in 'frames rows cols channels'"
        require("order", holds, said, self.order)

    @property
    def plain(self) -> tuple[str, ...]:
        """The names of the channels without a sign."""
        return tuple(name.removeprefix("-") for name in self.channels)

    @property
    def signs(self) -> tuple[float, ...]:
        """1 or -1 for each channel."""
        return tuple(-1.0 if name.startswith("-") else 1.0 for name in self.channels)

    @property
    def sound(self) -> Limits | None:
        """The limits of the values of sound taxels, with the signs of the channels."""
        if self.limits is None:
            return None
        pairs = limits_of(self.limits, len(self.channels)).T.tolist()
        signed = zip(pairs, self.signs, strict=True)
        return tuple((low, high) if sign > 0.0 else (-high, -low) for (low, high), sign in signed)

    @property
    def full_names(self) -> tuple[str, ...]:
        """The names of the channels, as frames have them."""
        return channel_names(self.plain, len(self.channels))

    @property
    def second(self) -> float:
        """The unit of the times, s."""
        return SECONDS[self.time_unit or "s"]

    @property
    def numbers(self) -> int:
        """Count of numbers in a frame."""
        return self.shape[0] * self.shape[1] * len(self.channels)

    @property
    def form(self) -> TextForm:
        """Form of a table."""
        return TextForm(
            self.separator, self.decimal, self.header, self.skip, self.comment, self.thousands
        )

    def columns(self, header: tuple[str, ...]) -> tuple[str, ...]:
        """Return the columns of a CSV file, row by row, the channels of a taxel together.

        Parameters
        ----------
        header : tuple of str
            All columns of the file: without a line of names, those but the times and truths.

        Raises
        ------
        SceneError
            If there are more or fewer than the numbers of a frame.
        """
        if isinstance(self.values, tuple):
            names = self.values
        elif not self.header and not self.values:
            names = tuple(name for name in header if name not in {self.time, *self.truth})
        else:
            pattern = self.values or "r{row}_c{col}_{channel}"
            names = tuple(_named(pattern, place) for place in self._places())
        if len(set(names)) != self.numbers:
            rows, cols = self.shape
            raise SceneError(
                f"'values' must name {rows}×{cols}×{len(self.channels)} = {self.numbers} "
                f"different columns, got {len(set(names))}: a pattern must contain {{row}} and "
                "{col}, or {n}, and {channel}, as in 't{n}_{channel}'."
            )
        return names

    def _places(self) -> Iterator[dict[str, str]]:
        rows, cols = self.shape
        for row in range(rows):
            for col in range(cols):
                numbers = {"row": row, "col": col, "n": row * cols + col}
                place = {key: str(number + self.first) for key, number in numbers.items()}
                words = self.names or self.plain
                yield from ({**place, "channel": name, "axis": name} for name in words)


def _named(pattern: str, place: dict[str, str]) -> str:
    return _PLACE.sub(lambda match: place[match[1]], pattern)


def read_layout(path: Path) -> DataLayout:
    """Read a layout; it raises as `read_options_file`."""
    return read_options_file(DataLayout, "The layout", path, {})
