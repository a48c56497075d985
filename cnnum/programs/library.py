"""The programs of the library by name: each is a module under `cnnum.templates`."""

from functools import cache
from importlib import import_module, resources
from typing import cast

from cnnum.errors import name_error
from cnnum.programs import Program

_ROOMS = ("tactile", "tactile.contact_mechanics", "pictures")


def _modules(room: str) -> tuple[str, ...]:
    """Return the names of a room's modules."""
    files = resources.files(f"cnnum.templates.{room}").iterdir()
    return tuple(sorted(file.name[:-3] for file in files if file.name.endswith(".py")))


def _program(room: str, name: str) -> Program | None:
    """Return the program that a module of a room holds under its own name."""
    found = getattr(import_module(f"cnnum.templates.{room}.{name}"), name, None)
    return found if isinstance(found, Program) else None


@cache
def _programs(room: str) -> dict[str, Program]:
    """Return every program of a room."""
    found = {name: _program(room, name) for name in _modules(room)}
    return {name: program for name, program in found.items() if program is not None}


def program_names(room: str | None = None) -> tuple[str, ...]:
    """Return the names of the programs in the library.

    Parameters
    ----------
    room : "tactile" or "pictures", optional
        Those for three-axial frames, or those for pictures; all unless given.

    Raises
    ------
    UnknownNameError
        If there is no such room.
    """
    if not (room is None or (isinstance(cast(object, room), str) and room in _ROOMS)):
        raise name_error("room of programs", room, _ROOMS)
    rooms = _ROOMS if room is None else (room,)
    return tuple(name for each in rooms for name in _programs(each))


def get_program(name: str) -> Program:
    """Return the program of that name.

    Raises
    ------
    UnknownNameError
        If there is none.
    """
    for room in _ROOMS if isinstance(cast(object, name), str) else ():
        if name in _modules(room) and (program := _program(room, name)) is not None:
            return program
    raise name_error("program", name, program_names())
