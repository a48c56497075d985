"""Sweeps: all runs of an experiment, here or on a Dask cluster, into one dataset."""

import re
import tempfile
import time
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cnnum.design.experiment import DRAW, Experiment
from cnnum.design.run_task import BLOCK, NAMES, REASON, Figures, refuse_launches, run_task
from cnnum.design.tasks import Parts, Task, run_tasks
from cnnum.errors import TemplateFileError
from cnnum.safety.files import (
    beside,
    refuse_folder,
    refuse_target,
    write_whole,
    written,
    written_folder,
)
from cnnum.safety.reading import DAMAGE, open_regular
from cnnum.sharing import dataset


class ChunkStore(Parts):
    """Partial results of a sweep: arrays with one number per run.

    Parameters
    ----------
    folder : Path
    key : str
        Key of the experiment; results of another one raise an error.
    """

    def __init__(self, folder: Path, key: str) -> None:
        super().__init__(folder, key, ".npz", TemplateFileError, "experiment")

    def write(self, task: tuple[int, int], figures: dict[str, NDArray[Any]]) -> None:
        """Keep the results of a task, whole or not at all."""
        with written(self.file(task), error=TemplateFileError, force=True) as file:
            np.savez(file, allow_pickle=False, **figures)

    def read(
        self, tasks: Sequence[tuple[int, int]], figures: Collection[str], sentence: str
    ) -> Iterator[dict[str, NDArray[Any]]]:
        """Yield the results of all tasks, in their order.

        Parameters
        ----------
        tasks : sequence of (first, last)
        figures : collection of str
            Names of the arrays that every task has, with one number per run.
        sentence : str
            Name of the array of texts, with one per run.

        Raises
        ------
        TemplateFileError
            If one of the files is damaged.
        """
        for task in tasks:
            place = self.file(task)
            try:
                with open_regular(place) as file, np.load(file, allow_pickle=False) as part_arrays:
                    part: dict[str, NDArray[Any]] = {
                        n: part_arrays[n] for n in (*figures, sentence)
                    }
                if any(
                    value.shape != (task[1] - task[0],) or value.dtype.kind not in kinds
                    for name, value in part.items()
                    for kinds in ("U" if name == sentence else "fiub",)
                ):
                    raise ValueError("expected a number or a text per run")
            except (OSError, MemoryError, *DAMAGE):
                raise TemplateFileError(
                    f"'{place}' is damaged: remove it, and the same command recreates it."
                ) from None
            yield part


Done = Callable[[int, int], None]

LEAST_SECONDS = 0.25
"""Of a task, as it is measured: a cluster takes some milliseconds for each."""

FIRST = 64
MOST = 64
"""Runs that are timed first, and blocks of a task at most."""


@dataclass(frozen=True, slots=True)
class Sweep:
    """The result of a sweep.

    Attributes
    ----------
    results : xarray.Dataset
        Results of every run, on the axes of the experiment. `failed` is 0 for a run that reached
        its end, and otherwise the number of the reason, a line in the attribute "reasons"; all
        results of such a run are NaN.
    path : Path or None
        The file that was written.
    tasks, run_now : int
        Total number of tasks, and number of those that ran now.
    seconds : float
        Wall time, s.
    task_seconds : float
        Median time of a task that ran now, s; 0 if none did.
    """

    results: Any
    path: Path | None
    tasks: int
    run_now: int
    seconds: float
    task_seconds: float


def sweep(
    experiment: Experiment,
    path: str | PathLike[str] | None = None,
    *,
    scheduler: str | None = None,
    done: Done | None = None,
    force: bool = False,
) -> Sweep:
    """Run an experiment and return its results.

    With a path, the results of each task are stored in a folder of that name with the suffix
    ".parts". A sweep that was killed resumes from there and gives the same file.

    Parameters
    ----------
    experiment : Experiment
    path : path, optional
        Path of a NetCDF file (.nc) or a Zarr folder (.zarr).
    scheduler : str, optional
        Address of a Dask scheduler. By default, this process runs all tasks.
    done : callable, optional
        Called with (tasks done, all tasks) after each one.
    force : bool
        Whether to replace existing results.

    Raises
    ------
    MissingExtraError
        If xarray is not installed, or Dask if it is requested.
    TemplateFileError
        If the suffix is unknown, the path exists already or cannot be written, or the parts beside
        it belong to another experiment.
    CnnumError
        If a launch of the experiment cannot be prepared.
    """
    refuse_launches(experiment)
    begin, target = time.perf_counter(), None if path is None else _target(Path(path))
    if target is None:
        with tempfile.TemporaryDirectory() as folder:
            store = ChunkStore(Path(folder), experiment.key)
            return _swept(experiment, store, None, scheduler, done, begin)
    refuse_results(target, force=force)
    store = ChunkStore(beside(target, ".parts"), experiment.key)
    with store.held():
        return _swept(experiment, store, target, scheduler, done, begin, force=force)


