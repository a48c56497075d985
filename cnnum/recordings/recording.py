"""A recording in memory: arrays of your own become a file that every command reads."""

from __future__ import annotations  # signatures that `help` shows as they are written

import re
import tempfile
import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cnnum import sharing
from cnnum.arrays import Floats, numbers
from cnnum.errors import ArrayError, RecordingError, RecordingWarning
from cnnum.frame import FORCE_AXES, Frame, Quality, Truth, contradicted, shown_maps, time_unit_of
from cnnum.recordings.export import export, marked_text, suffix_of, write_index
from cnnum.recordings.layout import Layout
from cnnum.recordings.mcap_chunks import CHUNK_BYTES, ChunkMaker, beginning, untimed
from cnnum.recordings.reader import look
from cnnum.recordings.times import FASTEST, numbered, rate_of
from cnnum.renamed import renamed, warn_of
from cnnum.safety.files import refuse_target, written
from cnnum.safety.values import as_path, checked_name, is_real, shown
from cnnum.tactile.array_calibration import ArrayCalibration
from cnnum.values import ByContent, read_only

AXES = {"x": "shear_x", "y": "shear_y", "z": "normal"}
"""Short names of the three axes of a taxel: to the right, downwards, and into the skin."""

CELL = re.compile(r"(.+)\[(\d{1,4}), (\d{1,4})\]")
"""A column of a data frame: channel, row and column."""

MARKED = re.compile(r"\br(\d{1,4})_c(\d{1,4})\b")
"""A taxel at an end of its range, as `marked_text` writes it."""

TRUTH = "truth "
KNOWN = {"time", "sequence", "quality", "saturated", "log time (ns)", "rate (Hz)", "unit", "pads"}
"""Columns of a data frame that do not belong to a taxel."""


