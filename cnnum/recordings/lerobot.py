"""Recordings as episodes of a LeRobot data set (layout 3.0): touch beside the pictures of a robot.

The row of a picture holds the taxel frames that came since the picture before, with their own
times, so that nothing is resampled, filled or lost. The tables need pyarrow; the rest is JSON.
"""

import csv
import io
import json
import os
import re
import shutil
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cnnum.arrays import Floats
from cnnum.errors import ArrayError, RecordingError, missing_extra, name_error, unreadable
from cnnum.recordings.hdf5_file import read_hdf5
from cnnum.recordings.recording import Recording
from cnnum.safety.files import (
    make_folder,
    refuse_folder,
    sentences,
    write_whole,
    written_folder,
)
from cnnum.safety.reading import read_text
from cnnum.safety.values import shown

TACTILE = "observation.tactile"
NEW, TIMES, FLAGS = (f"{TACTILE}_{name}" for name in ("new", "time", "quality"))
EVENTS = "observation.tactile_events"
TIME = "timestamp"
PLACE = ("episode_index", "index", "task_index")
"""Features that say where in the data set a row is."""

VERSION = "v3.0"
INFO = "meta/info.json"
NUMBERED = "chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
FILES_A_CHUNK = 1000
DATA_MB = 100
"""Bytes of a data file, in MB, after which the next one begins."""

MOST_FRAMES = 1000
"""Taxel frames of one picture."""

QUANTILES = (0.01, 0.1, 0.5, 0.9, 0.99)

LONGEST_TABLE = 1 << 28
"""Bytes of the longest table of states that is read."""

MOST_EPISODES = 1_000_000
"""Episodes of the largest data set that is read."""

LONGEST_INFO = 1 << 24
"""Bytes of the longest description of a data set that is read."""


@dataclass(frozen=True, slots=True, eq=False)
class Packed:
    """Taxel frames by pictures.

    Attributes
    ----------
    frames : (pictures, n, rows, cols, channels) float32
        The last `n` that had come by the picture's time, the newest last. Before the first frame
        has come often enough, the first stands in.
    new : (pictures,) int
        How many of them came since the picture before.
    times : (pictures,) float, s
        Of the pictures.
    taken : (pictures, n, 2) float
        Time of each frame, s since the first, and its flags.
    """

    frames: NDArray[np.float32]
    new: NDArray[np.int64]
    times: Floats
    taken: Floats


def packed(recording: Recording, fps: float, window: int | None = None) -> Packed:
    """Return the taxel frames by the pictures in whose time they came.

    Parameters
    ----------
    recording : Recording
    fps : float
        Pictures per second. Picture k is at k / fps after the first taxel frame, and the last one
        at or after the last frame.
    window : int, optional
        Frames per picture; by default as many as the most that came in the time of one.

    Raises
    ------
    ArrayError
        If the rate makes no sense, or a picture would hold too many frames, or fewer than came.
    """
    if not 0.0 < fps < 1e4:
        raise ArrayError(f"The picture rate must be above 0 Hz and below 10 kHz, got {fps!r}.")
    since = recording.times - recording.times[0]
    times = np.arange(int(np.ceil(since[-1] * fps - 1e-6)) + 1) / fps
    # the newest frame that had come at each picture; a millionth of its time is no delay
    last = np.searchsorted(since, times + 1e-6 / fps, side="right") - 1
    new = np.diff(last, prepend=-1)
    usual = max(1, int(np.ceil(recording.rate / fps - 1e-9)))
    held = max(usual, int(new.max())) if window is None else window
    if held > MOST_FRAMES:
        raise ArrayError(f"A picture can hold at most {MOST_FRAMES} taxel frames, got {held}.")
    if new.max() > held:
        raise ArrayError(
            f"A picture of this data set holds {held} taxel frames, and {new.max()} came in the "
            "time of one."
        )
    index = np.maximum(last[:, np.newaxis] + np.arange(1 - held, 1), 0)
    taken = np.stack([since[index], np.asarray(recording.quality, float)[index]], axis=2)
    return Packed(np.asarray(recording.values[index], np.float32), new, times, taken)


