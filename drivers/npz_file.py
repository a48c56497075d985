"""Recordings as NumPy archives: written by `cnnum record`, read again as an array.

An archive holds, a row a frame: ``values`` (frames, rows, cols, channels), ``sequence``, ``time``
(s), ``quality`` (flags of `cnnum.frame.Quality`), ``truth`` (frames, truths) and ``saturated``
(frames, rows, cols), the taxels at an end of their range, and ``log_time`` (ns). Next to these it
holds ``channels``, ``unit``, ``rate`` (Hz), ``truths`` (names) and ``calibration_*`` where the
array had a calibration. ``kind`` marks it as one.
"""

import logging
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cnnum.arrays import Floats, Shape
from cnnum.drivers.driver import Counters, Counting
from cnnum.drivers.npz_archive import read_arrays
from cnnum.errors import CalibrationError, CodecError
from cnnum.frame import Frame, Quality, Truth, contradicted
from cnnum.recordings.chunks import untimed
from cnnum.recordings.npz_writer import CALIBRATION, CAME, FRAMES, KIND, MARKS
from cnnum.safety.names import shown
from cnnum.tactile.taxel import Calibration
from cnnum.tactile.taxel.readout import Heat

_KEYS = ("kind", "channels", "unit", "rate", "truths", *FRAMES)
_FLAGS = int(~Quality.GOOD)
_NUMBERS, _WHOLE, _TEXT = "fiub", "iub", "U"
_KINDS = {
    **dict.fromkeys(("kind", "channels", "unit", "truths"), _TEXT),
    **dict.fromkeys(("sequence", "quality", CAME), _WHOLE),
}
_HELD = (*CALIBRATION, "depth", "heat")
_PARTS = tuple(f"calibration_{name}" for name in _HELD)
_SINGLE = tuple(f"calibration_{name}" for name in ("alpha_normal", "beta_ns", "limit", "depth"))
_AXES = {
    **dict.fromkeys(("kind", "unit", "rate", *_SINGLE), 0),
    **dict.fromkeys(("channels", "truths", "calibration_heat"), 1),
}
_WANTED = frozenset((*_KEYS, MARKS, CAME, *_PARTS))


@dataclass(frozen=True, slots=True, eq=False)
class Archive:
    """The content of an archive.

    Attributes
    ----------
    values : (frames, rows, cols, channels) float
    channels : tuple of str
    unit : str
    rate : float, Hz
    sequence : (frames,) int
    time : (frames,) float, s
    quality : (frames,) int
    truths : tuple of str
    truth : (frames, truths) float
    calibration : Calibration or None
    saturated : (frames, rows, cols) bool or None
        Taxels at an end of their range; None in archives of earlier versions.
    came : (frames,) int or None
        When each came by the time of day, ns; None in archives of earlier versions.
    """

    values: Floats
    channels: tuple[str, ...]
    unit: str
    rate: float
    sequence: NDArray[np.int64]
    time: Floats
    quality: NDArray[np.int64]
    truths: tuple[str, ...]
    truth: Floats
    calibration: Calibration | None
    saturated: NDArray[np.bool_] | None = None
    came: NDArray[np.int64] | None = None

    def __post_init__(self) -> None:
        frames = len(self.values)
        if self.values.ndim != 4 or self.values.shape[3] != len(self.channels):
            raise CodecError(
                f"'values' must be (frames, rows, cols, {len(self.channels)}), got "
                f"{self.values.shape}."
            )
        expected = dict.fromkeys(("sequence", "time", "quality"), (frames,))
        for name, shape in {**expected, "truth": (frames, len(self.truths))}.items():
            if getattr(self, name).shape != shape:
                raise CodecError(f"'{name}' must be {shape}, got {getattr(self, name).shape}.")
        if self.saturated is not None and self.saturated.shape != self.values.shape[:3]:
            raise CodecError(
                f"'{MARKS}' must be {self.values.shape[:3]}, got {self.saturated.shape}."
            )
        if self.came is not None and self.came.shape != (frames,):
            raise CodecError(f"'{CAME}' must be {(frames,)}, got {self.came.shape}.")
        if not frames:
            raise CodecError("there is no frame in it.")

    def frame(self, number: int, calibration: str = "") -> Frame:
        """Return one of the frames, with the id of its calibration."""
        known = zip(self.truths, self.truth[number].tolist(), strict=True)
        return Frame(
            values=self.values[number],
            channels=self.channels,
            unit=self.unit,
            sequence=int(self.sequence[number]),
            time=float(self.time[number]),
            quality=Quality(int(self.quality[number])),
            truth=Truth(dict(known)) if self.truths else None,
            calibration=calibration,
            saturated=self._marked(number),
            wall_ns=self._wall(number),
        )

    def _wall(self, number: int) -> int | None:
        came = None if self.came is None else int(self.came[number])
        return None if came == untimed(float(self.time[number])) else came

    def _marked(self, number: int) -> NDArray[np.bool_] | None:
        if self.saturated is None or not self.saturated[number].any():
            return None
        return np.asarray(self.saturated[number])

    def lost_before(self, number: int) -> int:
        """Return how many scans never arrived between a frame and the one before it."""
        if number == 0 or not self.quality[number] & Quality.DROPPED_BEFORE:
            return 0
        return max(0, int(self.sequence[number]) - int(self.sequence[number - 1]) - 1)


