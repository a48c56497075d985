"""A data file as an array: a CSV, NumPy or HDF5 file of your own, or one that cnnum wrote."""

import logging
import re
import warnings
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from cnnum.arrays import Floats, Shape
from cnnum.drivers.codecs.wire import Asked, wire
from cnnum.drivers.driver import Counters, Counting, Driver, lost_before
from cnnum.drivers.npz_file import NpzOptions, rate_that_counts
from cnnum.drivers.own_data.layout import EXAMPLE, DataLayout, read_layout
from cnnum.drivers.own_data.sources import (
    DATED,
    HDF5,
    LINES,
    NUMBERS,
    READERS,
    TEXTS,
    VALUES,
    Arrays,
    held_by,
    shaped,
)
from cnnum.drivers.recording_file import McapOptions, is_own_archive
from cnnum.drivers.text_table import Columns, Head, Wanted, read_columns
from cnnum.errors import (
    ArrayError,
    CalibrationError,
    CnnumError,
    CodecError,
    RecordingError,
    RecordingWarning,
    SceneError,
    missing_file,
    name_error,
    unreadable,
)
from cnnum.frame import Frame, Quality, unit_fault
from cnnum.recordings.export import (
    CSV_CAME,
    CSV_MARKS,
    HDF5_KIND,
    PADS,
    RATE,
    calibration_of,
)
from cnnum.recordings.hdf5_file import list_hdf5, read_hdf5
from cnnum.recordings.mcap_chunks import untimed
from cnnum.recordings.message_topics import LOG_TIME, holds_frames, is_bag
from cnnum.recordings.recording import Recording
from cnnum.recordings.times import rate_of
from cnnum.safety.reading import names_something, open_regular
from cnnum.safety.values import shown
from cnnum.tactile.taxel import Calibration

HEAD = ("sequence", "time (s)", "quality")
"""The first columns of what `cnnum record` writes."""

FRAME_HEAD = (b"time,sequence,quality,", b",time,sequence,quality,")
"""Those of a data frame, without and with its index."""

H5_ARRAYS, H5_LATER = ("values", "time", "sequence", "quality"), ("log_time", CSV_MARKS)
H5_TRUTH = "truth/"
"""Arrays of an HDF5 file: those that it must have, those that it may, and the ground truth."""

TRUTH, UNIT = "truth ", "unit"
_TAXEL = re.compile(r"r(\d{1,5})_c(\d{1,5})")
_CELL = re.compile(r"r(\d{1,5})_c(\d{1,5})_(.{1,80}) \((.{1,80})\)")
_FRAME_CELL = re.compile(r"(.{1,80})\[(\d{1,5}), (\d{1,5})\]")


def is_own_csv(path: Path) -> bool:
    """Return whether a CSV file is one of cnnum's.

    Raises
    ------
    RecordingError
        If it cannot be read.
    """
    try:
        with open_regular(path) as file:
            begin = file.read(64)
    except OSError as error:
        raise unreadable(RecordingError, f"'{path}'", error) from None
    return begin.startswith((",".join(HEAD).encode(), *FRAME_HEAD))


def read_own_csv(path: Path) -> tuple[Recording, bool]:
    """Return the recording of such a file, and whether its times agree with the rate it states.

    Without a column of it, the rate is that of the times, or 1 Hz of a single frame.

    Raises
    ------
    CodecError
        If columns are missing, or a field is not a number.
    RecordingError
        If it cannot be read.
    """
    form: list[_Form] = []

    def pick(head: Head) -> Wanted:
        form.append(_Form(head))
        return form[0].wanted

    held = read_columns(path, pick)
    own = form[0]
    values = held.cells[:, : own.cells].reshape(-1, *own.shape, len(own.channels))
    truth = held.cells[:, own.cells :]
    times = held.facts[:, 0]
    rate = float(held.facts[0, 1]) if RATE in held.head.names else 0.0
    counts = rate_that_counts(rate, times)
    made = Recording(
        values,
        rate=counts or rate_of(times) or 1.0,
        unit=own.unit or next(iter(set(held.texts[UNIT]))),
        channels=own.channels,
        times=times,
        truth={name: truth[:, place] for place, name in enumerate(own.truths)},
        quality=held.whole["quality"],
        saturated=_saturated(held, own.shape),
        sequence=held.whole["sequence"],
        wall_ns=_came(held.whole.get(CSV_CAME), times),
        pads=int(held.whole[PADS][0]) if PADS in held.whole else None,
    )
    return made, counts == rate


