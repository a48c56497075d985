"""Where an operation of a program comes from: the function and the line that asked for it."""

import inspect
from types import FrameType

_OURS = ("cnnum.graph.", "cnnum.programs.", "cnnum.engine", "cnnum.runs.")
"""Modules of the language itself: the line that is wanted lies outside of them."""

_INNER = frozenset(("<locals>", "<lambda>", "<listcomp>", "<genexpr>", "<dictcomp>", "<setcomp>"))
"""Parts of a name that Python adds: the wanted name is that of the function around them."""


def origin_here() -> str:
    """Return the program's line that asks for an operation now, as "function module:line"."""
    frame: FrameType | None = inspect.currentframe()
    while frame is not None:
        module = str(frame.f_globals.get("__name__", ""))
        if not f"{module}.".startswith(_OURS) and not module.startswith(("cnnum.engine", "numpy")):
            parts = frame.f_code.co_qualname.split(".")
            name = ".".join(part for part in parts if part not in _INNER)
            return f"{name or 'inner'} {module}:{frame.f_lineno}"
        frame = frame.f_back
    return ""
