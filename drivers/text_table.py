"""Tables of numbers in text files: a row at a time, and refused with the file and the line."""

import csv
import json
import math
import re
import warnings
from array import array
from codecs import getincrementaldecoder
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from difflib import get_close_matches
from functools import cache
from io import TextIOWrapper
from pathlib import Path
from typing import IO

import numpy as np
from numpy.typing import NDArray

from cnnum.arrays import Floats
from cnnum.errors import CodecError, RecordingError, RecordingWarning, unreadable
from cnnum.safety.reading import MEGABYTE, open_regular
from cnnum.safety.values import host_bytes, shown

FORMS = "2024-05-03 12:00:00.25, 2024-05-03T10:00:00Z and 12:00:00.25"
"""Examples of what is read, for the sentence of an error."""

DAY = 86_400_000_000_000

_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
_OF_DAY = re.compile(r"(\d{1,3}):([0-5]\d):([0-5]\d|60)(?:[.,](\d{1,9}))?\s*([AaPp][Mm])?")
_DAYS = re.compile(r"(\d+) days?,? ")
_FRACTION = re.compile(r"(?<=:\d\d)[.,](\d{1,12})")
_YEAR_FIRST = re.compile(r"(\d{4})/(\d\d)/(\d\d)(?=[ T])")


def nanoseconds(text: str) -> int | None:
    """Return a date with its time, or a time of day, in ns; None where it is neither.

    A date counts from 1970, and is in UTC unless it names another zone. A time of day counts from
    midnight; its hours may go beyond 24, and days may stand before it, as in "0 days 00:00:01".

    Parameters
    ----------
    text : str
        In one of the forms of ISO 8601, with a blank or slashes where loggers write them, or
        hours, minutes and seconds.
    """
    text = text.strip()
    if gone := _DAYS.match(text):
        rest = nanoseconds(text[gone.end() :])
        return None if rest is None else int(gone[1]) * DAY + rest
    if day := _OF_DAY.fullmatch(text):
        return _of_day(day)
    text = _YEAR_FIRST.sub(r"\1-\2-\3", text).removesuffix(" UTC")
    fraction = _FRACTION.search(text)
    whole = text if fraction is None else text[: fraction.start()] + text[fraction.end() :]
    try:
        result = datetime.fromisoformat(whole)
    except ValueError:
        return None
    if len(whole) < len("20240503T12"):  # a day alone is no time of a frame
        return None
    return _since_epoch(result) + (_part(fraction[1]) if fraction else 0)


MONTHS = {
    word: english
    for english, words in {
        "Jan": "januar jänner janv janvier ene enero january",
        "Feb": "februar févr février febrero february",
        "Mar": "mär mrz märz mars marzo march",
        "Apr": "april avr avril abr abril",
        "May": "mai mayo",
        "Jun": "juni juin junio june",
        "Jul": "juli juil juillet julio july",
        "Aug": "august août ago agosto",
        "Sep": "sept september septembre septiembre",
        "Oct": "okt oktober octobre octubre october",
        "Nov": "november novembre noviembre",
        "Dec": "dez dezember déc décembre dic diciembre december",
    }.items()
    for word in words.split()
}
"""English names of months by those of other languages."""

_WORD = re.compile(r"[^\W\d_]{3,}")


def by_format(form: str) -> Callable[[str], int | None]:
    """Return a function as `nanoseconds` for one form.

    Parameters
    ----------
    form : str
        As `datetime.strptime` takes it. Names of months may be English, German, French or Spanish.
    """

    def read(text: str) -> int | None:
        try:
            text = _WORD.sub(lambda word: MONTHS.get(word[0].lower(), word[0]), text)
            return _since_epoch(datetime.strptime(text.strip(), form))
        except ValueError:
            return None

    return read


def _of_day(match: re.Match[str]) -> int:
    hours, minutes, seconds = (int(match[n]) for n in (1, 2, 3))
    if match[5]:
        hours = hours % 12 + (12 if match[5].lower() == "pm" else 0)
    whole = (60 * hours + minutes) * 60 + seconds
    return whole * 1_000_000_000 + (_part(match[4]) if match[4] else 0)


def _part(digits: str) -> int:
    return int(digits[:9].ljust(9, "0"))


