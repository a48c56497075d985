"""Columns and arrays of CSV, NumPy and HDF5 files by name, read whole."""

import math
import warnings
from array import array
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from cnnum.arrays import Floats
from cnnum.drivers.codecs.stream import Scan
from cnnum.drivers.codecs.wire import Asked, wire
from cnnum.drivers.npz_file import read_arrays
from cnnum.drivers.own_data.layout import AXES, ORDERS, DataLayout
from cnnum.drivers.text_table import (
    LONGEST_LINE,
    Head,
    Wanted,
    nanoseconds,
    open_text,
    read_columns,
    read_line,
)
from cnnum.errors import CodecError, RecordingError, RecordingWarning, unreadable
from cnnum.recordings.hdf5_file import PARQUET, read_hdf5
from cnnum.recordings.message_topics import (
    BAGS,
    LOG_TIME,
    PUBLISH_TIME,
    field_arrays,
    is_bag,
)
from cnnum.recordings.message_topics import LINES as JSON_LINES
from cnnum.safety.reading import DAMAGE, MEGABYTE, open_regular
from cnnum.safety.values import shown

Arrays = Mapping[str, NDArray[Any]]
MAT = ".mat"
"""Suffix of MATLAB's files, which are HDF5 from its version 7.3, with the axes reversed."""

NUMBERS = "fiub"
"""Kinds of numbers that a file may hold."""

VALUES = "values"
"""Name of the array of values where a layout names none."""

TEXTS = (".csv", ".txt", ".tsv", ".dat", ".asc")
"""Suffixes of tables in text files."""

DATED = "dates"
"""Name of an array that is there where the times of a text file are dates or times of day."""

LINES = "line of the file"
"""Name of the numbers of the rows' lines, of text files."""


def csv_columns(path: Path, layout: DataLayout) -> Arrays:
    """Return the columns of a CSV file; the values are (frames, numbers of a frame)."""

    def pick(head: Head) -> Wanted:
        return Wanted(
            cells=layout.columns(head.names),
            facts=layout.truth,
            clock=layout.time,
            clock_format=layout.time_format,
        )

    held = read_columns(path, pick, layout.form)
    arrays: dict[str, NDArray[Any]] = {VALUES: held.cells, LINES: held.lines}
    arrays |= {name: held.facts[:, place] for place, name in enumerate(layout.truth)}
    if held.clock is not None:
        arrays[layout.time] = held.clock / (layout.second if held.dated else 1.0)
        arrays |= {DATED: np.ones(1)} if held.dated else {}
    return arrays


def npy_array(path: Path, layout: DataLayout) -> Arrays:
    """Return the one array of a NumPy file."""
    for name in _singles(layout):
        raise CodecError(f"'{path}' holds one array and no '{name}': give 'rate', and no 'time'.")
    try:
        with open_regular(path) as file:
            held: object = np.load(file, allow_pickle=False)
    except OSError as error:
        raise unreadable(RecordingError, f"'{path}'", error) from None
    except (*DAMAGE, MemoryError) as error:
        why = str(error).rstrip(".") or type(error).__name__
        raise CodecError(f"'{path}' is not a NumPy array: {why}.") from None
    if not isinstance(held, np.ndarray):
        raise CodecError(
            f"'{path}' is not a NumPy array but an archive: give it the suffix '.npz'."
        )
    return {VALUES: cast("NDArray[Any]", held)}


def npz_arrays(path: Path, layout: DataLayout) -> Arrays:
    """Return arrays of a NumPy archive."""
    if isinstance(columns := layout.values, tuple):
        held = read_arrays(path, {*columns, *_singles(layout)})
        for name in (*columns, *_singles(layout)):
            if name not in held:
                raise CodecError(f"'{path}' has no array {shown(name)}; it has {_some(held)}.")
        return {VALUES: _joined(path, held, columns), **{n: held[n] for n in _singles(layout)}}
    held = read_arrays(path, {_array_name(layout), *_singles(layout)})
    return _picked(path, layout, held.__getitem__, held)


