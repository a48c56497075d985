"""The drivers by name. A new array is one new file and one line here, or "module:Options".

Drivers of other packages and of files next to a scene, by "module:Options" or an entry point.

To import a module runs its code. What calls this has asked the user first: a name that stands in a
scene file comes here only if the file is trusted (`cnnum.scenes.scene_file.read_scene`).
"""

import sys
from collections.abc import Mapping
from dataclasses import is_dataclass
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from importlib.util import find_spec, module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType
from typing import Protocol, cast

from cnnum.drivers.driver import Driver
from cnnum.drivers.options import read_options
from cnnum.errors import SceneError, name_error
from cnnum.safety.values import shown

GROUP = "cnnum.drivers"
"""Entry points of other packages: name of a driver to the record of its options."""


def offered() -> Mapping[str, EntryPoint]:
    """Return the drivers that installed packages offer, by name."""
    return {point.name: point for point in entry_points(group=GROUP)}


def outside_record(name: str, base: Path) -> type | None:
    """Return the record of options that a name stands for; None where it stands for none.

    Parameters
    ----------
    name : str
        Name of an entry point, or "module:Options". A module that cannot be imported by its name is
        looked for in `base`.
    base : Path
        Folder of the scene file.

    Raises
    ------
    SceneError
        If the module or the record is not there, or the record is no dataclass with `open`.
    """
    point = offered().get(name)
    place = point.value if point is not None else name
    module, colon, record = place.partition(":")
    if not colon:
        return None
    # what is installed is never looked for beside a scene
    result = getattr(module_of("driver", module, base if point is None else None), record, None)
    if not (isinstance(result, type) and is_dataclass(result) and hasattr(result, "open")):
        raise SceneError(
            f"The driver {shown(name)}: expected a dataclass '{record}' of options with a method "
            f"'open' in the module '{module}', as the page 'Use an array' shows."
        )
    return result


def module_of(what: str, name: str, base: Path | None) -> ModuleType:
    """Return a module by its name, or of a file in a folder: its code is run.

    Parameters
    ----------
    what : str
        "driver" or "program": what the module is wanted for.
    name : str
    base : Path or None
        Folder in which a module that cannot be imported by its name is looked for.

    Raises
    ------
    SceneError
        If there is no such name.
    """
    parts = name.split(".")
    if not all(part.isidentifier() for part in parts):
        raise SceneError(f"The {what} module {shown(name)} is not a valid module name.")
    try:
        known = name in sys.modules or find_spec(name) is not None
    except ModuleNotFoundError:
        known = False
    near = None if base is None else base.joinpath(*parts).with_suffix(".py")
    if known or near is None or not near.is_file():
        return _imported(what, name, near)
    spec = spec_from_file_location(name, near)
    assert spec is not None
    assert spec.loader is not None
    module = sys.modules[name] = module_from_spec(spec)  # dataclasses look their module up there
    try:
        spec.loader.exec_module(module)
    except BaseException:
        del sys.modules[name]
        raise
    return module


def _imported(what: str, name: str, near: Path | None) -> ModuleType:
    try:
        return import_module(name)
    except ModuleNotFoundError as error:
        remedy = "reinstall it" if near is None else f"install it, or put it at '{near}'"
        raise SceneError(
            f"The {what} module '{name}' cannot be imported ({error}): {remedy}."
        ) from None


DRIVERS: Mapping[str, str] = {
    "simulated": "cnnum.drivers.simulated.array:SimulatedOptions",
    "serial": "cnnum.drivers.serial_array:SerialOptions",
    "uskin-csv": "cnnum.drivers.uskin_csv:UskinCsvOptions",
    "mcap": "cnnum.drivers.recording_file:McapOptions",
    "npz": "cnnum.drivers.npz_file:NpzOptions",
    "lerobot": "cnnum.drivers.recording_file:LerobotOptions",
    "file": "cnnum.drivers.own_data.driver:DataFileOptions",
}
"""Name in a scene file to the record of its options, imported when it is asked for."""


class DriverOptions(Protocol):
    """Options of a driver, checked on creation, which can open the driver."""

    def open(self) -> Driver:
        """Open the source: a port, a file, a simulation."""
        ...


def driver_names() -> tuple[str, ...]:
    """Return the names of all drivers, those of other packages last."""
    return (*DRIVERS, *(name for name in offered() if name not in DRIVERS))


def driver_options(
    name: str, options: Mapping[str, object], *, base: Path | None = None
) -> DriverOptions:
    """Return a driver's checked options without opening anything.

    Raises
    ------
    UnknownNameError
        If there is no driver of that name.
    SceneError
        If an option is unknown, missing, of the wrong type or out of range.
    """
    folder = base if base is not None else Path()
    kind = _record(name, folder)
    try:
        return read_options(kind, options, folder)
    except SceneError as error:
        raise SceneError(f"Driver '{name}': {_lower_first(str(error))}") from None


def _record(name: str, base: Path) -> type[DriverOptions]:
    """Return the record of a driver's options."""
    if name in DRIVERS:
        module, record = DRIVERS[name].split(":")
        return cast(type[DriverOptions], getattr(import_module(module), record))

    result = outside_record(name, base)
    if result is None:
        raise name_error("driver", name, driver_names())
    return cast(type[DriverOptions], result)


def is_driver(name: str) -> bool:
    """Return whether a name is that of a driver, and not of a scene or a file."""
    module, colon, record = name.partition(":")
    own = bool(colon) and record.isidentifier() and module.replace(".", "_").isidentifier()
    return own or name in driver_names()


def open_driver(
    name: str, options: Mapping[str, object] | None = None, *, base: Path | None = None
) -> Driver:
    """Open a driver by its name.

    Parameters
    ----------
    name : str
        One of `driver_names()`, or "module:Options" for a record of your own.
    options : mapping of str to object
        Options as in the table of a scene; the record of options of each driver documents them.
    base : Path, optional
        Folder for relative paths. The default is the working folder.

    Raises
    ------
    UnknownNameError, SceneError
        As for `driver_options`.
    CnnumError
        If the source cannot be opened: PortError, RecordingError or CodecError.
    """
    return driver_options(name, options or {}, base=base).open()


def _lower_first(sentence: str) -> str:
    return sentence[:1].lower() + sentence[1:]