def _since_epoch(when: datetime) -> int:
    known = when if when.tzinfo is not None else when.replace(tzinfo=UTC)
    gone = known - _EPOCH
    return (gone.days * 86_400 + gone.seconds) * 1_000_000_000 + gone.microseconds * 1000


LARGEST, MOST_ROWS = 32 * MEGABYTE, 1_000_000
"""Bytes and rows of the longest table that is held as text (`read_table`): 24 minutes of a uSkin
pad at 60 Hz (384 bytes per row). In memory such a file took 12 times its size, one of two digits a
field 24 times (0.8 GB). Numbers are read a row at a time (`read_columns`), without this limit.
"""

LONGEST_LINE = 64 * MEGABYTE
"""Letters of a line: a million taxels of three numbers."""

SEPARATORS = (";", "\t", "|", " ")
"""Signs between fields other than the comma."""

MISSING = frozenset(
    [
        *(
            "na",
            "n/a",
            "#n/a",
            "<na>",
            "nan",
            "nat",
            "-nan",
            "null",
            "none",
            "nil",
            "undefined",
            "missing",
            "-",
        ),
        *(
            "--",
            "?",
            "1.#qnan",
            "1.#ind",
            "-1.#ind",
            "#num!",
            "#div/0!",
            "#value!",
            "#ref!",
            "#name?",
            "#null!",
        ),
    ]
)
"""Words for a missing value, in small letters: of R, Python, JavaScript, Excel and Windows."""

_NUMBER = re.compile(r"[+-]?(\d+[.\d]*|\.\d+)(e[+-]?\d+)?", re.IGNORECASE)
_POINTED = re.compile(r"\s*[+-]?\d+,\d+\s*")
"""A number with a decimal comma."""

FEW = 6
"""Columns that the sentence of an error names."""

MANY = 100
"""Rows before the last, all of which end in a longer number: then that without an end is cut."""

ROWS_A_LOOK = 1024
"""Rows between looks at the memory that they take."""


@dataclass(frozen=True, slots=True)
class TextForm:
    """The form of a table in a text file.

    Attributes
    ----------
    separator : str
        One sign between fields; " " stands for any number of blanks and tabs.
    decimal : "." or ","
        The sign in numbers. With fields in quotes it may be the separator, too.
    header : bool
        Whether the first line names the columns.
    skip : int
        Lines before it.
    comment : str
        A line that begins with this is none of the table, unless it is the header.
    thousands : str
        The sign between groups of three digits, as in "16,300"; "" for none.
    """

    separator: str = ","
    decimal: str = "."
    header: bool = True
    skip: int = 0
    comment: str = "#"
    thousands: str = ""

    def plain(self, fields: list[str]) -> list[str]:
        """Return the fields of a line, with points in numbers, and no sign between thousands."""
        if sign := self.thousands:
            fields = [
                text.replace(sign, "") if groups(text, sign, self.decimal) else text
                for text in fields
            ]
        if self.decimal == ".":
            return fields
        return [text.replace(self.decimal, ".") for text in fields]


THOUSANDS = (",", ".", "'", "\u2019", " ", "\u00a0", "\u202f")
"""Signs between groups of three digits: of English, German, Swiss, French and ISO."""


@cache
def _grouped(sign: str, decimal: str) -> re.Pattern[str]:
    part = re.escape(decimal)
    return re.compile(rf"\s*[+-]?\d{{1,3}}(?:{re.escape(sign)}\d{{3}})+(?:{part}\d*)?\s*")


def groups(text: str, sign: str, decimal: str = ".") -> bool:
    """Return whether a number has this sign between its groups of three digits."""
    return _grouped(sign, decimal).fullmatch(text) is not None


PLAIN = TextForm()