@dataclass(frozen=True, slots=True, eq=False)
class Episode:
    """One episode of a data set.

    Attributes
    ----------
    recording : Recording
    task : str
        In words.
    states : mapping of str to (times, {column: values})
        Features such as "observation.state" and "action", with times in s after the first taxel
        frame. A picture takes the newest row that had come.
    events : mapping of str to (n,) float
        Times of the events of each kind, s after the first taxel frame.
    """

    recording: Recording
    task: str = "touch"
    states: Mapping[str, tuple[ArrayLike, Mapping[str, ArrayLike]]] = field(
        default_factory=dict[str, tuple[ArrayLike, Mapping[str, ArrayLike]]]
    )
    events: Mapping[str, Sequence[float]] = field(default_factory=dict[str, Sequence[float]])


@dataclass(frozen=True, slots=True, eq=False)
class _Feature:
    """A column of the data, (rows, ...), and how `info.json` describes it."""

    values: NDArray[Any]
    names: Sequence[str] | None = None
    info: Mapping[str, object] | None = None

    @property
    def shape(self) -> tuple[int, ...]:
        return self.values.shape[1:] or (1,)

    def description(self) -> dict[str, object]:
        result: dict[str, object] = {"dtype": str(self.values.dtype), "shape": list(self.shape)}
        result["names"] = list(self.names) if self.names else None
        if self.info:
            result["info"] = dict(self.info)
        return result


def read_states(path: Path) -> dict[str, tuple[Floats, dict[str, Floats]]]:
    """Return the states and actions of a CSV file, as `Episode.states` has them.

    Parameters
    ----------
    path : Path
        A line of names, then numbers: "timestamp" in s after the first taxel frame, rising, and
        columns such as "observation.state.elbow" and "action.grip", of which the last part is the
        name within the feature.

    Raises
    ------
    RecordingError
        If the file cannot be read, or is not such a table.
    """
    try:
        lines = list(csv.reader(io.StringIO(read_text(path, most=LONGEST_TABLE))))
    except OSError as error:
        raise unreadable(RecordingError, f"'{path}'", error) from None
    except (csv.Error, UnicodeError) as error:
        raise RecordingError(f"'{path}' is not a table in UTF-8: {error}.") from None
    rows = [(number, row) for number, row in enumerate(lines, 1) if row]
    names = [name.strip().removeprefix("\ufeff") for name in rows[0][1]] if rows else []
    features = {name.rpartition(".")[0] for name in names if name != TIME}
    if names.count(TIME) != 1 or len({*names}) < len(names) or not all(features):
        raise RecordingError(
            f"'{path}' must begin with a line of names, each once, '{TIME}' and such as "
            f"'action.grip', got {shown(', '.join(names))}."
        )
    values = np.empty((len(rows) - 1, len(names)))
    for place, (number, row) in enumerate(rows[1:]):
        try:
            values[place] = np.reshape([float(text) for text in row], len(names))  # no less
        except ValueError:
            raise RecordingError(
                f"Line {number} of '{path}' must have {len(names)} numbers, got "
                f"{shown(','.join(row))}."
            ) from None
    times = values[:, names.index(TIME)]
    if not np.isfinite(values).all() or (np.diff(times) < 0).any():
        raise RecordingError(f"The numbers of '{path}' must be finite, and its times rising.")
    states: dict[str, dict[str, Floats]] = {}
    for place, name in enumerate(names):
        if name != TIME:
            feature, _, own = name.rpartition(".")
            states.setdefault(feature, {})[own] = values[:, place]
    return {feature: (times, columns) for feature, columns in states.items()}


