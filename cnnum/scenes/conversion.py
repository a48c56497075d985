"""From a driver's values to a program's input: the channels that are read, dead taxels filled."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import count
from operator import attrgetter
from pathlib import Path
from typing import Protocol, cast

import numpy as np
from numpy.typing import NDArray

from cnnum.arrays import Floats, Shape, all_finite, finite
from cnnum.drivers.driver import Driver
from cnnum.errors import CalibrationError, SceneError
from cnnum.frame import FORCE_AXES, Frame
from cnnum.tactile.array_calibration import (
    ArrayCalibration,
    CalibratedReader,
    read_array_calibration,
)
from cnnum.tactile.taxel import SIDES, Calibration

Cell = tuple[int, int]
"""Row and column, from 0."""


class DeadCells:
    """Gives dead taxels the mean of their nearest living neighbours.

    Parameters
    ----------
    cells : sequence of (row, column)
        At least one.
    shape : (rows, cols)
    fills : bool
        Whether they take a value; not where their neighbours are known by their places.

    Raises
    ------
    SceneError
        If a cell lies outside the array, or none is left.
    """

    __slots__ = ("_cols", "_fills", "_rows", "_weights")

    def __init__(self, cells: Sequence[Cell], shape: Shape, *, fills: bool = True) -> None:
        self._fills = fills
        dead = np.zeros(shape, dtype=bool)
        for row, col in cells:
            if not (0 <= row < shape[0] and 0 <= col < shape[1]):
                raise SceneError(
                    f"'frames.dead' names the taxel [{row}, {col}], expected rows 0 to "
                    f"{shape[0] - 1} and columns 0 to {shape[1] - 1}."
                )
            dead[row, col] = True
        if dead.all():
            raise SceneError("'frames.dead' names every taxel: at least one must be working.")
        self._rows, self._cols = np.nonzero(dead)
        places = zip(self._rows.tolist(), self._cols.tolist(), strict=True)
        self._weights = np.array([_nearest_living(dead, place) for place in places])

    def without(self, frame: Frame) -> Frame:
        """Return a frame whose dead taxels read 0."""
        values = frame.values.copy()
        values[self._rows, self._cols] = 0.0
        return replace(frame, values=values)

    def filled(self, values: Floats) -> Floats:
        """Return (rows, cols, channels) values with those of the neighbours in dead taxels."""
        if not self._fills:
            return values
        made = values.copy()
        channels = values.shape[2]
        made[self._rows, self._cols] = self._weights @ values.reshape(-1, channels)
        return made


def _nearest_living(dead: np.ndarray, place: Cell) -> Floats:
    """Return the weights of all taxels, flat: equal in the nearest ring with a living one."""
    away = np.indices(dead.shape) - np.array(place)[:, None, None]
    ring = np.abs(away).max(axis=0)
    for distance in count(1):
        living = (ring == distance) & ~dead
        if living.any():
            return np.asarray(living.ravel() / living.sum(), dtype=np.float64)
    raise AssertionError("a taxel lives")


Reader = Callable[[Frame], Floats]
"""Takes a driver's frame to (rows, cols, wanted) numbers."""


class Conversion(Protocol):
    """Turns a driver's frames into channels of a program."""

    @property
    def channels(self) -> tuple[str, ...]:
        """The channels that it can give."""
        ...

    def reader(self, wanted: Sequence[str], *, checks: bool = True) -> Reader:
        """Return a reader of the wanted channels alone, for every frame.

        Parameters
        ----------
        wanted : sequence of str
        checks : bool
            Whether it looks for NaN and infinity; not where the caller has looked.

        Raises
        ------
        ArrayError
            When it looks at a frame that holds NaN or infinity.
        """
        ...


@dataclass(frozen=True, slots=True)
class AsRead:
    """The driver's channels as they are."""

    channels: tuple[str, ...]

    def reader(self, wanted: Sequence[str], *, checks: bool = True) -> Reader:
        """Return a function that picks the wanted channels."""
        values: Reader = _checked if checks else attrgetter("values")
        if tuple(wanted) == self.channels:
            return values
        picked = [self.channels.index(name) for name in wanted]
        return lambda frame: values(frame)[..., picked]


@dataclass(frozen=True, slots=True)
class ByCalibration:
    """Four bridge voltages become the strain at every taxel (4.15)."""

    calibration: Calibration

    @property
    def channels(self) -> tuple[str, ...]:
        """The three rows of the strain tensor that a taxel sees."""
        return FORCE_AXES

    def reader(self, wanted: Sequence[str], *, checks: bool = True) -> Reader:
        """Return a function that computes the wanted strains."""
        return StrainReader(self.calibration, tuple(wanted), checks=checks)


@dataclass(frozen=True, slots=True)
class ByArrayCalibration:
    """Raw values of every taxel become physical ones; each reader tares by itself."""

    calibration: ArrayCalibration
    shape: Shape
    channels: tuple[str, ...]

    def reader(self, wanted: Sequence[str], *, checks: bool = True) -> Reader:
        """Return a function for the wanted channels; it always looks for NaN and infinity."""
        return CalibratedReader(self.calibration, self.shape, self.channels, wanted)


