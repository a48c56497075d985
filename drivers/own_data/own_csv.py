"""CSV files that `cnnum record` wrote: their header says all but the rate."""

import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from cnnum.drivers.text_table import LARGEST, TextTable
from cnnum.errors import CodecError, RecordingError, unreadable
from cnnum.recordings.csv_writer import MARKS
from cnnum.recordings.recording import Recording, rate_of
from cnnum.safety.names import shown
from cnnum.safety.reading import open_regular

HEAD = ("sequence", "time (s)", "quality")
"""The first columns."""

TRUTH = "truth "
_TAXEL = re.compile(r"r(\d{1,5})_c(\d{1,5})")
_CELL = re.compile(r"r(\d{1,5})_c(\d{1,5})_(.{1,80}) \((.{1,80})\)")


def is_own(path: Path) -> bool:
    """Return whether a CSV file is one that `cnnum record` or `cnnum recover` wrote.

    Raises
    ------
    RecordingError
        If it cannot be read.
    """
    head = ",".join(HEAD).encode()
    try:
        with open_regular(path, most=LARGEST) as file:
            return file.read(len(head)) == head
    except OSError as error:
        raise unreadable(RecordingError, f"'{path}'", error) from None


def read_own(table: TextTable) -> Recording:
    """Return the recording; its rate is that of its times, 1 Hz of a single frame.

    Raises
    ------
    CodecError
        If columns are missing, or a field is no number.
    """
    cells = [_CELL.fullmatch(name) for name in table.header]
    known = [match for match in cells if match]
    if not known:
        raise CodecError(f"'{table.path}', line 1: expected columns as 'r0_c0_normal (count)'.")
    rows, cols = (max(int(match[part]) for match in known) + 1 for part in (1, 2))
    channels = tuple(dict.fromkeys(match[3] for match in known))
    unit = known[0][4]
    wanted = [
        f"r{row}_c{col}_{channel} ({unit})"
        for row in range(rows if rows * cols * len(channels) == len(known) else 0)
        for col in range(cols)
        for channel in channels
    ]
    if [match[0] for match in known] != wanted:
        raise CodecError(
            f"'{table.path}', line 1: expected the columns of every cell row by row, from "
            f"'{known[0][0]}' to '{known[-1][0]}'."
        )
    values = table.numbers(wanted, finite=False).reshape(-1, rows, cols, len(channels))
    times = table.numbers([HEAD[1]])[:, 0]
    return Recording(
        values,
        rate=rate_of(times) or 1.0,
        unit=unit,
        channels=channels,
        times=times,
        truth=_truth(table),
        quality=table.numbers([HEAD[2]])[:, 0],
        saturated=_saturated(table, rows, cols),
    )


def _saturated(table: TextTable, rows: int, cols: int) -> np.ndarray | None:
    """Return the marks of each frame; None where there is no column of them."""
    if MARKS not in table.header:
        return None
    place, found = table.header.index(MARKS), np.zeros((len(table.rows), rows, cols), np.bool_)
    for number, row in enumerate(table.rows):
        for name in row[place].split():
            cell = _TAXEL.fullmatch(name)
            if cell is None or int(cell[1]) >= rows or int(cell[2]) >= cols:
                raise CodecError(
                    f"'{table.path}', line {table.lines[number]}: expected taxels of {rows}×{cols} "
                    f"in the column '{MARKS}', as in 'r0_c3 r1_c3', got {shown(name)}."
                )
            found[number, int(cell[1]), int(cell[2])] = True
    return found


def _truth(table: TextTable) -> Mapping[str, np.ndarray]:
    names = [name for name in table.header if name.startswith(TRUTH)]
    columns = table.numbers(names, finite=False)
    return {name.removeprefix(TRUTH): columns[:, place] for place, name in enumerate(names)}
