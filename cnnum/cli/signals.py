"""Ending a command: by a signal, or by Ctrl-C, without losing the work at hand."""

import signal
import threading
from collections.abc import Callable, Generator
from contextlib import contextmanager
from types import FrameType
from typing import Any

import click


@contextmanager
def handled(handler: Any, *signals: signal.Signals) -> Generator[None, None, None]:
    """Handle signals in this way while the block runs; only the main thread can say so."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {number: signal.signal(number, handler) for number in signals}
    try:
        yield
    finally:
        for number, old in before.items():
            signal.signal(number, old)


_HANG_UP = getattr(signal, "SIGHUP", None)
"""The terminal has gone; Windows has no such signal."""


class Stop:
    """Ends a block at Ctrl-C, SIGTERM or SIGHUP, but never in the midst of a shielded block."""

    def __init__(self) -> None:
        self._shielded = self._wanted = False

    def __call__(self, _number: int, _frame: FrameType | None) -> None:
        """Handle the signal: at once, or when the shield ends."""
        self._wanted = True
        if not self._shielded:
            raise KeyboardInterrupt

    @contextmanager
    def shield(self) -> Generator[None, None, None]:
        """Let the block come to its end before a signal is heeded."""
        self._shielded = True
        yield
        self._shielded = False
        if self._wanted:
            raise KeyboardInterrupt


@contextmanager
def stoppable() -> Generator[Stop, None, None]:
    """Let SIGTERM and SIGHUP end the block as Ctrl-C does.

    Ctrl-C and SIGHUP that the parent ignores stay ignored: so a shell starts jobs in the
    background, and so does `nohup`.
    """
    stop = Stop()
    with handled(stop, signal.SIGTERM, *_heeded()):
        yield stop


def _heeded() -> list[signal.Signals]:
    return [
        number
        for number in (signal.SIGINT, _HANG_UP)
        if number is not None and signal.getsignal(number) is not signal.SIG_IGN
    ]


@contextmanager
def stop_wanted() -> Generator[Callable[[], bool], None, None]:
    """Note Ctrl-C, SIGTERM and SIGHUP in the block, which ends at its next good place.

    Yields
    ------
    callable
        Whether that is wanted. A second signal ends the block at once, as Ctrl-C does.
    """
    wanted = False

    def note(_number: int, _frame: FrameType | None) -> None:
        nonlocal wanted
        if wanted:
            raise KeyboardInterrupt
        wanted = True
        click.echo("Stopping at the next step; a second Ctrl-C ends at once.", err=True)

    with handled(note, signal.SIGTERM, *_heeded()):
        yield lambda: wanted


@contextmanager
def undisturbed() -> Generator[None, None, None]:
    """Let no such signal break into the block: a file is being finished."""
    hang_up = [_HANG_UP] if _HANG_UP is not None else []
    with handled(signal.SIG_IGN, signal.SIGINT, signal.SIGTERM, *hang_up):
        yield


STOPPED = 130
"""Exit code after Ctrl-C, SIGTERM or SIGHUP."""


class Stopping:
    """Whether a block was stopped by a signal."""

    stopped = False

    def say(self, done: int, total: int, what: str, *, as_json: bool) -> int:
        """Say how far the work came, and return the exit code."""
        click.echo(f"Stopped after {done} of {total} {what}.", err=as_json)
        return STOPPED


@contextmanager
def until_stopped() -> Generator[Stopping, None, None]:
    """Let Ctrl-C, SIGTERM and SIGHUP end the block, and go on after it."""
    stop = Stopping()
    try:
        with stoppable():
            yield stop
    except KeyboardInterrupt:
        stop.stopped = True
