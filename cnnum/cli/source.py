"""The array that a command reads: a driver by its name, or that of a scene."""

import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from cnnum.errors import UnknownNameError
from cnnum.safety.names import shown
from cnnum.safety.reading import names_something

if TYPE_CHECKING:
    from cnnum.drivers.driver import Driver
    from cnnum.frame import Frame


def open_source(source: str, settings: Mapping[str, object], *, trust: bool = False) -> "Driver":
    """Open a driver by its name, or the array of a scene.

    Parameters
    ----------
    source : str
        Name of a driver or a scene, or a scene's TOML file.
    settings : mapping of str to object
        Options of the driver, over those of the scene.
    trust : bool
        Whether a driver that a scene file names as "module:Options" may be imported.

    Raises
    ------
    UnknownNameError
        If it is none of these.
    CnnumError
        From opening the source.
    """
    from cnnum.drivers.registry import driver_names, is_driver, open_driver
    from cnnum.scenes.scene_file import read_scene, scene_names

    if is_driver(source):
        return open_driver(source, settings)
    if source not in scene_names() and not names_something(Path(source)):
        raise UnknownNameError(
            f"There is no array {shown(source)}: expected one of the drivers "
            f"{', '.join(driver_names())}, one of the scenes {', '.join(scene_names())}, or a "
            "scene's TOML file."
        )
    changes = {f"array.{key}": value for key, value in settings.items()}
    spec = read_scene(source, changes=changes, trust=trust)
    return open_driver(spec.driver, spec.driver_options, base=spec.base)


def scene_text(source: str) -> str:
    """Return the text of a scene; empty where the source is a driver, or cannot be read."""
    from cnnum.drivers.registry import is_driver

    if is_driver(source):
        return ""
    from cnnum.scenes.scene_file import text_of

    return text_of(source)


def limited(driver: "Driver", seconds: float | None, frames: int | None) -> "Iterator[Frame]":
    """Yield frames up to a count, or a time by the host's clock."""
    begin = time.monotonic()
    for count, frame in enumerate(driver.frames(), start=1):
        yield frame
        late = seconds is not None and time.monotonic() - begin >= seconds
        if late or (frames is not None and count >= frames):
            return
