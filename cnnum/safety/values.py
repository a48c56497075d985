"""Checks of single values, and of whether there is room in memory."""

import math
import os
from numbers import Real
from os import PathLike
from pathlib import Path
from typing import Any, TypeGuard, cast

from cnnum.arrays import Shape
from cnnum.errors import CnnumError, SizeError


def host_bytes() -> int | None:
    """Return the memory of this machine, None where the system does not say."""
    try:
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, ValueError, OSError):  # Windows has no sysconf
        return None


def refuse_on_host(what: str, shape: Shape, bytes_a_cell: int) -> None:
    """Raise if something of an array takes more memory than this machine has.

    Parameters
    ----------
    what : str
        Owner of the memory.
    shape : (rows, cols)
    bytes_a_cell : int

    Raises
    ------
    SizeError
        With the size that is needed.
    """
    room = host_bytes()
    if room is not None:
        of = f"{what} of {shape[0]}×{shape[1]} cells"
        refuse_beyond(of, shape[0] * shape[1] * bytes_a_cell, room, "this machine")


def refuse_beyond(what: str, needed: int, room: int, owner: str) -> None:
    """Raise if something takes more bytes than its owner has room for.

    Raises
    ------
    SizeError
        With the size that is needed.
    """
    if needed > room:
        raise SizeError(
            f"{what} needs at least {_gigabytes(needed)} of memory, more than the "
            f"{_gigabytes(room)} of {owner}: take fewer cells, or fewer frames at a time."
        )


def _gigabytes(count: int) -> str:
    return f"{count / 1e9:,.3g} GB" if count < 1e12 else f"{count / 1e9:,.0f} GB"


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
