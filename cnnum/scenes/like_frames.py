"""Frames like those of a scene, on which whole numbers measure the range of every value."""

from itertools import islice

import numpy as np

from cnnum.arrays import Floats
from cnnum.drivers.driver import Driver
from cnnum.drivers.registry import DRIVERS, open_driver
from cnnum.embedded.formats import is_integer
from cnnum.errors import SceneError
from cnnum.scenes.conversion import Conversion
from cnnum.scenes.dead_cells import DeadCells
from cnnum.scenes.scene_file import SceneSpec

MOST = 2000
"""Frames that are measured: with three axes of 8×8 taxels some seconds of work."""

PLAYED_AGAIN = frozenset(DRIVERS) - {"serial"}
"""Drivers whose frames are the same when they are opened again."""


def like_frames(
    spec: SceneSpec,
    precision: str,
    driver: Driver,
    conversion: Conversion,
    dead: DeadCells | None,
) -> Floats | None:
    """Return the frames that `engine.ranges` names, or the scene's own; None for real numbers.

    Parameters
    ----------
    spec : SceneSpec
    precision : str
        The engine's.
    driver : Driver
        The scene's.
    conversion : Conversion
    dead : DeadCells or None
        Taxels that are filled from their neighbours.

    Returns
    -------
    (frames, rows, cols, channels) float, or None

    Raises
    ------
    SceneError
        If the scene names none and its own cannot be played twice, or if they are of another array.
    CnnumError
        Whatever is wrong with the recording.
    """
    if not is_integer(precision):
        if spec.ranges is None:
            return None
        raise SceneError(
            f"Scene '{spec.name}': 'engine.ranges' gives ranges to whole numbers, and the engine "
            f"counts in {precision}: leave it out, or take precision 'q15'."
        )
    if spec.ranges is None and spec.driver not in PLAYED_AGAIN:
        raise SceneError(
            f"Scene '{spec.name}': precision '{precision}' needs frames like those to come: add a "
            "table [engine.ranges] with the driver and the path of a recording of this array."
        )
    options = dict(spec.driver_options if spec.ranges is None else spec.ranges)
    name = spec.driver if spec.ranges is None else str(options.pop("driver", ""))
    with open_driver(name, options, base=spec.base) as source:
        if (source.shape, source.channels) != (driver.shape, driver.channels):
            raise SceneError(
                f"Scene '{spec.name}': 'engine.ranges' has frames of {source.shape[0]}×"
                f"{source.shape[1]} taxels with {', '.join(source.channels)}, expected the array's "
                f"{driver.shape[0]}×{driver.shape[1]} with {', '.join(driver.channels)}."
            )
        read = conversion.reader(conversion.channels)
        good = (frame for frame in source.frames() if not frame.quality)
        whole = (frame if dead is None else dead.without(frame) for frame in islice(good, MOST))
        values = [read(frame) for frame in whole]
    if not values:
        raise SceneError(f"Scene '{spec.name}': 'engine.ranges' has no good frame to measure.")
    return np.stack(values if dead is None else [dead.filled(one) for one in values])
