"""Expressions that a kernel takes in: arithmetic on known words, which can do nothing else.

They come as text, from records such as output functions, and go into the text of kernels.
"""

import re
from collections.abc import Iterable

from cnnum.errors import CnnumError

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
    """Refuse a text that is not one expression of some variables.

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
    """Return the words of an expression, None where it is none."""
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