def _came(log_times: NDArray[np.int64] | None, times: Floats) -> NDArray[np.int64] | None:
    """Return when frames came, None if their log times are their times and no more."""
    if log_times is None or log_times.tolist() == [untimed(time) for time in times.tolist()]:
        return None
    return log_times


def read_own_hdf5(path: Path) -> tuple[Recording, Calibration | None, bool] | None:
    """Return the recording of an HDF5 file, its calibration, and whether times and rate agree.

    None if it is not cnnum's.

    Raises
    ------
    CodecError
        If it is, and does not hold all parts of one.
    RecordingError, MissingExtraError
        As `read_hdf5`.
    """
    shapes, attributes = list_hdf5(path)
    if attributes.get("kind") != HDF5_KIND:
        return None
    truths = [name for name in shapes if name.startswith(H5_TRUTH)]
    names = [*H5_ARRAYS, *(name for name in H5_LATER if name in shapes), *truths]
    _, held = read_hdf5(path, names)
    try:
        made = _recording(held, truths, attributes)
        text = str(attributes.get("calibration", ""))
        known = Calibration.from_text(text, path) if text else None
        return made, known, made.rate == float(attributes["rate"])
    except (KeyError, TypeError, ValueError, CalibrationError) as error:
        raise CodecError(f"'{path}' is not a recording of cnnum: {error}") from None


def _recording(
    held: Mapping[str, NDArray[Any]], truths: list[str], attributes: Mapping[str, Any]
) -> Recording:
    for name in H5_ARRAYS:
        if name not in held:
            raise CodecError(f"it has no '{name}'.")
    channels, times = attributes["channels"], held["time"].astype(np.float64)
    listed = [channels] if isinstance(channels, str) else cast("list[Any]", channels)
    return Recording(
        held["values"],
        rate=rate_that_counts(float(attributes["rate"]), times),
        unit=str(attributes["unit"]),
        channels=[str(name) for name in listed],
        times=times,
        truth={name.removeprefix(H5_TRUTH): held[name] for name in truths},
        quality=held["quality"],
        saturated=held.get(CSV_MARKS),
        sequence=held["sequence"],
        wall_ns=_came(held.get("log_time"), times),
        pads=int(attributes[PADS]) if PADS in attributes else None,
    )


class _Form:
    """The meaning of the columns of a file.

    Attributes
    ----------
    shape : (rows, cols)
    channels, truths : tuple of str
    unit : str
        Empty if a column says it.
    cells : int
        Numbers of a frame.
    wanted : Wanted
    """

    def __init__(self, head: Head) -> None:
        framed = "time" in head.names
        named = list(_framed(head) if framed else _recorded(head))
        if not named:
            raise CodecError(
                f"'{head.path}', line {head.line}: expected columns such as 'r0_c0_normal (count)'."
            )
        rows = max(place[0] for place, _ in named) + 1
        cols = max(place[1] for place, _ in named) + 1
        self.shape = rows, cols
        self.channels = tuple(dict.fromkeys(place[2] for place, _ in named))
        self.unit = "" if framed else named[0][0][3]
        self.cells = rows * cols * len(self.channels)
        columns = {place[:3]: name for place, name in named}
        whole = len(columns) == len(named) == self.cells
        if not whole or len({place[3] for place, _ in named}) > 1:
            raise CodecError(
                f"'{head.path}', line {head.line}: expected the columns of every cell row by row, "
                f"from '{named[0][1]}' to '{named[-1][1]}'."
            )
        truths = [name for name in head.names if name.startswith(TRUTH)]
        self.truths = tuple(name.removeprefix(TRUTH) for name in truths)
        in_order = (
            columns[row, col, channel]
            for row in range(rows)
            for col in range(cols)
            for channel in self.channels
        )
        facts = ["time" if framed else HEAD[1], *([RATE] if RATE in head.names else [])]
        texts = [*([CSV_MARKS] if CSV_MARKS in head.names else []), *([UNIT] if framed else [])]
        marked = [name for name in (CSV_CAME, PADS) if name in head.names]
        self.wanted = Wanted(
            cells=[*in_order, *truths],
            facts=facts,
            texts=texts,
            whole=["sequence", "quality", *marked],
        )


