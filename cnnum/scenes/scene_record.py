"""The results of a scene: events and wanted fields frame by frame, and a summary."""

import csv
import io
import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, fields
from importlib import import_module
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

import numpy as np

from cnnum import sharing
from cnnum.arrays import Floats
from cnnum.drivers.driver import Counters
from cnnum.errors import SceneError, name_error
from cnnum.safety.files import written
from cnnum.scenes.events import Event
from cnnum.values import same

if TYPE_CHECKING:
    from cnnum.scenes.frame_path import FrameResult


LEAST, MOST = 1e-9, 1e6
PER_DECADE = 232
"""Bins: each is 1 % wider than the one before."""


def place_of(value: float) -> int:
    """Return the bin of a number."""
    return int(PER_DECADE * math.log10(min(max(LEAST, value), MOST) / LEAST))


class Histogram:
    """Counts positive numbers in bins 1 % wide, from 1e-9 to 1e6; those beyond in the end bins.

    A quantile is the mean of the numbers in its bin. So it is within 1 % of the exact one, and
    exact where all numbers of the bin are equal.
    """

    __slots__ = ("_counts", "_sums", "total")

    def __init__(self) -> None:
        bins = math.ceil(PER_DECADE * math.log10(MOST / LEAST)) + 1
        self._counts = [0] * bins
        self._sums = [0.0] * bins
        self.total = 0

    def add(self, value: float) -> None:
        """Count a number."""
        self.add_at(place_of(value), value)

    def add_at(self, place: int, value: float) -> None:
        """Count a number whose bin is known."""
        self._counts[place] += 1
        self._sums[place] += value
        self.total += 1

    def quantile(self, share: float) -> float:
        """Return the number that this share of all is not above; 0 where there is none."""
        rank, seen = max(1, math.ceil(share * self.total)), 0
        for count, total in zip(self._counts, self._sums, strict=True):
            seen += count
            if seen >= rank:
                return total / count
        return 0.0


@dataclass(frozen=True, slots=True)
class Summary:
    """Summary of a scene: ``sent == handed_on + dropped + skipped + refused``.

    Attributes
    ----------
    frames : int
        Frames that the driver delivered, including bad and repeated ones but not those that ran
        silently before the requested part.
    handed_on : int
        Frames on which the program ran.
    refused : int
        Bad frames that were skipped: flagged by the driver, out of range, or unusable for the
        program.
    repeated : int
        Repeated scans.
    counters : Counters
        Counters of the driver.
    saturated : int
        Frames with a taxel at an end of its range because of a load: loads in them are lower
        bounds.
    masked : int
        Frames with a taxel that had dropped out and was continued from its neighbours.
    dropouts : int
        Number of times that a taxel has dropped out.
    longest_gap : float
        Longest time in s between two frames on which the program ran, with a bad or lost frame
        between them; 0 if there was none.
    p50_us, p99_us : float
        Time from a frame in host memory to its events, µs, within 1 %.
    arrival_p50_us, arrival_p99_us : float or None
        Time from the arrival of a frame at its port to its events, µs; None if none came live.
    before : int
        Frames that ran silently before the requested part.
    """

    frames: int
    handed_on: int
    refused: int
    repeated: int
    counters: Counters
    longest_gap: float
    p50_us: float
    p99_us: float
    arrival_p50_us: float | None = None
    arrival_p99_us: float | None = None
    before: int = 0
    saturated: int = 0
    masked: int = 0
    dropouts: int = 0

    @property
    def bad_frames(self) -> int:
        """Refused frames, and packets or rows that the driver found damaged."""
        return self.refused + self.counters.bad

    @property
    def dropped(self) -> int:
        """Scans that were lost on the way, including damaged packets."""
        return self.counters.dropped

    @property
    def skipped(self) -> int:
        """Scans that were not used: older ones, repeats, and those outside the requested part."""
        cut_off = self.frames - self.handed_on - self.refused - self.repeated
        return self.counters.skipped + self.repeated + cut_off + self.counters.waiting + self.before

    @property
    def sent(self) -> int:
        """Scans that the array has sent by its numbers or, without numbers, those that arrived."""
        sent = self.counters.sent
        if sent is not None:
            return sent
        return self.before + self.frames + self.dropped + self.counters.skipped