def write_lerobot(
    episodes: Sequence[Episode],
    folder: Path,
    fps: float,
    *,
    robot: str = "unknown",
    append: bool = False,
) -> int:
    """Write a data set, or append episodes to one that this function wrote.

    A set is replaced as a whole, so that a killed process leaves the old one or the new one.

    Parameters
    ----------
    episodes : sequence of Episode
        Of one array.
    folder : Path
        New, unless episodes are appended.
    fps : float
        Pictures per second.
    robot : str
        Type of the robot.
    append : bool
        Whether the episodes follow those of the set that is there.

    Returns
    -------
    int
        Rows of all episodes that were written now.

    Raises
    ------
    MissingExtraError
        If pyarrow is not installed.
    ArrayError
        As `packed`, or if states do not cover their episode.
    RecordingError
        If the folder is there already or cannot be written, or episodes have other features.
    """
    try:
        arrow: Any = import_module("pyarrow")
        parquet: Any = import_module("pyarrow.parquet")
    except ImportError:
        raise missing_extra("LeRobot's layout", "pyarrow", "lerobot") from None
    if not episodes:
        raise RecordingError("A data set must have at least one episode, got none.")
    for episode in episodes:
        if not isinstance(cast("object", episode), Episode):
            raise RecordingError(f"Episodes must be of the type Episode, got {shown(episode)}.")
        if not episode.task.strip():
            raise RecordingError("The task of an episode must be said in words, got none.")
    old = read_info(folder) if append else None
    if not append and _is_own(folder):
        raise RecordingError(
            f"'{folder}' already exists; choose another name, or give --append (in Python "
            "append=True)."
        )
    if folder.parent.is_dir():  # else it is made, and nothing is in the way
        refuse_folder(folder, error=RecordingError, force=append, owns=_is_own)
    if old is not None and old.get("fps") != _plain(fps):
        raise RecordingError(f"'{folder}' has {old.get('fps')} pictures per second, not {fps:g}.")
    window = None if old is None else _held(folder, old)
    if window is None:
        window = max(packed(episode.recording, fps).frames.shape[1] for episode in episodes)
    features = dict[str, Any]() if old is None else dict(features_of(folder, old))
    rows = 0
    with sentences(folder, RecordingError):
        make_folder(folder.parent)
    with written_folder(folder, error=RecordingError, force=append, owns=_is_own) as draft:
        writer = _Set(draft, arrow, parquet)
        if old is not None:
            writer.take_over(folder, old)
        for episode in episodes:  # one at a time: all windows may be larger than the memory
            table = _columns(episode, fps, window)
            own = {name: column.description() for name, column in table.items()}
            features = features or own
            _refuse_other(features, own)
            writer.add(table, episode.task)
            rows += len(table[TACTILE].values)
        writer.finish(features, fps, robot if old is None else str(old.get("robot_type")))
    return rows


def _numbers(name: str, values: ArrayLike) -> Floats:
    try:
        numbers = np.asarray(values, np.float64)
    except (TypeError, ValueError):
        raise ArrayError(f"{name} must be numbers, got {shown(values)}.") from None
    if not np.isfinite(numbers).all():
        raise ArrayError(f"{name} must be finite, got NaN or infinity.")
    return numbers


def _columns(episode: Episode, fps: float, window: int) -> dict[str, _Feature]:
    """Return the features of an episode but for its place in the set."""
    touch, recording = packed(episode.recording, fps, window), episode.recording
    end = float(touch.times[-1])
    array = {
        "axes": list(recording.channels),
        "unit": recording.unit,
        "pads": recording.pads,
    }
    columns = {
        TACTILE: _Feature(touch.frames, ("frame", "row", "col", "axis"), array),
        NEW: _Feature(touch.new),
        TIMES: _Feature(touch.taken[..., 0]),
        FLAGS: _Feature(touch.taken[..., 1].astype(np.int64)),
    }
    for name, (times, rows) in episode.states.items():
        if name in {*columns, EVENTS, TIME, "frame_index", *PLACE} or not rows:
            raise ArrayError(
                f"States must have columns, and a name that no other feature has, got '{name}'."
            )
        at = _numbers(f"the times of {name}", times)
        given = [_numbers(f"{name}.{column}", own) for column, own in rows.items()]
        if at.ndim != 1 or any(own.shape != at.shape for own in given):
            raise ArrayError(f"Each column of '{name}' must have one number per time.")
        newest = np.searchsorted(at, touch.times + 1e-6 / fps, side="right") - 1
        if not len(at) or newest[0] < 0 or at[-1] < end - 1.0 / fps:
            span = f"{at[0]:g} to {at[-1]:g} s" if len(at) else "no row"
            raise ArrayError(
                f"'{name}' must cover the episode, 0 to {end:g} s after its first taxel frame, got "
                f"{span}."
            )
        columns[name] = _Feature(np.stack(given, axis=1).astype(np.float32)[newest], tuple(rows))
    if episode.events:
        edges = np.concatenate([[-np.inf], touch.times + 1e-6 / fps])
        own = {kind: _numbers(f"the times of {kind}", at) for kind, at in episode.events.items()}
        if any(((at < 0.0) | (at > end + 1e-6 / fps)).any() for at in own.values()):
            raise ArrayError(
                f"Events must lie within the episode, 0 to {end:g} s after its first taxel frame."
            )
        counts = [np.histogram(at, edges)[0] for at in own.values()]
        columns[EVENTS] = _Feature(np.stack(counts, axis=1), tuple(own))
    times = touch.times.astype(np.float32)
    return columns | {
        TIME: _Feature(times),
        "frame_index": _Feature(np.arange(len(times))),
        **{name: _Feature(np.zeros(len(times), np.int64)) for name in PLACE},
    }