Place = tuple[int, int, str, str]
"""Row, column, channel and unit of a column."""


def _recorded(head: Head) -> Iterator[tuple[Place, str]]:
    for name in head.names:
        if match := _CELL.fullmatch(name):
            yield (int(match[1]), int(match[2]), match[3], match[4]), name


def _framed(head: Head) -> Iterator[tuple[Place, str]]:
    for name in head.names:
        if match := _FRAME_CELL.fullmatch(name):
            yield (int(match[2]), int(match[3]), match[1], ""), name


def _saturated(held: Columns, shape: tuple[int, int]) -> NDArray[np.bool_] | None:
    """Return the marks of each frame, or None if there is no column of them."""
    if CSV_MARKS not in held.texts:
        return None
    rows, cols = shape
    result = np.zeros((len(held.lines), rows, cols), np.bool_)
    for number, text in enumerate(held.texts[CSV_MARKS]):
        for name in text.split():
            cell = _TAXEL.fullmatch(name)
            if cell is None or int(cell[1]) >= rows or int(cell[2]) >= cols:
                raise CodecError(
                    f"'{held.head.path}', line {held.lines[number]}: expected taxels of "
                    f"{rows}×{cols} in the column '{CSV_MARKS}', as in 'r0_c3 r1_c3', got "
                    f"{shown(name)}."
                )
            result[number, int(cell[1]), int(cell[2])] = True
    return result


MOST_SHARE_BACK = 0.05
"""Share of the frames before which a clock may be set back: one that falls more often is none."""


@dataclass(frozen=True, slots=True)
class DataFileOptions:
    """Options of the driver "file".

    Attributes
    ----------
    path : Path
        A text file (.csv, .txt, .tsv, .dat, .asc), a .npy, .npz, .h5, .hdf5 or .parquet file,
        messages (.mcap, .jsonl, .bag, the folder of a rosbag2), or what an array sent (.bin, .log).
    layout : Path, optional
        The TOML file that names its columns and their meaning (`DataLayout`). Unless given, it is
        that of the same name with the suffix .toml. Files that cnnum wrote need none.
    topic : str
        Topic of an MCAP file or a bag, in place of that of the layout.
    """

    path: Path
    layout: Path | None = None
    topic: str = ""

    def open(self) -> Driver:
        """Read the file.

        Raises
        ------
        RecordingError
            If it cannot be read.
        CodecError
            If it does not fit the layout; the sentence names the file and the fault.
        SceneError
            If the layout is missing or wrong.
        UnknownNameError
            If the suffix is none that is known.
        MissingExtraError
            If h5py is not installed, for an HDF5 file.
        """
        path, suffix = self.path, self.path.suffix.lower()
        if suffix not in READERS and not is_bag(path) and not self._has_layout():
            raise name_error("kind of data file", suffix or path.name, READERS)
        if not names_something(path):
            raise missing_file(RecordingError, f"There is no file '{path}'.")
        try:
            if suffix in TEXTS and self.layout is None and is_own_csv(path):
                made, timed = read_own_csv(path)
                return DataFile(made, calibration=_beside(path), timed=timed)
            own = read_own_hdf5(path) if suffix in HDF5 and not self._has_layout() else None
            if own is not None:
                return DataFile(own[0], calibration=own[1], timed=own[2])
            if self.layout is None and not self.topic:
                if suffix == ".npz" and is_own_archive(path):
                    return NpzOptions(path).open()
                if suffix == ".mcap" and holds_frames(path):
                    return McapOptions(path).open()
            layout = read_layout(self._layout())
            layout = replace(layout, topic=self.topic) if self.topic else layout
            held = held_by(path, layout)
            timed = DATED in held or bool(layout.rate or layout.time_unit)
            return DataFile(_laid_out(path, layout, held), layout, timed=timed)
        except ArrayError as error:
            raise CodecError(f"'{path}': {error}") from None
        except OSError as error:
            if isinstance(error, CnnumError):
                raise
            raise unreadable(RecordingError, f"'{path}'", error) from None

    def _has_layout(self) -> bool:
        return self.layout is not None or names_something(self.path.with_suffix(".toml"))

    def _layout(self) -> Path:
        path = self.path.with_suffix(".toml") if self.layout is None else self.layout
        if not names_something(path):
            if self.path.is_file():  # what stands in place of the data needs no layout
                open_regular(self.path).close()
            raise SceneError(
                f"There is no layout '{path}', which describes '{self.path.name}': write one "
                f"with {EXAMPLE}; 'cnnum layout {self.path.name}' proposes it."
            )
        return path


