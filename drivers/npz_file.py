"""Recordings as NumPy archives: sizes are checked before memory is taken.

An archive is a zip file of ``.npy`` members. The directory of the zip file, the header of each
array and the bytes that follow must agree. The promised array must fit into the memory of this
machine. And it must be no more than the file can honestly hold.

Recordings as NumPy archives: written by `cnnum record`, read again as an array.

An archive holds, one row per frame: ``values`` (frames, rows, cols, channels), ``sequence``,
``time`` (s), ``quality`` (flags of `cnnum.frame.Quality`), ``truth`` (frames, truths) and
``saturated`` (frames, rows, cols), the taxels at an end of their range, and ``log_time`` (ns). Next
to these it holds ``channels``, ``unit``, ``rate`` (Hz), ``truths`` (names) and ``calibration_*``
where the array had a calibration. ``kind`` marks it as one.
"""

import logging
import math
import struct
import warnings
import zipfile
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from cnnum.arrays import Floats, Shape
from cnnum.drivers.driver import Counters, Counting
from cnnum.errors import CalibrationError, CodecError, RecordingError, unreadable
from cnnum.frame import Frame, Quality, Truth, contradicted
from cnnum.recordings.export import CALIBRATION, CAME, FRAMES, KIND, MARKS, PADS
from cnnum.recordings.mcap_chunks import untimed
from cnnum.safety.reading import DAMAGE, MEGABYTE, open_regular
from cnnum.safety.values import host_bytes, shown
from cnnum.tactile.taxel import Calibration
from cnnum.tactile.taxel.readout import Heat

SUFFIX = ".npy"

PLAIN = "fiub"
"""Kinds of numbers that a member may hold (float, int, unsigned, bool), in up to 64 bits."""

MOST_NAMES, LONGEST_NAME = 1024, 256
"""Texts of one array of texts, and signs of one."""

MOST_AXES = 6

LONGEST_HEADER = 1 << 16
"""Bytes before an array's values; that of a recording has 128."""

LONGEST_READ = 1 << 20
"""Bytes of one read from a file: the directory of a zip file comes in one."""

SPARED, MOST_FOLD = 256 * MEGABYTE, 64
"""An archive may hold `SPARED` bytes, or `MOST_FOLD` times its own.

Values of 64 bits of which the lowest is noise take a 64th at best. Frames that never change are
compressed further: these pass up to `SPARED` bytes, a recording without compression always."""


class _Bounded:
    """A file of which no read takes more memory than `LONGEST_READ`."""

    def __init__(self, file: IO[bytes]) -> None:
        self._file = file
        self.seek, self.tell, self.seekable = file.seek, file.tell, file.seekable

    def read(self, size: int = -1) -> bytes:
        if size > LONGEST_READ:
            raise zipfile.BadZipFile("its directory is longer than that of any recording")
        return self._file.read(LONGEST_READ if size < 0 else size)


@dataclass(frozen=True, slots=True)
class _Header:
    """The header before an array's values."""

    shape: tuple[int, ...]
    by_columns: bool
    dtype: np.dtype[Any]
    length: int

    @property
    def bytes(self) -> int:
        """Bytes of the values."""
        return math.prod(self.shape) * self.dtype.itemsize

    @property
    def memory(self) -> int:
        """Bytes of the values, and of their copy in numbers of 64 bits."""
        as_it_is = self.dtype in (np.dtype("f8"), np.dtype("i8"))
        return self.bytes + (0 if as_it_is else 8 * math.prod(self.shape))


def read_arrays(path: Path, wanted: Collection[str]) -> dict[str, NDArray[Any]]:
    """Return those of the wanted arrays that an archive holds, by name; others are not read.

    Raises
    ------
    RecordingError
        If the file cannot be read, or needs more memory than there is.
    CodecError
        If it is no archive, is damaged, or promises more than it can hold; names the array.
    """
    try:
        with open_regular(path) as file:
            return _read(path, file, wanted)
    except (CodecError, RecordingError):
        raise
    except MemoryError:
        raise RecordingError(f"'{path}' cannot be read: there is not enough memory.") from None
    except OSError as error:
        raise unreadable(RecordingError, f"'{path}'", error) from None


