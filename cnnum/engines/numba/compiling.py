"""How the functions of this room are compiled, and which of them are kept on disk.

Only functions that Python calls are kept, each with all that it calls in it
(`function_cache.py`). Their last parameter is `ROOM`, a number of the contents of this room: their
callees may lie in another file. It is part of their key.
"""

import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any, ParamSpec, TypeVar, cast

import numba

from cnnum.engines.forks import note_threads
from cnnum.engines.numba.function_cache import KeptForms

_P = ParamSpec("_P")
_R = TypeVar("_R")

_FILES = sorted(Path(__file__).parent.glob("*.py"))

ROOM = zlib.crc32(b"".join(file.read_bytes() for file in _FILES))
"""Another number for other contents of the files of this room."""


_INNER = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
"""Of functions that Python never calls: to unpack a plan would be most of a small one."""


def _compile(function: Callable[..., Any], **options: Any) -> Callable[..., Any]:
    # the error model of NumPy: no test for a zero divisor in the loops, so that they vectorise
    common: dict[str, Any] = {"nogil": True, "error_model": "numpy"}
    return cast(Callable[..., Any], numba.njit(**common, **options)(function))


def inlined(function: Callable[_P, _R]) -> Callable[_P, _R]:
    """Compile a function into each of its callers, which pays where it works on few cells."""
    return cast(Callable[_P, _R], _compile(function, forceinline=True, **_INNER))


def merged(function: Callable[_P, _R]) -> Callable[_P, _R]:
    """Take a function into the text of its callers, which pays where there is one or it is short.

    Every function that is compiled on its own goes through the compiler with all that it calls.
    """
    return cast(Callable[_P, _R], _compile(function, inline="always"))


def compiled(function: Callable[_P, _R]) -> Callable[_P, _R]:
    """Compile a function when one that calls it is, even one that is inlined itself."""
    return cast(Callable[_P, _R], _compile(function, forceinline=False, **_INNER))


def compiled_parallel(function: Callable[_P, _R]) -> Callable[_P, _R]:
    """Compile a function whose `numba.prange` loops run on all cores."""
    return cast(Callable[_P, _R], _compile(function, forceinline=False, parallel=True, **_INNER))


def kept(function: Callable[_P, _R]) -> Callable[_P, _R]:
    """Compile a function when it is first called, and keep it: its last parameter is `ROOM`."""
    form: Any = _compile(function)
    form._cache = KeptForms(function)
    return cast(Callable[_P, _R], form)


def cores() -> int:
    """Return the number of cores that compiled functions may use; asking starts their threads."""
    note_threads()
    return int(numba.get_num_threads())
