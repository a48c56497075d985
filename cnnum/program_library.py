"""The tactile programs by name: each is a module of `cnnum.templates.tactile`."""

from importlib import import_module, resources

from cnnum.errors import name_error
from cnnum.programs import Program

_ROOM = "cnnum.templates.tactile"


def program_names() -> tuple[str, ...]:
    """Return the names of the programs in the library."""
    modules = (f.name[:-3] for f in resources.files(_ROOM).iterdir() if f.name.endswith(".py"))
    return tuple(sorted(name for name in modules if not name.startswith("_") and _find(name)))


def get_program(name: str) -> Program:
    """Return the program of that name.

    Raises
    ------
    UnknownNameError
        If there is none.
    """
    names = program_names()
    found = _find(name) if name in names else None
    if found is None:
        raise name_error("program", name, names)
    return found


def _find(name: str) -> Program | None:
    """Return the program that a module holds under its own name, if it holds one."""
    found = getattr(import_module(f"{_ROOM}.{name}"), name, None)
    return found if isinstance(found, Program) else None
