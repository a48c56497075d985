"""The folder that PoCL works in, and a repair of its wheel for newer processors.

The folder that PoCL works in: one of this process alone, which is removed at its end.

PoCL trusts its folder: a damaged kernel in it ends the process, or gives wrong numbers. So PoCL
never sees a folder that outlives its process: `program_cache.py` keeps the files that PoCL builds,
and lays out for it those known to be whole.

A repair of the PoCL wheel, for processors that are newer than its compiler.

The wheel's PoCL 3.0 holds LLVM 14, which names no processor newer than itself: AMD's family 26 is
"generic" to it. PoCL passes that name to its compiler after all options of a user, and the compiler
refuses every kernel: "unknown target CPU 'generic'". AMD's Zen 4 is "znver3" to it, the newest of
its kind that it names: without AVX-512. PoCL then asks for its vectors of 16 all the same, and the
compiler ends the process. PoCL has a remedy of its own, the variable POCL_LLVM_CPU_NAME, from
version 5.0 on; the wheel ends with 3.0.

PoCL's record of a device, at the address that PyOpenCL gives as `Device.int_ptr`, holds a pointer
to the name. The repair points it at a name that LLVM 14 knows, before the first kernel is built. It
is made for this exact build alone. It is used only after a child process has shown that the
repaired device works (`selection.py`).
"""

import atexit
import ctypes
import os
import shutil
import tempfile
import threading
import time
from collections.abc import Generator
from contextlib import contextmanager, suppress
from pathlib import Path

import pyopencl as cl

from cnnum.engines.cache import cache_folder, why_not_ours
from cnnum.engines.notices import Processor, processor
from cnnum.errors import say_once
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
    """Return the folder that PoCL was given, or None if it has another one, or is not asked yet."""
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


BUILD = "OpenCL 3.0 PoCL 3.0-rc2  Linux, Release, RELOC, LLVM 14.0.6, SLEEF, DISTRO, POCL_DEBUG"
"""Version of the wheel's platform."""

LIBRARY = "libpocl-21062cec.so"
"""The wheel's library; the digits are a checksum of its content."""

UNKNOWN, NARROWER = "generic", "znver3"
"""Names that LLVM 14 gives to newer processors: to any, and to those of AMD with AVX-512."""

TRIPLE_AT, TRIPLE = 632, b"x86_64-unknown-linux-gnu"
"""Byte of the record that points to the compiler's target: it shows that the record is as known."""

NAME_AT = 640
"""Byte of the record that points to the processor's name."""

AVX2 = frozenset({"abm", "avx2", "bmi1", "bmi2", "f16c", "fma", "movbe", "popcnt"})
AVX512 = AVX2 | {"adx", "aes", "avx512bw", "avx512cd", "avx512dq", "avx512f", "avx512vl"}
TARGETS = {"skylake-avx512": AVX512, "haswell": AVX2}
"""Names that LLVM 14 knows, the fastest first, with the instructions that each may use.

RDSEED is not among them, for no compiler takes it unasked: Linux turns it off on Zen 5, where it is
faulty. With "haswell" such a processor would still be asked for vectors of 16, and fail.
"""

_NAMES = {name: ctypes.create_string_buffer(name.encode()) for name in (*TARGETS, UNKNOWN)}
"""Memory that records point to: it lives as long as the process."""


def remedy_for(device: cl.Device) -> str | None:
    """Return the name that a device of the wheel should have, or None if its own is right."""
    if not is_wheel(device):
        return None
    return target_for(_string(device, NAME_AT).decode(), processor())


def target_for(name: str, of: Processor) -> str | None:
    """Return the name for a processor that LLVM 14 knows by one, or None if that is right."""
    wider = name == NARROWER and of.flags >= AVX512
    return best_target(of) if name == UNKNOWN or wider else None


def best_target(of: Processor) -> str | None:
    """Return the fastest target whose instructions a processor has."""
    return next((name for name, needs in TARGETS.items() if needs <= of.flags), None)


def is_wheel(device: cl.Device) -> bool:
    """Return whether a device is of the exact build that the repair is made for."""
    if str(device.platform.version) != BUILD:
        return False
    try:
        maps = Path("/proc/self/maps").read_text(encoding="utf-8", errors="replace")
    except OSError:
        return False
    return LIBRARY in maps and _string(device, TRIPLE_AT) == TRIPLE


def rename_target(device: cl.Device, name: str) -> None:
    """Let PoCL compile for the processor of that name; only where `is_wheel` holds."""
    pointer = ctypes.addressof(_NAMES[name])
    ctypes.c_void_p.from_address(int(device.int_ptr) + NAME_AT).value = pointer


def _string(device: cl.Device, at: int) -> bytes:
    """Return the text that a pointer in the record of a device points to."""
    return ctypes.c_char_p.from_address(int(device.int_ptr) + at).value or b""
