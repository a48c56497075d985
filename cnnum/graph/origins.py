"""Where an operation of a program comes from: the function and the line that asked for it."""

import inspect
from types import FrameType

_OURS = ("cnnum.graph.", "cnnum.programs.", "cnnum.engine", "cnnum.runs.")
"""Modules of the language itself: the line that is wanted lies outside of them."""

_INNER = ("<lambda>", "<listcomp>", "<genexpr>", "<dictcomp>")


def origin_here() -> str:
    """Return the program's line that asks for an operation now, as "function module:line"."""
    frame: FrameType | None = inspect.currentframe()
    while frame is not None:
        module = str(frame.f_globals.get("__name__", ""))
        if not f"{module}.".startswith(_OURS) and not module.startswith(("cnnum.engine", "numpy")):
            name = frame.f_code.co_name
            return f"{name if name not in _INNER else 'inner'} {module}:{frame.f_lineno}"
        frame = frame.f_back
    return ""