def hdf5_arrays(path: Path, layout: DataLayout) -> Arrays:
    """Return arrays of an HDF5 file, or columns of a Parquet one.

    A name of an HDF5 file may have folders, as in "trial1/taxels".
    """
    columns = layout.values
    if isinstance(columns, tuple):
        known, every = read_hdf5(path, list(dict.fromkeys((*columns, *_singles(layout)))))
        for name in (*columns, *_singles(layout)):
            if name not in every:
                raise CodecError(f"'{path}' has no array {shown(name)}; it has {_some(known)}.")
        return {VALUES: _joined(path, every, columns), **{n: every[n] for n in _singles(layout)}}
    known, held = read_hdf5(path, list(dict.fromkeys((_array_name(layout), *_singles(layout)))))
    return _picked(path, layout, held.__getitem__, known)


def message_fields(path: Path, layout: DataLayout) -> Arrays:
    """Return fields of messages: of an MCAP file, a bag, or lines of JSON."""
    times = layout.time or ("" if layout.rate else LOG_TIME)
    values = layout.values if isinstance(layout.values, tuple) else (layout.values,)
    wanted = tuple(dict.fromkeys((*values, *((times,) if times else ()), *layout.truth)))
    held = field_arrays(path, layout.topic, wanted)
    if not held["order"]:
        warnings.warn(
            f"The messages of '{path}' are not in the order of their arrival: they are sorted by "
            "their log times.",
            RecordingWarning,
            stacklevel=2,
        )
    parts = [held[name].reshape(len(held[name]), -1) for name in values]
    main = held[values[0]] if len(values) == 1 else np.concatenate(parts, axis=1)
    arrays = {VALUES: main, **{name: held[name] for name in layout.truth}}
    if times:
        stamped = times in (LOG_TIME, PUBLISH_TIME)
        arrays[times] = held[times] / (layout.second if stamped else 1.0)
        if np.isnan(arrays[times]).any():  # said with the messages that lack it
            timed = ~np.isnan(arrays[times].reshape(len(main), -1)).any(axis=1)
            arrays = {name: part[timed] for name, part in arrays.items()}
    return arrays


