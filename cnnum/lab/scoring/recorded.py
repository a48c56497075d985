"""Real recordings as trials: two data sets of uSkin pads that hold an object.

`uskin_grasp` has slip labels of its own. In `tactile_prediction_flat_dataset` a camera on the wrist
follows a marker on the object. So the marker's motion is the motion in the hand.
"""

import warnings
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from cnnum.arrays import Floats
from cnnum.drivers.simulated.grips import Flags, Trial, first, runs
from cnnum.drivers.text_table import read_table
from cnnum.drivers.uskin_csv import UskinCsvOptions
from cnnum.errors import RecordingError, RecordingWarning
from cnnum.frame import Frame, Quality

USKIN, FLAT = "uskin_grasp", "tactile_prediction_flat_dataset"
"""Folders of the data sets in CNNUM_RECORDINGS."""

HELD_BACK = ("4", "9", "12", "16")
"""Objects of the flat data set that no constant may be chosen on."""

SETTING: dict[str, float | bool] = {"push": 1.0, "shear_gain": 2.0, "axes": False, "pads": 2}
"""Raw counts that rise under a push; the axes' signs are not documented."""

FAST, SLOW, WINDOW, SEEN = 6e-3, 1.5e-3, 0.12, 0.7
"""m/s of a slip at least, and of none at most. Then s to each side of a speed, and the share of
rows there that must show the marker."""

LOST = 10.0
"""m: where a marker is that is not seen."""

PRESSED, RESTS, GAP = 40.0, 8, 5
"""Mean counts of both pads at least; rows that give the rest; frames until an object is dropped."""


@dataclass(frozen=True, slots=True)
class Folder:
    """A folder of one trial.

    Attributes
    ----------
    path : Path
    object : str
        Its name in the data set; empty in `uskin_grasp`.
    """

    path: Path
    object: str


def uskin_folders(root: Path) -> list[Folder]:
    """Return the labelled trials, if they are there."""
    return [Folder(file.parent, "") for file in sorted((root / USKIN).glob("*/slip_label.csv"))]


def flat_folders(root: Path, objects: tuple[str, ...] | None) -> list[Folder]:
    """Return the trials of some objects; of all but those held back unless named.

    Only the tables that name the objects are read.
    """
    result = list[Folder]()
    for file in sorted((root / FLAT).glob("*/*/meta_data.csv")):
        name = _object(file)
        wanted = name not in HELD_BACK if objects is None else name in objects
        if wanted or objects == ("all",):
            result.append(Folder(file.parent, name))
    return result


def uskin_trial(folder: Folder) -> Trial:
    """Return a trial with the labels of its own log; it counts until the object is lost.

    Raises
    ------
    CnnumError
        If a file is missing or not as it should be.
    """
    frames = _frames(folder.path)
    truths = [frame.truth for _, frame in frames if frame.truth is not None]
    if len(truths) != len(frames):
        raise RecordingError(f"Trial '{folder.path}' needs one label per row in 'slip_label.csv'.")
    slips = np.array([float(truth["slip"] > 0) for truth in truths])
    kept = np.minimum.accumulate(np.array([truth["fail"] == 0 for truth in truths]))
    return _trial(folder, frames, slips, kept)


def flat_trial(folder: Folder) -> Trial:
    """Return a trial with labels from the marker's speed; it counts while both pads are pressed.

    It raises as `uskin_trial`.
    """
    frames = _frames(folder.path)
    table = read_table(folder.path / "marker.csv")
    marker = table.numbers([f"marker1_position_{axis}" for axis in "xyz"])
    frames = [(row, frame) for row, frame in frames if row < len(marker)]
    rate = float(read_table(folder.path / "meta_data.csv").numbers(["frequency_hz"])[0, 0])
    rows = np.array([row for row, _ in frames])
    values = np.stack([frame.values for _, frame in frames])
    speed = speeds(marker, rate)[rows]
    trial = replace(_trial(folder, frames, labels(speed), held(values)), speed=speed)
    turns = [f"marker1_quaternion_{axis}" for axis in "xyzw"]
    if not set(turns) <= set(table.header):
        return trial
    return replace(trial, turning=turning(marker, table.numbers(turns), rate)[rows])