def _swept(
    experiment: Experiment,
    store: ChunkStore,
    target: Path | None,
    scheduler: str | None,
    done: Done | None,
    begin: float,
    *,
    force: bool = False,
) -> Sweep:
    dataset({}, {}, {})  # says at once that the extra is missing
    chunk = store.chunk()
    if chunk is None:
        chunk = experiment.chunk or _measured(experiment)
        store.begin(chunk)
    tasks = list(experiment.tasks(chunk))
    missing = list(store.missing(tasks))
    seconds = list[float]()
    work, name = partial(timed_task, experiment), f"sweep-{experiment.key}"
    for task, figures, spent in run_tasks(work, missing, scheduler=scheduler, name=name):
        store.write(task, figures)
        seconds.append(spent)
        if done is not None:
            done(len(tasks) - len(missing) + len(seconds), len(tasks))
    results = _dataset(experiment, store.read(tasks, NAMES, REASON))
    if target is not None:
        _write(results, target, force=force)
        store.remove()
    middle = float(np.median(seconds)) if seconds else 0.0
    return Sweep(results, target, len(tasks), len(missing), time.perf_counter() - begin, middle)


def timed_task(experiment: Experiment, task: Task) -> tuple[Task, Figures, float]:
    """Return a task, its results, and the seconds that it took."""
    begin = time.perf_counter()
    figures = run_task(experiment, *task)
    return task, figures, time.perf_counter() - begin


def _measured(experiment: Experiment) -> int:
    """Return how many runs make a task long enough, by a first few that are run twice."""
    count = min(FIRST, experiment.launched)
    run_task(experiment, 0, count)
    _, _, seconds = timed_task(experiment, (0, count))
    blocks = np.ceil(count * LEAST_SECONDS / max(seconds, 1e-6) / BLOCK)
    return int(BLOCK * min(MOST, max(1, blocks)))


def _dataset(experiment: Experiment, parts: Iterable[Figures]) -> Any:
    axes, shape = experiment.order, experiment.shape
    figures: dict[str, list[NDArray[Any]]] = {name: [] for name in (*NAMES, "failed")}
    reasons = dict[str, tuple[int, str]]()
    for part in parts:
        for name in NAMES:
            figures[name].append(part[name])
        figures["failed"].append(_numbered(part[REASON], reasons))
    variables = {
        name: (axes, np.concatenate(figure).reshape(shape)) for name, figure in figures.items()
    }
    coordinates = {name: ((name,), list(experiment.axes[name])) for name in axes if name != DRAW}
    for name, ((axis,), values) in coordinates.items():
        if len({isinstance(value, str) for value in values}) > 1:
            coordinates[name] = ((axis,), [str(value) for value in values])
    attributes = {"template": experiment.template, "experiment": experiment.key}
    if reasons:
        attributes["reasons"] = "\n".join(sentence for _, sentence in reasons.values())
    return dataset(variables, coordinates, attributes)


def _numbered(sentences: NDArray[Any], reasons: dict[str, tuple[int, str]]) -> NDArray[np.int32]:
    """Return the number of each run's reason, 0 for none; those that differ in numbers are one."""
    result = np.zeros(len(sentences), dtype=np.int32)
    for run in np.flatnonzero(sentences != "").tolist():
        sentence = " ".join(str(sentences[run]).split())
        kind = re.sub(r"[-+]?\d[\d.,]*(e[-+]?\d+)?", "#", sentence)
        result[run] = reasons.setdefault(kind, (len(reasons) + 1, sentence))[0]
    return result


def failures(results: Any) -> dict[str, int]:
    """Return the number of failed runs of a sweep for each reason.

    Parameters
    ----------
    results : xarray.Dataset
        Results of a sweep.
    """
    counts = np.bincount(results["failed"].values.ravel())[1:].tolist()
    sentences = str(results.attrs.get("reasons", "")).split("\n")
    return dict(zip(sentences, counts, strict=False))


def _target(path: Path) -> Path:
    if path.suffix not in (".nc", ".zarr"):
        raise TemplateFileError(f"'{path}' must be a NetCDF file (.nc) or a Zarr folder (.zarr).")
    return path


def refuse_results(target: Path, *, force: bool = False) -> None:
    """Check before the work that results can be written.

    Raises
    ------
    TemplateFileError
        If their folder does not exist, or an existing file may not be replaced.
    """
    if target.suffix == ".nc":
        refuse_target(target, error=TemplateFileError, force=force)
    else:
        refuse_folder(target, error=TemplateFileError, force=force, owns=_is_zarr)


def _write(results: Any, target: Path, *, force: bool) -> None:
    """Write a dataset, whole or not at all."""
    if target.suffix == ".nc":
        content = bytes(results.to_netcdf(engine="scipy"))
        write_whole(target, content, error=TemplateFileError, force=force)
        return
    with written_folder(target, error=TemplateFileError, force=force, owns=_is_zarr) as draft:
        results.to_zarr(draft, mode="w", consolidated=False)


def _is_zarr(folder: Path) -> bool:
    """Return whether a folder holds a Zarr group and its arrays, and no other file."""
    names = [path.relative_to(folder) for path in folder.rglob("*") if not path.is_dir()]
    arrays = {name.parts[0] for name in names if len(name.parts) > 1}
    chunks = all(name.name == "zarr.json" or name.parts[1:2] == ("c",) for name in names)
    return chunks and all((folder / array / "zarr.json").is_file() for array in ("", *arrays))