class EventList(list[Event]):
    """A list of events.

    Parameters
    ----------
    events : iterable of Event
    """

    def __init__(self, events: Iterable[Event] = ()) -> None:
        super().__init__(events)

    def __repr__(self) -> str:
        kinds = [event.title for event in self]
        counted = ", ".join(f"{kinds.count(kind)} {kind}" for kind in dict.fromkeys(kinds))
        return f"EventList({counted or 'empty'})"

    def _repr_html_(self) -> str:
        rows = [
            (f"{event.time:.3f} s", event.title, str(event).partition(", ")[2]) for event in self
        ]
        return sharing.table(f"{len(self)} events", ("time", "event", "about"), rows)

    def plot(self, ax: object = None) -> object:
        """Draw the events over time, one row per kind, and return the axes."""
        from cnnum import sharing

        return sharing.marks([event.title for event in self], [event.time for event in self], ax)

    def to_dataframe(self) -> Any:
        """Return a `pandas.DataFrame` with one row per event (extra `tables`)."""
        return sharing.data_frame(self._columns())

    def to_xarray(self) -> Any:
        """Return an `xarray.Dataset` along the axis "event" (extra `tables`)."""
        variables = {name: (("event",), values) for name, values in self._columns().items()}
        return sharing.dataset(variables, {}, {})

    def _columns(self) -> dict[str, Any]:
        """Return a column for each field; a value that an event lacks is NaN or empty."""
        columns: dict[str, Any] = {}
        for name in (field.name for field in fields(Event)):
            values: list[Any] = [getattr(event, name) for event in self]
            if name == "where":
                for place, axis in enumerate(("row", "column")):
                    columns[axis] = np.array([v[place] if v else np.nan for v in values])
            elif name in ("kind", "phase", "unit"):
                columns[name] = np.array([value or "" for value in values], dtype=np.str_)
            else:
                columns[name] = np.array([np.nan if v is None else v for v in values])
        return columns


FIELD_AXES = ("row", "col")

SHOWN = 6
"""Fields that a short description names."""

SPIKES = ("_spikes", "_spike_time", "_spike_gap")
"""Endings of the outputs of a channel that its spikes are made of."""

ADDRESS_EVENT = np.dtype([("t", "<i8"), ("x", "<i2"), ("y", "<i2"), ("p", "i1")])
"""A spike as event cameras record it: time, µs; column; row; 1, or 0 where it is negative."""