def read_npz(path: Path) -> Archive:
    """Read a recording.

    Raises
    ------
    RecordingError
        If the file cannot be read, or needs more memory than there is.
    CodecError
        If it is not a recording or is damaged; the sentence names the file and the fault.
    """
    held = read_arrays(path, _WANTED)
    try:
        return _checked(_recording(held))
    except (CodecError, CalibrationError) as error:
        raise CodecError(f"'{path}' is not a recording of cnnum: {error}") from None


def _recording(held: Mapping[str, NDArray[Any]]) -> Archive:
    for name in _KEYS:
        if name not in held:
            raise CodecError(f"it has no '{name}'.")
    for name, array in held.items():
        _check_array(name, array)
    if str(held["kind"]) != KIND:
        raise CodecError(f"'kind' must be '{KIND}', got {shown(str(held['kind']))}.")
    return Archive(
        values=held["values"].astype(np.float64, copy=False),
        channels=tuple(str(name) for name in held["channels"]),
        unit=str(held["unit"]),
        rate=float(held["rate"]),
        sequence=held["sequence"].astype(np.int64, copy=False),
        time=held["time"].astype(np.float64, copy=False),
        quality=held["quality"].astype(np.int64, copy=False),
        truths=tuple(str(name) for name in held["truths"]),
        truth=held["truth"].astype(np.float64, copy=False),
        calibration=_calibration(held),
        saturated=held[MARKS] != 0 if MARKS in held else None,
        came=held[CAME].astype(np.int64, copy=False) if CAME in held else None,
    )


def _checked(recording: Archive) -> Archive:
    """Return a recording unless it holds values that no array sends."""
    if not recording.values.size:
        raise CodecError(f"'values' must have a cell at least, got {recording.values.shape}.")
    if not 0 <= recording.rate < math.inf:
        raise CodecError(f"'rate' must be 0 Hz or more, and finite, got {recording.rate}.")
    if not np.isfinite(recording.time).all():
        raise CodecError("'time' must be finite; it holds NaN or infinity.")
    if (recording.quality & ~_FLAGS).any():
        raise CodecError(f"'quality' must hold flags of 0 to {_FLAGS}.")
    return recording


def _check_array(name: str, array: NDArray[Any]) -> None:
    kinds = _KINDS.get(name, _NUMBERS)
    if array.dtype.kind not in kinds:
        wanted = {_TEXT: "texts", _WHOLE: "whole numbers"}.get(kinds, "numbers")
        raise CodecError(f"'{name}' must hold {wanted}, got the type '{array.dtype}'.")
    if name in _AXES and array.ndim != _AXES[name]:
        raise CodecError(f"'{name}' must have {_AXES[name]} axes, got {array.ndim}.")


def _calibration(held: Mapping[str, NDArray[Any]]) -> Calibration | None:
    if "calibration_alpha_normal" not in held:
        return None
    for name in _PARTS:
        if name not in held:
            raise CodecError(f"it has no '{name}'.")
    parts = {name: held[f"calibration_{name}"].astype(np.float64, copy=False) for name in _HELD}
    if parts["heat"].shape != (2,):
        raise CodecError(f"'calibration_heat' must be (2,), got {parts['heat'].shape}.")
    depth = float(parts["depth"])
    return Calibration(
        alpha_normal=float(parts["alpha_normal"]),
        beta_ns=float(parts["beta_ns"]),
        offsets=parts["offsets"],
        cross=parts["cross"],
        drift=parts["drift"],
        heat=Heat(*parts["heat"].tolist()),
        limit=float(parts["limit"]),
        depth=None if np.isnan(depth) else depth,
    )


@dataclass(frozen=True, slots=True)
class NpzOptions:
    """Options of the driver "npz".

    Attributes
    ----------
    path : Path
        A file that `cnnum record` wrote.
    """

    path: Path

    def open(self) -> "NpzFile":
        """Read the recording.

        Raises
        ------
        RecordingError
            If the file cannot be read.
        CodecError
            If it is not a recording.
        """
        return NpzFile(read_npz(self.path))


class NpzFile(Counting):
    """A recording as an array: its frames as they came, flags and lost scans included.

    Attributes are those of `McapFile`.
    """

    def __init__(self, recording: Archive) -> None:
        super().__init__()
        self._recording = recording
        self.shape: Shape = (recording.values.shape[1], recording.values.shape[2])
        self.channels = recording.channels
        self.unit = recording.unit
        self.rate = recording.rate
        seen = contradicted(self.rate, recording.time) if self.rate else None
        if seen is not None:
            logging.getLogger("cnnum").warning(
                "The recording says %g frames a second, and its times have %.4g: those count.",
                self.rate,
                seen,
            )
            self.rate = seen
        self.calibration = recording.calibration
        self.total_frames = len(recording.values)

    def frames(self) -> Iterator[Frame]:
        """Yield the frames as fast as they are fetched; a second call starts again."""
        self._counters = Counters()
        known = self.calibration.identity if self.calibration else ""
        for number in range(self.total_frames):
            frame = self._recording.frame(number, known)
            self.count(repeated=frame.repeated, dropped=self._recording.lost_before(number))
            yield frame
