"""Tables that fit their lines: no number is ever cut, and columns that have no room are named."""

from collections.abc import Sequence

from rich.console import Console
from rich.table import Column, Table

LEAST_TEXT = 20
"""Columns that a text may be wrapped to where there is no room for more."""

NAME = 48
"""Longest text of a first column that counts as a name, which a pipe gets on one line."""

_ANY = Console(width=100_000, markup=False)
"""Lays nothing out, but knows how wide a text is."""


def needed(made: Table) -> int:
    """Return the columns of the narrowest layout in which no number is cut or wrapped."""
    texts = (column for column in made.columns if not column.no_wrap)
    spared = sum(max(0, _natural(column) - LEAST_TEXT) for column in texts)
    return _ANY.measure(made).maximum - spared


def whole(made: Table, width: int) -> int:
    """Return the columns that a table takes in a pipe or a file: nothing of it is left out.

    Parameters
    ----------
    made : Table
        Names in its first column are kept on one line.
    width : int
        Columns to wrap texts at, where numbers leave as many.
    """
    if made.columns and _natural(made.columns[0]) <= NAME:
        made.columns[0].no_wrap = True
    return max(width, needed(made))


def fitted(made: Table, width: int, spare: Sequence[str] = ()) -> tuple[Table, tuple[str, ...]]:
    """Return a table that fits a terminal, and the names of the columns that had no room.

    Headers are folded at their underscores before a column goes; the first column never goes.

    Parameters
    ----------
    made : Table
    width : int
    spare : sequence of str
        Columns that go first, in this order. Then long texts go, numbers from right to left, and
        short texts, such as verdicts, last.
    """
    if needed(made) <= width:
        return made, ()
    gone: list[str] = []
    names = [str(column.header) for column in made.columns]
    order = [name for name in spare if name in names[1:]]
    others = sorted(made.columns[:0:-1], key=_worth)
    order += [str(column.header) for column in others if str(column.header) not in order]
    kept = _with(made, names)
    while needed(kept) > width and order:
        gone.append(order.pop(0))
        kept = _with(made, [name for name in names if name not in gone])
    return kept, tuple(name for name in names if name in gone)


def _worth(column: Column) -> int:
    return 1 if column.no_wrap else 0 if _natural(column) > LEAST_TEXT else 2


def _natural(column: Column) -> int:
    """Return the width of a column whose texts are not wrapped."""
    return max(_ANY.measure(part).maximum for part in (column.header, *column.cells))


def _with(made: Table, names: Sequence[str]) -> Table:
    """Return a table of some columns, their headers folded to the width of the cells below."""
    kept = [column for column in made.columns if str(column.header) in names]
    copy = Table(
        box=made.box,
        title=made.title,
        title_justify=made.title_justify,
        pad_edge=made.pad_edge,
        padding=made.padding,
        show_header=made.show_header,
        show_edge=made.show_edge,
    )
    for column in kept:
        cells = list(column.cells)
        room = max((_ANY.measure(part).maximum for part in cells), default=0)
        copy.add_column(
            _folded(str(column.header), room),
            justify=column.justify,
            no_wrap=column.no_wrap,
            header_style=column.header_style,
            style=column.style,
            overflow=column.overflow,
        )
    for row in zip(*(column.cells for column in kept), strict=True):
        copy.add_row(*row)
    return copy


def _folded(header: str, room: int) -> str:
    """Return a header on lines that are no wider than a number of columns, where that can be."""
    lines = [""]
    for part in header.replace("_", "_\n").splitlines():
        if lines[-1] and len(lines[-1]) + len(part) > room:
            lines.append("")
        lines[-1] += part
    return "\n".join(lines)
