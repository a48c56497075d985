"""Building programs: one place that keeps compilers' chatter from the user."""

import warnings
from collections.abc import Sequence
from threading import Lock

import pyopencl as cl

from cnnum.engines.devices.program_cache import build_kept, switch_off_pyopencl_caches

switch_off_pyopencl_caches()

_TURN = Lock()
"""Filters of warnings belong to the process: threads that set them take turns."""


def build_program(context: cl.Context, source: str, options: Sequence[str] = ()) -> cl.Program:
    """Return a built program.

    Some compilers write a line to their log at every build (Intel's: that it has started), and
    PyOpenCL warns of any log that is not empty; a faulty kernel is an error.

    Raises
    ------
    pyopencl.RuntimeError
        If the compiler refuses the source.
    """
    with _TURN, warnings.catch_warnings():
        warnings.simplefilter("ignore", cl.CompilerWarning)
        return build_kept(context, source, options)
