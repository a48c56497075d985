"""The programs of the library by name: each is a module under `cnnum.templates`."""

from functools import cache
from importlib import import_module, resources
from importlib.util import module_from_spec, spec_from_file_location
from os import PathLike
from pathlib import Path
from typing import cast

from cnnum.errors import ProgramError, missing_file, name_error, unreadable
from cnnum.programs import Program
from cnnum.safety.reading import open_regular

_ROOMS = ("tactile", "tactile.contact_mechanics", "pictures")


def _modules(room: str) -> tuple[str, ...]:
    """Return the names of a room's modules."""
    files = resources.files(f"cnnum.templates.{room}").iterdir()
    return tuple(sorted(file.name[:-3] for file in files if file.name.endswith(".py")))


def _program(room: str, name: str) -> Program | None:
    """Return the program that a module of a room holds under its own name."""
    result = getattr(import_module(f"cnnum.templates.{room}.{name}"), name, None)
    return result if isinstance(result, Program) else None


@cache
def _programs(room: str) -> dict[str, Program]:
    """Return every program of a room."""
    result = {name: _program(room, name) for name in _modules(room)}
    return {name: program for name, program in result.items() if program is not None}


def program_names(room: str | None = None) -> tuple[str, ...]:
    """Return the names of the programs in the library.

    Parameters
    ----------
    room : "tactile" or "pictures", optional
        Only programs for three-axial frames, or only those for pictures. The default is all.

    Raises
    ------
    UnknownNameError
        If `room` is unknown.
    """
    if not (room is None or (isinstance(cast(object, room), str) and room in _ROOMS)):
        raise name_error("room of programs", room, _ROOMS)
    rooms = _ROOMS if room is None else (room,)
    return tuple(name for folder in rooms for name in _programs(folder))


def get_program(name: str) -> Program:
    """Return the library's program of that name.

    Raises
    ------
    UnknownNameError
        If the library has no program of that name.
    """
    for room in _ROOMS if isinstance(cast(object, name), str) else ():
        if name in _modules(room) and (program := _program(room, name)) is not None:
            return program
    raise name_error("program", name, program_names())


def load_program(path: str | PathLike[str], name: str | None = None) -> Program:
    """Return a program that a Python file defines. The file is executed.

    Parameters
    ----------
    path : str or Path
        A file that ends in ``.py``.
    name : str, optional
        Name of the program, if the file has several.

    Raises
    ------
    ProgramError
        If the file cannot be read or run, has no program, or has several and none is named.
    UnknownNameError
        If the file has no program of that name.
    """
    file = Path(path)
    try:
        open_regular(file).close()
    except FileNotFoundError:
        raise missing_file(ProgramError, f"There is no file '{file}' of programs.") from None
    except OSError as error:
        raise unreadable(ProgramError, f"'{file}'", error) from None
    spec = spec_from_file_location(file.stem, file)
    if spec is None or spec.loader is None:
        raise ProgramError(f"'{file}' is not a Python file: programs must be in a '.py' file.")
    module = module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
    except Exception as error:
        why = f"{type(error).__name__}: {error}"
        raise ProgramError(f"'{file}' cannot be run: {why}.") from error
    own = {n: value for n, value in vars(module).items() if isinstance(value, Program)}
    if name is not None:
        if name not in own:
            raise name_error(f"program of '{file.name}'", name, own)
        return own[name]
    if len(own) != 1:
        held = f"the programs {', '.join(own)}: name one of them" if own else "no program"
        raise ProgramError(f"'{file}' holds {held}.")
    return next(iter(own.values()))
