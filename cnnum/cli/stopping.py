"""Ctrl-C in a long command: the work done by then is printed."""

from collections.abc import Generator
from contextlib import contextmanager

import click

from cnnum.cli.signals import stoppable

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
