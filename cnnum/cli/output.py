"""The output of a command: JSON records for programs, or text and tables for people."""

import json
import math
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from rich import box
from rich.console import Console, ConsoleOptions, RenderableType
from rich.segment import Segment
from rich.table import Table
from rich.text import Text

from cnnum.cli.fitted_tables import fitted, needed, whole
from cnnum.safety.names import visible, visible_json
from cnnum.sharing.json_values import json_value

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