def _beside(table: Path) -> Calibration | None:
    """Return the calibration that was recorded with a CSV file."""
    file = calibration_of(table)
    return Calibration.load(file) if names_something(file) else None


def recording_by(path: Path, layout: DataLayout) -> Recording:
    """Return the recording of a file by its layout.

    Raises
    ------
    CnnumError
        If the file cannot be read, or does not fit the layout.
    """
    return _laid_out(path, layout, held_by(path, layout))


def _laid_out(path: Path, layout: DataLayout, held: Arrays) -> Recording:
    values = shaped(path, layout, held[VALUES])
    times, back = None, np.zeros(0, np.int64)
    name = layout.time or next((name for name in (LOG_TIME,) if name in held), "")
    if name:
        times, back = _times(path, layout, held, name, len(values))
    rate = layout.rate or (0.0 if times is None else rate_of(times))
    if not rate:
        raise CodecError(f"'{path}': the times '{name}' give no rate: set 'rate'.")
    quality = np.zeros(len(values), np.int64)
    if times is not None:
        again = np.zeros(len(values), np.bool_)
        again[1:] = (np.diff(times) == 0.0) & _same(values)
        quality[again] = int(Quality.REPEATED)
        rate = layout.rate or rate_of(times[~again]) or rate
        if len(back):
            # from each place on all times are later, so that the frame is one period on
            for n in back.tolist():
                times[n:] += times[n - 1] - times[n] + 1.0 / rate
            quality[back] |= int(Quality.DROPPED_BEFORE)
    return Recording(
        values,
        rate=rate,
        unit=layout.unit,
        channels=layout.full_names,
        times=times,
        truth={name: np.asarray(held[name], dtype=float) for name in layout.truth},
        quality=quality,
    )


def _same(values: Floats) -> NDArray[np.bool_]:
    """Return for each frame but the first whether it is the one before once more."""
    same = (values[1:] == values[:-1]) | (np.isnan(values[1:]) & np.isnan(values[:-1]))
    return np.asarray(same.all(axis=(1, 2, 3)))


