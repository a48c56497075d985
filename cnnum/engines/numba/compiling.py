"""How the functions of this room are compiled: once a number type, and kept on disk."""

from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar, cast

import numba

_P = ParamSpec("_P")
_R = TypeVar("_R")


def _compile(
    function: Callable[..., Any], *, parallel: bool = False, inline: bool = False
) -> Callable[..., Any]:
    # the error model of NumPy: no test for a zero divisor in the loops, so that they vectorise
    options: dict[str, Any] = {
        "nogil": True,
        "error_model": "numpy",
        "parallel": parallel,
        "forceinline": inline,
    }
    try:
        # kept beside the source, or in the user's cache where the package is read-only
        return cast(Callable[..., Any], numba.njit(cache=True, **options)(function))
    except RuntimeError:
        # neither folder can be written: compiled anew in every process
        return cast(Callable[..., Any], numba.njit(**options)(function))


def inlined(function: Callable[_P, _R]) -> Callable[_P, _R]:
    """Compile a function into each of its callers, which pays where it works on few cells."""
    return cast(Callable[_P, _R], _compile(function, inline=True))


def compiled(function: Callable[_P, _R]) -> Callable[_P, _R]:
    """Compile a function when it is first called."""
    return cast(Callable[_P, _R], _compile(function))


def compiled_parallel(function: Callable[_P, _R]) -> Callable[_P, _R]:
    """Compile a function whose `numba.prange` loops run on all cores."""
    return cast(Callable[_P, _R], _compile(function, parallel=True))


def cores() -> int:
    """Return the number of cores that compiled functions may use."""
    return int(numba.get_num_threads())
