"""Putting a finished file in its place, without ever replacing another."""

import contextlib
import os
import shutil
import tempfile
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

from cnnum.errors import RecordingError


@contextmanager
def placed(target: Path, *, force: bool) -> Generator[IO[bytes], None, None]:
    """Give a draft to write to; after the block it stands at `target`, synced to the disk.

    Parameters
    ----------
    target : Path
    force : bool
        Whether a file that is there already is replaced.

    Raises
    ------
    RecordingError
        If there is a file at `target` already, or the draft cannot be written; then nothing has
        changed there.
    """
    try:
        handle, name = tempfile.mkstemp(
            prefix=f".{target.name}.", suffix=".part", dir=target.parent
        )
        draft = Path(name)
        try:
            with os.fdopen(handle, "wb+") as file:
                yield file
                file.flush()
                os.fsync(file.fileno())
            draft.chmod(0o644)
            put(draft, target, force=force)
        finally:
            draft.unlink(missing_ok=True)
    except FileExistsError:
        raise taken(target) from None
    except OSError as error:
        if isinstance(error, RecordingError):
            raise
        raise RecordingError(
            f"'{target}' cannot be written: {error.strerror or error}; choose a folder that "
            "exists, has room and may be written to."
        ) from None


def taken(target: Path, way: str = "--force") -> RecordingError:
    """Return the error for a file that is there already."""
    return RecordingError(f"'{target}' is there already: choose another name, or give {way}.")


def put(draft: Path, target: Path, *, force: bool) -> None:
    """Move a file to its place.

    Raises
    ------
    FileExistsError
        If there is a file and `force` does not say to replace it; the draft stays.
    OSError
        If it cannot be moved; the draft stays.
    """
    if force:
        draft.replace(target)
    else:
        _link(draft, target)
    sync_folder(target.parent)


def sync_folder(folder: Path) -> None:
    """Bring the names of a folder to the disk, where the system can."""
    with contextlib.suppress(OSError):  # Windows opens no folders
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


def _link(draft: Path, target: Path) -> None:
    # a rename would replace a file that has come in the meantime; a link never does
    try:
        target.hardlink_to(draft)
    except FileExistsError:
        raise
    except (OSError, NotImplementedError):  # a file system without hard links
        _copy(draft, target)
    draft.unlink()


def _copy(draft: Path, target: Path) -> None:
    with draft.open("rb") as source, target.open("xb") as copy:
        try:
            shutil.copyfileobj(source, copy)
            copy.flush()
            os.fsync(copy.fileno())
        except BaseException:
            target.unlink()
            raise
