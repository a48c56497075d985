"""Tasks of a long job: their results are kept part by part, and they run here or elsewhere.

A job is cut into tasks of neighbouring items. Each result is a file next to the job's own, written
whole or not at all, so that a job that was killed goes on from there. The tasks run in this
process, in processes of this machine, or on a Dask cluster.
"""

import contextlib
import json
import os
import signal
import threading
from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import AbstractContextManager
from importlib import import_module
from multiprocessing import get_context, parent_process
from pathlib import Path
from typing import Any, TypeVar

from cnnum.errors import CnnumError, RecordingError, missing_extra
from cnnum.safety.files import DRAFT, held_folder, make_folder, sentences, write_whole
from cnnum.safety.reading import MEGABYTE, read_text

Task = tuple[int, int]
"""The first item, and the one after the last."""

Item = TypeVar("Item")
Outcome = TypeVar("Outcome")

MANIFEST = "manifest.json"

AHEAD = 2
"""Tasks that wait at each process, so that none is idle while its results are written."""

KEPT = "Finished tasks are kept"

MOST_DEATHS = 3
"""Times in a row that a process may die before a task has come to its end."""


class Parts:
    """Folder that stores the results of a job until it is complete.

    Parameters
    ----------
    folder : Path
    key : str
        Key of the job; results of another one raise an error.
    ending : str
        Suffix of the files.
    error : type of CnnumError
        Class of the errors that are raised.
    job : str
        Description of the job, for messages.
    """

    def __init__(
        self, folder: Path, key: str, ending: str, error: type[CnnumError], job: str
    ) -> None:
        self.folder, self.key = folder, key
        self.ending, self.error, self.job = ending, error, job

    def held(self) -> AbstractContextManager[None]:
        """Keep the folder for this process until the block ends, however the process ends.

        Raises
        ------
        CnnumError
            If the folder cannot be made, or another process works on it.
        """
        return held_folder(self.folder, self.error)

    def chunk(self) -> int | None:
        """Return the number of items per task with which the job began, or None if it begins now.

        Raises
        ------
        CnnumError
            If the folder contains another job or other files, or its manifest is damaged.
        """
        manifest = self.folder / MANIFEST
        if not manifest.exists():
            with sentences(self.folder, self.error):
                if self.folder.exists() and any(
                    not path.name.startswith(DRAFT) for path in self.folder.iterdir()
                ):
                    raise self.error(
                        f"The folder '{self.folder}' holds other files: choose another --output."
                    )
            return None
        key, chunk = self._noted(manifest)
        if key != self.key:
            raise self.error(
                f"The folder '{self.folder}' contains the results of another {self.job}: "
                "choose another --output, or remove it."
            )
        return chunk

    def _noted(self, manifest: Path) -> tuple[str, int]:
        """Return the job's key and the items of a task, as the manifest has them."""
        try:
            noted: Any = json.loads(read_text(manifest, most=MEGABYTE))
            key, chunk = noted["key"], noted["chunk"]
        except (OSError, ValueError, TypeError, KeyError, RecursionError):
            key = chunk = None
        if not isinstance(key, str) or type(chunk) is not int or not 0 < chunk < 1 << 40:
            raise self.error(
                f"'{manifest}' is damaged, so the results next to it cannot be used: choose "
                "another --output, or remove that folder."
            )
        return key, chunk

    def begin(self, chunk: int) -> None:
        """Create the folder, and record the number of items per task."""
        with sentences(self.folder, self.error):
            make_folder(self.folder)
        text = json.dumps({"key": self.key, "chunk": chunk})
        write_whole(self.folder / MANIFEST, text, error=self.error)

    def missing(self, tasks: Sequence[Task]) -> Iterator[Task]:
        """Yield the tasks whose results are not there."""
        for task in tasks:
            if not self.file(task).exists():
                yield task

    def remove(self) -> None:
        """Remove the results, which are elsewhere, and the folder if nothing else is in it."""
        with contextlib.suppress(OSError):
            for path in (*self.folder.glob(f"runs_*{self.ending}"), self.folder / MANIFEST):
                path.unlink(missing_ok=True)
            for path in self.folder.glob(f"{DRAFT}*"):  # drafts of a run that was killed
                path.unlink(missing_ok=True)
            self.folder.rmdir()

    def file(self, task: Task) -> Path:
        """Return the file of a task's results."""
        return self.folder / f"runs_{task[0]:09d}_{task[1]:09d}{self.ending}"


