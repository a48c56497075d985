"""A data file as an array: a CSV, NumPy or HDF5 file of your own, or a CSV file of cnnum."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from cnnum.arrays import Shape
from cnnum.drivers.driver import Counters, Counting
from cnnum.drivers.own_data.layout import EXAMPLE, SECONDS, DataLayout, read_layout
from cnnum.drivers.own_data.own_csv import is_own, read_own
from cnnum.drivers.own_data.sources import READERS, VALUES, shaped
from cnnum.drivers.text_table import read_table
from cnnum.errors import (
    ArrayError,
    CodecError,
    RecordingError,
    SceneError,
    missing_file,
    name_error,
)
from cnnum.frame import Frame
from cnnum.recordings.export import calibration_of
from cnnum.recordings.recording import Recording, rate_of
from cnnum.safety.reading import names_something
from cnnum.tactile.taxel import Calibration


@dataclass(frozen=True, slots=True)
class DataFileOptions:
    """Options of the driver "file".

    Attributes
    ----------
    path : Path
        A .csv, .npy, .npz, .h5 or .hdf5 file.
    layout : Path, optional
        The TOML file that names its columns and their meaning (`DataLayout`). Unless given, it is
        that of the same name with the suffix .toml. A CSV file that `cnnum record` wrote needs
        none.
    """

    path: Path
    layout: Path | None = None

    def open(self) -> "DataFile":
        """Read the file.

        Raises
        ------
        RecordingError
            If it cannot be read.
        CodecError
            If it does not fit the layout; the sentence names the file and the fault.
        SceneError
            If the layout is missing or wrong.
        UnknownNameError
            If the suffix is none that is known.
        MissingExtraError
            If h5py is not installed, for an HDF5 file.
        """
        path, suffix = self.path, self.path.suffix.lower()
        if suffix not in READERS:
            raise name_error("kind of data file", suffix or path.name, READERS)
        if not names_something(path):
            raise missing_file(RecordingError, f"There is no file '{path}'.")
        try:
            if suffix == ".csv" and self.layout is None and is_own(path):
                return DataFile(read_own(read_table(path)), calibration=_beside(path))
            layout = read_layout(self._layout())
            return DataFile(_recording(path, layout), layout)
        except ArrayError as error:
            raise CodecError(f"'{path}': {error}") from None

    def _layout(self) -> Path:
        path = self.path.with_suffix(".toml") if self.layout is None else self.layout
        if not names_something(path):
            raise SceneError(
                f"There is no layout '{path}', which describes '{self.path.name}': write one "
                f"with {EXAMPLE}."
            )
        return path


def _beside(table: Path) -> Calibration | None:
    """Return the calibration that was recorded with a CSV file."""
    file = calibration_of(table)
    return Calibration.load(file) if names_something(file) else None


def _recording(path: Path, layout: DataLayout) -> Recording:
    held = READERS[path.suffix.lower()](path, layout)
    times = held[layout.time].astype(float) * SECONDS[layout.time_unit] if layout.time else None
    rate = layout.rate or (rate_of(times) if times is not None and times.ndim == 1 else 0.0)
    if not rate:
        raise CodecError(f"'{path}': the times '{layout.time}' give no rate: set 'rate'.")
    return Recording(
        shaped(path, layout, held[VALUES]),
        rate=rate,
        unit=layout.unit,
        channels=layout.channels,
        times=None if times is None else times - times[0],
        truth={name: np.asarray(held[name], dtype=float) for name in layout.truth},
    )


class DataFile(Counting):
    """A data file as an array: its frames in their order.

    Attributes
    ----------
    pads : int or None
        Pads side by side, where the layout says so.
    pitch : float or None
        Distance of the taxels, m, where the layout says so.
    calibration, total_frames
        As in `cnnum.drivers.mcap_file.McapFile`.
    """

    def __init__(
        self,
        recording: Recording,
        layout: DataLayout | None = None,
        calibration: Calibration | None = None,
    ) -> None:
        super().__init__()
        self.recording = recording
        self.shape: Shape = recording.shape
        self.channels = recording.channels
        self.unit = recording.unit
        self.rate = recording.rate
        self.calibration = calibration
        self.pads = None if layout is None else layout.pads
        self.pitch = None if layout is None else layout.pitch
        self.total_frames = len(recording)

    def frames(self) -> Iterator[Frame]:
        """Yield the frames as fast as they are fetched; a second call starts again."""
        self._counters = Counters()
        known = self.calibration.identity if self.calibration else ""
        for frame in self.recording.frames():
            self.count(repeated=frame.repeated)
            yield replace(frame, calibration=known) if known else frame
