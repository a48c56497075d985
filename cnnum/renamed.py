"""Old names that work for one more version, each with a warning that gives the new one."""

import functools
import warnings
from collections.abc import Callable, Mapping
from typing import Any, ParamSpec, TypeVar

P = ParamSpec("P")
R = TypeVar("R")


def warn_of(old: str, new: str, kind: type[Warning] = DeprecationWarning) -> None:
    """Warn the caller's caller that an old name is used.

    A key of a file is a matter of its user, who is shown a `FutureWarning`; Python hides a
    `DeprecationWarning` from all but the script and the tests that cause it.
    """
    said = f"{old} is deprecated and will be removed in the next version: use {new} instead."
    warnings.warn(said, kind, stacklevel=3)


def renamed(**names: str) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Let a function take its old keywords, old=new, with a warning."""

    def wrap(function: Callable[P, R]) -> Callable[P, R]:
        @functools.wraps(function)
        def call(*args: P.args, **given: P.kwargs) -> R:
            for old in names.keys() & given.keys():
                new, known = names[old], dict[str, Any](given)
                if new in known:
                    raise TypeError(f"{function.__name__}() got both '{old}' and '{new}'.")
                warn_of(f"The argument '{old}' of {function.__name__}()", f"'{new}'")
                known[new] = known.pop(old)
                return call(*args, **known)  # pyright: ignore[reportCallIssue]
            return function(*args, **given)

        return call

    return wrap


def by_new_names(table: Mapping[str, object], names: Mapping[str, str]) -> dict[str, object]:
    """Return a file's table with new names of old keys, and of old words (key=word), and warn."""
    result = dict[str, object]()
    for key, value in table.items():
        word = f"{key}={value}" if isinstance(value, str) else ""
        if word in names:
            warn_of(f"'{value}' of '{key}'", f"'{names[word]}'", FutureWarning)
        if key in names:
            warn_of(f"The key '{key}'", f"'{names[key]}'", FutureWarning)
        result[names.get(key, key)] = names.get(word, value)
    return result
