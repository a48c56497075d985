"""Whether there is room in memory: work that never fits is refused before it begins."""

import os

from cnnum.arrays import Shape
from cnnum.errors import SizeError


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
