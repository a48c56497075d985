"""Recordings in the layout of LeRobot's datasets (version 2.1): touch with slower pictures.

Each picture's row holds the taxel frames of its time. The parquet file needs pyarrow; the rest is
JSON. A gap is never filled in silence: a row says how many of its frames are new.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cnnum.arrays import Floats
from cnnum.errors import ArrayError, RecordingError, missing_extra
from cnnum.recordings.recording import Recording
from cnnum.safety.files import (
    make_folder,
    refuse_folder,
    sentences,
    write_whole,
    written_folder,
)

TACTILE, NEW = "observation.tactile", "observation.tactile_new"

MOST_FRAMES = 1000
"""Taxel frames of one picture."""


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
    """

    frames: NDArray[np.float32]
    new: NDArray[np.int64]
    times: Floats


def packed(recording: Recording, fps: float, pictures: int | None = None) -> Packed:
    """Return the taxel frames of each picture's time.

    Parameters
    ----------
    recording : Recording
    fps : float
        Pictures a second; picture k is at k / fps from the first taxel frame.
    pictures : int, optional
        As many as the recording's time holds unless given.

    Raises
    ------
    ArrayError
        If the rate is none, or a picture would hold too many frames.
    """
    if not 0.0 < fps < 1e4:
        raise ArrayError(f"The picture rate must be above 0 Hz and below 10 kHz, got {fps!r}.")
    stride = max(1, int(np.ceil(recording.rate / fps - 1e-9)))
    if stride > MOST_FRAMES:
        raise ArrayError(f"A picture can hold at most {MOST_FRAMES} taxel frames, got {stride}.")
    since = recording.times - recording.times[0]
    count = int(since[-1] * fps + 1e-9) + 1 if pictures is None else pictures
    times = np.arange(count) / fps
    # the newest frame that had come at each picture; half a ns of rounding is no delay
    last = np.searchsorted(since, times + 5e-10, side="right") - 1
    index = np.maximum(last[:, np.newaxis] + np.arange(1 - stride, 1), 0)
    before = np.concatenate([[-1], last[:-1]])
    values = np.asarray(recording.values[index], np.float32)
    return Packed(values, np.minimum(last - before, stride), times)


def write_lerobot(
    recording: Recording, folder: Path, fps: float, *, task: str = "touch", robot: str = "unknown"
) -> int:
    """Write a data set of one episode, and return its number of rows.

    Parameters
    ----------
    recording : Recording
    folder : Path
        New: nothing may be there.
    fps : float
        Pictures a second.
    task, robot : str
        As the data set names them.

    Raises
    ------
    MissingExtraError
        If pyarrow is not installed.
    RecordingError
        If the folder is there already, or cannot be written.
    """
    try:
        arrow: Any = import_module("pyarrow")
        parquet: Any = import_module("pyarrow.parquet")
    except ImportError:
        raise missing_extra("LeRobot's layout", "pyarrow", "lerobot") from None
    if folder.parent.is_dir():  # else it is made, and nothing is in the way
        refuse_folder(folder, error=RecordingError)
    touch = packed(recording, fps)
    rows = len(touch.times)
    zeros, numbers = np.zeros(rows, np.int64), np.arange(rows)
    columns: dict[str, Any] = {
        TACTILE: touch.frames,
        NEW: touch.new[:, np.newaxis],
        "timestamp": touch.times.astype(np.float32),
        "frame_index": numbers,
        "episode_index": zeros,
        "index": numbers,
        "task_index": zeros,
    }
    with sentences(folder, RecordingError):
        make_folder(folder.parent)
    with written_folder(folder, error=RecordingError) as draft:
        data = draft / "data" / "chunk-000" / "episode_000000.parquet"
        data.parent.mkdir(parents=True)
        kinds = {np.dtype(np.float32): arrow.float32(), np.dtype(np.int64): arrow.int64()}
        table = arrow.table(
            {
                name: arrow.array(values.tolist(), _nested(arrow, kinds[values.dtype], values.ndim))
                for name, values in columns.items()
            }
        )
        parquet.write_table(table, data)
        _write_meta(recording, draft / "meta", columns, fps, task, robot)
    return rows


def _nested(arrow: Any, kind: Any, axes: int) -> Any:
    for _ in range(axes - 1):
        kind = arrow.list_(kind)
    return kind


def _write_meta(
    recording: Recording, meta: Path, columns: Mapping[str, Any], fps: float, task: str, robot: str
) -> None:
    rows = len(columns["index"])
    features: dict[str, dict[str, object]] = {
        name: {
            "dtype": str(values.dtype),
            "shape": list(values.shape[1:]) or [1],
            "names": ["frame", "row", "col", "axis"] if name == TACTILE else None,
        }
        for name, values in columns.items()
    }
    features[TACTILE]["info"] = {
        "axes": list(recording.channels),
        "unit": recording.unit,
        "rate_hz": recording.rate,
    }
    info = {
        "codebase_version": "v2.1",
        "robot_type": robot,
        "total_episodes": 1,
        "total_frames": rows,
        "total_tasks": 1,
        "total_videos": 0,
        "total_chunks": 1,
        "chunks_size": 1000,
        "fps": int(fps) if fps == int(fps) else fps,
        "splits": {"train": "0:1"},
        "data_path": "data/chunk-{episode_chunk:03d}/episode_{episode_index:06d}.parquet",
        "video_path": None,
        "features": features,
    }
    meta.mkdir()
    write_whole(meta / "info.json", json.dumps(info, indent=4), error=RecordingError)
    _line(meta / "tasks.jsonl", {"task_index": 0, "task": task})
    _line(meta / "episodes.jsonl", {"episode_index": 0, "tasks": [task], "length": rows})
    stats = {name: _stats(values) for name, values in columns.items()}
    _line(meta / "episodes_stats.jsonl", {"episode_index": 0, "stats": stats})


def _stats(values: NDArray[Any]) -> dict[str, object]:
    whole = values.astype(np.float64)
    flat = whole if whole.ndim > 1 else whole[:, np.newaxis]
    return {
        "min": flat.min(axis=0).tolist(),
        "max": flat.max(axis=0).tolist(),
        "mean": flat.mean(axis=0).tolist(),
        "std": flat.std(axis=0).tolist(),
        "count": [len(flat)],
    }


def _line(path: Path, record: dict[str, object]) -> None:
    write_whole(path, json.dumps(record, ensure_ascii=False) + "\n", error=RecordingError)
