"""The output of a command: records for programs, text and tables for people, and progress."""

import json
import math
import sys
from collections.abc import Generator, Iterable, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

from rich import box
from rich.console import Console, ConsoleOptions, RenderableType
from rich.markup import escape
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    ProgressColumn,
    SpinnerColumn,
    Task,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.segment import Segment
from rich.table import Column, Table
from rich.text import Text

from cnnum.safety.values import visible, visible_json
from cnnum.sharing import json_value

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


PIPED_WIDTH = 120
"""Columns at which a pipe or a file gets its texts wrapped; tables are as wide as they are."""


def on_terminal() -> bool:
    """Return whether standard output is a terminal, whose lines have an end."""
    return sys.stdout.isatty()


class _Console(Console):
    """A console that leaves a closed pipe to whoever runs the command."""

    def render(
        self, renderable: RenderableType, options: ConsoleOptions | None = None
    ) -> Iterable[Segment]:
        """Render, with no control characters but those of rich itself."""
        for segment in super().render(renderable, options):
            text, style, control = segment
            yield segment if control else Segment(visible(text), style)

    def on_broken_pipe(self) -> None:
        """Raise; rich would end the process with 1, as if a check had failed."""
        raise BrokenPipeError


def console() -> Console:
    """Return a console on standard output, as wide as the terminal.

    Text is shown as it is: names of files and extras have brackets, which are no markup.
    """
    width = None if on_terminal() else PIPED_WIDTH
    return _Console(width=width, highlight=False, markup=False)


@dataclass(frozen=True, slots=True)
class Output:
    """Standard output of a command.

    Attributes
    ----------
    as_json : bool
        One JSON object a line, and nothing else.
    """

    as_json: bool

    def record(self, values: Mapping[str, object], text: str = "") -> None:
        """Write a record at once, or the text that says the same."""
        if self.as_json:
            text = json.dumps(json_value(values), ensure_ascii=False, allow_nan=False)
            self._line(visible_json(text))
        elif text:
            self._line(visible(text))

    def show(self, *parts: RenderableType, spare: Sequence[str] = ()) -> None:
        """Lay out tables and text; nothing with --json.

        A number of a table is never cut: a pipe gets tables as wide as they are. A terminal gets
        those columns that it has room for, and the names of the others.

        Parameters
        ----------
        parts : renderable
        spare : sequence of str
            Columns of tables that go first.
        """
        if not self.as_json:
            for part in parts:
                self._lay_out(part, spare)
            sys.stdout.flush()

    def _lay_out(self, part: RenderableType, spare: Sequence[str]) -> None:
        target, gone = console(), tuple[str, ...]()
        width = target.width
        if isinstance(part, Table) and on_terminal():
            part, gone = fitted(part, width, spare)
            target.width = max(width, needed(part))
        elif isinstance(part, Table):
            target.width = whole(part, width)
        with target.capture() as laid_out:
            target.print(part)
            if gone:
                target.print(f"No room in {width} columns: {', '.join(gone)}.", width=width)
        for line in laid_out.get().splitlines():
            sys.stdout.write(line.rstrip() + "\n")  # tables pad their lines

    def _line(self, text: str) -> None:
        # not through a console: it breaks lines, and would pass by a progress bar
        sys.stdout.write(text + "\n")
        sys.stdout.flush()


def table(*columns: str, title: str = "") -> Table:
    """Return an empty table; a column whose name begins with ">" is aligned to the right."""
    made = Table(box=box.SIMPLE_HEAD, title=title or None, title_justify="left", pad_edge=False)
    for name in columns:
        right = name.startswith(">")
        made.add_column(
            name.removeprefix(">"),
            justify="right" if right else "left",
            no_wrap=right,
            header_style="bold",
            overflow="fold",
        )
    return made


def facts(pairs: Iterable[tuple[str, str]], title: str = "") -> Table:
    """Return a table of names and values, without lines."""
    made = Table.grid(padding=(0, 2))
    made.title, made.title_justify = title or None, "left"
    made.add_column(style="bold", no_wrap=True)
    made.add_column(overflow="fold")
    for name, value in pairs:
        made.add_row(name, Text(value))
    return made


def number(value: float, digits: int = 3) -> str:
    """Return a number with a given count of significant digits."""
    return f"{value:.{digits}g}" if math.isfinite(value) else "∞" if value > 0 else "?"


def quantity(value: float, unit: str) -> str:
    """Return a quantity with the prefix that keeps it between 1 and 1000."""
    if value == 0 or not math.isfinite(value):
        return f"{value:g} {unit}"
    steps = min(max(math.floor(math.log10(abs(value)) / 3), -4), 4)
    prefix = ("p", "n", "µ", "m", "", "k", "M", "G", "T")[steps + 4]
    return f"{value / 1000.0**steps:.3g} {prefix}{unit}"


def verdict(passed: bool) -> Text:
    """Return "passed" or "FAILED", distinct without colours too."""
    return Text("passed", style="green") if passed else Text("FAILED", style="bold red")


COMPILING = "compiling…"
"""The words of a command while it opens a scene."""


class _Rate(ProgressColumn):
    """Steps a second."""

    def render(self, task: Task) -> Text:
        return Text("" if task.speed is None else f"{task.speed:.0f}/s")


class Steps:
    """The function that a command calls once a step."""

    def __init__(self, progress: Progress | None, unit: str, total: int | None) -> None:
        self._progress = progress
        self._task = progress.add_task(unit, total=total) if progress else None

    def advance(self, note: str = "") -> None:
        """Count one more step as done."""
        if self._progress is not None and self._task is not None:
            self._progress.advance(self._task)
            if note:
                self._progress.update(self._task, description=escape(visible(note)))


@contextmanager
def progress(unit: str, total: int | None, *, as_json: bool) -> Generator[Steps, None, None]:
    """Show progress while the block runs, if standard error is a terminal.

    Parameters
    ----------
    unit : str
        Name of the steps: "frames".
    total : int or None
        Steps in all, where that is known.
    as_json : bool
        Records on the same terminal would tear the bar, and it them: then there is none.
    """
    both = sys.stdout.isatty()
    if not sys.stderr.isatty() or (as_json and both):
        yield Steps(None, unit, total)
        return
    known = (BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    unknown = (SpinnerColumn(), TextColumn("{task.completed}"), TimeElapsedColumn())
    with Progress(
        TextColumn("{task.description}"),
        *(known if total is not None else unknown),
        _Rate(),
        console=Console(stderr=True),
        transient=True,
        # the bar holds back for lines on the same terminal, and must not catch those of a file
        redirect_stdout=both,
        redirect_stderr=False,
    ) as shown:
        yield Steps(shown, unit, total)


@contextmanager
def busy(text: str, *, as_json: bool) -> Generator[None, None, None]:
    """Show on standard error the work in progress, if it is a terminal.

    Parameters
    ----------
    text : str
        As in "compiling…".
    as_json : bool
        As of `progress`.
    """
    if not sys.stderr.isatty() or (as_json and sys.stdout.isatty()):
        yield
        return
    with Console(stderr=True).status(text):
        yield