def array_shapes(path: Path) -> dict[str, tuple[tuple[int, ...], str]]:
    """Return the shapes and types of the arrays of an archive, or of the one of a .npy file ("").

    Arrays of other things than plain numbers and texts are left out. It raises as `read_arrays`.
    """
    result: dict[str, tuple[tuple[int, ...], str]] = {}
    try:
        with open_regular(path) as file:
            if path.suffix.lower() == SUFFIX:
                header = _parsed(file)
                return {"": (header.shape, header.dtype.str)}
            with zipfile.ZipFile(_Bounded(file)) as archive:  # pyright: ignore[reportArgumentType, reportCallIssue]
                for info in archive.infolist()[:MOST_NAMES]:
                    try:
                        header = _header(path, archive, info)
                    except CodecError:
                        continue
                    result[info.filename.removesuffix(SUFFIX)] = header.shape, header.dtype.str
    except OSError as error:
        raise unreadable(RecordingError, f"'{path}'", error) from None
    except DAMAGE as error:
        raise CodecError(f"'{path}' is not a NumPy file: {str(error).rstrip('.')}.") from None
    return result


def _read(path: Path, file: IO[bytes], wanted: Collection[str]) -> dict[str, NDArray[Any]]:
    size = file.seek(0, 2)
    try:
        archive = zipfile.ZipFile(_Bounded(file))  # pyright: ignore[reportArgumentType, reportCallIssue]
    except DAMAGE:
        raise CodecError(f"'{path}' is not a NumPy archive (.npz), or it is cut off.") from None
    with archive:
        members = _members(path, archive, wanted)
        headers = {name: _header(path, archive, info) for name, info in members.items()}
        _refuse_beyond(path, size, sum(header.bytes for header in headers.values()))
        _refuse_memory(path, sum(header.memory for header in headers.values()))
        return {
            name: _values(path, archive, members[name], header) for name, header in headers.items()
        }


def _members(
    path: Path, archive: zipfile.ZipFile, wanted: Collection[str]
) -> dict[str, zipfile.ZipInfo]:
    result: dict[str, zipfile.ZipInfo] = {}
    for info in archive.infolist():
        name = info.filename.removesuffix(SUFFIX)
        if name not in wanted:
            continue
        if name in result:
            raise CodecError(f"'{path}' contains the array '{name}' twice.")
        if info.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
            raise _damaged(path, name, "it is neither stored as it is nor deflated")
        result[name] = info
    return result


def _header(path: Path, archive: zipfile.ZipFile, info: zipfile.ZipInfo) -> _Header:
    name = info.filename.removesuffix(SUFFIX)
    try:
        with archive.open(info) as member, warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of Python's parser and NumPy, about odd headers
            header = _parsed(member)
    except OSError as error:
        raise _damaged(path, name, str(error.strerror or error)) from None
    except DAMAGE as error:
        raise _damaged(path, name, str(error) or type(error).__name__) from None
    if info.file_size != header.length + header.bytes:
        raise _damaged(
            path,
            name,
            f"expected {header.bytes} bytes of values by its header, got "
            f"{info.file_size - header.length}",
        )
    return header


def _parsed(member: IO[bytes]) -> _Header:
    version = np.lib.format.read_magic(member)
    form = {(1, 0): "<H", (2, 0): "<I"}.get(version)
    if form is None:
        raise ValueError(f"expected an array of version 1.0 or 2.0, got {version}")
    (length,) = struct.unpack(form, member.read(struct.calcsize(form)))
    if length > LONGEST_HEADER:
        raise ValueError(f"expected a header of at most {LONGEST_HEADER} bytes, got {length}")
    begin = member.tell()
    member.seek(begin - struct.calcsize(form))
    read = {
        (1, 0): np.lib.format.read_array_header_1_0,
        (2, 0): np.lib.format.read_array_header_2_0,
    }[version]
    shape, by_columns, dtype = read(member)
    _check(shape, dtype)
    return _Header(shape, by_columns, dtype, begin + length)


def _check(shape: tuple[int, ...], dtype: np.dtype[Any]) -> None:
    if any(isinstance(n, bool) or n < 0 for n in shape) or len(shape) > MOST_AXES:
        raise ValueError(f"expected up to six axes of 0 or more, got {shown(shape)}")
    if dtype.kind == "U":
        if math.prod(shape) > MOST_NAMES or dtype.itemsize > 4 * LONGEST_NAME:
            raise ValueError(
                f"expected at most {MOST_NAMES} strings of {LONGEST_NAME} characters, got "
                f"{shown(shape)} of type {shown(dtype.str)}"
            )
    elif dtype.kind not in PLAIN or dtype.itemsize > 8 or dtype.names or dtype.subdtype:
        raise ValueError(f"expected plain numbers or strings, got the type {shown(dtype.str)}")


def _refuse_beyond(path: Path, size: int, needed: int) -> None:
    """Raise if the arrays are more than their file can honestly hold."""
    if needed > max(SPARED, MOST_FOLD * size):
        raise CodecError(
            f"'{path}' claims to contain {needed / 1e9:.3g} GB in a file of {size / 1e9:.3g} GB, "
            f"more than {MOST_FOLD} times its size: if that is right, write it without "
            "compression."
        )


