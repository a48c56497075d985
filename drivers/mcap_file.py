"""Recordings in MCAP files as arrays: recordings of `cnnum record`, as far as they are whole."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from cnnum.arrays import Shape
from cnnum.drivers.driver import Counters, Counting, lost_before
from cnnum.drivers.options import require
from cnnum.frame import Frame
from cnnum.recordings.reader import Contents, look


@dataclass(frozen=True, slots=True)
class McapOptions:
    """Options of the driver "mcap".

    Attributes
    ----------
    path : Path
        A file that `cnnum record` wrote; it may be cut off or damaged.
    budget : float
        How many times as much time, unpacked bytes and frames as usual the file may take.
    """

    path: Path
    budget: float = 1.0

    def __post_init__(self) -> None:
        require("budget", self.budget > 0.0, "a number above 0", self.budget)

    def open(self) -> "McapFile":
        """Look through the recording; a warning counts its unreadable parts.

        Raises
        ------
        RecordingError, CodecError
            As `look`.
        """
        contents = look(self.path, self.budget)
        contents.warn()
        return McapFile(contents)


class McapFile(Counting):
    """A recording as an array: its frames as they came, read a chunk at a time.

    Attributes
    ----------
    calibration : Calibration or None
        That of the array when it was recorded.
    total_frames : int
    """

    def __init__(self, contents: Contents) -> None:
        super().__init__()
        self._contents = contents
        layout = contents.layout
        self.shape: Shape = layout.shape
        self.channels = layout.channels
        self.unit = layout.unit
        self.rate = layout.rate
        self.calibration = layout.calibrated(contents.path)
        self.total_frames = contents.frames

    def frames(self) -> Iterator[Frame]:
        """Yield the frames as fast as they are fetched; a second call starts again.

        Raises
        ------
        RecordingError
            If the file can no longer be read.
        CodecError
            If it has been changed into none of this array.
        """
        self._counters = Counters()
        last: int | None = None
        for frame, _ in self._contents.stored():
            self.count(repeated=frame.repeated, dropped=lost_before(frame, last))
            last = frame.sequence
            yield frame
