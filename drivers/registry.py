"""The drivers by name. A new array is one new file and one line here, or "module:Options"."""

from collections.abc import Mapping
from importlib import import_module
from pathlib import Path
from typing import Protocol, cast

from cnnum.drivers.driver import Driver
from cnnum.drivers.options import read_options
from cnnum.errors import SceneError, name_error

DRIVERS: Mapping[str, str] = {
    "simulated": "cnnum.drivers.simulated.array:SimulatedOptions",
    "serial": "cnnum.drivers.serial_array:SerialOptions",
    "uskin-csv": "cnnum.drivers.uskin_csv:UskinCsvOptions",
    "mcap": "cnnum.drivers.mcap_file:McapOptions",
    "npz": "cnnum.drivers.npz_file:NpzOptions",
    "file": "cnnum.drivers.own_data.driver:DataFileOptions",
}
"""Name in a scene file to the record of its options, imported when it is asked for."""


class DriverOptions(Protocol):
    """A frozen record that has checked itself and can open its driver."""

    def open(self) -> Driver:
        """Open the source: a port, a file, a simulation."""
        ...


def driver_names() -> tuple[str, ...]:
    """Return the names that a scene's driver can have, those of other packages last."""
    from cnnum.drivers.outside import offered

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
    from cnnum.drivers.outside import outside_record

    found = outside_record(name, base)
    if found is None:
        raise name_error("driver", name, driver_names())
    return cast(type[DriverOptions], found)


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
        As in a scene's table; each driver's record of options lists them.
    base : Path, optional
        Folder that relative paths start from; the working folder unless given.

    Raises
    ------
    UnknownNameError, SceneError
        As `driver_options`.
    CnnumError
        Errors of opening: PortError, RecordingError, CodecError.
    """
    return driver_options(name, options or {}, base=base).open()


def _lower_first(sentence: str) -> str:
    return sentence[:1].lower() + sentence[1:]
