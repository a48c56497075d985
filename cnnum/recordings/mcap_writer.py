"""Recordings as MCAP files with an index, for other programs too: a chunk at a time."""

from dataclasses import replace
from typing import IO

from cnnum.recordings.attachments import records
from cnnum.recordings.chunks import CHUNK_BYTES, ChunkMaker, beginning
from cnnum.recordings.mcap_index import write_index
from cnnum.recordings.raw_chunks import RawMaker
from cnnum.recordings.reader import Contents


def write_mcap(file: IO[bytes], contents: Contents) -> None:
    """Write files, frames and raw bytes to chunks anew, and the index.

    Raises
    ------
    OSError
        If there is no room.
    RecordingError, CodecError
        If the recording can no longer be read.
    """
    file.write(beginning() + records(contents.held))
    layout = replace(contents.layout, marks=True)
    maker, raw = ChunkMaker(layout), RawMaker()
    for frame, log_time in contents.stored():
        maker.add(frame, log_time)
        if maker.size >= CHUNK_BYTES:
            file.write(maker.end())
    if maker.count:
        file.write(maker.end())
    for log_time, data in contents.raw():
        raw.add(data, log_time)
        if raw.size >= CHUNK_BYTES:
            file.write(raw.take().chunk())
    if raw.count:
        file.write(raw.take().chunk())
    write_index(file, layout)
