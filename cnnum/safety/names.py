"""Names that users give: one line of letters, digits and a few signs, checked where they come in.

A name goes on into listings, plans, pages and error messages. So it may not end a line or a
comment.
"""

import re

from cnnum.errors import CnnumError

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
    return _CONTROLS.sub(lambda found: f"\\u{ord(found[0]):04x}", text)


def tidied(text: str) -> str:
    """Return a text with '_' in place of all that a name may not hold."""
    return "".join(sign if sign.isalnum() or sign in SIGNS else "_" for sign in text)
