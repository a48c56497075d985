"""Compilation of this package's functions, with a cache that persists between processes.

Numba's own cache trusts its files: a damaged file breaks every run, and two processes that compile
at once can mix up their files. Here each compiled specialisation is an entry of the cache of cnnum,
keyed by everything it depends on and used only if its checksum is right.

Only functions called from Python are cached, each including its callees. Their last parameter has
the default `ROOM`, a checksum of this package's sources, since callees may be in another file.
Calls omit it, so that its value, and not only its type, is part of the key.
"""

import hashlib
import pickle
import sys
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any, ParamSpec, TypeVar, cast

import numba
from numba.core import config, serialize
from numba.core.caching import NullCache
from numba.core.compiler import CompileResult

from cnnum.engines.cache import Shelf
from cnnum.engines.forks import note_threads

# Numba's own ways to take a form apart and to put it together have no types
_FORM: Any = CompileResult
_NUMBA: Any = serialize

SHELF = Shelf("numba", "NUMBA_CACHE_DIR")


class KeptForms(NullCache):
    """The cache that Numba asks before it compiles a function, and fills afterwards.

    Parameters
    ----------
    function : callable
        As it stands in the source; its signature names the contents of the source.
    """

    def __init__(self, function: Callable[..., Any]) -> None:
        name = (function.__module__, function.__qualname__)
        self._about = (*name, numba.__version__, sys.implementation.cache_tag)

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return the form for a signature, or None if it is not kept."""
        target_context.refresh()
        key = self._key(sig, target_context.codegen())
        name = _name(key)
        content = SHELF.get(name)
        if content is None:
            return None
        try:
            kept, form = pickle.loads(content)
            return _FORM._rebuild(target_context, *form) if kept == key else None
        except Exception:  # of a Numba that was changed without a new version
            SHELF.drop(name)
            return None

    def save_overload(self, sig: Any, cres: Any) -> None:
        """Keep a form, unless it holds addresses of this process."""
        if cres.lifted or cres.library.has_dynamic_globals:
            return
        key = self._key(sig, cres.codegen)
        SHELF.put(_name(key), _NUMBA.dumps((key, cres._reduce())))

    def _key(self, sig: Any, codegen: Any) -> str:
        assert f"default={ROOM}" in str(sig), "a call must leave `ROOM` to its default"
        return repr((*self._about, str(sig), codegen.magic_tuple()))


def _name(key: str) -> str:
    return hashlib.sha256(key.encode()).hexdigest()[:32]


_P = ParamSpec("_P")
_R = TypeVar("_R")

_FILES = sorted(Path(__file__).parent.glob("*.py"))

ROOM = zlib.crc32(b"".join(file.read_bytes() for file in _FILES))
"""Checksum of the source files of this package."""


_INNER = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
"""Of functions that Python never calls: to unpack a plan would be most of a small one."""


def _compile(function: Callable[..., Any], **options: Any) -> Callable[..., Any]:
    # the error model of NumPy: no test for a zero divisor in the loops, so that they vectorise
    common: dict[str, Any] = {"nogil": True, "error_model": "numpy"}
    return cast(Callable[..., Any], numba.njit(**common, **options)(function))


def inlined(function: Callable[_P, _R]) -> Callable[_P, _R]:
    """Inline a function into each of its callers, which pays if it works on few cells."""
    return cast(Callable[_P, _R], _compile(function, forceinline=True, **_INNER))


def merged(function: Callable[_P, _R]) -> Callable[_P, _R]:
    """Inline a function at source level, which pays if it is short or has only one caller.

    Every separately compiled function is compiled together with all its callees.
    """
    return cast(Callable[_P, _R], _compile(function, inline="always"))


def compiled(function: Callable[_P, _R]) -> Callable[_P, _R]:
    """Compile a function together with its callers, even with those that are inlined."""
    return cast(Callable[_P, _R], _compile(function, forceinline=False, **_INNER))


def compiled_parallel(function: Callable[_P, _R]) -> Callable[_P, _R]:
    """Compile a function whose `numba.prange` loops run on all cores."""
    return cast(Callable[_P, _R], _compile(function, forceinline=False, parallel=True, **_INNER))


def kept(function: Callable[_P, _R]) -> Callable[_P, _R]:
    """Compile a function on its first call and cache it: its last default is `ROOM`."""
    assert (function.__defaults__ or (None,))[-1] == ROOM
    form: Any = _compile(function)
    form._cache = KeptForms(function)
    return cast(Callable[_P, _R], form)


def cores() -> int:
    """Return the number of cores that compiled functions may use; asking starts their threads."""
    note_threads()
    return int(numba.get_num_threads())


def most_cores() -> int:
    """Return the number of cores for threads of Python; asking starts none."""
    most: Any = vars(config)["NUMBA_NUM_THREADS"]
    return int(most)