def _times(
    path: Path, layout: DataLayout, held: Arrays, name: str, frames: int
) -> tuple[Floats, NDArray[np.int64]]:
    """Return the times from the first frame, s, and the frames whose clock was set back."""
    column = held[name]
    if column.dtype.kind not in NUMBERS or column.size != frames or max(column.shape) != frames:
        raise CodecError(
            f"'{path}': the times '{name}' must be one number per frame, ({frames},), got "
            f"{column.shape} of the type '{column.dtype}'."
        )
    whole = column.reshape(-1)
    if whole.dtype.kind in "iu":  # ns since 1970 have more digits than a float
        whole = (whole.astype(np.int64) - int(whole[0])) if len(whole) else whole
    times = whole.astype(float) * layout.second
    times -= times[0]
    if not np.isfinite(times).all():
        raise CodecError(f"'{path}': the times '{name}' must be finite.")
    if frames > 1 and not times.any():
        raise CodecError(
            f"'{path}': the times '{name}' are all equal, so they give no rate: set 'rate', "
            "and leave out 'time'."
        )
    dated = DATED in held
    fault = "" if dated or layout.rate or layout.time_unit else unit_fault(times)
    if fault:
        logging.getLogger("cnnum").warning(
            "'%s', %s: the times '%s' are %s.", path, _where(held, 1), layout.time, fault,
        )  # fmt: skip
    back = np.flatnonzero(np.diff(times) < 0.0) + 1
    if len(back) > MOST_SHARE_BACK * frames:
        raise CodecError(
            f"'{path}', {_where(held, int(back[0]))}: the times '{name}' go back in "
            f"{len(back)} of {frames} frames, so they cannot be used: set 'rate', and leave "
            "out 'time'."
        )
    if len(back):
        first = int(back[0])
        more = f" (and {len(back) - 1} times more)" if len(back) > 1 else ""
        warnings.warn(
            f"'{path}', {_where(held, first)}: the clock goes back by "
            f"{times[first - 1] - times[first]:.3g} s{more}: the frames keep their order, each "
            "one period after the previous one, and are flagged.",
            RecordingWarning,
            stacklevel=2,
        )
    return times, back


def _where(held: Arrays, frame: int) -> str:
    return f"line {held[LINES][frame]}" if LINES in held else f"frame {frame}"


class DataFile(Counting):
    """A data file as an array: its frames in their order.

    Attributes
    ----------
    pads : int or None
        Pads side by side, where the layout or the recording says so.
    pitch : float or None
        Distance of the taxels, m, where the layout says so.
    layout : DataLayout or None
    limits : (low, high), or one pair per channel, or None
        Limits of the values of sound taxels, where the layout has them.
    bandwidth : float or None, Hz
        Highest frequency of loads, where the layout has it.
    positions : sequence of (x, y), mm
        Positions of the taxels, where the layout has them; empty if not.
    timed : bool
        Whether the unit of the times is beyond doubt: dates, a unit or rate that is stated, or a
        file of cnnum, which has looked at them.
    calibration, total_frames
        As in `cnnum.drivers.recording_file.McapFile`.
    """

    def __init__(
        self,
        recording: Recording,
        layout: DataLayout | None = None,
        calibration: Calibration | None = None,
        *,
        timed: bool = False,
    ) -> None:
        super().__init__()
        self.recording = recording
        self.timed = timed
        self.shape: Shape = recording.shape
        self.channels = recording.channels
        self.unit = recording.unit
        self.rate = recording.rate
        self.calibration = calibration
        self.layout = layout
        self.pads = recording.pads if layout is None else layout.pads
        self.pitch = None if layout is None else layout.pitch
        self.limits = None if layout is None else layout.sound
        self.bandwidth = None if layout is None else layout.bandwidth
        self.positions = () if layout is None else layout.positions
        if layout is not None and layout.protocol and not self.positions:
            self.positions = wire(layout.protocol, Asked(layout.shape)).positions
        self.total_frames = len(recording)

    def frames(self) -> Iterator[Frame]:
        """Yield the frames as fast as they are fetched; a second call starts again."""
        self._counters = Counters()
        known = self.calibration.identity if self.calibration else ""
        last: int | None = None
        for frame in self.recording.frames():
            self.count(repeated=frame.repeated, dropped=lost_before(frame, last))
            last = frame.sequence
            yield replace(frame, calibration=known) if known else frame
