"""Results of tasks on disk: a file each, written whole, so that a kill loses none that is done."""

import io
import json
import shutil
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cnnum.errors import TemplateFileError
from cnnum.safety.files import write_whole

MANIFEST = "manifest.json"


class ChunkStore:
    """The folder in which a sweep's results lie until all are there.

    Parameters
    ----------
    folder : Path
    key : str
        Of the experiment; results of another are refused.
    """

    def __init__(self, folder: Path, key: str) -> None:
        self.folder, self.key = folder, key

    def chunk(self) -> int | None:
        """Return the runs of a task that the sweep began with, None where it begins now.

        Raises
        ------
        TemplateFileError
            If the folder holds another experiment.
        """
        manifest = self.folder / MANIFEST
        if not manifest.exists():
            return None
        found = json.loads(manifest.read_text(encoding="utf-8"))
        if found["key"] != self.key:
            raise TemplateFileError(
                f"The folder '{self.folder}' holds another experiment's results: give another "
                "--output, or remove it."
            )
        return int(found["chunk"])

    def begin(self, chunk: int) -> None:
        """Make the folder, and note how many runs a task has."""
        self.folder.mkdir(parents=True, exist_ok=True)
        text = json.dumps({"key": self.key, "chunk": chunk})
        write_whole(self.folder / MANIFEST, text.encode())

    def missing(self, tasks: Sequence[tuple[int, int]]) -> Iterator[tuple[int, int]]:
        """Yield the tasks whose results are not there."""
        for task in tasks:
            if not self._file(task).exists():
                yield task

    def write(self, task: tuple[int, int], figures: dict[str, NDArray[Any]]) -> None:
        """Keep the results of a task, whole or not at all."""
        buffer = io.BytesIO()
        np.savez(buffer, allow_pickle=False, **figures)
        write_whole(self._file(task), buffer.getvalue())

    def read(self, tasks: Sequence[tuple[int, int]]) -> Iterator[dict[str, NDArray[Any]]]:
        """Yield the results of all tasks, in their order."""
        for task in tasks:
            with np.load(self._file(task), allow_pickle=False) as found:
                yield {name: found[name] for name in found.files}

    def remove(self) -> None:
        """Remove the folder: all its results are elsewhere."""
        shutil.rmtree(self.folder, ignore_errors=True)

    def _file(self, task: tuple[int, int]) -> Path:
        return self.folder / f"runs_{task[0]:09d}_{task[1]:09d}.npz"
