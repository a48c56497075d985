"""Compiled functions, kept from one process to the next.

Numba's own cache trusts its files: a damaged file of it ends every run, and two processes that
compile at once can mix up their files. Here each compiled form of a function is an entry of the
cache of cnnum. It is found by all that it depends on, and used only if it is whole.
"""

import hashlib
import pickle
import sys
from collections.abc import Callable
from typing import Any

import numba
from numba.core import serialize
from numba.core.caching import NullCache
from numba.core.compiler import CompileResult

from cnnum.engines.cache import Shelf

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
        """Return the form for a signature; None where it is not kept."""
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
        return repr((*self._about, str(sig), codegen.magic_tuple()))


def _name(key: str) -> str:
    return hashlib.sha256(key.encode()).hexdigest()[:32]