def speeds(places: Floats, rate: float) -> Floats:
    """Return the speed of a marker, m/s: the slope of a line through its places in a window.

    Parameters
    ----------
    places : (rows, 3) float, m
    rate : float, Hz

    Returns
    -------
    (rows,) float
        NaN where it is seen too rarely.
    """
    seen = np.abs(places - LOST).max(axis=1) > 1e-6
    half, values = max(2, round(WINDOW * rate)), np.full(len(places), np.nan)
    for n in range(len(places)):
        near = np.arange(max(0, n - half), min(len(places), n + half + 1))
        used = near[seen[near]]
        if len(used) >= SEEN * len(near):
            time = (used - used.mean()) / rate
            values[n] = np.linalg.norm((time[:, None] * places[used]).sum(axis=0) / (time @ time))
    return values


def turning(places: Floats, turned: Floats, rate: float) -> Floats:
    """Return how fast a marker turns, degrees/s: the slope of its turn in a window.

    Parameters
    ----------
    places : (rows, 3) float, m
    turned : (rows, 4) float
        Quaternions, the real part last.
    rate : float, Hz

    Returns
    -------
    (rows,) float
        NaN where the marker is seen too rarely.
    """
    seen = (np.abs(places - LOST).max(axis=1) > 1e-6) & (np.abs(turned).sum(axis=1) > 0.5)
    half, values = max(2, round(WINDOW * rate)), np.full(len(places), np.nan)
    for n in map(int, np.flatnonzero(seen)):
        near = np.arange(max(0, n - half), min(len(places), n + half + 1))
        used = near[seen[near]]
        if len(used) >= SEEN * len(near):
            away = Rotation.from_quat(turned[n]).inv() * Rotation.from_quat(turned[used])
            time = (used - used.mean()) / rate
            slope = (time[:, None] * away.as_rotvec()).sum(axis=0) / (time @ time)
            values[n] = np.degrees(np.linalg.norm(slope))
    return values


def labels(speed: Floats) -> Floats:
    """Return 1 for a slip, 0 for none, NaN in between and where the speed is not known."""
    with np.errstate(invalid="ignore"):
        return np.where(speed > FAST, 1.0, np.where(speed < SLOW, 0.0, np.nan))


def held(values: Floats) -> Flags:
    """Return the frames from the first in which both pads are pressed until the object is gone.

    Parameters
    ----------
    values : (frames, 4, 8, 3) float, counts
    """
    rest = np.median(values[:RESTS], axis=0)
    pads = np.split((values - rest)[..., 2], 2, axis=2)
    pressed = np.min([pad.mean(axis=(1, 2)) for pad in pads], axis=0) > PRESSED
    start = first(pressed)
    gaps = [a for a, b in runs(~pressed) if a > start and (b - a >= GAP or b == len(pressed))]
    end = gaps[0] if gaps else len(pressed)
    place = np.arange(len(pressed))
    return np.asarray((place >= start) & (place < end))


def _object(file: Path) -> str:
    table = read_table(file)
    name = table.rows[0][table.header.index("object_name")].strip()
    try:
        return str(int(float(name)))
    except ValueError:
        return name


def _frames(path: Path) -> list[tuple[int, Frame]]:
    """Return the scans of a trial with their rows; rows that repeat one are left out."""
    with warnings.catch_warnings():
        # files that end a row apart are the rule here
        warnings.simplefilter("ignore", RecordingWarning)
        scans = enumerate(UskinCsvOptions(path).open().frames())
    return [(row, frame) for row, frame in scans if Quality.REPEATED not in frame.quality]


def _trial(folder: Folder, frames: list[tuple[int, Frame]], slips: Floats, scored: Flags) -> Trial:
    times = np.array([frame.time for _, frame in frames])
    count = len(frames)
    rate = float(max(1, round((count - 1) / (times[-1] - times[0]))))
    return Trial(
        family=folder.object or USKIN,
        name=folder.path.name,
        rate=rate,
        frames=np.stack([frame.values for _, frame in frames]).astype(np.float32),
        slips=slips,
        scored=scored,
        early=np.zeros(count, dtype=bool),
        slid=np.zeros(count),
        sense=np.zeros(count, dtype=np.int64),
        direction=float("nan"),
        rows=np.array([row for row, _ in frames]),
        setting={**SETTING, "rate": rate},
    )
