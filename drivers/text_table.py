"""Tables of numbers in CSV files: read whole, and refused with the file and the line."""

import csv
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from io import TextIOWrapper
from itertools import islice
from pathlib import Path

import numpy as np

from cnnum.arrays import Floats
from cnnum.errors import CodecError, RecordingError
from cnnum.safety.names import shown
from cnnum.safety.reading import MEGABYTE, open_regular

LARGEST, MOST_ROWS = 32 * MEGABYTE, 1_000_000
"""Bytes and rows of the longest table: a file has 24 minutes of a uSkin pad at 60 Hz (384 bytes a
row). In memory such a file took 12 times its size, one of two digits a field 24 times (0.8 GB).
"""


@dataclass(frozen=True, slots=True, eq=False)
class TextTable:
    """The rows of a CSV file under its header.

    Attributes
    ----------
    path : Path
    header : tuple of str
    rows : tuple of tuple of str
        As they stand in the file, all as long as the header.
    lines : tuple of int
        Number of the line of each row, from 1.
    """

    path: Path
    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    lines: tuple[int, ...]

    def numbers(self, columns: Sequence[str], *, finite: bool = True) -> Floats:
        """Return columns as numbers, (rows, columns).

        Parameters
        ----------
        columns : sequence of str
        finite : bool
            Whether NaN and infinity are refused, too.

        Raises
        ------
        CodecError
            If a column is missing, or a field is not a finite number.
        """
        places = [self._place(name) for name in columns]
        values = np.empty((len(self.rows), len(places)))
        for i, row in enumerate(self.rows):
            for j, place in enumerate(places):
                values[i, j] = self._number(row[place], i, columns[j], finite)
        return values

    def first(self, rows: int) -> "TextTable":
        """Return the table with as many rows at the most."""
        return replace(self, rows=self.rows[:rows], lines=self.lines[:rows])

    def _place(self, column: str) -> int:
        if column not in self.header:
            raise CodecError(f"'{self.path}', line 1: expected a column '{column}', found none.")
        return self.header.index(column)

    def _number(self, text: str, row: int, column: str, finite: bool) -> float:
        value: float | None
        try:
            value = float(text)
        except ValueError:
            value = None
        if value is None or (finite and not math.isfinite(value)):
            kind = "a finite number" if finite else "a number"
            raise CodecError(
                f"'{self.path}', line {self.lines[row]}: expected {kind} in the column "
                f"'{column}', got {shown(text)}."
            )
        return value


def read_table(path: Path) -> TextTable:
    """Read a CSV file with a header.

    Raises
    ------
    RecordingError
        If the file cannot be read.
    CodecError
        If it is empty, has too many rows, or one longer or shorter than the header, or is not text.
    """
    try:
        with (
            open_regular(path, most=LARGEST) as raw,
            TextIOWrapper(raw, encoding="utf-8", newline="") as file,
        ):
            reader = csv.reader(file)
            rows = ((reader.line_num, tuple(row)) for row in reader if row)
            found = list(islice(rows, MOST_ROWS + 2))
    except OSError as error:
        raise RecordingError(f"'{path}' cannot be read: {error.strerror}.") from None
    except (UnicodeDecodeError, csv.Error) as error:
        raise CodecError(f"'{path}' is not a CSV text file in UTF-8: {error}.") from None
    if len(found) > MOST_ROWS + 1:
        raise CodecError(f"'{path}' has more than {MOST_ROWS} rows: give a part of it.")
    if not found:
        raise CodecError(f"'{path}' is empty: expected a header and rows of numbers.")
    (_, header), *rest = found
    for line, row in rest:
        if len(row) != len(header):
            raise CodecError(
                f"'{path}', line {line}: expected {len(header)} fields as in the header, "
                f"got {len(row)}."
            )
    if not rest:
        raise CodecError(f"'{path}' has a header and no rows: expected rows of numbers.")
    return TextTable(path, header, tuple(row for _, row in rest), tuple(n for n, _ in rest))