@dataclass(frozen=True, slots=True)
class Head:
    """The names of the columns, and where they stand.

    Attributes
    ----------
    path : Path
    names : tuple of str
    line : int
        Number of the line, from 1.
    """

    path: Path
    names: tuple[str, ...]
    line: int

    def place(self, column: str) -> int:
        """Return the place of a column.

        Raises
        ------
        CodecError
            If there is none of that name.
        """
        if column not in self.names:
            near = get_close_matches(column, self.names, n=1)
            names = near or self.names[:FEW]
            held = ", ".join(shown(name) for name in names)
            raise CodecError(
                f"'{self.path}', line {self.line}: expected a column {shown(column)}, found none "
                f"of that name; {'a similar one is' if near else 'the first ones are'} "
                f"{held}{self.hint()}."
            )
        return self.names.index(column)

    def hint(self) -> str:
        """Return the key of a layout that the header seems to need."""
        other = next((s for s in SEPARATORS if len(self.names) == 1 and s in self.names[0]), "")
        if other:
            return f"; a layout can set separator = {json.dumps(other)}"
        numbers = all(_NUMBER.fullmatch(name) for name in self.names)
        return "; a layout can set header = false" if numbers else ""

    def number(self, text: str, line: int, column: str, *, finite: bool) -> float:
        """Return the number of a field.

        Raises
        ------
        CodecError
            If it is none. Where it need not be finite, a missing one is NaN.
        """
        value = _value(text)
        if value is None and not finite and (not text.strip() or text.strip().lower() in MISSING):
            value = math.nan
        if value is None or (finite and not math.isfinite(value)):
            kind = "a finite number" if finite else "a number"
            keys = ["decimal = ','"] if _POINTED.fullmatch(text) else []
            keys += [f"thousands = {sign!r}" for sign in THOUSANDS if groups(text, sign)]
            hint = f"; a layout can set {' or '.join(keys)}" if keys else ""
            raise CodecError(
                f"'{self.path}', line {line}: expected {kind} in the column '{column}', got "
                f"{shown(text)}{hint}."
            )
        return value