class SceneRecord:
    """Fields and events of the frames of a scene, without bad and repeated frames.

    Parameters
    ----------
    names : sequence of str
        Outputs to keep, in order.

    Attributes
    ----------
    events : EventList
    """

    def __init__(self, names: Iterable[str]) -> None:
        self.names = tuple(names)
        self.events = EventList()
        self._times: list[float] = []
        self._numbers: list[int] = []
        self._bound: list[bool] = []
        self._values: dict[str, list[Floats]] = {name: [] for name in self.names}

    def add(self, moment: "FrameResult") -> None:
        """Add the results of a frame, or only its events if it has no outputs."""
        self.events.extend(moment.events)
        if not moment.outputs:
            return
        self._times.append(moment.frame.time)
        self._numbers.append(moment.number)
        self._bound.append(moment.load_is_bound)
        for name, values in self._values.items():
            values.append(np.array(moment.outputs[name]))

    @property
    def times(self) -> Floats:
        """(frames,) time of every frame, s."""
        return np.array(self._times)

    @property
    def numbers(self) -> np.ndarray:
        """(frames,) number of every frame, from 0."""
        return np.array(self._numbers, dtype=np.int64)

    @property
    def load_is_bound(self) -> np.ndarray:
        """(frames,) whether a taxel was at an end of its range, so that loads are lower bounds."""
        return np.array(self._bound, dtype=bool)

    def __len__(self) -> int:
        return len(self._times)

    def _content(self) -> tuple[object, ...]:
        rows = self._times, self._numbers, self._bound
        return self.names, list(self.events), *rows, self._values

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, SceneRecord):
            return NotImplemented
        return same(self._content(), other._content())

    def __hash__(self) -> int:
        return hash((self.names, tuple(self._times), tuple(self._numbers)))

    def __repr__(self) -> str:
        some = ", ".join(self.names[:SHOWN]) or "no field"
        more = len(self.names) - SHOWN
        fields = f"{some} and {more} more" if more > 0 else some
        return f"SceneRecord({len(self)} frames with {fields}; {self.events!r})"

    def __getitem__(self, name: str) -> Floats:
        """Return (frames, rows, cols) or (frames,) values of a field.

        Raises
        ------
        UnknownNameError
            If it was not wanted.
        """
        if name not in self._values:
            raise name_error("field", name, self.names)
        return np.array(self._values[name])

    def address_events(self, channel: str) -> np.ndarray:
        """Return the spikes of a channel as address events, ordered by time.

        Parameters
        ----------
        channel : str
            "sa1", "ra1", "pc" or "sa2" of the program `receptors`. The record must keep its
            `_spikes`, `_spike_time` and `_spike_gap`.

        Returns
        -------
        (events,) of `ADDRESS_EVENT`
            The fields t (µs on the clock of the frames), x (column), y (row) and p (1 or 0).

        Raises
        ------
        UnknownNameError
            If the record does not keep all three.
        """
        count, time, gap = (self[channel + ending] for ending in SPIKES)
        number, row, column = np.nonzero(count)
        repeats = np.abs(count[number, row, column]).round().astype(np.int64)
        which = np.repeat(np.arange(repeats.size), repeats)
        nth = np.arange(which.size) - np.repeat(np.cumsum(repeats) - repeats, repeats)
        at = number[which], row[which], column[which]
        events = np.empty(which.size, ADDRESS_EVENT)
        events["t"] = np.rint(1e6 * (self.times[at[0]] + time[at] + nth * gap[at]))
        events["x"], events["y"], events["p"] = at[2], at[1], count[at] > 0
        return events[np.argsort(events["t"], kind="stable")]

    def plot(self, ax: object = None) -> object:
        """Draw the fields over time (for maps, the largest magnitude), or the events if there are
        none.

        Returns the axes.
        """
        from cnnum import sharing

        if not self.names:
            return self.events.plot(ax)
        values = {name: self[name] for name in self.names}
        named = {
            name: value if value.ndim == 1 else np.abs(value).max(axis=tuple(range(1, value.ndim)))
            for name, value in values.items()
        }
        maps = any(self[name].ndim > 1 for name in self.names)
        labels = ("time (s)", "value, or largest of a map" if maps else "value")
        return sharing.lines(self.times, named, ax, labels)

    def to_xarray(self) -> Any:
        """Return an `xarray.Dataset` with the axes time, row and col (extra `tables`)."""
        coordinates = {name: (("time",), values) for name, values in self.leading().items()}
        return sharing.dataset(self.variables(), coordinates, {})

    def to_dataframe(self) -> Any:
        """Return a `pandas.DataFrame`, one row per frame, one column per cell (extra `tables`)."""
        columns: dict[str, Any] = dict(self.leading())
        for name in self.names:
            columns |= sharing.cell_columns(name, self[name])
        return sharing.data_frame(columns)

    def save(self, path: str | Path, *, force: bool = False) -> None:
        """Write the fields (.npz, .csv or .nc, NetCDF 3), or the spikes of a channel (.txt).

        A .txt file has one line `t x y p` per spike, as event cameras write them: time in s,
        column, row, and 1, or 0 for a negative spike (Mueggler et al., Int. J. Robotics Res. 36
        (2017) 142).

        Parameters
        ----------
        path : str or Path
        force : bool
            Whether an existing file is replaced.

        Raises
        ------
        UnknownNameError
            If the suffix is another one.
        ReportError
            If there is such a file, or it cannot be written.
        SceneError
            If a .txt file is requested and the record does not keep the spikes of exactly one
            channel.
        """
        target = Path(path)
        suffix_of(target)
        refuse_no_spikes(target, self.names)
        with written(target, force=force) as file:
            WRITERS[target.suffix.lower()](file, self)

    def leading(self) -> dict[str, np.ndarray]:
        """Return the columns that come before the fields, by name."""
        return {"time": self.times, "frame": self.numbers, "load_is_bound": self.load_is_bound}

    def variables(self) -> dict[str, tuple[tuple[str, ...], Floats]]:
        """Return the axes and values of every field."""
        values = {name: self[name] for name in self.names}
        return {name: (("time", *FIELD_AXES[: v.ndim - 1]), v) for name, v in values.items()}


