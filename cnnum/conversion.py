"""From what a driver reads to what a program takes: only the channels that something reads."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np

from cnnum.arrays import Floats
from cnnum.errors import SceneError
from cnnum.frame import FORCE_AXES, Frame
from cnnum.tactile.taxel import SIDES, Calibration


class Conversion(Protocol):
    """Turns a driver's frame into channels of a program."""

    @property
    def channels(self) -> tuple[str, ...]:
        """What it can give."""
        ...

    def convert(self, frame: Frame, wanted: Sequence[str]) -> Floats:
        """Return (rows, cols, wanted) of a frame."""
        ...


@dataclass(frozen=True, slots=True)
class AsRead:
    """The driver's channels as they are."""

    channels: tuple[str, ...]

    def convert(self, frame: Frame, wanted: Sequence[str]) -> Floats:
        """Return the wanted channels of the frame."""
        if tuple(wanted) == self.channels:
            return frame.values
        return frame.values[..., [self.channels.index(name) for name in wanted]]


@dataclass(frozen=True, slots=True)
class ByCalibration:
    """Four bridge voltages become the strain at every taxel (4.15)."""

    calibration: Calibration

    @property
    def channels(self) -> tuple[str, ...]:
        """The three rows of the strain tensor that a taxel sees."""
        return FORCE_AXES

    def convert(self, frame: Frame, wanted: Sequence[str]) -> Floats:
        """Return the wanted strains."""
        if not wanted:
            return np.empty((*frame.shape, 0))
        return self.calibration.to_strain(frame.values, tuple(wanted), time=frame.time)


def conversion_for(
    use: str, channels: tuple[str, ...], known: Calibration | None, base: Path
) -> Conversion:
    """Return the conversion that a scene asks for.

    Parameters
    ----------
    use : str
        "driver", "none", or the path of a calibration file.
    channels : tuple of str
        The driver's.
    known : Calibration or None
        What the driver knows of its array.
    base : Path
        Folder that a relative path starts from.

    Raises
    ------
    SceneError
        If the array has bridges and nothing says how to read them.
    CalibrationError
        If the file can not be read.
    """
    bridges = channels == SIDES
    if use not in ("driver", "none"):
        return ByCalibration(Calibration.load(base / use))
    if use == "driver" and bridges and known is not None:
        return ByCalibration(known)
    if use == "driver" and bridges:
        raise SceneError(
            "The array gives bridge voltages: name a calibration with 'calibration.file'."
        )
    return AsRead(channels)
