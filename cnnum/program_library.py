"""The programs of the library by name: each is a module under `cnnum.templates`."""

from functools import cache
from importlib import import_module, resources

from cnnum.errors import name_error
from cnnum.programs import Program

_ROOMS = ("tactile", "pictures")


@cache
def _programs(room: str) -> dict[str, Program]:
    """Return every program that a module of a room holds under its own name."""
    package = f"cnnum.templates.{room}"
    modules = (f.name[:-3] for f in resources.files(package).iterdir() if f.name.endswith(".py"))
    found = {name: getattr(import_module(f"{package}.{name}"), name, None) for name in modules}
    return {name: p for name, p in sorted(found.items()) if isinstance(p, Program)}


def program_names(room: str | None = None) -> tuple[str, ...]:
    """Return the names of the programs in the library.

    Parameters
    ----------
    room : "tactile" or "pictures", optional
        Those for three-axial frames, or those for pictures; all unless given.
    """
    rooms = _ROOMS if room is None else (room,)
    return tuple(name for each in rooms for name in _programs(each))


def get_program(name: str) -> Program:
    """Return the program of that name.

    Raises
    ------
    UnknownNameError
        If there is none.
    """
    programs = {name: program for room in _ROOMS for name, program in _programs(room).items()}
    if name not in programs:
        raise name_error("program", name, programs)
    return programs[name]