def _value(text: str) -> float | None:
    try:
        return float(text) if "_" not in text else None
    except ValueError:
        return None


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
            Whether NaN and infinity are refused, too. If not, a missing field is NaN.

        Raises
        ------
        CodecError
            If a column is missing, or a field is not a finite number.
        """
        head = Head(self.path, self.header, self.head)
        places = [head.place(name) for name in columns]
        values = np.empty((len(self.rows), len(places)))
        for i, row in enumerate(self.rows):
            for j, place in enumerate(places):
                line = self.lines[i]
                values[i, j] = head.number(row[place], line, columns[j], finite=finite)
        return values

    def first(self, rows: int) -> "TextTable":
        """Return the table with as many rows at the most."""
        return replace(self, rows=self.rows[:rows], lines=self.lines[:rows])


def read_table(path: Path, form: TextForm = PLAIN) -> TextTable:
    """Read a CSV file as text; without a header its columns are "1", "2" and so on.

    Raises
    ------
    RecordingError
        If the file cannot be read.
    CodecError
        If it is empty, has too many rows, or one longer or shorter than the header, or is not text.
    """
    rows, lines = list[tuple[str, ...]](), list[int]()
    with closing(rows_of(path, form, most=LARGEST)) as reader:
        head = next(reader)
        for line, fields in reader:
            if len(rows) >= MOST_ROWS:
                raise CodecError(f"'{path}' has more than {MOST_ROWS} rows: give a part of it.")
            rows.append(tuple(fields))
            lines.append(line)
    return TextTable(path, tuple(head[1]), tuple(rows), tuple(lines), head[0])


@dataclass(frozen=True, slots=True)
class Wanted:
    """Columns of a table.

    Attributes
    ----------
    cells : sequence of str
        Numbers that may be missing.
    facts : sequence of str
        Numbers that may not.
    clock : str
        Times, as numbers or as dates and times of day; "" where there are none.
    clock_format : str
        The form of dates, as `datetime.strptime` takes it; "" for the usual ones.
    texts : sequence of str
    whole : sequence of str
        Whole numbers of up to 63 bits.
    """

    cells: Sequence[str]
    facts: Sequence[str] = ()
    clock: str = ""
    clock_format: str = ""
    texts: Sequence[str] = ()
    whole: Sequence[str] = ()


@dataclass(slots=True, eq=False)
class Columns:
    """Columns of a table as numbers.

    Attributes
    ----------
    head : Head
    lines : (rows,) int
        Number of the line of each row, from 1.
    cells, facts : (rows, columns) float
    clock : (rows,) float or None
        Numbers as they stand, or s from the first row where they are dates or times of day.
    dated : bool
        Whether they are such.
    texts : dict of str to list of str
    whole : dict of str to (rows,) int
    """

    head: Head
    lines: NDArray[np.int64]
    cells: Floats
    facts: Floats
    clock: Floats | None
    dated: bool
    texts: dict[str, list[str]] = field(default_factory=dict[str, list[str]])
    whole: dict[str, NDArray[np.int64]] = field(default_factory=dict[str, NDArray[np.int64]])


def read_columns(path: Path, pick: Callable[[Head], Wanted], form: TextForm = PLAIN) -> Columns:
    """Read columns of a table as numbers, a row at a time: only the numbers are held.

    Parameters
    ----------
    path : Path
    pick : callable
        Returns the columns by the header. Without a header these are "1", "2" and so on.
    form : TextForm

    Raises
    ------
    RecordingError
        If the file cannot be read, or its numbers need more memory than there is.
    CodecError
        If a row is longer or shorter than the header, a column is missing, or a field is none of
        its kind; the sentence names the file and the line.
    """
    with closing(rows_of(path, form)) as reader:
        line, names = next(reader)
        head = Head(path, tuple(names), line)
        table = _Growing(head, pick(head), form.decimal)
        for line, fields in reader:
            table.add(line, fields)
    return table.done()


class _Growing:
    """The numbers of the rows so far."""

    def __init__(self, head: Head, wanted: Wanted, decimal: str) -> None:
        self.head, self.wanted = head, wanted
        self._cells = [head.place(name) for name in wanted.cells]
        self._facts = [head.place(name) for name in wanted.facts]
        self._texts = {name: head.place(name) for name in wanted.texts}
        self._whole = {name: head.place(name) for name in wanted.whole}
        self._clock = head.place(wanted.clock) if wanted.clock else None
        self._numbers, self._singles, self._lines = array("d"), array("d"), array("q")
        self._times, self._dates = array("d"), array("q")
        self._held: dict[str, list[str]] = {name: [] for name in wanted.texts}
        self._ints = {name: array("q") for name in wanted.whole}
        # `TextForm.plain` has put points for decimal commas in the fields, and so in the dates
        form = wanted.clock_format.replace(decimal, ".")
        self._date = by_format(form) if form else nanoseconds
        self._dated: bool | None = True if wanted.clock_format else None
        self._room = host_bytes()

    def add(self, line: int, fields: list[str]) -> None:
        """Take in a row."""
        try:
            if any("_" in text for text in fields):  # Python takes 1_000 for a number
                raise ValueError
            self._numbers.extend([float(fields[place]) for place in self._cells])
        except ValueError:
            del self._numbers[len(self._lines) * len(self._cells) :]
            pairs = zip(self._cells, self.wanted.cells, strict=True)
            for place, name in pairs:
                self._numbers.append(self.head.number(fields[place], line, name, finite=False))
        for place, name in zip(self._facts, self.wanted.facts, strict=True):
            self._singles.append(self.head.number(fields[place], line, name, finite=True))
        for name, place in self._texts.items():
            self._held[name].append(fields[place])
        for name, place in self._whole.items():
            self._ints[name].append(self._integer(fields[place], line, name))
        if self._clock is not None:
            self._take_time(fields[self._clock], line)
        self._lines.append(line)
        if self._room is not None and len(self._lines) % ROWS_A_LOOK == 0:
            self._look(self._room)

    def _integer(self, text: str, line: int, name: str) -> int:
        try:
            value = int(text)
        except ValueError:  # a program between may have made 3.0 of 3
            number = self.head.number(text, line, name, finite=True)
            value = int(number) if number.is_integer() else 1 << 63
        if not -(1 << 63) <= value < 1 << 63:
            raise CodecError(
                f"'{self.head.path}', line {line}: expected a whole number in the column "
                f"'{name}', got {shown(text)}."
            )
        return value

    def _take_time(self, text: str, line: int) -> None:
        if self._dated is None:
            self._dated = _value(text) is None and self._date(text) is not None
        if not self._dated:
            value = _value(text)
            if value is None and not self._lines and text.strip().lower() not in MISSING:
                raise CodecError(
                    f"'{self.head.path}', line {line}: expected a time in the column "
                    f"'{self.wanted.clock}', got {shown(text)}: a number, or a time such as "
                    f"{FORMS}; a layout can set 'time_format' for others, as in \"%d.%m.%Y "
                    '%H:%M:%S".'
                )
            self._times.append(self.head.number(text, line, self.wanted.clock, finite=True))
            return
        when = self._date(text)
        if when is None or not -(1 << 63) <= when < 1 << 63:
            form = self.wanted.clock_format
            like = f"of the form {shown(form)}" if form else f"as {FORMS} are"
            raise CodecError(
                f"'{self.head.path}', line {line}: expected a time in the column "
                f"'{self.wanted.clock}' {like}, got {shown(text)}."
            )
        if self._dates and when < self._dates[-1] and 0 <= when < DAY <= self._dates[-1] + DAY // 2:
            when += -(-(self._dates[-1] - DAY // 2 - when) // DAY) * DAY  # past midnight
        self._dates.append(when)

    def _look(self, room: int) -> None:
        floats = len(self._numbers) + len(self._singles) + len(self._times)
        wholes = len(self._lines) + len(self._dates) + sum(map(len, self._ints.values()))
        held = 8 * (floats + wholes)
        # the arrays are held once more while they become those of NumPy
        if 2 * held > room:
            raise RecordingError(
                f"'{self.head.path}' holds more numbers than the memory of this machine "
                f"({room / 1e9:.1f} GB): give a part of it."
            )

    def done(self) -> Columns:
        """Return all columns."""
        count = len(self._lines)
        if not count:
            raise CodecError(
                f"'{self.head.path}' has a header and no rows: expected rows of numbers."
            )
        clock: Floats | None = None
        if self._clock is not None:
            dates = np.asarray(self._dates, np.int64)
            clock = 1e-9 * (dates - dates[0]) if self._dated else np.asarray(self._times)
        return Columns(
            self.head,
            np.asarray(self._lines, np.int64),
            np.asarray(self._numbers).reshape(count, len(self._cells)),
            np.asarray(self._singles).reshape(count, len(self._facts)),
            clock,
            bool(self._dated),
            self._held,
            {name: np.asarray(held, np.int64) for name, held in self._ints.items()},
        )


def rows_of(
    path: Path, form: TextForm = PLAIN, most: int | None = None
) -> Generator[tuple[int, list[str]], None, None]:
    """Yield the line of the header and its names, then that of each row and its fields.

    Comments and rows without any content are left out, and so are the separators with nothing
    behind them with which loggers and spreadsheets end their rows.

    Raises
    ------
    RecordingError, CodecError
        As `read_table`.
    """
    try:
        with open_regular(path, most=most) as raw, open_text(raw) as text:
            yield from _rows(path, form, text)
    except OSError as error:
        raise unreadable(RecordingError, f"'{path}'", error) from None
    except (UnicodeError, csv.Error) as error:
        raise CodecError(f"'{path}' is not a CSV text file: {error}.") from None


def open_text(raw: IO[bytes]) -> TextIOWrapper:
    """Return the text of a file, for `read_line`.

    Spreadsheets write UTF-16, too, and call it "Unicode".
    """
    begin = raw.read(1 << 16)
    raw.seek(0)
    if begin.startswith((b"\xff\xfe", b"\xfe\xff")):
        return TextIOWrapper(raw, "utf-16", newline="")
    try:
        getincrementaldecoder("utf-8")().decode(begin)
    except UnicodeError:
        if b"\0" in begin:
            raise UnicodeError("it contains null bytes, which text files do not have") from None
    return TextIOWrapper(raw, "utf-8-sig", "surrogateescape", newline="")


def read_line(text: TextIOWrapper, most: int) -> str:
    """Return the next line; one that is not UTF-8 is text of Windows in western Europe.

    Its µ, °, ä and é stand in names and units.
    """
    line = text.readline(most)
    if line.isascii() or not _SPOILT.search(line):
        return line
    return line.encode("utf-8", "surrogateescape").decode("cp1252", "replace")


_SPOILT = re.compile("[\udc80-\udcff]")
"""What stands for bytes that are not UTF-8."""


def _rows(path: Path, form: TextForm, text: TextIOWrapper) -> Iterator[tuple[int, list[str]]]:
    lines = _Lines(path, form, text)
    content = ((lines.number, row) for row in fields_of(lines, form) if any(map(str.strip, row)))
    first = next(content, None)
    if first is None:
        raise CodecError(f"'{path}' is empty: expected a header and rows of numbers.")
    line, names = first
    rest: list[tuple[int, list[str]]] = []
    if not form.header:
        rest, names = [first], [str(n + 1) for n in range(len(first[1]))]
        line = form.skip + 1
    elif lines.comment and 2 * sum(map(bool, map(_NUMBER.fullmatch, map(str.strip, names)))) > (
        len(names)
    ):
        # the header is a comment, as NumPy and rostopic write it; some columns may have words
        said = next(fields_of([lines.comment.lstrip(form.comment)], form), list[str]())
        if len(said) == len(names):
            rest, (line, names) = [first], (lines.commented, said)
    names = [name.strip() for name in names]
    while len(names) > 1 and not names[-1]:
        names.pop()
    head = Head(path, tuple(names), line)
    yield line, names
    count, shortest = 0, LONGEST_LINE
    for number, row in _chained(rest, content):
        while len(row) > len(names) and not row[-1].strip():
            row.pop()
        if [text.strip() for text in row] == names:
            warnings.warn(
                f"'{path}', line {number}: the header occurs again, as where a second recording "
                "begins, and is skipped.",
                RecordingWarning,
                stacklevel=2,
            )
            continue
        size = len(row[-1].strip())
        if lines.torn and (len(row) < len(names) or (count >= MANY and 0 < size < shortest)):
            warnings.warn(
                f"'{path}' ends within line {number}"
                + ("" if len(row) < len(names) else " (its last number is shorter than all others)")
                + ", which is left out: whatever wrote it was stopped.",
                RecordingWarning,
                stacklevel=2,
            )
            break
        if len(row) != len(names):
            raise CodecError(
                f"'{path}', line {number}: expected {len(names)} fields as in line {line}, got "
                f"{len(row)}{head.hint()}."
            )
        count, shortest = count + 1, min(shortest, size)
        yield number, form.plain(row)
    if not count:
        raise CodecError(f"'{path}' has a header and no rows: expected rows of numbers.")


def _chained(
    first: list[tuple[int, list[str]]], rest: Iterator[tuple[int, list[str]]]
) -> Iterator[tuple[int, list[str]]]:
    yield from first
    yield from rest


def fields_of(lines: "_Lines | list[str]", form: TextForm) -> Iterator[list[str]]:
    """Return an iterator over the fields of each line, without single or double quotes."""
    if form.separator == " ":
        return (_blank_fields(line) for line in lines)
    sign = re.escape(form.separator)
    quoted = re.compile(rf"(?:^|(?<={sign}))(\s*)'([^'\r\n]*)'(?=\s*(?:{sign}|$))")
    doubled = (
        quoted.sub(r'\1"\2"', line) if "'" in line and '"' not in line else line for line in lines
    )
    return csv.reader(doubled, delimiter=form.separator, skipinitialspace=True)


def _blank_fields(line: str) -> list[str]:
    fields = line.split()
    if "'" in line or '"' in line:
        joined = re.findall(r"""'[^']*'(?!\S)|"[^"]*"(?!\S)|\S+""", line)
        fields = [text[1:-1] if re.fullmatch(r"'.*'|\".*\"", text) else text for text in joined]
    return fields


