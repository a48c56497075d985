"""The registry of engines: those of this package, and those that other packages provide.

An engine's modules are imported only when it is opened.
"""

from collections.abc import Callable, Mapping
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from typing import Any, cast

from cnnum.embedded.formats import is_integer
from cnnum.engines.backend import Backend, EngineRecord
from cnnum.engines.notices import how_to_get_opencl
from cnnum.errors import DeviceError, NoOpenCLError, NotSupportedError, name_error, say_once
from cnnum.safety.values import shown

GROUP = "cnnum.engines"
"""Entry-point group in which other packages register an `EngineRecord` by name."""

PRECISIONS = ("float32", "float64", "q15", "q7")
"""Precisions that messages suggest; other integer formats exist as well."""


def _in(place: str) -> Callable[..., Any]:
    """Return a proxy for the function "module:name", whose module is imported on the first call."""
    module, _, name = place.partition(":")

    def call(*arguments: object) -> Any:
        return getattr(import_module(module), name)(*arguments)

    return call


def _no_opencl(error: ImportError) -> NoOpenCLError:
    return NoOpenCLError(f"PyOpenCL cannot be imported ({error})", how_to_get_opencl())


PACKAGED: Mapping[str, EngineRecord] = {
    record.name: record
    for record in (
        EngineRecord(
            "opencl",
            _in("cnnum.engines.opencl.backend:OpenCLBackend"),
            whole=_in("cnnum.engines.fixed_point.device_frames:opened"),
            devices=True,
            missing=_no_opencl,
            lanes=True,
        ),
        EngineRecord(
            "numba",
            _in("cnnum.engines.numba:NumbaBackend"),
            stands_in=True,
            looks=True,
        ),
        EngineRecord(
            "reference",
            _in("cnnum.engines.reference:ReferenceBackend"),
            precisions=("float64",),
            whole=_in("cnnum.engines.fixed_point:emulated"),
            fuses=False,  # so that it can check those that do
            takes_steps=False,
            implicit=True,
            analogue=_in("cnnum.engines.reference:on_analogue"),
        ),
    )
}
"""In the order in which they are tried if no name is given: engines with devices first."""


def _offered() -> Mapping[str, EntryPoint]:
    """Return the engines that installed packages provide, by name."""
    return {point.name: point for point in entry_points(group=GROUP) if point.name not in PACKAGED}


def backend_names() -> tuple[str, ...]:
    """Return the names of all engines, those of other packages last."""
    return (*PACKAGED, *_offered())


def record_named(name: str) -> EngineRecord:
    """Return the engine of that name.

    Raises
    ------
    UnknownNameError
        If there is no such engine.
    NotSupportedError
        If another package registers something that is not an engine or cannot be imported.
    """
    if not isinstance(cast(object, name), str):
        raise name_error("engine", name, backend_names())
    if name in PACKAGED:
        return PACKAGED[name]
    point = _offered().get(name)
    if point is None:
        raise name_error("engine", name, backend_names())
    try:
        record = point.load()
    except (ImportError, AttributeError) as error:
        raise NotSupportedError(
            f"The engine {shown(name)} is offered as '{point.value}', which cannot be imported "
            f"({error}): reinstall the package that offers it."
        ) from error
    if not isinstance(record, EngineRecord) or record.name != name:
        raise NotSupportedError(
            f"The engine {shown(name)} is offered as '{point.value}': expected a "
            f"cnnum.engines.backend.EngineRecord named {shown(name)}, got {type(record).__name__}."
        )
    return record


def first_that(able: Callable[[EngineRecord], object]) -> EngineRecord:
    """Return the first engine of this package for which `able` is true."""
    return next(record for record in PACKAGED.values() if able(record))


def device_for(name: str, device: str | None) -> str | None:
    """Return the device name if the engine runs on devices, else None."""
    return device if record_named(name).devices else None


def open_backend(name: str | None, device: str | None, precision: str | None) -> Backend:
    """Open an engine by name; the default is "opencl" if a device works, else "numba".

    Raises
    ------
    UnknownNameError
        If there is no such engine or precision.
    DeviceError
        If its device is not available.
    """
    if not (precision is None or isinstance(cast(object, precision), str)):
        raise name_error("precision", precision, PRECISIONS)
    if name is not None:
        return open_record(record_named(name), device, precision)
    try:
        return open_record(first_that(lambda record: record.devices), device, precision)
    except NoOpenCLError as error:
        if device is not None:  # an explicit device has no substitute
            raise
        host = first_that(lambda record: record.stands_in)
        say_once(f"The {host.name} engine runs because {error.reason}; {error.advice}.")
        return open_record(host, None, precision)


def open_record(record: EngineRecord, device: str | None, precision: str | None) -> Backend:
    """Open an engine; raises the errors of `open_backend`."""
    if is_integer(precision):
        from cnnum.engines.fixed_point import fixed_point_backend

        named = str(precision)
        return _tried(record, lambda: fixed_point_backend(record, device, named, _whole_names()))
    if device is not None and not record.devices:
        raise DeviceError(f"The {record.name} engine runs on the host, got device={device!r:.60}.")
    precision = precision or record.precisions[0]
    if precision not in record.precisions:
        raise name_error("precision", precision, record.precisions)
    return _tried(record, lambda: record.open(record, device, precision))


def _whole_names() -> tuple[str, ...]:
    return tuple(record.name for record in PACKAGED.values() if record.whole is not None)


def _tried(record: EngineRecord, make: Callable[[], Backend]) -> Backend:
    try:
        return make()
    except ImportError as error:
        if record.missing is None:
            raise
        raise record.missing(error) from error