def _refuse_memory(path: Path, needed: int) -> None:
    room = host_bytes()
    if room is not None and needed > room:
        raise RecordingError(
            f"'{path}' needs {needed / 1e9:.3g} GB of memory, more than the {room / 1e9:.3g} GB of "
            "this machine: record it in parts."
        )


def _values(
    path: Path, archive: zipfile.ZipFile, info: zipfile.ZipInfo, header: _Header
) -> NDArray[Any]:
    name = info.filename.removesuffix(SUFFIX)
    try:
        with archive.open(info) as member:
            member.read(header.length)
            content = bytearray(header.bytes)
            _fill(content, member)
            flat = np.frombuffer(content, header.dtype)
            return flat.reshape(header.shape, order="F" if header.by_columns else "C")
    except OSError as error:
        raise _damaged(path, name, str(error.strerror or error)) from None
    except DAMAGE as error:
        raise _damaged(path, name, str(error) or type(error).__name__) from None


def _fill(content: bytearray, member: IO[bytes]) -> None:
    at = 0
    while part := member.read(min(LONGEST_READ, len(content) - at) or 1):  # its end has the check
        if at + len(part) > len(content):
            raise ValueError("it contains more values than its header states")
        content[at : at + len(part)] = part
        at += len(part)
    if at < len(content):
        raise ValueError(f"expected {len(content)} bytes of values, got {at}")


def _damaged(path: Path, name: str, why: str) -> CodecError:
    return CodecError(f"'{path}' is damaged in the array '{name}': {why.rstrip('.')}.")


_KEYS = ("kind", "channels", "unit", "rate", "truths", *FRAMES)
_FLAGS = int(~Quality.GOOD)
_NUMBERS, _WHOLE, _TEXT = "fiub", "iub", "U"
_KINDS = {
    **dict.fromkeys(("kind", "channels", "unit", "truths"), _TEXT),
    **dict.fromkeys(("sequence", "quality", CAME, PADS), _WHOLE),
}
_HELD = (*CALIBRATION, "depth", "heat")
_PARTS = tuple(f"calibration_{name}" for name in _HELD)
_SINGLE = tuple(f"calibration_{name}" for name in ("alpha_normal", "beta_ns", "limit", "depth"))
_AXES = {
    **dict.fromkeys(("kind", "unit", "rate", PADS, *_SINGLE), 0),
    **dict.fromkeys(("channels", "truths", "calibration_heat"), 1),
}
_WANTED = frozenset((*_KEYS, MARKS, CAME, PADS, *_PARTS))


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
    pads : int or None
        Pads side by side in the columns, where that is known.
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
    pads: int | None = None

    def __post_init__(self) -> None:
        frames = len(self.values)
        if self.values.ndim != 4 or self.values.shape[3] != len(self.channels):
            raise CodecError(
                f"'values' must have the shape (frames, rows, cols, {len(self.channels)}), got "
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
        if self.pads is not None and (self.pads < 1 or self.values.shape[2] % self.pads):
            raise CodecError(f"{self.pads} pads do not share {self.values.shape[2]} columns.")
        if not frames:
            raise CodecError("it holds no frame.")

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
        pads=int(held[PADS]) if PADS in held else None,
    )


def _checked(recording: Archive) -> Archive:
    """Return a recording unless it holds values that no array sends."""
    if not recording.values.size:
        raise CodecError(f"'values' must contain at least one cell, got {recording.values.shape}.")
    if not 0 <= recording.rate < math.inf:
        raise CodecError(f"'rate' must be 0 Hz or more, and finite, got {recording.rate}.")
    if not np.isfinite(recording.time).all():
        raise CodecError("'time' must be finite; it holds NaN or infinity.")
    if (recording.quality & ~_FLAGS).any():
        raise CodecError(f"'quality' must contain flags from 0 to {_FLAGS}.")
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
            If the file is not a recording.
        """
        return NpzFile(read_npz(self.path))


def rate_that_counts(rate: float, times: Floats) -> float:
    """Return the rate that a file states, or that of its times where they contradict it."""
    seen = contradicted(rate, times) if rate else None
    if seen is None:
        return rate
    logging.getLogger("cnnum").warning(
        "The recording states %g frames per second, but its times give %.4g, which is used.",
        rate,
        seen,
    )
    return seen


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
        self.rate = rate_that_counts(recording.rate, recording.time)
        self.timed = self.rate == recording.rate
        self.pads = recording.pads
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
