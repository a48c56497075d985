"""The folder that PoCL works in: one of this process alone, which is removed at its end.

PoCL trusts its folder: a damaged kernel in it ends the process, or gives wrong numbers. So PoCL
never sees a folder that outlives its process: `program_cache.py` keeps the files that PoCL builds,
and lays out for it those known to be whole.
"""

import atexit
import os
import shutil
import tempfile
import threading
import time
from collections.abc import Generator
from contextlib import contextmanager, suppress
from pathlib import Path

from cnnum.engines.cache import cache_folder, why_not_ours
from cnnum.engines.notices import say_once
from cnnum.safety.files import create

VARIABLE = "POCL_CACHE_DIR"
"""PoCL reads it once, when its devices are first listed. A value of the user's own stands."""

NOWHERE = str(Path(os.devnull, "none"))
"""PoCL offers no device where its folder cannot be made."""

ROOM = 4 * 1024 * 1024
"""Bytes that must fit: a program with its kernels takes some 100 kB, a large plan's 1 MB."""

STALE_S = 3600.0
"""s after which a folder that no process holds is one of a process that was killed."""

_LOCK = threading.RLock()
_OPENED = list["WorkFolder | None"]()
"""Of this process, once PoCL has been asked for devices."""


class WorkFolder:
    """A folder of this process alone, held by a lock.

    Parameters
    ----------
    base : Path
        The folder it is made in.

    Raises
    ------
    OSError
        If there is no room, or kernels could not be run from there.
    """

    __slots__ = ("_hold", "_owner", "path")

    def __init__(self, base: Path) -> None:
        self.path = Path(tempfile.mkdtemp(prefix="cnnum-", dir=base))
        self._owner, self._hold = os.getpid(), -1
        try:
            _try_room(self.path)
            self._hold = _held(self.path)
        except BaseException:
            self.close()
            raise

    @property
    def ours(self) -> bool:
        """Whether this process made it; one that was forked did not."""
        return self._owner == os.getpid()

    def close(self) -> None:
        """Remove it."""
        if self.ours:
            shutil.rmtree(self.path, ignore_errors=True)
            if self._hold >= 0:
                os.close(self._hold)
                self._hold = -1


@contextmanager
def given_a_folder() -> Generator[None]:
    """List platforms and devices within the block: PoCL takes its folder then."""
    with _LOCK:
        if VARIABLE in os.environ:
            yield
            return
        if not _OPENED:
            _OPENED.append(_open())
        work = _OPENED[0]
        os.environ[VARIABLE] = NOWHERE if work is None else str(work.path)
        try:
            yield
        finally:
            os.environ.pop(VARIABLE, None)


def work_folder() -> Path | None:
    """Return the folder that PoCL was given; None where it has another one, or is not asked yet."""
    work = _OPENED[0] if _OPENED else None
    return work.path if work is not None and work.ours else None


def _open() -> WorkFolder | None:
    for base in _bases():
        try:
            work = WorkFolder(base)
        except OSError:
            continue
        atexit.register(work.close)
        return work
    say_once(
        f"PoCL is not used: no folder with {ROOM // 2**20} MiB of room, from which programs may "
        f"run, is there for its work; set {VARIABLE} to one."
    )
    return None


def _bases() -> Generator[Path]:
    kept = cache_folder()
    if kept is not None:
        base = kept / "work"
        with suppress(OSError):
            if base.is_symlink() or (base.exists() and not base.is_dir()):
                base.unlink()
            base.mkdir(exist_ok=True, mode=0o700)
            if not (why := why_not_ours(base, base.lstat())):
                _clear_stale(base)
                yield base
            else:
                say_once(f"PoCL does not work in the cache: {why}; remove that folder.")
    with suppress(OSError):
        yield Path(tempfile.gettempdir())


def _try_room(folder: Path) -> None:
    if hasattr(os, "statvfs") and os.statvfs(folder).f_flag & getattr(os, "ST_NOEXEC", 0):
        raise OSError("programs may not be run from there")
    trial = folder / "room"
    with create(trial) as file:
        if hasattr(os, "posix_fallocate"):
            os.posix_fallocate(file.fileno(), 0, ROOM)
        else:
            file.write(bytes(ROOM))
    trial.unlink()


def _held(folder: Path) -> int:
    """Return a lock that the system drops when the process ends; −1 where there are none."""
    try:
        import fcntl
    except ImportError:
        return -1
    handle = os.open(folder / "in-use", os.O_CREAT | os.O_RDWR | os.O_CLOEXEC, 0o600)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        os.close(handle)
        return -1
    return handle


def _clear_stale(base: Path) -> None:
    """Remove folders of processes that were killed."""
    for folder in base.glob("cnnum-*"):
        with suppress(OSError):
            if time.time() - folder.lstat().st_mtime < STALE_S:
                continue
            handle = _held(folder)
            if handle >= 0:
                shutil.rmtree(folder, ignore_errors=True)
                os.close(handle)