class _Set:
    """A data set in a folder that is being filled.

    Parameters
    ----------
    folder : Path
    arrow, parquet : modules
    """

    def __init__(self, folder: Path, arrow: Any, parquet: Any) -> None:
        self._folder, self._arrow, self._parquet = folder, arrow, parquet
        self._tasks, self._rows = list[str](), 0
        self._episodes = list[dict[str, Any]]()
        self._data = self._first = 0
        self._writer: Any = None

    def take_over(self, folder: Path, info: Mapping[str, Any]) -> None:
        """Take what an older set holds; its data files are linked, or copied."""
        for path in sorted((folder / "data").glob("*/*.parquet")):
            place = self._folder / path.relative_to(folder)
            place.parent.mkdir(parents=True, exist_ok=True)
            with suppress(OSError):
                os.link(path, place)
            if not place.exists():
                shutil.copyfile(path, place)
        try:
            tasks = self._parquet.read_table(folder / "meta/tasks.parquet").to_pylist()
            names = {int(row["task_index"]): row[_TASK] for row in tasks}
            self._tasks = [str(names[number]) for number in range(len(names))]
            for path in sorted((folder / "meta/episodes").glob("*/*.parquet")):
                self._episodes += self._parquet.read_table(path).to_pylist()
            self._rows = int(info["total_frames"])
            ends = [(own["data/chunk_index"], own["data/file_index"]) for own in self._episodes]
        except (OSError, ValueError, LookupError, TypeError, self._arrow.ArrowException) as error:
            raise RecordingError(
                f"The tables of '{folder}' are damaged, so that nothing can be appended: {error}."
            ) from None
        chunk, number = max(ends, default=(0, -1))
        self._data = chunk * FILES_A_CHUNK + number + 1

    def add(self, table: Mapping[str, _Feature], task: str) -> None:
        """Write the rows of an episode, as one row group."""
        if task not in self._tasks:
            self._tasks.append(task)
        count, episode = len(table[TACTILE].values), len(self._episodes)
        place = {
            "episode_index": np.full(count, episode),
            "index": np.arange(self._rows, self._rows + count),
            "task_index": np.full(count, self._tasks.index(task)),
        }
        columns = {name: place.get(name, column.values) for name, column in table.items()}
        self._write(columns)
        stats = {name: _stats(values) for name, values in columns.items()}
        self._episodes.append(
            {
                "episode_index": episode,
                "tasks": [task],
                "length": count,
                "data/chunk_index": self._data // FILES_A_CHUNK,
                "data/file_index": self._data % FILES_A_CHUNK,
                "dataset_from_index": self._rows,
                "dataset_to_index": self._rows + count,
                "meta/episodes/chunk_index": 0,
                "meta/episodes/file_index": 0,
                **{f"stats/{n}/{key}": v for n, own in stats.items() for key, v in own.items()},
            }
        )
        self._rows += count

    def _write(self, columns: Mapping[str, NDArray[Any]]) -> None:
        table = self._arrow.table({name: self._array(own) for name, own in columns.items()})
        if self._writer is not None and self._first + table.nbytes > DATA_MB * 1e6:
            self._writer.close()
            self._writer, self._first = None, 0
            self._data += 1
        if self._writer is None:
            path = self._folder / "data" / _numbered(self._data)
            path.parent.mkdir(parents=True, exist_ok=True)
            self._writer = self._parquet.ParquetWriter(path, table.schema)
        self._writer.write_table(table, row_group_size=len(table))
        self._first += table.nbytes

    def _array(self, values: NDArray[Any]) -> Any:
        """Return a column as lists in lists, without a Python object for each number."""
        held = self._arrow.array(values.reshape(-1))
        for size in values.shape[:0:-1]:
            if values.shape[1:] == (1,):
                break  # LeRobot wants one number as a number
            offsets = np.arange(0, len(held) + 1, size, dtype=np.int32)
            held = self._arrow.ListArray.from_arrays(self._arrow.array(offsets), held)
        return held

    def finish(self, features: Mapping[str, object], fps: float, robot: str) -> None:
        """Write what describes the set."""
        if self._writer is not None:
            self._writer.close()
        meta = self._folder / "meta"
        (meta / "episodes/chunk-000").mkdir(parents=True)
        count, numbers = len(self._episodes), range(len(self._tasks))
        tasks = {"task_index": list(numbers), _TASK: self._tasks}
        table = self._arrow.table(tasks).replace_schema_metadata(_pandas_index())
        self._parquet.write_table(table, meta / "tasks.parquet")
        episodes = self._arrow.Table.from_pylist(self._episodes)
        self._parquet.write_table(episodes, meta / "episodes" / _numbered(0))
        stats = {name: _merged(self._episodes, name) for name in features}
        _write_json(meta / "stats.json", stats)
        info = {
            "codebase_version": VERSION,
            "robot_type": robot,
            "total_episodes": count,
            "total_frames": self._rows,
            "total_tasks": len(self._tasks),
            "chunks_size": FILES_A_CHUNK,
            "data_files_size_in_mb": DATA_MB,
            "video_files_size_in_mb": 200,
            "fps": _plain(fps),
            "splits": {"train": f"0:{count}"},
            "data_path": f"data/{NUMBERED}",
            "video_path": None,
            "features": dict(features),
        }
        _write_json(self._folder / INFO, info)


