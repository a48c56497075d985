"""Frames like those of a scene, on which whole numbers measure the range of every value."""

import math
from itertools import islice

import numpy as np

from cnnum.arrays import Floats
from cnnum.drivers.driver import Driver
from cnnum.drivers.geometry import Grid, Reordered
from cnnum.drivers.recording_file import MEMORY
from cnnum.drivers.registry import DRIVERS, open_driver
from cnnum.embedded.formats import is_integer
from cnnum.errors import SceneError
from cnnum.frame import BAD, Quality
from cnnum.scenes.conversion import Conversion, DeadCells
from cnnum.scenes.saturation import Mask, Saturation, marked
from cnnum.scenes.scene_file import SceneSpec

MOST = 2000
"""Frames that are measured: with three axes of 8×8 taxels some seconds of work."""

PASSED = BAD | Quality.REPEATED
"""Flags of frames that a scene passes over: a saturated one, or one after a gap, counts."""

PLAYED_AGAIN = frozenset(DRIVERS) - {"serial"}
"""Drivers whose frames are the same when they are opened again."""


def like_frames(
    spec: SceneSpec,
    precision: str,
    driver: Driver,
    conversion: Conversion,
    dead: DeadCells | None,
    at_ends: Saturation | None = None,
    grid: Grid | None = None,
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
    at_ends : Saturation or None
        Where the program reads which taxels stand at an end of their range, in one more channel:
        what marks them.
    grid : Grid or None
        Grid for taxels at known positions.

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
            f"Scene '{spec.name}': 'engine.ranges' is for whole numbers, but the engine uses "
            f"{precision}: leave it out, or use precision 'q15'."
        )
    own = spec.ranges is None and spec.driver == MEMORY
    if spec.ranges is None and spec.driver not in PLAYED_AGAIN and not own:
        raise SceneError(
            f"Scene '{spec.name}': precision '{precision}' needs typical frames: add a table "
            "[engine.ranges] with the driver and the path of a recording of this array."
        )
    options = dict(spec.driver_options if spec.ranges is None else spec.ranges)
    name = spec.driver if spec.ranges is None else str(options.pop("driver", ""))
    with driver if own else open_driver(name, options, base=spec.base) as opened:
        source = Reordered(opened, spec.reading) if spec.reading and not own else opened
        if (source.shape, source.channels) != (driver.shape, driver.channels):
            raise SceneError(
                f"Scene '{spec.name}': 'engine.ranges' has frames of {source.shape[0]}×"
                f"{source.shape[1]} taxels with {', '.join(source.channels)}, expected the array's "
                f"{driver.shape[0]}×{driver.shape[1]} with {', '.join(driver.channels)}."
            )
        read = conversion.reader(conversion.channels)
        values, marks = list[Floats](), list[Mask | None]()
        for frame in islice(
            (frame_values for frame_values in source.frames() if not frame_values.quality & PASSED),
            MOST,
        ):
            whole = frame if dead is None else dead.without(frame)
            frame_values = read(whole) if dead is None else dead.filled(read(whole))
            values.append(frame_values if grid is None else grid.maps(frame_values))
            seen = None if at_ends is None else at_ends.look(whole, math.inf)
            if at_ends is not None:
                at_ends.take(seen)
            mask = None if seen is None else seen.found
            marks.append(mask if grid is None else grid.marks(mask))
    if not values:
        raise SceneError(f"Scene '{spec.name}': 'engine.ranges' has no good frame to measure.")
    if at_ends is None:
        return np.stack(values)
    # the last frame comes once more with all marks set: they are 0 or 1 in any recording
    values.append(values[-1])
    marks.append(np.ones(driver.shape if grid is None else grid.shape, dtype=np.bool_))
    return np.stack([marked(value, at_end) for value, at_end in zip(values, marks, strict=True)])
