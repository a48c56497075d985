"""A recording in memory as the array of a scene."""

from collections.abc import Iterator

from cnnum.drivers.driver import Counting, lost_before
from cnnum.frame import Frame, Quality
from cnnum.recordings.recording import Recording

MEMORY = "memory"
"""Its name in a scene; no file can name it."""


class RecordingDriver(Counting):
    """The frames of a recording, flags and lost scans included.

    Parameters
    ----------
    recording : Recording
    """

    def __init__(self, recording: Recording) -> None:
        super().__init__()
        self._recording = recording
        self.shape = recording.shape
        self.channels = recording.channels
        self.unit = recording.unit
        self.rate = recording.rate
        self.total_frames = len(recording)

    def frames(self) -> Iterator[Frame]:
        """Yield the frames in their order, from the first one."""
        last: int | None = None
        for frame in self._recording.frames():
            repeated = bool(frame.quality & Quality.REPEATED)
            self.count(repeated=repeated, dropped=lost_before(frame, last))
            last = frame.sequence
            yield frame