def sent_scans(path: Path, layout: DataLayout) -> Arrays:
    """Return the scans of a file that holds what an array sent, by its protocol."""
    decoder = wire(layout.protocol, Asked(layout.shape)).decoder()
    scans: list[Scan] = []
    try:
        with open_regular(path) as file:
            while part := file.read(MEGABYTE):
                scans += decoder.feed(part)
        scans += decoder.flush()
    except OSError as error:
        raise unreadable(RecordingError, f"'{path}'", error) from None
    if not scans:
        said = decoder.conflict or f"no scan of the protocol '{layout.protocol}'"
        trouble = str(getattr(decoder, "trouble", ""))
        raise CodecError(f"'{path}' holds {said}{f': {trouble}' if trouble else '.'}")
    if decoder.bad:
        warnings.warn(
            f"'{path}': {decoder.bad} packets of the protocol '{layout.protocol}' are damaged and "
            "were left out.",
            RecordingWarning,
            stacklevel=2,
        )
    values = np.stack([np.asarray(scan.values, np.float64) for scan in scans])
    arrays: dict[str, NDArray[Any]] = {VALUES: values}
    stamps = [scan.time_us for scan in scans if scan.time_us is not None]
    if len(stamps) == len(scans):
        steps = np.diff(np.array(stamps, np.int64))
        wrap = scans[0].time_wrap
        steps[steps < -(wrap // 2)] += wrap if wrap < 1 << 62 else 0
        seconds = 1e-6 * np.concatenate([[0], np.cumsum(steps)])
        arrays[layout.time or LOG_TIME] = seconds / layout.second
    elif not layout.rate:
        raise CodecError(
            f"'{path}': the protocol '{layout.protocol}' has no times: set 'rate' in the layout."
        )
    return arrays


def blocks(path: Path, layout: DataLayout) -> Arrays:
    """Return the frames of a text file with a block of lines per frame, one line per row.

    Lines of as many numbers as the array has columns are rows. All others stand between the
    blocks; the times may stand in them, behind the word that the layout names.
    """
    rows, cols = layout.shape
    wide = cols * len(layout.channels)
    values, times, lines = array("d"), array("d"), array("q")
    count, number = 0, 0
    separator = None if layout.separator == " " else layout.separator
    try:
        with open_regular(path) as raw, open_text(raw) as text:
            while line := read_line(text, LONGEST_LINE):
                number += 1
                row = _row_of(layout, line, separator, wide)
                if row is not None:
                    values.extend(row)
                    if count % rows == 0:
                        lines.append(number)
                    count += 1
                elif count % rows and line.strip(f" \r\n{layout.separator}"):
                    raise CodecError(
                        f"'{path}', line {number}: expected row {count % rows + 1} of {rows} of a "
                        f"frame, {wide} numbers, got {shown(line.strip())}."
                    )
                elif layout.time and (when := stamp(layout.time, line)) is not None:
                    times.append(when)
    except OSError as error:
        raise unreadable(RecordingError, f"'{path}'", error) from None
    except UnicodeError as error:
        raise CodecError(f"'{path}' is not a text file: {error}.") from None
    if not count or count % rows:
        raise CodecError(
            f"'{path}' ends in row {count % rows} of {rows} of a frame: expected whole blocks of "
            f"{rows} lines with {wide} numbers each."
        )
    shape = (count // rows, rows, cols, len(layout.channels))
    held: dict[str, NDArray[Any]] = {VALUES: np.asarray(values).reshape(shape)}
    held[LINES] = np.asarray(lines, np.int64)
    if layout.time:
        if len(times) != len(lines):
            raise CodecError(
                f"'{path}' has {len(times)} times behind '{layout.time}' and {len(lines)} frames: "
                "set 'rate', and leave out 'time'."
            )
        held[layout.time] = np.asarray(times)
    return held


def _row_of(layout: DataLayout, line: str, separator: str | None, wide: int) -> list[float] | None:
    """Return the numbers of a line, or None if it is no row of the array."""
    fields = line.strip().split(separator)
    while len(fields) > wide and not fields[-1].strip():
        fields.pop()
    if len(fields) != wide:
        return None
    try:
        return [float(field.replace(layout.decimal, ".")) for field in fields]
    except ValueError:
        return None


def stamp(word: str, line: str) -> float | None:
    """Return the time behind a word in a line, as in "Time, 0.25" or "Frame 3 at 12:00:00.25"."""
    place = line.find(word)
    rest = line[place + len(word) :].strip(' ,;:=\t"\r\n') if place >= 0 else ""
    if not rest:
        return None
    when = nanoseconds(rest) if ":" in rest else None
    if when is not None:
        return 1e-9 * when
    try:
        return float(rest.replace(",", " ").split()[0])
    except ValueError:
        return None


def held_by(path: Path, layout: DataLayout) -> Arrays:
    """Return the values, times and truths of a file by its layout.

    Raises
    ------
    CnnumError
        If it cannot be read, or does not fit the layout.
    """
    if layout.protocol:
        return sent_scans(path, layout)
    if layout.block:
        return blocks(path, layout)
    if is_bag(path):
        return message_fields(path, layout)
    if path.is_dir():
        raise CodecError(f"'{path}' has a layout: expected a folder with bags of ROS 1 or ROS 2.")
    return READERS.get(path.suffix.lower(), csv_columns)(path, layout)


READERS: Mapping[str, Callable[[Path, DataLayout], Arrays]] = {
    **dict.fromkeys(TEXTS, csv_columns),
    ".npy": npy_array,
    ".npz": npz_arrays,
    ".h5": hdf5_arrays,
    ".hdf5": hdf5_arrays,
    MAT: hdf5_arrays,
    PARQUET: hdf5_arrays,
    ".mcap": message_fields,
    **dict.fromkeys((*JSON_LINES, *BAGS), message_fields),
    **dict.fromkeys((".log", ".bin"), csv_columns),  # where they name no protocol
}
"""By the suffix of the file; all others are tables in text."""

HDF5 = (".h5", ".hdf5", MAT)


def _array_name(layout: DataLayout) -> str:
    return layout.values if isinstance(layout.values, str) and layout.values else VALUES


def _joined(path: Path, held: Arrays, names: Iterable[str]) -> NDArray[Any]:
    """Return arrays side by side, (frames, numbers of a frame)."""
    arrays = [np.atleast_1d(held[name]) for name in names]
    parts = [part.reshape(len(part), -1) for part in arrays]
    if len({len(part) for part in parts}) > 1:
        raise CodecError(f"'{path}': the arrays that 'values' names are of different lengths.")
    return np.concatenate(parts, axis=1)


def _singles(layout: DataLayout) -> tuple[str, ...]:
    return (*((layout.time,) if layout.time else ()), *layout.truth)


def _picked(
    path: Path, layout: DataLayout, read: Callable[[str], NDArray[Any]], names: Iterable[str]
) -> Arrays:
    """Return the arrays that a layout names, those of values under `VALUES`."""
    known, main = list(names), _array_name(layout)
    for name in (main, *_singles(layout)):
        if name not in known:
            held = f"; it has {_some(known)}" if known else ""
            raise CodecError(f"'{path}' has no array {shown(name)}{held}.")
    return {VALUES: read(main), **{name: read(name) for name in _singles(layout)}}


def _some(names: Iterable[str]) -> str:
    return ", ".join(list(names)[:12])


GUESSED = (
    "frames rows cols channels",
    "frames channels rows cols",
    "rows cols channels frames",
    "channels rows cols frames",
    "frames cols rows channels",
    "frames channels cols rows",
    "cols rows channels frames",
    "channels cols rows frames",
)
"""Orders of axes that are tried in turn; the first is meant where several fit."""

PADDED = ("frames pads rows cols channels", "frames pads channels rows cols")
"""Those of five axes, where the layout has several pads."""


def shaped(path: Path, layout: DataLayout, held: NDArray[Any]) -> Floats:
    """Return values as (frames, rows, cols, channels), with the signs of the channels.

    Raises
    ------
    CodecError
        If they are no numbers, or of another shape than the layout says.
    """
    if held.dtype.kind not in NUMBERS:
        raise CodecError(f"'{path}' must contain numbers, got the type '{held.dtype}'.")
    guessed = PADDED if layout.pads > 1 and held.ndim == len(AXES[2]) else GUESSED
    orders = (ORDERS.get(layout.order, layout.order),) if layout.order else guessed
    said = bool(layout.order)
    fitting = [o for o in orders if _fits(held.shape, _sizes(layout, held, o), said=said)]
    if not fitting or not held.size:
        (rows, cols), count = layout.shape, len(layout.channels)
        raise CodecError(
            f"'{path}' must hold (frames, {rows}, {cols}, {count}), (frames, {rows * cols}, "
            f"{count}) or (frames, {rows * cols * count}) values"
            f"{f' in the order {layout.order!r}' if layout.order else ''} by its layout, or the "
            f"same in another order of the axes, got {held.shape}."
        )
    if fitting[0] != guessed[0] and len(fitting) > 1:
        raise CodecError(
            f"'{path}' holds {held.shape} values, which are of the layout's shape in several "
            f"orders: set 'order' to one of {', '.join(map(repr, fitting))}."
        )
    return arranged(layout, held, fitting[0])


def arranged(layout: DataLayout, held: NDArray[Any], order: str) -> Floats:
    """Return values in an order of axes that fits as (frames, rows, cols, channels)."""
    sizes = _sizes(layout, held, order)
    axes = list(sizes)
    wanted = next(known for known in AXES if set(known) == set(axes))
    values = held.reshape(list(sizes.values())).transpose([axes.index(name) for name in wanted])
    whole = len(values), *layout.shape, len(layout.channels)
    if "taxels" in wanted:
        values, wanted = values.reshape(whole), AXES[0]
    back = tuple(wanted.index(name) for name in layout.flip)  # each pad by itself
    numbers: Floats = np.flip(values, back).reshape(whole).astype(np.float64)
    return np.asarray(numbers * np.array(layout.signs))


def _sizes(layout: DataLayout, held: NDArray[Any], order: str) -> dict[str, int]:
    """Return the sizes of the axes by name, in their order in the file."""
    rows, cols = layout.shape
    known = {"rows": rows, "cols": cols, "taxels": rows * cols, "channels": len(layout.channels)}
    known["frames"] = held.size // layout.numbers
    if "pads" in order:
        known |= {"pads": layout.pads, "cols": cols // layout.pads}
    return {name: known[name] for name in order.split()}


def _fits(shape: tuple[int, ...], sizes: Mapping[str, int], *, said: bool) -> bool:
    """Return whether an array's axes are these, where neighbours may be one axis.

    An order that is said holds for the numbers of a frame whatever axes the file gives them, as of
    numbers axis by axis that were saved as (rows, cols, channels).
    """
    if said and next(iter(sizes)) == "frames" and shape[0] == sizes["frames"]:
        return math.prod(shape) == math.prod(sizes.values())
    edges = set(np.cumprod(list(sizes.values())[::-1]).tolist())
    axes = np.cumprod([size for size in shape[::-1] if size > 1] or [1]).tolist()
    # the frames are an axis of their own
    alone = sizes["frames"] in shape
    return alone and math.prod(shape) == math.prod(sizes.values()) and edges.issuperset(axes)