@dataclass(frozen=True, slots=True, eq=False, init=False, repr=False)
class Recording(ByContent):
    """Frames of an array in memory, with everything that a scene needs.

    Parameters
    ----------
    values : (frames, rows, cols, channels) or (frames, rows, cols) float
        A frame with NaN or infinity is replayed as a bad frame. Without a last axis there is one
        channel. Values of shape (frames, pads, rows, cols, channels) are stored with the columns
        of all pads side by side.
    rate : float, Hz, optional
        By default, the rate follows from the usual step of the times; a step that is too long for
        an array gives a warning.
    unit : str
        "count", "V", "N", "Pa", "strain"…
    channels : sequence of str, optional
        Names of the channels in order: "x", "y" and "z" are the shear to the right, the shear
        downwards and the normal load. These are the default for three channels, and "z" for one.
    times : (frames,) float, s, or dates or durations of NumPy or pandas, optional
        By default, frame n is at n / rate. Dates become seconds since the first.
    truth : mapping of str to (frames,) float, optional
        Ground truth of every frame, by name.
    quality : (frames,) int, optional
        Flags of `cnnum.Quality`. By default, frames before which scans are missing are marked.
    saturated : (frames, rows, cols) bool, optional
        Taxels at an end of their range. Frames with such taxels get the flag `Quality.SATURATED`.
    sequence : (frames,) int, optional
        Numbers of the scans. By default, they follow from the times: after a pause or missing
        scans the number jumps, and the frame has the flag `Quality.DROPPED_BEFORE`.
    wall_ns : (frames,) int, optional
        Wall-clock time at which the frames arrived, ns since 1970.
    pads : int, optional
        Number of pads side by side in the columns. For values with five axes, it is the length of
        the second axis.

    Raises
    ------
    ArrayError
        If the parts do not fit together, or the rate is not positive or contradicts the times.
    """

    values: Floats
    rate: float
    unit: str
    channels: tuple[str, ...]
    times: Floats
    truth: Mapping[str, Floats] = field(default_factory=dict[str, Floats])
    quality: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    saturated: NDArray[np.bool_] | None = None
    sequence: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    wall_ns: NDArray[np.int64] | None = None
    pads: int | None = None

    @renamed(axes="channels")
    def __init__(
        self,
        values: ArrayLike,
        *,
        rate: float | None = None,
        unit: str = "count",
        channels: Sequence[str] | None = None,
        times: ArrayLike | None = None,
        truth: Mapping[str, ArrayLike] | None = None,
        quality: ArrayLike | None = None,
        saturated: ArrayLike | None = None,
        sequence: ArrayLike | None = None,
        wall_ns: ArrayLike | None = None,
        pads: int | None = None,
    ) -> None:
        array = numbers("values", values)
        array = array[..., np.newaxis] if array.ndim == 3 else array
        if array.ndim not in (4, 5) or 0 in array.shape:
            raise ArrayError(
                "The values of a recording must have the shape (frames, rows, cols, channels), "
                "or (frames, pads, rows, cols, channels) with pads, and at least one of each, "
                f"got {array.shape}."
            )
        if array.ndim == 5:
            pads = array.shape[1] if pads is None else pads
            if pads != array.shape[1]:
                raise ArrayError(f"'pads' is {pads!r}, but the values have {array.shape[1]} pads.")
            array = side_by_side(array)
            if saturated is not None and np.ndim(saturated) == 4:
                saturated = side_by_side(np.asarray(saturated))
        if pads is not None and (type(pads) is not int or pads < 1 or array.shape[2] % pads):
            raise ArrayError(
                f"'pads' must divide the {array.shape[2]} columns equally, got {shown(pads)}."
            )
        times = None if times is None else _seconds(times)
        stated = rate is not None
        if rate is None:
            rate = _rate(times, len(array))
        if not (is_real(rate) and 0.0 < rate < FASTEST):
            raise ArrayError(
                f"The rate of a recording must be above 0 Hz and below 1 MHz, got {rate!r}."
            )
        frames = len(array)
        given = np.zeros(frames) if quality is None else numbers("quality", quality)
        flags: NDArray[np.int64] = _per_frame("quality", given, frames).astype(np.int64)
        marks = _marks(saturated, array.shape[:3])
        if marks is not None:
            flags[marks.any(axis=(1, 2))] |= int(Quality.SATURATED)
        at = _times(times, frames, rate)
        if not stated and (seems := time_unit_of(at)):
            warnings.warn(
                f"The frames of a recording are {1.0 / rate:.4g} s apart by their times: if the "
                f"times are in {seems}, convert them to s; if not, also give rate={rate:.4g}.",
                RecordingWarning,
                stacklevel=3,
            )
        seen = None if times is None else contradicted(float(rate), at)
        if seen is not None:
            raise ArrayError(
                f"The rate of a recording is {rate:g} Hz, but its times give {seen:.4g} frames "
                "per second: correct the rate or the times."
            )
        if sequence is not None:
            scans = _whole("sequence", sequence, frames)
            if quality is None:
                flags[1:][np.diff(scans) > 1] |= int(Quality.DROPPED_BEFORE)
        elif times is None:
            scans = np.arange(frames)
        else:
            scans = numbered(at, rate, flags & int(Quality.REPEATED) != 0)
            flags[1:][np.diff(scans) > 1] |= int(Quality.DROPPED_BEFORE)
        parts: dict[str, object] = {
            "values": read_only(array),
            "rate": float(rate),
            "unit": checked_name("a unit", unit, ArrayError),
            "channels": channel_names(channels, array.shape[3]),
            "times": read_only(at),
            "truth": {
                checked_name("a truth", name, ArrayError): _per_frame(
                    f"truth '{name}'", row, frames
                )
                for name, row in (truth or {}).items()
            },
            "quality": read_only(flags),
            "saturated": marks,
            "sequence": read_only(scans),
            "wall_ns": None if wall_ns is None else _whole("wall_ns", wall_ns, frames),
            "pads": pads,
        }
        for name, value in parts.items():
            object.__setattr__(self, name, value)

    @classmethod
    def from_frames(
        cls, frames: Iterable[Frame], *, rate: float | None = None, pads: int | None = None
    ) -> Recording:
        """Return a recording of frames from a driver, with their flags, saturation marks and truth.

        Parameters
        ----------
        frames : iterable of Frame
            Frames of a single array.
        rate : float, Hz, optional
            By default, the rate follows from the times, or is 1 Hz if they give none.
        pads : int, optional
            Number of pads side by side in the columns.

        Raises
        ------
        ArrayError
            If there is no frame, or the frames are not from a single array.
        """
        held = list(frames)
        arrays = {(frame.shape, tuple(frame.channels), frame.unit) for frame in held}
        if len(arrays) != 1:
            raise ArrayError(
                "The frames of a recording must have one shape, one unit and the same channels, "
                f"got {len(arrays)} kinds of {len(held)} frames."
            )
        times = np.array([frame.time for frame in held])
        known = [frame.truth.values if frame.truth else {} for frame in held]
        truths = dict.fromkeys(name for truth in known for name in truth)
        came = [frame.wall_ns for frame in held if frame.wall_ns is not None]
        marks = None
        if any(frame.saturated is not None for frame in held):
            none = np.zeros(held[0].shape, np.bool_)
            marks = np.stack([none if f.saturated is None else f.saturated for f in held])
        return cls(
            np.stack([frame.values for frame in held]),
            rate=rate or rate_of(times) or 1.0,
            unit=held[0].unit,
            channels=held[0].channels,
            times=times,
            truth={name: [truth.get(name, np.nan) for truth in known] for name in truths},
            quality=[int(frame.quality) for frame in held],
            saturated=marks,
            sequence=[frame.sequence for frame in held],
            wall_ns=came if len(came) == len(held) else None,
            pads=pads,
        )

    @classmethod
    def from_mcap(cls, path: str | Path) -> Recording:
        """Return the recording in an MCAP file from `cnnum record`, even if truncated or damaged.

        `cnnum.load_recording` reads every kind of file, including messages of other programs.

        Raises
        ------
        RecordingError, CodecError
            If the file cannot be read, or is not a recording of cnnum.
        """
        contents = look(as_path(path, RecordingError))
        contents.warn()
        layout = contents.layout
        frames = (frame for frame, _ in contents.stored())
        return cls.from_frames(frames, rate=layout.rate, pads=layout.pads)

    @classmethod
    def from_lerobot(cls, folder: str | Path, episode: int | None = None) -> Recording:
        """Return the taxels of an episode of a LeRobot data set (layout 3.0; extra `lerobot`).

        Parameters
        ----------
        folder : str or Path
        episode : int, optional
            May be left out if the set has one.

        Raises
        ------
        RecordingError
            If there is no such episode, or the set has another layout or no taxels.
        """
        from cnnum.recordings.lerobot import address, read_lerobot

        path = as_path(folder, RecordingError)
        whole = isinstance(cast(object, episode), int | np.integer)
        if episode is not None and not (whole and episode >= 0):
            raise RecordingError(f"An episode is a whole number from 0 on, got {shown(episode)}.")
        return read_lerobot(path if episode is None else address(path, episode))

    @classmethod
    def from_xarray(cls, dataset: Any) -> Recording:
        """Return the recording in a dataset from `to_xarray`, or in a similar one of your own.

        Parameters
        ----------
        dataset : xarray.Dataset
            With "values" on the axes time, row, col and axis, and possibly pad. The coordinates
            time (s) and axis (names of channels), the variables "quality" and "saturated", and the
            attributes "rate", "unit" and "pads" are used if present; other variables on the axis
            time become truths.

        Raises
        ------
        ArrayError
            If the dataset has no such values, or its parts do not fit together.
        """
        sizes: tuple[str, ...] = ("time", "row", "col", "axis")
        if "values" in dataset and "pad" in dataset["values"].dims:
            sizes = ("time", "pad", *sizes[1:])
        if "values" not in dataset or set(dataset["values"].dims) != set(sizes):
            raise ArrayError(
                "A dataset of a recording must have 'values' on the axes time, row, col and "
                f"axis, got {shown(', '.join(map(str, dataset)) or 'nothing')}."
            )
        values = dataset["values"].transpose(*sizes)
        own = ("values", "quality", "saturated")
        truth = {str(n): variable.values for n, variable in dataset.items() if n not in own}
        return cls(
            values.values,
            rate=dataset.attrs.get("rate"),
            unit=str(dataset.attrs.get("unit", "count")),
            channels=[str(n) for n in values["axis"].values] if "axis" in values.coords else None,
            times=values["time"].values if "time" in values.coords else None,
            truth=truth,
            pads=int(dataset.attrs["pads"]) if "pads" in dataset.attrs else None,
            **{
                name: dataset[name].transpose(*sizes[:-1], missing_dims="ignore").values
                for name in own[1:]
                if name in dataset
            },
        )

    @classmethod
    def from_dataframe(
        cls, frame: Any, *, rate: float | None = None, unit: str | None = None
    ) -> Recording:
        """Return the recording in a data frame from `to_dataframe`, or in a similar one.

        Parameters
        ----------
        frame : pandas.DataFrame
            One row per frame, and one column per taxel and channel: "z[0, 3]" is channel z at row
            0, column 3. The columns "time" (s), "sequence", "quality", "saturated",
            "log time (ns)", "truth …", "rate (Hz)", "unit" and "pads" are used if present; any
            other column is an error.
        rate : float, Hz, optional
        unit : str, optional
            They override the rate and unit of the data frame.

        Raises
        ------
        ArrayError
            If a taxel is missing, a column is unknown, or the parts do not fit together.
        """
        listed = [str(name) for name in getattr(frame, "columns", ())]
        twice = [name for name in dict.fromkeys(listed) if listed.count(name) > 1]
        if not hasattr(frame, "columns") or not len(frame) or twice:
            what = f"two columns '{twice[0]}'" if twice else f"{type(frame).__name__} without rows"
            raise ArrayError(
                "A recording comes from a pandas.DataFrame of at least one row, with each column "
                f"once, got {what}."
            )
        columns = {str(name): frame[name] for name in frame.columns}
        cells = {name: match for name in columns if (match := CELL.fullmatch(name))}
        names = list(dict.fromkeys(cell[1] for cell in cells.values()))
        rows, cols = (max((int(f[n]) for f in cells.values()), default=-1) + 1 for n in (2, 3))
        wanted = [f"{n}[{r}, {c}]" for n in names for r in range(rows) for c in range(cols)]
        missing = [name for name in wanted if name not in cells]
        if not wanted or missing:
            example = missing[0] if missing else "z[0, 0]"
            raise ArrayError(
                "A data frame of a recording must have a column for each taxel and channel, but "
                f"'{example}' is missing."
            )
        others = {n for n in columns if n not in cells and not n.startswith(TRUTH)} - KNOWN
        if others:
            raise ArrayError(
                f"The column {shown(min(others))} is not part of a recording: give truths names "
                f"such as '{TRUTH}slip', and drop other columns."
            )
        values = np.stack([_column(name, columns[name]) for name in wanted], axis=1)
        marks = None
        if "saturated" in columns:
            marks = np.zeros((len(frame), rows, cols), dtype=np.bool_)
            for number, text in enumerate(columns["saturated"]):
                for match in MARKED.finditer(text if isinstance(text, str) else ""):
                    marks[number, int(match[1]), int(match[2])] = True
        whole = {"sequence": "sequence", "quality": "quality", "wall_ns": "log time (ns)"}
        said = {k: columns[k].iloc[0] for k in ("rate (Hz)", "unit", "pads") if k in columns}
        return cls(
            values.reshape(len(frame), len(names), rows, cols).transpose(0, 2, 3, 1),
            rate=said.get("rate (Hz)") if rate is None else rate,
            unit=str(said.get("unit", "count")) if unit is None else unit,
            channels=names,
            times=columns.get("time"),
            truth={
                name.removeprefix(TRUTH): _column(name, column)
                for name, column in columns.items()
                if name.startswith(TRUTH)
            },
            saturated=marks,
            pads=int(said["pads"]) if "pads" in said else None,
            **{key: np.asarray(columns[name]) for key, name in whole.items() if name in columns},
        )

    def __len__(self) -> int:
        return len(self.values)

    @property
    def axes(self) -> tuple[str, ...]:
        """The old name of `channels`."""
        warn_of("Recording.axes", "Recording.channels")
        return self.channels

    def __repr__(self) -> str:
        frames, rows, cols, _ = self.values.shape
        return (
            f"Recording({frames} frames of {rows}×{cols}, {', '.join(self.channels)} in "
            f"{self.unit}, {self.rate:g} Hz, {self.times[-1] - self.times[0]:.3f} s)"
        )

    def _repr_html_(self) -> str:
        frames, rows, cols, _ = self.values.shape
        pairs = [
            ("frames", f"{frames} of {rows}×{cols} at {self.rate:g} Hz"),
            ("channels", f"{', '.join(self.channels)} in {self.unit}"),
            ("truth", ", ".join(self.truth) or "none"),
        ]
        last = shown_maps(self.values[-1], self.channels, self.unit)
        shown = [sharing.picture(f"{name}, last frame", values) for name, values in last.items()]
        return sharing.facts("Recording", pairs, shown)

    def plot(self, ax: object = None) -> object:
        """Draw the largest magnitude of each channel over time, and return the axes."""
        from cnnum import sharing

        peaks = np.abs(self.values).max(axis=(1, 2))
        named = {name: peaks[:, n] for n, name in enumerate(self.channels)}
        return sharing.lines(
            self.times, named, ax, ("time (s)", f"largest magnitude ({self.unit})")
        )

    def to_xarray(self) -> Any:
        """Return an `xarray.Dataset` with the axes time, row, col and axis (extra `tables`)."""
        variables: dict[str, Any] = {"values": (("time", "row", "col", "axis"), self.values)}
        variables["quality"] = (("time",), self.quality)
        if self.saturated is not None:
            variables["saturated"] = (("time", "row", "col"), self.saturated)
        variables |= {name: (("time",), values) for name, values in self.truth.items()}
        coordinates = {"time": (("time",), self.times), "axis": (("axis",), list(self.channels))}
        facts: dict[str, object] = {"unit": self.unit, "rate": self.rate}
        return sharing.dataset(variables, coordinates, facts | self._known_pads())

    def to_dataframe(self) -> Any:
        """Return a `pandas.DataFrame` with one row per frame (extra `tables`).

        Its `to_csv` writes a file that `cnnum.load_recording` and every command can read.
        """
        columns: dict[str, Any] = {
            "time": self.times,
            "sequence": self.sequence,
            "quality": self.quality,
        }
        for number, name in enumerate(self.channels):
            columns |= sharing.cell_columns(name, self.values[..., number])
        columns |= {f"truth {name}": values for name, values in self.truth.items()}
        if self.saturated is not None:
            columns["saturated"] = [marked_text(marks) for marks in self.saturated]
        if self.wall_ns is not None:
            columns["log time (ns)"] = self.wall_ns
        facts = {"rate (Hz)": self.rate, "unit": self.unit} | self._known_pads()
        return sharing.data_frame(columns | facts)

    def _known_pads(self) -> dict[str, object]:
        return {} if self.pads is None else {"pads": self.pads}

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return self.values.shape[1], self.values.shape[2]

    def frames(self) -> Iterator[Frame]:
        """Yield the frames in order."""
        names = tuple(self.truth)
        for number, values in enumerate(self.values):
            known = {name: float(self.truth[name][number]) for name in names}
            yield Frame(
                values=values,
                channels=self.channels,
                unit=self.unit,
                sequence=int(self.sequence[number]),
                time=float(self.times[number]),
                quality=Quality(int(self.quality[number])),
                truth=Truth(known) if names else None,
                saturated=self._marked(number),
                wall_ns=None if self.wall_ns is None else int(self.wall_ns[number]),
            )

    def _marked(self, number: int) -> NDArray[np.bool_] | None:
        if self.saturated is None or not self.saturated[number].any():
            return None
        return np.asarray(self.saturated[number])

    def calibrated(
        self,
        gain: ArrayLike = 1.0,
        *,
        offset: ArrayLike = 0.0,
        unit: str = "",
        tare: int = 0,
    ) -> Recording:
        """Return a calibrated recording, with the values gain · (raw − offset).

        Parameters
        ----------
        gain, offset, unit, tare
            As in `cnnum.tactile.array_calibration.ArrayCalibration`.

        Raises
        ------
        CalibrationError
            If the gain or the offset does not fit the array.
        """
        known = ArrayCalibration(gain, offset, unit, tare)
        return Recording(
            known.apply(self.values),
            rate=self.rate,
            unit=unit or self.unit,
            channels=self.channels,
            times=self.times,
            truth=self.truth,
            quality=self.quality,
            saturated=self.saturated,
            sequence=self.sequence,
            wall_ns=self.wall_ns,
            pads=self.pads,
        )

    def save(self, path: str | Path, *, force: bool = False) -> Path:
        """Write the recording to a file that `cnnum replay` reads, and return its path.

        Parameters
        ----------
        path : str or Path
            The suffix gives the format: ".mcap", ".npz", ".csv" or ".h5".
        force : bool
            Whether to replace an existing file.

        Raises
        ------
        UnknownNameError
            If the suffix is unknown.
        RecordingError
            If the file already exists, or cannot be written.
        """
        target = Path(path)
        suffix_of(target)
        refuse_target(target, error=RecordingError, force=force)
        with tempfile.TemporaryDirectory(prefix="cnnum-recording-") as folder:
            draft = Path(folder) / "frames.mcap"
            self._write(draft)
            export(look(draft), target, force=force)
        return target

    def _write(self, path: Path) -> None:
        """Write all frames in chunks."""
        with written(path, error=RecordingError) as file:
            file.write(beginning())
            layout = Layout.of(next(self.frames()), self.rate, None, self.pads)
            maker = ChunkMaker(layout)
            for frame in self.frames():
                maker.add(frame, untimed(frame.time) if frame.wall_ns is None else frame.wall_ns)
                if maker.size >= CHUNK_BYTES:
                    file.write(maker.end())
            if maker.count:
                file.write(maker.end())
            write_index(file, layout)


