"""The programs of the library by name: each is a module under `cnnum.templates`."""

from functools import cache
from importlib import import_module, resources

from cnnum.errors import name_error
from cnnum.programs import Program

_ROOMS = ("cnnum.templates.tactile", "cnnum.templates.pictures")


@cache
def _programs() -> dict[str, Program]:
    """Return every program that a module of the rooms holds under its own name."""
    found: dict[str, Program] = {}
    for room in _ROOMS:
        modules = (f.name[:-3] for f in resources.files(room).iterdir() if f.name.endswith(".py"))
        for name in modules:
            program = getattr(import_module(f"{room}.{name}"), name, None)
            if isinstance(program, Program):
                found[name] = program
    return dict(sorted(found.items()))


def program_names() -> tuple[str, ...]:
    """Return the names of the programs in the library."""
    return tuple(_programs())


def get_program(name: str) -> Program:
    """Return the program of that name.

    Raises
    ------
    UnknownNameError
        If there is none.
    """
    programs = _programs()
    if name not in programs:
        raise name_error("program", name, programs)
    return programs[name]
