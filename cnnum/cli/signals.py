"""Ending by a signal without losing what is at hand."""

import signal
import threading
from collections.abc import Generator
from contextlib import contextmanager
from typing import Any


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


@contextmanager
def stoppable() -> Generator[None, None, None]:
    """Let SIGTERM end the block as Ctrl-C does."""
    with handled(signal.default_int_handler, signal.SIGTERM):
        yield


@contextmanager
def undisturbed() -> Generator[None, None, None]:
    """Let neither Ctrl-C nor SIGTERM break into the block: a file is being finished."""
    with handled(signal.SIG_IGN, signal.SIGINT, signal.SIGTERM):
        yield