def side_by_side(values: NDArray[Any]) -> NDArray[Any]:
    """Return (frames, pads, rows, cols, …) values as (frames, rows, pads · cols, …)."""
    frames, pads, rows, cols, *more = values.shape
    return np.swapaxes(values, 1, 2).reshape(frames, rows, pads * cols, *more)


def channel_names(names: Sequence[str] | None, count: int) -> tuple[str, ...]:
    """Return the full names of channels.

    Raises
    ------
    ArrayError
        If there are more or fewer than `count`, or one is there twice.
    """
    usual = {3: FORCE_AXES, 1: FORCE_AXES[2:]}
    if names is None and count in usual:
        return usual[count]
    given = [] if names is None else [names] if isinstance(names, str) else list(names)
    result = tuple(AXES.get(name, name) for name in given)
    for name in result:
        checked_name("a channel", name, ArrayError)
    if len(result) != count or len(set(result)) != count:
        raise ArrayError(
            f"'channels' must name each of the {count} channels once, as in ('x', 'y', 'z'), got "
            f"{shown(names)}."
        )
    return result


def _whole(name: str, values: ArrayLike, frames: int) -> NDArray[np.int64]:
    """Return whole numbers; beyond 2^53 they would not stay so as floats."""
    array = np.asarray(values)
    if array.dtype.kind != "i":
        array = _per_frame(name, values, frames).astype(np.int64)
    if array.shape != (frames,):
        raise ArrayError(f"{name!r} must be one number per frame, ({frames},), got {array.shape}.")
    return read_only(array.astype(np.int64))


