"""The drivers by name. A new array is one new file and one line here."""

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
}
"""Name in a scene file to the record of its options, imported when it is asked for."""


class DriverOptions(Protocol):
    """A frozen record that has checked itself and can open its driver."""

    def open(self) -> Driver:
        """Open the source: a port, a file, a simulation."""
        ...


def driver_names() -> tuple[str, ...]:
    """Return the names that a scene's driver can have."""
    return tuple(DRIVERS)


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
    if name not in DRIVERS:
        raise name_error("driver", name, DRIVERS)
    module, record = DRIVERS[name].split(":")
    kind = cast(type[DriverOptions], getattr(import_module(module), record))
    try:
        return read_options(kind, options, base if base is not None else Path())
    except SceneError as error:
        raise SceneError(f"Driver '{name}': {_lower_first(str(error))}") from None


def open_driver(
    name: str, options: Mapping[str, object] | None = None, *, base: Path | None = None
) -> Driver:
    """Open a driver by its name.

    Parameters
    ----------
    name : str
        One of `driver_names()`.
    options : mapping of str to object
        As in a scene's table; each driver's record of options says what there is.
    base : Path, optional
        Folder that relative paths start from; the working folder unless given.

    Raises
    ------
    UnknownNameError
        If there is no driver of that name.
    SceneError
        If an option is unknown, missing, of the wrong type or out of range.
    CnnumError
        What opening brings: PortError, RecordingError, CodecError.
    """
    return driver_options(name, options or {}, base=base).open()


def _lower_first(sentence: str) -> str:
    return sentence[:1].lower() + sentence[1:]
