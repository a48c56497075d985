"""The layout of a recording's frames, stored in every chunk, and embedded files."""

import json
import struct
import zlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any, cast

import numpy as np
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import Attachment, AttachmentIndex

from cnnum.arrays import Shape
from cnnum.errors import CalibrationError, CodecError
from cnnum.frame import Frame
from cnnum.recordings.mcap_records import PREFIX, RECORD, Budget, Fields, built, read_prefix
from cnnum.tactile.taxel import Calibration, identity_of

CALIBRATION, SCENE = "calibration.toml", "scene.toml"

LARGEST = 1 << 26
"""Bytes of an attachment, at most."""

_TIMES = struct.Struct("<QQ")


@dataclass(frozen=True, slots=True)
class Held:
    """A file in a recording.

    Attributes
    ----------
    name : str
    text : str
    time : int, ns
        When it was put there, by the host's clock.
    """

    name: str
    text: str
    time: int = 0

    def record(self) -> bytes:
        """Return it as the record of an attachment."""
        data = self.text.encode()
        whole = RecordBuilder()
        Attachment(self.time, self.time, self.name, "application/toml", data).write(whole)
        return built(whole)

    def index(self, start: int, end: int) -> AttachmentIndex:
        """Return its entry in the summary; it stands at bytes `start` to `end`."""
        return AttachmentIndex(
            offset=start,
            length=end - start,
            log_time=self.time,
            create_time=self.time,
            data_size=len(self.text.encode()),
            name=self.name,
            media_type="application/toml",
        )


def attached(
    file: IO[bytes], place: int, size: int, budget: Budget | None = None
) -> Iterator[tuple[int, int, Held]]:
    """Yield start, end and content of the attachments with a valid checksum.

    Parameters
    ----------
    file : binary file
    place, size : int
        Where the first record begins, and the end of the file, bytes. Records that are damaged end
        the search: attachments stand before the frames.
    budget : Budget, optional
        Budget of the work; a CodecError says that it is spent.
    """
    while prefix := read_prefix(file, place, size):
        opcode, end = prefix
        if budget is not None:
            budget.look(RECORD)
        if opcode in (Opcode.DATA_END, Opcode.FOOTER):
            return
        if opcode == Opcode.ATTACHMENT and end - place < LARGEST:
            held = _held(file.read(end - place - PREFIX.size))
            if held is not None:
                yield place, end, held
        place = end


def _held(data: bytes) -> Held | None:
    """Return the attachment in a record's bytes, None if they are damaged."""
    if len(data) < _TIMES.size or zlib.crc32(data[:-4]) != int.from_bytes(data[-4:], "little"):
        return None
    log_time, _ = _TIMES.unpack_from(data)
    fields = Fields(data[_TIMES.size : -4])
    try:
        name, _ = fields.text(), fields.text()
        return Held(name, fields.raw(fields.number(8)).decode(), log_time)
    except (CodecError, UnicodeDecodeError):
        return None


def records(held: Sequence[Held]) -> bytes:
    """Return the records of all these files."""
    return b"".join(item.record() for item in held)


KIND = "cnnum recording 2"
"""Kind of MCAP recordings; NumPy archives have kind 1."""

MOST_VALUES = 1 << 22
"""Numbers of a frame, at most: 32 MiB, half of a chunk."""