def _seconds(times: ArrayLike) -> ArrayLike:
    """Return dates as seconds since the first, durations as seconds, and numbers as they are."""
    given = cast(Any, times)
    zoned = getattr(getattr(given, "dtype", None), "tz", None) is not None  # pandas, else objects
    array: NDArray[Any] = given.to_numpy("datetime64[ns]") if zoned else np.asarray(given)
    if array.dtype.kind not in "mM" or not array.size:
        return times
    array = array - array.ravel()[0] if array.dtype.kind == "M" else array
    return array / np.timedelta64(1, "s")


def _column(name: str, column: Any) -> Floats:
    values: NDArray[Any] = np.asarray(column)
    try:
        return numbers(name, values if values.dtype.kind == "c" else np.asarray(column, float))
    except (TypeError, ValueError):
        raise ArrayError(
            f"The column '{name}' must hold real numbers, got {values.dtype}."
        ) from None


def _rate(times: ArrayLike | None, frames: int) -> float:
    """Return the rate that times have.

    Raises
    ------
    ArrayError
        If there are none, or they give none.
    """
    result = 0.0 if times is None else rate_of(_per_frame("times", times, frames))
    if result > 0.0:
        return result
    given = "no times" if times is None else "times that give none"
    raise ArrayError(f"A recording needs its rate, and there are {given}: give 'rate' in Hz.")


def _times(times: ArrayLike | None, frames: int, rate: float) -> Floats:
    if times is None:
        return np.arange(frames) / rate
    values = _per_frame("times", times, frames)
    if not (np.isfinite(values).all() and (np.diff(values) >= 0.0).all()):
        raise ArrayError("'times' must be finite and must not decrease (s).")
    return values


def _per_frame(name: str, values: ArrayLike, frames: int) -> Floats:
    result = numbers(name, values)
    if result.shape != (frames,):
        raise ArrayError(f"{name!r} must be one number per frame, ({frames},), got {result.shape}.")
    return result


def _marks(saturated: ArrayLike | None, shape: tuple[int, ...]) -> NDArray[np.bool_] | None:
    if saturated is None:
        return None
    result = numbers("saturated", saturated)
    if result.shape != shape:
        raise ArrayError(f"'saturated' must be one mark per taxel, {shape}, got {result.shape}.")
    return read_only(result != 0.0) if result.any() else None