class _Lines:
    """The lines of a text file but its comments; none is longer than `LONGEST_LINE`.

    Attributes
    ----------
    number : int
        Number of the line that was read last, from 1.
    comment : str
        The last comment before the first line of the table.
    commented : int
        Its number.
    torn : bool
        Whether the line that was read last has no end, as the last one of a file may have none.
    """

    def __init__(self, path: Path, form: TextForm, text: TextIOWrapper) -> None:
        self._path, self._text = path, text
        self._comment, self._separator = form.comment, form.separator
        self.number = self.commented = 0
        self.comment, self._begun, self.torn = "", False, False
        for _ in range(form.skip):
            self._next()

    def __iter__(self) -> "_Lines":
        return self

    def __next__(self) -> str:
        while line := self._next():
            if self._comment and line.lstrip().startswith(self._comment) and self._is_comment(line):
                if not self._begun:
                    self.comment, self.commented = line.strip(), self.number
                continue
            self._begun = self._begun or bool(line.strip())
            return line
        raise StopIteration

    def _is_comment(self, line: str) -> bool:
        first = line.lstrip().partition(self._separator)[0].strip(' "\r\n').lower()
        return first not in MISSING  # "#N/A" is a word of Excel

    def _next(self) -> str:
        line = read_line(self._text, LONGEST_LINE)
        self.number += bool(line)
        self.torn = self.torn if not line else line[-1] not in "\r\n"
        if len(line) >= LONGEST_LINE:
            raise CodecError(
                f"'{self._path}', line {self.number}: expected a row of numbers, got a line of "
                f"more than {LONGEST_LINE // MEGABYTE} million characters."
            )
        return line