@dataclass(frozen=True, slots=True)
class Layout:
    """Shape and names of the frames of a recording.

    Attributes
    ----------
    shape : (rows, cols)
    channels : tuple of str
    unit : str
    rate : float, Hz
    truths : tuple of str
        Names of the ground truth; empty if there is none.
    calibration : str
        TOML text of the array's calibration; empty if it has none.
    marks : bool
        Whether the frames say which taxels stand at an end of their range; those of earlier
        versions do not.
    pads : int or None
        Pads side by side in the columns, where that is known.

    Raises
    ------
    CodecError
        If the shape is not positive, or a frame is too large.
    """

    shape: Shape
    channels: tuple[str, ...]
    unit: str
    rate: float
    truths: tuple[str, ...] = ()
    calibration: str = ""
    marks: bool = True
    pads: int | None = None

    def __post_init__(self) -> None:
        if min(*self.shape, len(self.channels)) < 1:
            raise CodecError(f"a frame needs rows, columns and channels, got {self.whole}.")
        if self.values > MOST_VALUES or len(self.truths) > MOST_VALUES:
            raise CodecError(f"a frame may have at most {MOST_VALUES} numbers, got {self.whole}.")
        if self.pads is not None and (self.pads < 1 or self.shape[1] % self.pads):
            raise CodecError(f"{self.shape[1]} columns do not divide into {self.pads} equal pads.")

    @classmethod
    def of(
        cls,
        frame: Frame,
        rate: float,
        calibration: Calibration | None,
        pads: int | None = None,
    ) -> "Layout":
        """Return the layout of an array's frames, by the first of them."""
        return cls(
            shape=frame.shape,
            channels=tuple(frame.channels),
            unit=frame.unit,
            rate=float(rate),
            truths=tuple(frame.truth.values) if frame.truth else (),
            calibration="" if calibration is None else calibration.to_text(),
            pads=pads,
        )

    @property
    def calibration_id(self) -> str:
        """Id of the calibration, as `Calibration.identity` says it; empty if there is none."""
        return identity_of(self.calibration) if self.calibration else ""

    @property
    def whole(self) -> tuple[int, int, int]:
        """Rows, columns and number of channels."""
        return (*self.shape, len(self.channels))

    @property
    def values(self) -> int:
        """Count of numbers in a frame."""
        rows, cols, channels = self.whole
        return rows * cols * channels

    @property
    def message(self) -> np.dtype[np.void]:
        """A message in its chunk, byte by byte; header of the record, then CDR."""
        fields: list[tuple[Any, ...]] = [
            ("opcode", "u1"),
            ("length", "<u8"),
            ("channel", "<u2"),
            ("number", "<u4"),
            ("log_time", "<u8"),
            ("publish_time", "<u8"),
            ("encoding", "V4"),
            ("sequence", "<i8"),
            ("time", "<f8"),
            ("quality", "<u4"),
            ("count", "<u4"),
            ("values", "<f8", self.whole),
            ("truths", "<u4"),
        ]
        if self.truths:
            fields += [("padding", "V4"), ("truth", "<f8", (len(self.truths),))]
        if self.marks:
            fields += [("taxels", "<u4"), ("saturated", "u1", self.shape)]
        form: np.dtype[np.void] = np.dtype(cast(Any, fields))
        return form

    def metadata(self) -> dict[str, str]:
        """Return the layout as the metadata of an MCAP channel."""
        rows, cols = self.shape
        known = {} if self.pads is None else {"pads": str(self.pads)}
        return known | {
            "kind": KIND,
            "rows": str(rows),
            "cols": str(cols),
            "channels": json.dumps(self.channels, ensure_ascii=False),
            "unit": self.unit,
            "rate": repr(self.rate),
            "truths": json.dumps(self.truths, ensure_ascii=False),
            "calibration": self.calibration,
            "marks": json.dumps(self.marks),
        }

    @classmethod
    def from_metadata(cls, held: Mapping[str, str]) -> "Layout":
        """Return the layout that the metadata of a channel describes.

        Raises
        ------
        CodecError
            If a key is missing or wrong.
        """
        if held.get("kind") != KIND:
            raise CodecError(f"'kind' must be '{KIND}', got {held.get('kind')!r:.60}.")
        try:
            return cls(
                shape=(int(held["rows"]), int(held["cols"])),
                channels=_names(held["channels"]),
                unit=held["unit"],
                rate=float(held["rate"]),
                truths=_names(held["truths"]),
                calibration=held["calibration"],
                marks=held.get("marks", "false") == "true",
                pads=int(held["pads"]) if "pads" in held else None,
            )
        except KeyError as error:
            raise CodecError(f"it has no {error}.") from None
        except CodecError:
            raise
        except (ValueError, RecursionError) as error:
            raise CodecError(f"its layout cannot be read: {error}.") from None

    def calibrated(self, path: Path) -> Calibration | None:
        """Return the array's calibration; `path` names the recording in an error.

        Raises
        ------
        CodecError
            If its text is no calibration.
        """
        if not self.calibration:
            return None
        try:
            return Calibration.from_text(self.calibration, path)
        except CalibrationError as error:
            raise CodecError(f"'{path}' is not a recording of cnnum: {error}") from None


def _names(text: str) -> tuple[str, ...]:
    result: Any = json.loads(text)
    if not isinstance(result, list) or not all(isinstance(n, str) for n in cast(Any, result)):
        raise ValueError(f"expected a list of names, got {text[:60]!r}")
    return tuple(cast(Any, result))
