"""Recordings as `cnnum replay` plays them."""

import warnings
from pathlib import Path

from cnnum.drivers import open_driver
from cnnum.errors import CodecError, RecordingWarning
from cnnum.frame import Frame


def frames_in(path: Path) -> list[Frame]:
    """Return the frames that `cnnum replay` would play; none where no whole chunk is there."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RecordingWarning)
            with open_driver(path.suffix[1:], {"path": str(path)}) as driver:
                return list(driver.frames())
    except CodecError:
        return []
