"""Results of tasks on disk: a file each, written whole, so that a kill loses none that is done."""

import contextlib
import json
from collections.abc import Collection, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cnnum.errors import TemplateFileError
from cnnum.safety.files import DRAFT, make_folder, sentences, write_whole, written
from cnnum.safety.reading import DAMAGE, MEGABYTE, open_regular, read_text

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
            If the folder holds another experiment or other files, or its manifest is damaged.
        """
        manifest = self.folder / MANIFEST
        if not manifest.exists():
            with sentences(self.folder, TemplateFileError):
                if self.folder.exists() and any(
                    not path.name.startswith(DRAFT) for path in self.folder.iterdir()
                ):
                    raise TemplateFileError(
                        f"The folder '{self.folder}' holds other files than a sweep's results: "
                        "give another --output."
                    )
            return None
        key, chunk = self._noted(manifest)
        if key != self.key:
            raise TemplateFileError(
                f"The folder '{self.folder}' holds another experiment's results: give another "
                "--output, or remove it."
            )
        return chunk

    def _noted(self, manifest: Path) -> tuple[str, int]:
        """Return the experiment's key and the runs of a task, as the manifest has them."""
        try:
            found: Any = json.loads(read_text(manifest, most=MEGABYTE))
            key, chunk = found["key"], found["chunk"]
        except (OSError, ValueError, TypeError, KeyError, RecursionError):
            key = chunk = None
        if not isinstance(key, str) or type(chunk) is not int or not 0 < chunk < 1 << 40:
            raise TemplateFileError(
                f"'{manifest}' is damaged, so the results beside it cannot be used: give another "
                "--output, or remove that folder."
            )
        return key, chunk

    def begin(self, chunk: int) -> None:
        """Make the folder, and note how many runs a task has."""
        with sentences(self.folder, TemplateFileError):
            make_folder(self.folder)
        text = json.dumps({"key": self.key, "chunk": chunk})
        write_whole(self.folder / MANIFEST, text, error=TemplateFileError)

    def missing(self, tasks: Sequence[tuple[int, int]]) -> Iterator[tuple[int, int]]:
        """Yield the tasks whose results are not there."""
        for task in tasks:
            if not self._file(task).exists():
                yield task

    def write(self, task: tuple[int, int], figures: dict[str, NDArray[Any]]) -> None:
        """Keep the results of a task, whole or not at all."""
        with written(self._file(task), error=TemplateFileError, force=True) as file:
            np.savez(file, allow_pickle=False, **figures)

    def read(
        self, tasks: Sequence[tuple[int, int]], figures: Collection[str], sentence: str
    ) -> Iterator[dict[str, NDArray[Any]]]:
        """Yield the results of all tasks, in their order.

        Parameters
        ----------
        tasks : sequence of (first, last)
        figures : collection of str
            Names of the arrays of numbers that every task has, one number a run.
        sentence : str
            Name of the array of texts, one a run.

        Raises
        ------
        TemplateFileError
            If a file of them is damaged.
        """
        for task in tasks:
            place = self._file(task)
            try:
                with open_regular(place) as file, np.load(file, allow_pickle=False) as found:
                    part: dict[str, NDArray[Any]] = {n: found[n] for n in (*figures, sentence)}
                if any(
                    one.shape != (task[1] - task[0],) or one.dtype.kind not in kinds
                    for name, one in part.items()
                    for kinds in ("U" if name == sentence else "fiub",)
                ):
                    raise ValueError("expected a number or a text a run")
            except (OSError, MemoryError, *DAMAGE):
                raise TemplateFileError(
                    f"'{place}' is damaged: remove it, and the same command recreates it."
                ) from None
            yield part

    def remove(self) -> None:
        """Remove the results, which are elsewhere, and the folder if nothing else is in it."""
        with contextlib.suppress(OSError):
            for path in (*self.folder.glob("runs_*.npz"), self.folder / MANIFEST):
                path.unlink(missing_ok=True)
            for path in self.folder.glob(f"{DRAFT}*"):  # drafts of a run that was killed
                path.unlink(missing_ok=True)
            self.folder.rmdir()

    def _file(self, task: tuple[int, int]) -> Path:
        return self.folder / f"runs_{task[0]:09d}_{task[1]:09d}.npz"
