"""A table of results: rows of numbers, and their aims."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from math import isnan

from cnnum.sharing import json_value

Value = str | float | int | bool | None
Row = dict[str, Value]


@dataclass(frozen=True, slots=True)
class Column:
    """A column.

    Attributes
    ----------
    key, title : str
        In the JSON record of a row, and for people.
    digits : int
        After the point.
    least, most : float, optional
        The aim that numbers should reach, or stay under.
    explains : bool
        Whether it says more of the thing that the first column names.
    """

    key: str
    title: str
    digits: int = 2
    least: float | None = None
    most: float | None = None
    explains: bool = False

    @property
    def aim(self) -> str:
        """The aim in signs, nothing without one."""
        if self.least is not None:
            return f"≥ {self.least:g}"
        return "" if self.most is None else f"≤ {self.most:g}"

    def reached(self, value: Value) -> bool | None:
        """Return whether a number reaches the aim; None without an aim or a number."""
        if not isinstance(value, float | int) or isinstance(value, bool) or isnan(value):
            return None
        if self.least is not None:
            return value >= self.least
        return None if self.most is None else value <= self.most

    def text(self, value: Value) -> str:
        """Return a number as people read it."""
        if json_value(value) is None:
            return "–"
        return f"{value:.{self.digits}f}" if isinstance(value, float) else str(value)


@dataclass(frozen=True, slots=True)
class Table:
    """Rows of results.

    Attributes
    ----------
    name : str
        In the JSON records.
    title, note : str
        For people; the note says how to read it.
    columns : sequence of Column
        The first names a row.
    rows : sequence of dict
        Aims are for rows without a true "baseline".
    """

    name: str
    title: str
    note: str
    columns: Sequence[Column]
    rows: Sequence[Row] = field(default_factory=list[Row])

    def records(self) -> Iterator[dict[str, object]]:
        """Yield every row as a JSON object."""
        for row in self.rows:
            yield {"table": self.name, **{key: json_value(value) for key, value in row.items()}}

    def reached(self, column: Column, row: Row) -> bool | None:
        """Return whether a number reaches its aim, or None if it has none."""
        return None if row.get("baseline") else column.reached(row.get(column.key))

    @property
    def missed(self) -> int:
        """Number of numbers that miss their aim."""
        return sum(self.reached(column, row) is False for column, row in self._cells())

    @property
    def aimed(self) -> int:
        """Number of numbers that have an aim."""
        return sum(self.reached(column, row) is not None for column, row in self._cells())

    def _cells(self) -> Iterator[tuple[Column, Row]]:
        for row in self.rows:
            for column in self.columns:
                yield column, row
