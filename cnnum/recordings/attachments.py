"""Files that travel in a recording: the array's calibration, and the scene that was recorded."""

import struct
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import IO

from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import Attachment, AttachmentIndex

from cnnum.errors import CodecError
from cnnum.recordings.mcap_records import PREFIX, RECORD, Budget, Fields, built, read_prefix

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
    """Yield begin, end and content of the attachments whose checksum holds.

    Parameters
    ----------
    file : binary file
    place, size : int
        Where the first record begins, and the end of the file, bytes. Records that are damaged end
        the search: attachments stand before the frames.
    budget : Budget, optional
        Budget of the work; a CodecError says that it is spent.
    """
    while found := read_prefix(file, place, size):
        opcode, end = found
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
    """Return the attachment in a record's bytes, None where they are damaged."""
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
    return b"".join(one.record() for one in held)
