"""Progress on standard error: a bar where the number of steps is known, a counter elsewhere."""

import sys
from collections.abc import Generator
from contextlib import contextmanager

from rich.console import Console
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
from rich.text import Text

from cnnum.safety.names import visible

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
