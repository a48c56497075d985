"""Drivers of other packages and of files next to a scene, by "module:Options" or an entry point.

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

from cnnum.errors import SceneError
from cnnum.safety.names import shown

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
    found = getattr(module_of("driver", module, base if point is None else None), record, None)
    if not (isinstance(found, type) and is_dataclass(found) and hasattr(found, "open")):
        raise SceneError(
            f"The driver {shown(name)}: expected a dataclass '{record}' of options with a method "
            f"'open' in the module '{module}', as the page 'Use an array' shows."
        )
    return found


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
