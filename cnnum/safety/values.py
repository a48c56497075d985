"""Checks of single values: one real number, a record of ours, a path."""

import math
from numbers import Real
from os import PathLike
from pathlib import Path
from typing import Any, TypeGuard, cast

from cnnum.errors import CnnumError


def is_real(value: object) -> TypeGuard[float]:
    """Return whether a value is one real, finite number that float64 holds.

    An array of no axes is none, and neither is a whole number of 400 digits.
    """
    if not isinstance(value, Real):
        return False
    try:
        return math.isfinite(float(value))
    except OverflowError:
        return False


def expect(name: str, value: Any, kind: type, error: type[CnnumError]) -> None:
    """Raise an error if a value is not of a kind.

    Parameters
    ----------
    name : str
        Name of the argument.
    value : object
    kind : type
    error : type of CnnumError
        Its error.
    """
    if not isinstance(value, kind):
        raise error(f"'{name}' must be of the type {kind.__name__}, got {type(value).__name__}.")


def as_path(value: object, error: type[CnnumError]) -> Path:
    """Return the path that a text or a path stands for, or raise an error.

    Parameters
    ----------
    value : object
    error : type of CnnumError
        Its error.
    """
    if not isinstance(value, str | PathLike):
        raise error(f"A file is named by a text or a path, got {type(value).__name__}.")
    return Path(cast("str | PathLike[str]", value))