def run_tasks(
    function: Callable[[Item], Outcome],
    items: Sequence[Item],
    *,
    scheduler: str | None = None,
    workers: int = 1,
    name: str,
) -> Iterator[Outcome]:
    """Yield the result of each task as it is ready, in any order.

    A task whose process or worker died runs again, so it must be deterministic.

    Parameters
    ----------
    function : callable
        Function of one item. Both must be picklable.
    items : sequence
    scheduler : str, optional
        Address of a Dask scheduler.
    workers : int
        Number of processes if there is no scheduler; with 1, this process does the work.
    name : str
        Name of the job on the cluster.

    Raises
    ------
    MissingExtraError
        If a scheduler is given and Dask is not installed.
    RecordingError
        If processes or workers die repeatedly, or the scheduler is lost.
    """
    if scheduler:
        return _on_cluster(function, items, scheduler, name)
    if workers > 1 and len(items) > 1:
        return _in_processes(function, items, min(workers, len(items)))
    return map(function, items)


def _on_cluster(
    function: Callable[[Item], Outcome], items: Sequence[Item], scheduler: str, name: str
) -> Iterator[Outcome]:
    """Yield results as the workers of a cluster have them; those of a lost one are run again."""
    try:
        distributed: Any = import_module("dask.distributed")
    except ImportError:
        raise missing_extra("a job on several machines", "distributed", "cluster") from None
    with distributed.Client(scheduler, timeout="30s") as client:
        futures = client.map(function, items, key=name, pure=False)
        results = distributed.as_completed(futures, with_results=True)
        while True:
            try:
                future, outcome = next(results)
            except StopIteration:
                return
            except distributed.KilledWorker as error:
                raise RecordingError(
                    f"Worker after worker died before it finished a task. {KEPT}: check the memory "
                    "of the workers, and run the same command again."
                ) from error
            if future.cancelled():  # its outcome is then the reason
                raise RecordingError(
                    f"The scheduler {scheduler} was lost, or has dropped the tasks. {KEPT}: run "
                    "the same command again."
                )
            yield outcome
            future.release()


def _in_processes(
    function: Callable[[Item], Outcome], items: Sequence[Item], workers: int
) -> Generator[Outcome]:
    """Yield results of processes of this machine; the tasks of a dead one are run again."""
    waiting, deaths = deque(items), 0
    while waiting:
        running = dict[Future[Outcome], Item]()
        # forks of a process that has used OpenCL have lost it
        pool = ProcessPoolExecutor(workers, get_context("spawn"), _end_with_parent)
        try:
            while waiting or running:
                while waiting and len(running) < AHEAD * workers:
                    # taken once it is accepted: a pool may be found dead only here
                    running[pool.submit(function, waiting[0])] = waiting[0]
                    waiting.popleft()
                done, _ = wait(running, return_when=FIRST_COMPLETED)
                for future in done:
                    result = future.result()
                    del running[future]
                    deaths = 0
                    yield result
        except BrokenProcessPool:
            deaths += 1
            if deaths >= MOST_DEATHS:
                raise RecordingError(
                    f"A worker process died {deaths} times in a row before it finished a task. "
                    f"{KEPT}: check the memory of this machine, and run the same command again."
                ) from None
            waiting.extendleft(reversed(running.values()))
        finally:
            pool.shutdown(wait=True, cancel_futures=True)


def _end_with_parent() -> None:
    """Let a process of a pool end with the one that began it, however that ended."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the other process ends in order
    parent = parent_process()

    def watch() -> None:
        if parent is not None:
            parent.join()
            os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
