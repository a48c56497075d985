"""Processes that were forked from one in which an engine had run.

A fork copies the memory of a process, and none of its threads. A driver of OpenCL, or OpenMP, then
waits for threads that are not there, or ends the process.
"""

import os
from dataclasses import dataclass

from cnnum.errors import NoOpenCLError


@dataclass(slots=True)
class Lost:
    """The libraries that this process lost when it was forked.

    Attributes
    ----------
    opencl : bool
        OpenCL had been used before: nothing of it can be used here.
    threads : bool
        Compiled functions had run before: here they run on one core for each frame.
    """

    opencl: bool = False
    threads: bool = False


LOST = Lost()
_USED = Lost()


def note_opencl() -> None:
    """Note that a driver is loaded: processes forked from here on have no OpenCL."""
    _USED.opencl = True


def note_threads() -> None:
    """Note that compiled functions run: later forks have none of their threads."""
    _USED.threads = True


def refuse_after_fork() -> None:
    """Raise if OpenCL had been used before this process was forked.

    Raises
    ------
    NoOpenCLError
        With the remedy.
    """
    if LOST.opencl:
        raise NoOpenCLError(
            "this process was forked from one that had used it",
            "start processes with the method 'spawn' or 'forkserver', or make the first engine "
            "after the fork",
        )


def _lose() -> None:
    LOST.opencl, LOST.threads = _USED.opencl, _USED.threads


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_lose)
