"""Tables of numbers in CSV files: read whole, and refused with the file and the line."""

import csv
import json
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from difflib import get_close_matches
from io import TextIOWrapper
from itertools import islice
from pathlib import Path

import numpy as np

from cnnum.arrays import Floats
from cnnum.errors import CodecError, RecordingError, unreadable
from cnnum.safety.names import shown
from cnnum.safety.reading import MEGABYTE, open_regular

LARGEST, MOST_ROWS = 32 * MEGABYTE, 1_000_000
"""Bytes and rows of the longest table: a file has 24 minutes of a uSkin pad at 60 Hz (384 bytes a
row). In memory such a file took 12 times its size, one of two digits a field 24 times (0.8 GB).
"""


SEPARATORS = (";", "\t", "|")
"""Signs between fields other than the comma."""

_NUMBER = re.compile(r"[+-]?\d+[.\d]*(e[+-]?\d+)?", re.IGNORECASE)
_POINTED = re.compile(r"\s*[+-]?\d+,\d+\s*")
"""A number with a decimal comma."""

FEW = 6
"""Columns that the sentence of an error names."""


@dataclass(frozen=True, slots=True)
class TextForm:
    """The form of a CSV file.

    Attributes
    ----------
    separator : str
        One sign between fields.
    decimal : "." or ","
        The sign in numbers.
    header : bool
        Whether the first line names the columns.
    skip : int
        Lines before it.
    """

    separator: str = ","
    decimal: str = "."
    header: bool = True
    skip: int = 0

    def plain(self, fields: list[str]) -> tuple[str, ...]:
        """Return the fields of a line, with points in numbers."""
        if self.decimal == ".":
            return tuple(fields)
        return tuple(field.replace(self.decimal, ".") for field in fields)


PLAIN = TextForm()


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
    head : int
        Number of the line of the header.
    """

    path: Path
    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    lines: tuple[int, ...]
    head: int = 1

    def numbers(self, columns: Sequence[str], *, finite: bool = True) -> Floats:
        """Return columns as numbers, (rows, columns).

        Parameters
        ----------
        columns : sequence of str
        finite : bool
            Whether NaN and infinity are refused, too. If not, an empty field is NaN.

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
            near = get_close_matches(column, self.header, n=1)
            names = near or self.header[:FEW]
            held = ", ".join(shown(name) for name in names)
            raise CodecError(
                f"'{self.path}', line {self.head}: expected a column {shown(column)}, found none "
                f"of that name; {'near is' if near else 'the first are'} {held}{self.hint()}."
            )
        return self.header.index(column)

    def hint(self) -> str:
        """Return the key of a layout that the header seems to need."""
        other = next((s for s in SEPARATORS if len(self.header) == 1 and s in self.header[0]), "")
        if other:
            return f"; a layout can set separator = {json.dumps(other)}"
        numbers = all(_NUMBER.fullmatch(name) for name in self.header)
        return "; a layout can set header = false" if numbers else ""

    def _number(self, text: str, row: int, column: str, finite: bool) -> float:
        value: float | None
        try:
            value = float(text) if finite or text.strip() else math.nan
        except ValueError:
            value = None
        if value is None or (finite and not math.isfinite(value)):
            kind = "a finite number" if finite else "a number"
            hint = "; a layout can set decimal = ','" if _POINTED.fullmatch(text) else ""
            raise CodecError(
                f"'{self.path}', line {self.lines[row]}: expected {kind} in the column "
                f"'{column}', got {shown(text)}{hint}."
            )
        return value


def read_table(path: Path, form: TextForm = PLAIN) -> TextTable:
    """Read a CSV file; without a header its columns are "1", "2" and so on.

    Raises
    ------
    RecordingError
        If the file cannot be read.
    CodecError
        If it is empty, has too many rows, or one longer or shorter than the header, or is not text.
    """
    found = _lines(path, form)
    if len(found) > MOST_ROWS + 1:
        raise CodecError(f"'{path}' has more than {MOST_ROWS} rows: give a part of it.")
    if not found:
        raise CodecError(f"'{path}' is empty: expected a header and rows of numbers.")
    if form.header:
        (head, names), *rest = found
        header = tuple(name.strip() for name in names)
    else:
        head, rest = form.skip + 1, found
        header = tuple(str(number + 1) for number in range(len(found[0][1])))
    table = TextTable(path, header, tuple(row for _, row in rest), tuple(n for n, _ in rest), head)
    _refuse_torn(table)
    return table


def _lines(path: Path, form: TextForm) -> list[tuple[int, tuple[str, ...]]]:
    """Return the fields of all lines, but one line more than a table may have."""
    try:
        with (
            open_regular(path, most=LARGEST) as raw,
            TextIOWrapper(raw, encoding="utf-8-sig", newline="") as file,  # Excel writes a mark
        ):
            for _ in islice(file, form.skip):
                pass
            reader = csv.reader(file, delimiter=form.separator, skipinitialspace=True)
            rows = ((form.skip + reader.line_num, form.plain(row)) for row in reader if row)
            return list(islice(rows, MOST_ROWS + 2))
    except OSError as error:
        raise unreadable(RecordingError, f"'{path}'", error) from None
    except (UnicodeDecodeError, csv.Error) as error:
        raise CodecError(f"'{path}' is not a CSV text file in UTF-8: {error}.") from None


def _refuse_torn(table: TextTable) -> None:
    for line, row in zip(table.lines, table.rows, strict=True):
        if len(row) != len(table.header):
            raise CodecError(
                f"'{table.path}', line {line}: expected {len(table.header)} fields as in line "
                f"{table.head}, got {len(row)}{table.hint()}."
            )
    if not table.rows:
        raise CodecError(f"'{table.path}' has a header and no rows: expected rows of numbers.")