_TASK = "task"
"""Column of the tasks' words, which LeRobot reads as the index of a pandas table."""


def _pandas_index() -> dict[str, str]:
    """Return the mark by which pandas takes the column of words as its index."""
    index = {"name": _TASK, "field_name": _TASK, "pandas_type": "unicode", "numpy_type": "object"}
    column = {
        "name": "task_index", "field_name": "task_index", "pandas_type": "int64",
        "numpy_type": "int64", "metadata": None,
    }  # fmt: skip
    table = {
        "index_columns": [_TASK],
        "column_indexes": [],
        "columns": [column, index | {"metadata": None}],
        "pandas_version": "2.2.0",
    }
    return {"pandas": json.dumps(table)}


def _numbered(number: int) -> str:
    return NUMBERED.format(chunk_index=number // FILES_A_CHUNK, file_index=number % FILES_A_CHUNK)


def _stats(values: NDArray[Any]) -> dict[str, Any]:
    """Return what LeRobot normalises by: over the rows, for each number of a feature.

    Rows in which it is NaN do not count; 0 stands for a taxel that has no number in any row.
    """
    flat = np.asarray(values, np.float64).reshape(len(values), *(values.shape[1:] or (1,)))
    known = np.isfinite(flat)
    flat = np.where(known, flat, np.nan)
    flat[:, ~known.any(axis=0)] = 0.0
    quantiles = np.nanquantile(flat, QUANTILES, axis=0)
    return {
        "min": np.nanmin(flat, axis=0).tolist(),
        "max": np.nanmax(flat, axis=0).tolist(),
        "mean": np.nanmean(flat, axis=0).tolist(),
        "std": np.nanstd(flat, axis=0).tolist(),
        "count": [len(flat)],
        **{f"q{100 * q:02.0f}": own.tolist() for q, own in zip(QUANTILES, quantiles, strict=True)},
    }


def _merged(episodes: Sequence[Mapping[str, Any]], name: str) -> dict[str, Any]:
    """Return the statistics of all episodes from those of each; quantiles are weighted means."""
    given = {
        key: np.array([own[f"stats/{name}/{key}"] for own in episodes], np.float64)
        for key in ("min", "max", "mean", "std", "count", *(f"q{100 * q:02.0f}" for q in QUANTILES))
    }
    counts = given["count"][:, 0]
    share = counts / counts.sum()
    mean = np.tensordot(share, given["mean"], 1)
    variance = np.tensordot(share, given["std"] ** 2 + (given["mean"] - mean) ** 2, 1)
    result = {
        "min": given["min"].min(axis=0),
        "max": given["max"].max(axis=0),
        "mean": mean,
        "std": np.sqrt(variance),
        "count": counts.sum(keepdims=True).astype(np.int64),
        **{key: np.tensordot(share, own, 1) for key, own in given.items() if key[0] == "q"},
    }
    return {key: value.tolist() for key, value in result.items()}


def _plain(fps: float) -> float:
    return int(fps) if fps == int(fps) else fps


def _write_json(path: Path, table: Mapping[str, Any]) -> None:
    text = json.dumps(table, indent=4, ensure_ascii=False) + "\n"
    write_whole(path, text, error=RecordingError)


def _refuse_other(features: Mapping[str, Any], other: Mapping[str, Any]) -> None:
    """Raise if two episodes do not have the same features."""
    for name in dict.fromkeys((*features, *other)):
        if features.get(name) != other.get(name):
            raise RecordingError(
                f"The episodes of a data set must have the same features, but '{name}' differs: "
                f"{shown(str(features.get(name)))} and {shown(str(other.get(name)))}."
            )


# reading

EPISODE = re.compile(r"episode-(\d{1,9})")
"""Name by which an episode of a set is addressed, as in "set/episode-000003"; no such file is."""


def episode_of(path: Path) -> tuple[Path, int] | None:
    """Return the data set and the number of an episode's address; None if it is none."""
    match = EPISODE.fullmatch(path.name)
    if match is None or not is_lerobot(path.parent):
        return None
    return path.parent, int(match[1])


def episodes_of(folder: Path) -> list[Path]:
    """Return the addresses of the episodes of a data set.

    Raises
    ------
    RecordingError
        As `read_info`.
    """
    count = read_info(folder)["total_episodes"]
    return [address(folder, number) for number in range(min(count, MOST_EPISODES))]


def address(folder: Path, number: int) -> Path:
    """Return the address of an episode."""
    return folder / f"episode-{number:06d}"


def is_lerobot(folder: Path) -> bool:
    """Return whether a folder is a data set of LeRobot."""
    try:
        return (folder / INFO).is_file()
    except (OSError, ValueError):  # a name that no file can have
        return False


def _is_own(folder: Path) -> bool:
    """Return whether a folder holds nothing but what `write_lerobot` writes."""
    files = {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}
    return INFO in files and all(OWN.fullmatch(name) for name in files)


OWN = re.compile(
    r"(data|meta/episodes)/chunk-\d+/file-\d+\.parquet|meta/(info\.json|stats\.json|tasks\.parquet)"
)
"""Files of a set of taxels alone; one with pictures, or a user's own files, is not replaced."""


def read_info(folder: Path) -> dict[str, Any]:
    """Return the description of a data set.

    Raises
    ------
    RecordingError
        If there is none, or it is of another version of the layout.
    """
    path = folder / INFO
    try:
        held: Any = json.loads(read_text(path, most=LONGEST_INFO))
    except OSError as error:
        raise unreadable(RecordingError, f"'{path}'", error) from None
    except (ValueError, RecursionError):
        raise RecordingError(f"'{path}' is not JSON.") from None
    info = cast("dict[str, Any]", held) if isinstance(held, dict) else {}
    version = info.get("codebase_version")
    if version != VERSION:
        raise RecordingError(
            f"'{folder}' has LeRobot's layout {shown(version)}, and {VERSION} is read; LeRobot "
            "converts older sets."
        )
    for name in ("total_episodes", "total_frames"):
        count: Any = info.get(name)
        if not isinstance(count, int) or count < 0:
            raise RecordingError(f"'{path}' must give '{name}', got {shown(count)}.")
    return info


def features_of(folder: Path, info: Mapping[str, Any]) -> Mapping[str, dict[str, Any]]:
    """Return the descriptions of the features of a data set."""
    features: Any = info.get("features")
    described = isinstance(features, dict) and all(
        isinstance(own, dict) for own in cast("dict[str, Any]", features).values()
    )
    if not described:
        raise RecordingError(f"'{folder / INFO}' does not describe the features of the set.")
    return cast("dict[str, dict[str, Any]]", features)


def _held(folder: Path, info: Mapping[str, Any]) -> int:
    """Return the taxel frames of a picture in a set that `write_lerobot` wrote."""
    features = features_of(folder, info)
    shape: Any = features.get(TACTILE, {}).get("shape")
    sizes: list[Any] = [*shape] if NEW in features and isinstance(shape, list) else []
    if len(sizes) != 4 or not isinstance(sizes[0], int):
        raise RecordingError(f"'{folder}' is not a data set that cnnum wrote: write a new one.")
    return sizes[0]


def read_lerobot(path: Path, feature: str = TACTILE) -> Recording:
    """Return the taxels of an episode.

    Parameters
    ----------
    path : Path
        "SET/episode-000003", or the folder of a set that has one episode.
    feature : str
        The feature with the taxels. In a set that cnnum did not write it has the shape (rows,
        cols), (rows, cols, axes) or (frames, rows, cols, axes), of which the last frame counts.

    Raises
    ------
    MissingExtraError
        If pyarrow is not installed.
    RecordingError
        If there is no such episode, or the set has another layout or no taxels.
    """
    folder, number = episode_of(path) or (path, None)
    info, episodes = read_info(folder), episodes_of(folder)
    if number is None and len(episodes) != 1:
        some = f"one of them, such as '{episodes[0]}'" if episodes else "a set that has some"
        raise RecordingError(f"'{folder}' has {len(episodes)} episodes: choose {some}.")
    number = number or 0
    if number >= len(episodes):
        raise RecordingError(f"'{folder}' has {len(episodes)} episodes, none with number {number}.")
    features = features_of(folder, info)
    if feature not in features:
        raise name_error("feature", feature, tuple(features))
    own = feature == TACTILE and NEW in features
    wanted = ["episode_index", TIME, feature, *((NEW, TIMES, FLAGS) if own else ())]
    columns = _rows(folder, number, wanted)
    values = columns[feature]
    if own:
        described: Any = features[feature].get("info")
        array = cast("dict[str, Any]", described) if isinstance(described, dict) else {}
        return _unpacked(columns, array)
    if values.ndim == 5:
        values = values[:, -1]
    if values.ndim not in (3, 4):
        raise RecordingError(
            f"The feature '{feature}' has the shape {values.shape[1:]}: taxels have (rows, cols), "
            "(rows, cols, axes) or (frames, rows, cols, axes)."
        )
    values = values if values.ndim == 4 else values[..., np.newaxis]
    return Recording(values, times=np.round(columns[TIME].astype(float), 6))


def _unpacked(columns: Mapping[str, NDArray[Any]], array: Mapping[str, Any]) -> Recording:
    """Return the frames that came with each row, in their order."""
    windows = columns[TACTILE]
    shape = windows.shape[:2]
    if windows.ndim != 5 or columns[TIMES].shape != shape or columns[FLAGS].shape != shape:
        raise RecordingError(f"The features '{TACTILE}', '{TIMES}' and '{FLAGS}' do not agree.")
    count = int(shape[1])
    new = np.clip(columns[NEW].astype(np.int64), 0, count)
    fresh = np.arange(count) >= count - new[:, np.newaxis]
    return Recording(
        windows[fresh],
        unit=str(array.get("unit", "count")),
        channels=array.get("axes"),
        times=columns[TIMES][fresh],
        quality=columns[FLAGS][fresh],
        pads=array.get("pads"),
    )


def _rows(folder: Path, number: int, wanted: list[str]) -> dict[str, NDArray[Any]]:
    """Return the columns of an episode's rows; the table of the episodes names its file."""
    parts = list[dict[str, NDArray[Any]]]()
    places = ["episode_index", "data/chunk_index", "data/file_index"]
    for table in sorted((folder / "meta/episodes").glob("*/*.parquet")):
        names, held = read_hdf5(table, places)
        if not held:
            raise RecordingError(f"'{table}' has no columns {', '.join(places)}, only {names}.")
        for chunk, file in zip(
            *(held[name][held["episode_index"] == number] for name in places[1:]), strict=True
        ):
            path = folder / f"data/chunk-{int(chunk):03d}/file-{int(file):03d}.parquet"
            names, columns = read_hdf5(path, wanted, ("episode_index", number))
            if not columns:
                raise RecordingError(
                    f"'{path}' lacks features that the set describes: it has {names}."
                )
            rows = columns["episode_index"] == number
            parts.append({name: values[rows] for name, values in columns.items()})
    if len(parts) != 1 or not len(parts[0][TIME]):
        raise RecordingError(f"'{folder}' holds no rows of the episode {number}.")
    return parts[0]
