"""Columns and arrays of CSV, NumPy and HDF5 files by name, read whole."""

import math
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from cnnum.arrays import Floats
from cnnum.drivers.npz_archive import read_arrays
from cnnum.drivers.own_data.hdf5_file import read_hdf5
from cnnum.drivers.own_data.layout import SECONDS, DataLayout
from cnnum.drivers.text_table import Head, Wanted, read_columns
from cnnum.errors import CodecError, RecordingError, unreadable
from cnnum.safety.names import shown
from cnnum.safety.reading import DAMAGE, open_regular

Arrays = Mapping[str, NDArray[Any]]
NUMBERS = "fiub"
"""Kinds of numbers that a file may hold."""

VALUES = "values"
"""Name of the array of values where a layout names none."""

TEXTS = (".csv", ".txt", ".tsv", ".dat", ".asc")
"""Suffixes of tables in text files."""

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
    found: dict[str, NDArray[Any]] = {VALUES: held.cells, LINES: held.lines}
    found |= {name: held.facts[:, place] for place, name in enumerate(layout.truth)}
    if held.clock is not None:
        found[layout.time] = held.clock / (SECONDS[layout.time_unit] if held.dated else 1.0)
    return found


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
        raise CodecError(f"'{path}' is no NumPy array: {why}.") from None
    if not isinstance(held, np.ndarray):
        raise CodecError(f"'{path}' is no NumPy array but an archive: give it the suffix '.npz'.")
    return {VALUES: cast("NDArray[Any]", held)}


def npz_arrays(path: Path, layout: DataLayout) -> Arrays:
    """Return arrays of a NumPy archive."""
    held = read_arrays(path, {_array_name(layout), *_singles(layout)})
    return _picked(path, layout, held.__getitem__, held)


def hdf5_arrays(path: Path, layout: DataLayout) -> Arrays:
    """Return arrays of an HDF5 file; a name may have folders, as in "trial1/taxels"."""
    known, held = read_hdf5(path, list(dict.fromkeys((_array_name(layout), *_singles(layout)))))
    return _picked(path, layout, held.__getitem__, known)


READERS: Mapping[str, Callable[[Path, DataLayout], Arrays]] = {
    **dict.fromkeys(TEXTS, csv_columns),
    ".npy": npy_array,
    ".npz": npz_arrays,
    ".h5": hdf5_arrays,
    ".hdf5": hdf5_arrays,
}
"""By the suffix of the file."""

HDF5 = (".h5", ".hdf5")


def _array_name(layout: DataLayout) -> str:
    return layout.values if isinstance(layout.values, str) and layout.values else VALUES


def _singles(layout: DataLayout) -> tuple[str, ...]:
    return (*((layout.time,) if layout.time else ()), *layout.truth)


def _picked(
    path: Path, layout: DataLayout, read: Callable[[str], NDArray[Any]], names: Iterable[str]
) -> Arrays:
    """Return the arrays that a layout names, those of values under `VALUES`."""
    known, main = list(names), _array_name(layout)
    for name in (main, *_singles(layout)):
        if name not in known:
            held = f"; it has {', '.join(known[:12])}" if known else ""
            raise CodecError(f"'{path}' has no array {shown(name)}{held}.")
    return {VALUES: read(main), **{name: read(name) for name in _singles(layout)}}


def shaped(path: Path, layout: DataLayout, held: NDArray[Any]) -> Floats:
    """Return values as (frames, rows, cols, channels).

    Raises
    ------
    CodecError
        If they are no numbers, or of another shape than the layout says.
    """
    if held.dtype.kind not in NUMBERS:
        raise CodecError(f"'{path}' must hold numbers, got the type '{held.dtype}'.")
    (rows, cols), count = layout.shape, len(layout.channels)
    whole = (count, rows, cols) if layout.order == "channels-first" else (rows, cols, count)
    fits = held.shape[1:] in {whole, (math.prod(whole),)}
    if count == 1:
        fits |= held.shape[1:] == (rows, cols)
    if not fits or not len(held):
        raise CodecError(
            f"'{path}' must hold (frames, {', '.join(map(str, whole))}) or (frames, "
            f"{math.prod(whole)}) values by its layout, got {held.shape}."
        )
    values = held.reshape(len(held), *whole).astype(np.float64)
    return np.moveaxis(values, 1, -1) if layout.order == "channels-first" else values
