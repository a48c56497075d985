"""Checks of what users give: names, expressions, single values, and whether there is memory.

Names that users give, and expressions that kernels take in, checked where they come in.

Names that users give: one line of letters, digits and a few signs, checked where they come in.

A name goes on into listings, plans, pages and error messages. So it may not end a line or a
comment.

Expressions that a kernel takes in: arithmetic on known words, which can do nothing else.

They come as text, from records such as output functions, and go into the text of kernels.
"""

import math
import os
import re
from collections.abc import Iterable
from numbers import Real
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeGuard, cast

from cnnum.errors import CnnumError, SizeError

if TYPE_CHECKING:  # NumPy, which `cnnum --help` does without
    from cnnum.arrays import Shape

# C0 but for the tab and the line feed, DEL, C1, and the controls of direction
_CONTROLS = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u202a-\u202e\u2066-\u2069]")

SIGNS = " _-.,:+=()/"
"""Signs that a name may hold, next to letters and digits."""

LONGEST = 80
"""Signs of the longest name."""


def checked_name(what: str, name: object, error: type[CnnumError]) -> str:
    """Return a name that is one line of letters, digits and a few signs.

    Parameters
    ----------
    what : str
        Kind of the named thing: "a template", "a memory"…
    name : object
        The user's value.
    error : type
        Raised where it is no such name.

    Raises
    ------
    CnnumError
        The leaf that was given.
    """
    if not isinstance(name, str) or not 0 < len(name) <= LONGEST or tidied(name) != name:
        raise error(
            f"The name of {what} must be 1 to {LONGEST} letters, digits and signs of '{SIGNS}', "
            f"got {name!r:.60}."
        )
    return name


def shown(value: object) -> str:
    """Return a value as a sentence shows it: its first 60 signs, however large it is."""
    try:
        return f"{value!r:.60}"
    except ValueError:  # Python writes no whole number of more than some thousands of digits
        return "a whole number of thousands of digits"


def visible(text: str) -> str:
    """Return a text as a terminal may show it: nothing in it moves, hides or turns other text.

    Names in files can hold escape sequences of terminals, and signs that turn the direction of
    reading. Each of their control characters becomes U+FFFD; ends of lines and tabs stay.
    """
    return _CONTROLS.sub("\ufffd", text)


def visible_json(text: str) -> str:
    """Return JSON text whose control characters are written as escapes of JSON."""
    return _CONTROLS.sub(lambda match: f"\\u{ord(match[0]):04x}", text)


def tidied(text: str) -> str:
    """Return a text with '_' in place of all that a name may not hold."""
    return "".join(sign if sign.isalnum() or sign in SIGNS else "_" for sign in text)


WORDS = frozenset(
    [
        *("ONE", "ZERO", "HUGE", "R", "PICK"),
        *("clamp", "exp", "fabs", "fmax", "fmin", "log", "pow", "sqrt", "tanh"),
    ]
)
"""Words of every kernel: numbers, the choice between two, and functions."""

_TOKEN = re.compile(
    r" +|(?P<word>[A-Za-z_][A-Za-z_0-9]*)"
    r"|[0-9]+(\.[0-9]*)?([eE][+-]?[0-9]+)?f?"
    r"|[<>=!]=|[-+*/<>(),]"
)
# comments begin, and variables change
_REFUSED = ("//", "/*", "++", "--")


def check_expression(
    what: str, text: object, variables: Iterable[str], error: type[CnnumError]
) -> None:
    """Check that a text is a single expression of given variables.

    Parameters
    ----------
    what : str
        Name of the expression, for the sentence of the error.
    text : object
        The user's value.
    variables : iterable of str
        All of them stand in it.
    error : type
        Raised where it is something else.

    Raises
    ------
    CnnumError
        The leaf that was given.
    """
    names = set(variables)
    used = _words(text) if isinstance(text, str) else None
    if used is None or not names <= used <= names | WORDS:
        raise error(
            f"{what} must be one expression of {', '.join(sorted(names))}, of numbers, + - * /, "
            f"comparisons and {', '.join(sorted(WORDS))}, got {text!r:.60}."
        )


def _words(text: str) -> set[str] | None:
    """Return the words of an expression, None if it is none."""
    if any(sign in text for sign in _REFUSED):
        return None
    words: set[str] = set()
    at = depth = 0
    while at < len(text):
        token = _TOKEN.match(text, at)
        if token is None:
            return None
        depth += (token[0] == "(") - (token[0] == ")")
        if depth < 0 or (token[0] == "," and depth == 0):
            return None
        if token["word"]:
            words.add(token["word"])
        at = token.end()
    return words if depth == 0 else None


def host_bytes() -> int | None:
    """Return the memory of this machine, None if the system does not say."""
    try:
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, ValueError, OSError):  # Windows has no sysconf
        return None


def refuse_on_host(what: str, shape: "Shape", bytes_a_cell: int) -> None:
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
            f"{_gigabytes(room)} of {owner}: use fewer cells, or fewer frames at a time."
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