class StrainReader:
    """`Calibration.to_strain` of single frames: all that one frame does not change is done once.

    Parameters
    ----------
    calibration : Calibration
    wanted : tuple of str
        Channels; only the bridges that they read are looked at.
    checks : bool
        Whether it looks for NaN and infinity.
    """

    __slots__ = ("_calibration", "_checks", "_offsets", "_part", "_wanders", "_wanted", "_weights")

    def __init__(
        self, calibration: Calibration, wanted: tuple[str, ...], *, checks: bool = True
    ) -> None:
        self._checks = checks
        weights = calibration.strain_weights(wanted)
        used = np.flatnonzero(weights.reshape(-1, 4).any(axis=0))
        self._calibration, self._wanted = calibration, wanted
        self._wanders = calibration.wanders
        # from the first bridge that is used to the last: a slice, which is not copied
        self._part = slice(int(used[0]), int(used[-1]) + 1) if used.size else slice(0)
        self._offsets = calibration.offsets[..., self._part]
        self._weights = np.ascontiguousarray(np.swapaxes(weights[..., self._part], -1, -2))

    def __call__(self, frame: Frame) -> Floats:
        """Return (rows, cols, wanted) strain.

        Raises
        ------
        ArrayError
            If the frame does not hold four bridges, or a value is not finite.
        PhysicsError
            If its time is negative or NaN.
        """
        values, weights = frame.values, self._weights
        if values.shape[2] != 4 or not frame.time >= 0.0:  # in the words of the general way
            return self._calibration.to_strain(values, self._wanted, time=frame.time)
        if self._checks:
            _checked(frame)
        volts = values[..., self._part] - self._offsets
        if self._wanders:
            volts -= np.broadcast_to(self._calibration.wander(frame.time), values.shape)[
                ..., self._part
            ]
        if weights.ndim == 2:
            return np.asarray(volts @ weights, dtype=np.float64)
        return np.asarray((volts[..., np.newaxis, :] @ weights)[..., 0, :], dtype=np.float64)

    def with_others(self, others: Sequence["StrainReader"]) -> "Callable[..., Floats] | None":
        """Return the quick way for frames of skins that differ in offsets alone, or None."""
        for other in others:
            alike = other._part == self._part and np.array_equal(other._weights, self._weights)
            if not alike or other._wanders or other._offsets.shape[-1:] != self._offsets.shape[-1:]:
                return None
        if self._weights.ndim != 2:
            return None
        part, weights = self._part, self._weights
        shape = np.broadcast_shapes((1, 1, weights.shape[0]), *(o._offsets.shape for o in others))
        offsets = np.stack([np.broadcast_to(other._offsets, shape) for other in others])

        def read(lanes: NDArray[np.intp], values: Floats) -> Floats:
            apart = offsets if len(lanes) == len(offsets) else offsets[lanes]
            return np.asarray((values[..., part] - apart) @ weights, dtype=np.float64)

        return read


class ReadersAbreast:
    """Reads frames of several skins of one shape, which others have checked.

    Parameters
    ----------
    readers : sequence of callable
        One of each skin.
    """

    def __init__(self, readers: Sequence[Reader]) -> None:
        self._readers: list[Reader] = list(readers)
        strains = [part for part in self._readers if isinstance(part, StrainReader)]
        all_strains = len(strains) == len(self._readers)
        self._quick = strains[0].with_others(strains) if all_strains else None

    def __call__(self, lanes: NDArray[np.intp], frames: Sequence[Frame], values: Floats) -> Floats:
        """Return (frames, rows, cols, wanted) numbers.

        Parameters
        ----------
        lanes : (frames,) int
            Skins, each once.
        frames : sequence of Frame
        values : (frames, rows, cols, channels) float
            Their values.
        """
        if self._quick is not None and values.shape[3] == 4:
            return self._quick(lanes, values)
        own: list[int] = lanes.tolist()
        read = [self._readers[lane](frame) for lane, frame in zip(own, frames, strict=True)]
        return np.stack(read)


def _checked(frame: Frame) -> Floats:
    values = frame.values
    return values if all_finite(values) else finite("frame", values)


def unit_of(conversion: Conversion, driver: Driver) -> str:
    """Return the unit of a program's input: "strain" of bridges, else the driver's."""
    if isinstance(conversion, ByArrayCalibration):
        return conversion.calibration.unit or driver.unit
    return "strain" if isinstance(conversion, ByCalibration) else driver.unit


def conversion_for(
    use: str, driver: Driver, base: Path, scale: ArrayCalibration | None = None
) -> Conversion:
    """Return the conversion that a scene asks for.

    Parameters
    ----------
    use : str
        "driver", "none", or the path of a calibration file.
    driver : Driver
    base : Path
        Folder that a relative path starts from.
    scale : ArrayCalibration, optional
        Scale of the raw values, where the scene itself says it.

    Raises
    ------
    SceneError
        If the array has bridges and nothing says how to read them.
    CalibrationError
        If the file cannot be read, does not fit the array, or takes all frames for its tare.
    """
    channels = driver.channels
    known = cast(Calibration | None, getattr(driver, "calibration", None))
    if use not in ("driver", "none") and scale is None:
        scale = read_array_calibration(base / use)
    if scale is not None:
        scale.form(driver.shape, len(channels))
        total = getattr(driver, "total_frames", None)
        if total is not None and scale.tare >= total:
            raise CalibrationError(
                f"'tare' needs {scale.tare} frames at rest, but the recording has {total}: "
                "use those before the first touch."
            )
        return ByArrayCalibration(scale, driver.shape, channels)
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
