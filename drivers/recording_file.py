"""Recordings as arrays of a scene: MCAP files, recordings in memory, and the driver of any file."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from cnnum.arrays import Shape
from cnnum.drivers.driver import Counters, Counting, lost_before
from cnnum.drivers.options import require
from cnnum.drivers.own_data.sources import READERS
from cnnum.drivers.registry import open_driver
from cnnum.errors import CnnumError, RecordingError, missing_file
from cnnum.frame import Frame, Quality
from cnnum.recordings.lerobot import TACTILE, episode_of, is_lerobot, read_lerobot
from cnnum.recordings.message_topics import holds_frames, is_bag, topics
from cnnum.recordings.reader import Contents, look
from cnnum.recordings.recording import Recording
from cnnum.safety.reading import DAMAGE, names_something, open_regular
from cnnum.safety.values import as_path, shown


@dataclass(frozen=True, slots=True)
class McapOptions:
    """Options of the driver "mcap".

    Attributes
    ----------
    path : Path
        A file that `cnnum record` wrote; it may be truncated or damaged.
    budget : float
        Factor on the limits of reading time, unpacked bytes and frames.
    """

    path: Path
    budget: float = 1.0

    def __post_init__(self) -> None:
        require("budget", self.budget > 0.0, "a number above 0", self.budget)

    def open(self) -> "McapFile":
        """Scan the recording, with a warning that counts its unreadable parts.

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
    timed : bool
        Whether the unit of the times is beyond doubt where these agree with the rate.
    """

    timed = True

    def __init__(self, contents: Contents) -> None:
        super().__init__()
        self._contents = contents
        layout = contents.layout
        self.shape: Shape = layout.shape
        self.channels = layout.channels
        self.unit = layout.unit
        self.rate = layout.rate
        self.pads = layout.pads
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


@dataclass(frozen=True, slots=True)
class LerobotOptions:
    """Options of the driver "lerobot".

    Attributes
    ----------
    path : Path
        "SET/episode-000003", or the folder of a LeRobot data set that has one episode.
    feature : str
        The feature with the taxels; `read_lerobot` says which shapes it may have.
    """

    path: Path
    feature: str = TACTILE

    def open(self) -> "RecordingDriver":
        """Read the episode; it raises as `read_lerobot`."""
        return RecordingDriver(read_lerobot(self.path, self.feature))


MEMORY = "memory"
"""Its name in a scene; no file can name it."""


class RecordingDriver(Counting):
    """The frames of a recording, flags and lost scans included.

    Parameters
    ----------
    recording : Recording
    """

    timed = True  # `Recording` has looked at them

    def __init__(self, recording: Recording) -> None:
        super().__init__()
        self._recording = recording
        self.shape = recording.shape
        self.channels = recording.channels
        self.unit = recording.unit
        self.rate = recording.rate
        self.pads = recording.pads
        self.total_frames = len(recording)

    def frames(self) -> Iterator[Frame]:
        """Yield the frames in their order, from the first one."""
        last: int | None = None
        for frame in self._recording.frames():
            repeated = bool(frame.quality & Quality.REPEATED)
            self.count(repeated=repeated, dropped=lost_before(frame, last))
            last = frame.sequence
            yield frame


LISTED = 6
"""Topics that a sentence names."""

KIND = "kind.npy"
"""Member of a NumPy archive that `cnnum record` wrote."""


def array_of(file: Path, topic: str = "") -> dict[str, object]:
    """Return the table of a scene that reads this recording.

    Parameters
    ----------
    file : Path
    topic : str
        Topic of an MCAP file or a bag of others, in place of that of the layout.

    Raises
    ------
    RecordingError
        If there is no such file, or it is none of the known kinds.
    """
    if episode_of(file) is not None or is_lerobot(file):
        return {"driver": "lerobot", "path": str(file.absolute())}
    known = ", ".join(READERS)
    expected = f"expected a file of the kind {known}, or the folder of a trial."
    if not names_something(file):
        said = f"There is no recording {shown(str(file))}: {expected}"
        raise missing_file(RecordingError, said)
    # a relative path in a scene starts from the scene's folder, not from the working one
    path, suffix = str(file.absolute()), file.suffix.lower()
    if topic:
        return {"driver": "file", "path": path, "topic": topic}
    if is_bag(file):
        return {"driver": "file", "path": path}
    if file.is_dir():
        return {"driver": "uskin-csv", "path": path}
    if suffix == ".mcap" and (holds_frames(file) or not _has_layout(file)):
        _refuse_others(file)
        return {"driver": "mcap", "path": path}
    if suffix == ".npz" and (is_own_archive(file) or not _has_layout(file)):
        return {"driver": "npz", "path": path}
    if suffix in READERS or _has_layout(file):
        return {"driver": "file", "path": path}
    raise RecordingError(f"'{file}' is not a recording: {expected}")


def _refuse_others(file: Path) -> None:
    """Say of an MCAP file with messages of others how to read them."""
    if holds_frames(file):
        return
    try:
        names = list(topics(file))
    except CnnumError:
        return  # its driver says what is wrong with it
    if names:
        some = ", ".join(f"'{name}'" for name in names[:LISTED])
        raise RecordingError(
            f"'{file}' contains messages of other programs ({some}), which need a layout: "
            f"'cnnum layout {file.name} --topic {names[0]}' proposes one."
        )


def is_of_others(file: Path) -> bool:
    """Return whether a file is a bag, or an MCAP file with messages of others."""
    if is_bag(file):
        return True
    if file.suffix.lower() != ".mcap" or not names_something(file) or holds_frames(file):
        return False
    if _has_layout(file):
        return True
    try:
        return bool(topics(file))
    except CnnumError:
        return False  # whoever reads its frames says what is wrong with it


def _has_layout(file: Path) -> bool:
    return names_something(file.with_suffix(".toml"))


def is_own_archive(file: Path) -> bool:
    """Return whether a NumPy archive is a recording of cnnum."""
    import zipfile

    try:
        with open_regular(file) as held, zipfile.ZipFile(held) as archive:
            return KIND in archive.namelist()
    except (OSError, *DAMAGE):
        return False


def load_recording(path: str | Path, *, budget: float = 1.0, topic: str = "") -> Recording:
    """Read a recording into memory.

    Parameters
    ----------
    path : str or Path
        A file from `cnnum record` or `Recording.save` (.mcap, .npz, .csv), a data file of your own
        with its layout, or the folder of a uSkin trial.
    budget : float
        Factor on the limits of reading time, unpacked bytes and frames of an MCAP file.
    topic : str
        Topic to read from an MCAP file or a bag, instead of the one in its layout.

    Returns
    -------
    Recording
        The frames with their flags, times and truth.

    Raises
    ------
    RecordingError, CodecError
        If the file cannot be read, or is not a recording.
    SceneError
        If its layout is missing or wrong.
    """
    table = array_of(as_path(path, RecordingError), topic)
    if table["driver"] == "mcap":
        table["budget"] = budget
    with open_driver(str(table.pop("driver")), table) as driver:
        frames = list(driver.frames())
        rate, pads = driver.rate, getattr(driver, "pads", None)
    if not frames:
        raise RecordingError(f"'{path}' holds no frame.")
    return Recording.from_frames(frames, rate=rate or None, pads=pads)
