"""Names that users give: one line of letters, digits and a few signs, checked where they come in.

A name goes on into listings, plans, pages and error messages. So it may not end a line or a
comment.
"""

from cnnum.errors import CnnumError

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


def tidied(text: str) -> str:
    """Return a text with '_' in place of all that a name may not hold."""
    return "".join(sign if sign.isalnum() or sign in SIGNS else "_" for sign in text)
