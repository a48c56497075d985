"""Built programs, kept from one process to the next.

PoCL builds in two turns: a program, and a kernel when it is first launched. The files of both in
PoCL's folder (`pocl.py`) are kept as one entry. They are laid out there before the program
is built again. Of other drivers the program's binary is kept, unless they have a cache of their
own. PyOpenCL's caches are switched off: it loads damaged files, and fails where it cannot write.
"""

import atexit
import hashlib
import io
import json
import os
import shutil
import threading
import time
import warnings
import zipfile
from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from threading import Lock
from typing import cast

import pyopencl as cl
from pyopencl.characterize import has_src_build_cache

from cnnum.engines.cache import Shelf
from cnnum.engines.devices.pocl import work_folder
from cnnum.engines.notices import processor
from cnnum.version import __version__

SHELF = Shelf("kernels")

DELAY_S = 1.0
"""s after a build, after which its kernels are kept even if the process is killed later."""

YOUNG_S = 30.0
"""s after a build, within which the timer looks for kernels that were built later. At the end of
the process all programs are looked at: a walk over hundreds of folders every second takes long."""

PASSED_OVER = frozenset({"last_accessed", "build.log"})
"""Files of PoCL's that say nothing about a program."""

_LOCK = threading.Lock()

_WRITING = threading.Lock()
"""PyOpenCL writes the calls of a kernel as Python under a new name. Threads could take the same."""


@dataclass(slots=True)
class _Laid:
    """The part of PoCL's folder for one program: its folders, and the files that are kept of it."""

    folders: frozenset[Path]
    kept: frozenset[str]
    built: float = field(default_factory=time.monotonic)


_PROGRAMS = dict[str, _Laid]()
"""Of this process, by the name of their entry."""

_TIMERS = list[threading.Timer]()


def switch_off_pyopencl_caches() -> None:
    """Let PyOpenCL keep nothing, unless the user has set its variable."""
    if "PYOPENCL_NO_CACHE" not in os.environ:
        setattr(cl, "_PYOPENCL_NO_CACHE", True)  # noqa: B010  (it has no other way after import)


def make_kernel(program: cl.Program, name: str) -> cl.Kernel:
    """Return a kernel of a built program; several threads may ask at once."""
    with _WRITING:
        return cl.Kernel(program, name)


def build_kept(context: cl.Context, source: str, options: Sequence[str]) -> cl.Program:
    """Return a built program, from its kept files where there are any.

    Raises
    ------
    pyopencl.RuntimeError
        If the compiler refuses the source.
    """
    device = context.devices[0]
    folder = work_folder()
    if os.environ.get("POCL_KERNEL_CACHE", "1") != "1" or not has_src_build_cache(device):
        folder = None
    name = _name(device, source, options)
    if folder is not None:
        return _build_in(folder, name, context, source, options)
    if has_src_build_cache(device):
        return _built(cl.Program(context, source), options)
    return _build_binary(name, context, source, options)


def _built(program: cl.Program, options: Sequence[str]) -> cl.Program:
    done: cl.Program = program.build(options=list(options))
    return done


def _name(device: cl.Device, source: str, options: Sequence[str]) -> str:
    here = processor()
    # PoCL's names for programs depend on where it is installed
    origin = [__version__, cl.__file__, source, *options, device.platform.version, device.name]
    origin += [device.version, device.driver_version]
    origin += [here.name, here.family, here.model, *sorted(here.flags)]
    return hashlib.sha256(json.dumps([str(part) for part in origin]).encode()).hexdigest()[:32]


def _build_binary(
    name: str, context: cl.Context, source: str, options: Sequence[str]
) -> cl.Program:
    binary = SHELF.get(name)
    if binary is not None:
        try:
            return _built(cl.Program(context, context.devices, [binary]), options)
        except cl.Error:  # a driver that has changed without a new version
            SHELF.drop(name)
    program = _built(cl.Program(context, source), options)
    (made,) = cast(list[bytes], program.get_info(cl.program_info.BINARIES))
    if made:
        SHELF.put(name, made)
    return program


def _build_in(
    folder: Path, name: str, context: cl.Context, source: str, options: Sequence[str]
) -> cl.Program:
    with _LOCK:
        if name in _PROGRAMS:
            program = _built(cl.Program(context, source), options)
            _PROGRAMS[name].built = time.monotonic()
        else:
            before = _folders(folder)
            kept = _lay_out(folder, name, before)
            program = _built(cl.Program(context, source), options)
            made = _folders(folder) - before
            _PROGRAMS[name] = _Laid(frozenset(map(Path, made)), kept)
    _keep_soon()
    return program


def _folders(folder: Path) -> set[str]:
    """Return PoCL's folders of programs: the first letters of a checksum, and the others."""
    outer = [entry.path for entry in _entries(folder) if entry.is_dir()]
    return {entry.path for place in outer for entry in _entries(place)}


def _entries(folder: str | Path) -> list[os.DirEntry[str]]:
    with os.scandir(folder) as entries:
        return list(entries)


def _lay_out(folder: Path, name: str, before: set[str]) -> frozenset[str]:
    """Give PoCL the files of an entry; return their names."""
    content = SHELF.get(name)
    if content is None:
        return frozenset()
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as entry:
            entry.extractall(folder)
            return frozenset(entry.namelist())
    except (OSError, zipfile.BadZipFile):  # a full disk: half a file must not stay
        for made in _folders(folder) - before:
            shutil.rmtree(made, ignore_errors=True)
        return frozenset()


def _keep_soon() -> None:
    with _LOCK:
        if not _TIMERS:
            atexit.register(keep_programs)
        elif _TIMERS[0].is_alive():
            return
        timer = threading.Timer(DELAY_S, keep_programs, [YOUNG_S])
        timer.daemon = True
        _TIMERS[:] = [timer]
        timer.start()


def keep_programs(young: float = float("inf")) -> None:
    """Keep the files that PoCL has built since the last time.

    Parameters
    ----------
    young : float
        s since its build, after which a program is passed over.
    """
    folder = work_folder()
    if folder is None:
        return
    since = time.monotonic() - young
    with _LOCK:
        recent = ((name, laid) for name, laid in _PROGRAMS.items() if laid.built >= since)
        for name, laid in recent:
            with suppress(OSError):  # PoCL has just moved or removed a file: the next time keeps it
                files = _files_of(laid.folders, folder)
                if not laid.kept >= files.keys():
                    SHELF.put(name, _packed(files))
                    laid.kept = frozenset(files)


def _files_of(folders: Iterable[Path], base: Path) -> dict[str, Path]:
    return {
        file.relative_to(base).as_posix(): file
        for made in folders
        for inside, _, names in os.walk(made)
        for file in (Path(inside, name) for name in names if name not in PASSED_OVER)
    }


def _packed(files: dict[str, Path]) -> bytes:
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w") as entry:
        for name, file in sorted(files.items()):
            entry.write(file, name)
    return content.getvalue()


switch_off_pyopencl_caches()

_TURN = Lock()
"""Filters of warnings belong to the process: threads that set them take turns."""


def build_program(context: cl.Context, source: str, options: Sequence[str] = ()) -> cl.Program:
    """Return a built program.

    Some compilers write a line to their log at every build (Intel's: that it has started), and
    PyOpenCL warns of any log that is not empty; a faulty kernel is an error.

    Raises
    ------
    pyopencl.RuntimeError
        If the compiler refuses the source.
    """
    with _TURN, warnings.catch_warnings():
        warnings.simplefilter("ignore", cl.CompilerWarning)
        return build_kept(context, source, options)