def suffix_of(target: Path) -> None:
    """Raise if a file's kind is unknown, before the work starts.

    Raises
    ------
    UnknownNameError
        If its suffix is none of `WRITERS`.
    """
    if target.suffix.lower() not in WRITERS:
        raise name_error("kind of file", target.suffix or target.name, WRITERS)


def _write_npz(file: IO[bytes], record: SceneRecord) -> None:
    fields = {name: record[name] for name in record.names}
    np.savez_compressed(file, allow_pickle=False, **record.leading(), **fields)


def _write_csv(file: IO[bytes], record: SceneRecord) -> None:
    columns: dict[str, Any] = {
        name: values.astype(np.int64) if values.dtype == bool else values
        for name, values in record.leading().items()
    }
    for name in record.names:
        columns |= sharing.cell_columns(name, record[name])
    text = io.TextIOWrapper(file, encoding="utf-8", newline="", write_through=True)
    try:
        writer = csv.writer(text)
        writer.writerow(columns)
        writer.writerows(zip(*(column.tolist() for column in columns.values()), strict=True))
    finally:
        text.detach()


def _write_netcdf(file: IO[bytes], record: SceneRecord) -> None:
    netcdf: Any = import_module("scipy.io").netcdf_file
    leading = record.leading()
    named: dict[str, tuple[tuple[str, ...], Any]] = {
        **{name: (("time",), values) for name, values in leading.items()},
        **record.variables(),
    }
    made = io.BytesIO()  # it is closed with the file, so that it is read before
    with netcdf(made, "w") as whole:
        for axes, values in named.values():
            for axis, size in zip(axes, values.shape, strict=True):
                if axis not in whole.dimensions:
                    whole.createDimension(axis, size)
        for name, (axes, values) in named.items():
            kind = "i4" if name in leading and values.dtype.kind != "f" else "f8"
            whole.createVariable(name, kind, axes)[:] = values
        whole.variables["time"].units = "s"
        whole.flush()
        file.write(made.getbuffer())


def _write_address_events(file: IO[bytes], record: SceneRecord) -> None:
    events = record.address_events(_channel_of(record.names))
    columns = [events[name].tolist() for name in ("t", "x", "y", "p")]
    lines = (f"{1e-6 * t:.6f} {x} {y} {p}\n" for t, x, y, p in zip(*columns, strict=True))
    file.write("".join(lines).encode("ascii"))


def _channel_of(names: Iterable[str]) -> str:
    """Return the only channel whose spikes are among some fields; "" without exactly one."""
    first = SPIKES[0]
    result = {name.removesuffix(first) for name in names if name.endswith(first)}
    known = set(names)
    whole = [channel for channel in result if known >= {channel + ending for ending in SPIKES}]
    return whole[0] if len(result) == len(whole) == 1 else ""


def refuse_no_spikes(target: Path, names: Iterable[str]) -> None:
    """Raise if address events would be written for no channel or for several.

    Raises
    ------
    SceneError
    """
    if target.suffix.lower() == ADDRESS_EVENTS and not _channel_of(tuple(names)):
        raise SceneError(
            f"'{target.name}' can hold the spikes of one channel only: name its three outputs "
            "in the scene's 'needs', as in ra1_spikes, ra1_spike_time and ra1_spike_gap."
        )


ADDRESS_EVENTS = ".txt"
"""Suffix of a file of address events."""

WRITERS: Mapping[str, Callable[[IO[bytes], SceneRecord], None]] = {
    ".npz": _write_npz,
    ".csv": _write_csv,
    ".nc": _write_netcdf,
    ADDRESS_EVENTS: _write_address_events,
}
"""By the suffix of the file."""


def refuse_no_fields(names: tuple[str, ...], outputs: Iterable[str]) -> None:
    """Raise if a scene to be saved outputs only events.

    Raises
    ------
    SceneError
        With fields that it could want.
    """
    if not names:
        some = ", ".join(list(outputs)[:12])
        raise SceneError(
            "The scene requests only events and no field, so there is nothing to save: add a "
            f"field to its 'needs', as in {some}."
        )
