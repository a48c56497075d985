"""Processes forked from one in which an engine had already run.

A fork copies the memory of a process but none of its threads. An OpenCL driver or OpenMP then waits
for threads that do not exist, or ends the process.
"""

import os
from dataclasses import dataclass

from cnnum.errors import NoOpenCLError


@dataclass(slots=True)
class Lost:
    """The libraries that became unusable in this process when it was forked.

    Attributes
    ----------
    opencl : bool
        OpenCL had been used before the fork, so it cannot be used here.
    threads : bool
        Compiled functions had run before the fork; here each frame runs on one core.
    """

    opencl: bool = False
    threads: bool = False


LOST = Lost()
_USED = Lost()


def note_opencl() -> None:
    """Record that a driver is loaded: processes forked from now on have no OpenCL."""
    _USED.opencl = True


def note_threads() -> None:
    """Record that compiled functions have run: later forks have none of their threads."""
    _USED.threads = True


def refuse_after_fork() -> None:
    """Raise if OpenCL had been used before this process was forked.

    Raises
    ------
    NoOpenCLError
        The message says how to avoid it.
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
