"""The one way in which cnnum writes: whole or not at all, and never over what is not its own.

Everything that is written goes through this module; a test of the house holds all others to it.
A file is made as a draft beside its target, synced to the disk, and moved to its place in one step,
so a full disk or a kill leaves the old file or none. Three cases need more than one step, and a
kill between two of them leaves a trace. On a file system without hard links a new name is claimed
first, so that an empty file can stay. Of several files that belong together, some can be missing.
And a folder that was about to be replaced can stay beside its place, under a name with `DRAFT` at
its beginning.

The rules for every target:

* It is a regular file, or a name that is free. A device, a pipe, a socket or a folder is refused,
  and so are the streams of this process (``/dev/stdout``).
* A file that is there is replaced only where the caller says so (``force``), or where it begins as
  a report that cnnum wrote does (`MARKS`): such a page is written again. It is looked at once more
  before it is replaced, and nothing that came while the draft was filled is ever replaced.
* A replaced file keeps its mode, and its owner where the system allows it. A new one gets the mode
  that the user's umask leaves.
* A link is followed: the file that it leads to is the one that is replaced. So a link to nowhere,
  too, needs `force`.
* A folder is replaced only if it holds nothing but what such an output has, which is looked at
  again once the folder has been moved aside.
"""

import contextlib
import errno
import hashlib
import os
import re
import shutil
import stat
from collections.abc import Callable, Generator, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import IO

from cnnum.errors import CnnumError, ReportError
from cnnum.safety.reading import KINDS

MARKS = re.compile(
    rb"(?:"
    rb"(?i:<!doctype html>)\s*<html lang=['\"]en['\"]>\s*(?:<head>)?\s*"
    rb"<meta charset=['\"]utf-8['\"]>\s*"
    rb'<meta name="generator" content="cnnum">'
    rb"|\x89PNG\r\n\x1a\n(?s:.{25})\0\0\0\x0etEXtSoftware\0cnnum"
    rb'|\{\n "command": "cnnum (?:[^"\\\n]|\\.)*",\n "environment": \{'
    rb")"
)
"""How the pages, pictures and data of cnnum's reports begin.

The words of a mark prove nothing where they stand further down, or alone: a user's own page may
quote the tag, and a user's own JSON, such as the tasks of an editor, may hold such a command."""

HEAD = 4096
"""Bytes that hold the whole beginning."""

DRAFT = ".cnnum-"
"""Beginning of a draft's name, in the folder of its target."""

LONGEST_NAME = 255
"""Bytes of a file's name on all common file systems."""

MOST_LINKS = 40
"""Links that lead to each other, as many as Linux follows."""

_A_FOLDER = "a folder that exists, has room and may be written to"
_A_FILE = "a file of that name exists"

_NEW = os.O_RDWR | os.O_CREAT | os.O_EXCL
_FLAGS = getattr(os, "O_CLOEXEC", 0) | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_BINARY", 0)


@contextmanager
def written(
    target: Path, *, error: type[CnnumError] = ReportError, force: bool = False
) -> Generator[IO[bytes], None, None]:
    """Give a draft to write to and to read from; after the block it stands at `target`.

    Parameters
    ----------
    target : Path
    error : type of CnnumError
        What is raised, with a sentence, where it cannot be written.
    force : bool
        Whether an existing file is replaced.

    Raises
    ------
    CnnumError
        The leaf that was given. Then nothing has changed at `target`.
    """
    with sentences(target, error), draft(target, force=force) as file:
        yield file


def write_whole(
    target: Path,
    content: bytes | str,
    *,
    error: type[CnnumError] = ReportError,
    force: bool = False,
) -> None:
    """Write a file in one step; arguments and errors are those of `written`."""
    data = content.encode("utf-8") if isinstance(content, str) else content
    with written(target, error=error, force=force) as file:
        file.write(data)


@contextmanager
def written_by_name(
    target: Path, *, error: type[CnnumError] = ReportError, force: bool = False
) -> Generator[Path, None, None]:
    """Do as `written` does, for a library that opens files by their names.

    It gives the name of a file that is not there, in a folder of its own beside the target.
    """
    refuse_target(target, error=error, force=force)
    with sentences(target, error):
        folder = place_of(target).parent / _draft_name()
        folder.mkdir(mode=0o700)
        try:
            name = folder / f"draft{target.suffix}"
            yield name
            _sync(name)
            put(name, target, force=force or made_here(target))
        finally:
            shutil.rmtree(folder, ignore_errors=True)


def write_files(
    folder: Path,
    files: Mapping[str, bytes | str],
    *,
    error: type[CnnumError] = ReportError,
    force: bool = False,
) -> None:
    """Write several files into a folder: all drafts first, then all moves.

    The folder is made, and so are those that names lead through, as in "src/slip.c".

    All places are looked at again before the first move. The other arguments and the errors are
    those of `written`. A target that changes between two moves, or a kill, can leave some of the
    files in their places without the others; each of them is whole.
    """
    with sentences(folder, error):
        make_folder(folder)
        for name in files:
            make_folder((folder / name).parent)
    with contextlib.ExitStack() as drafts:
        for name, content in files.items():
            data = content.encode("utf-8") if isinstance(content, str) else content
            file = drafts.enter_context(written(folder / name, error=error, force=force))
            file.write(data)
            file.flush()
            with sentences(folder / name, error):
                os.fsync(file.fileno())
        for name in files:
            refuse_target(folder / name, error=error, force=force)


def refuse_target(
    target: Path, *, error: type[CnnumError] = ReportError, force: bool = False
) -> None:
    """Check before the work that a file can be put in its place.

    Raises
    ------
    CnnumError
        The leaf that was given.
    """
    with sentences(target, error):
        _old(target, place_of(target), force=force)
        if not target.parent.is_dir():
            raise FileNotFoundError(errno.ENOENT, "no such folder")


@contextmanager
def sentences(target: Path, error: type[CnnumError]) -> Generator[None, None, None]:
    """Turn what the system says of a target into one sentence of an error."""
    try:
        yield
    except CnnumError:
        raise
    except FileExistsError:
        raise taken(target, error) from None
    except OSError as reason:
        absent = isinstance(reason, FileNotFoundError) and not target.parent.is_dir()
        why = f"there is no folder '{target.parent}'" if absent else reason.strerror or reason
        other = "another name" if reason.errno in (errno.EINVAL, errno.ENOTDIR) else _A_FOLDER
        raise error(f"'{target}' cannot be written: {why}; choose {other}.") from None


def taken(target: Path, error: type[CnnumError] = ReportError) -> CnnumError:
    """Return the error for a file that is there already."""
    return error(
        f"'{target}' already exists; choose another name, or give --force (in Python force=True)."
    )


@contextmanager
def draft(
    target: Path, *, force: bool = False, private: bool = False
) -> Generator[IO[bytes], None, None]:
    """Do as `written` does, with the system's own errors; what is private is the user's alone.

    Raises
    ------
    FileExistsError
        If there is a file that is not to be replaced.
    OSError
        If it cannot be written, or is no regular file.
    """
    place = place_of(target)
    old = _old(target, place, force=force)
    # what replaces a private file is private from its first byte on
    mode = 0o666 if old is None and not private else 0o600
    name = place.parent / _draft_name()
    handle = os.open(name, _NEW | _FLAGS, mode)
    try:
        with os.fdopen(handle, "wb+") as file:
            yield file
            file.flush()
            os.fsync(file.fileno())
        if old is not None:  # another may have come to its place while the draft was filled
            place_of(target)
            old = _old(target, place, force=force)
        if private and old is not None:
            name.replace(place)
        else:
            _move(name, place, old)
    finally:
        name.unlink(missing_ok=True)


def put(name: Path, target: Path, *, force: bool) -> None:
    """Move a file that is written and synced to its place.

    Raises
    ------
    FileExistsError
        If there is a file, and `force` does not say to replace it; the file stays where it is.
    OSError
        If it cannot be moved, or the target is no regular file; the file stays where it is.
    """
    place = place_of(target)
    _move(name, place, _status(place) if force else None)


def _move(name: Path, place: Path, old: os.stat_result | None) -> None:
    """Move a draft to its place: over the file of this status, or where nothing is."""
    if old is None:
        _link(name, place)
    else:
        _like(name, old)
        name.replace(place)
    sync_folder(place.parent)


def _like(name: Path, old: os.stat_result) -> None:
    """Give a file the owner and the mode of another."""
    mode, own = stat.S_IMODE(old.st_mode), name.stat()
    if hasattr(os, "chown") and (own.st_uid, own.st_gid) != (old.st_uid, old.st_gid):
        try:
            os.chown(name, old.st_uid, old.st_gid)
        except OSError:  # what was the old group's is not our group's
            mode &= ~(stat.S_IRWXG | stat.S_ISUID | stat.S_ISGID)
    name.chmod(mode)


def place_of(target: Path) -> Path:
    """Return where a file goes: its name, or where a link at that name leads.

    Raises
    ------
    OSError
        If something is there that is no regular file, or it is a stream of this process.
    """
    try:
        linked = target.is_symlink()
        if _is_stream(target):
            raise OSError(errno.EINVAL, "it is an open stream, expected a regular file")
        with contextlib.suppress(FileNotFoundError):
            mode = target.stat().st_mode
            for holds, name in KINDS:
                if holds(mode):
                    raise OSError(errno.EINVAL, f"it is {name}, expected a regular file")
        return target.resolve() if linked else target
    except (ValueError, RuntimeError):  # a NUL, letters that no name can have, a ring of links
        raise OSError(errno.EINVAL, "the name is not a valid file name") from None


def _is_stream(target: Path) -> bool:
    """Return whether a name leads to an open file of a process, as /dev/stdout does."""
    place = target
    for _ in range(MOST_LINKS):
        if str(place.parent.resolve()).startswith("/proc/"):
            return True
        if not place.is_symlink():
            return False
        place = place.parent / place.readlink()
    return False


def made_here(target: Path) -> bool:
    """Return whether a file begins as a report that cnnum wrote does."""
    try:
        with target.open("rb") as file:
            return MARKS.match(file.read(HEAD)) is not None
    except OSError:
        return False


def _old(target: Path, place: Path, *, force: bool) -> os.stat_result | None:
    """Return the status of the file that is to be replaced, None if there is none.

    Raises
    ------
    FileExistsError
        If it is not to be replaced; a link to nowhere is something that is there, too.
    """
    old = _status(place)
    there = old is not None or target.is_symlink()
    if there and not (force or made_here(place)):
        raise FileExistsError(errno.EEXIST, "it already exists")
    return old


def _status(place: Path) -> os.stat_result | None:
    try:
        return place.lstat()
    except FileNotFoundError:
        return None


def _draft_name() -> str:
    # not made of the target's name, which may be as long as a name can be
    return f"{DRAFT}{os.urandom(6).hex()}.part"


def beside(target: Path, ending: str) -> Path:
    """Return the name of a file next to another: its name, and an ending.

    A name that would be too long loses its end to a digest of the whole.
    """
    name = target.name + ending
    if len(os.fsencode(name)) > LONGEST_NAME:
        digest = f"~{hashlib.sha256(os.fsencode(target.name)).hexdigest()[:12]}"
        room = LONGEST_NAME - len(os.fsencode(digest + ending))
        name = os.fsencode(target.name)[:room].decode("utf-8", "ignore") + digest + ending
    return target.with_name(name)


def named_after(folder: Path, name: str, ending: str) -> Path:
    """Return the file of a thing with a name that a user gave, always in this very folder.

    Letters become small ones. What is no letter, no digit and none of ``-.,+=()`` becomes "_", as
    does a dot at the beginning. So two names may have the same file.

    Parameters
    ----------
    folder : Path
    name : str
        One that is not empty.
    ending : str
        Suffix of the file, such as ".toml".
    """
    kept = "".join(sign if sign.isalnum() or sign in "-.,+=()" else "_" for sign in name.lower())
    return beside(folder / (f"_{kept[1:]}" if kept.startswith(".") else kept), ending)


def create(path: Path) -> IO[bytes]:
    """Return a new file that a journal is appended to; it is unbuffered, and never another's.

    Raises
    ------
    FileExistsError
        If there is anything of that name.
    OSError
        If it cannot be created.
    """
    handle = os.open(path, _NEW | _FLAGS, 0o666)
    return os.fdopen(handle, "wb+", buffering=0)


def append(path: Path, data: bytes) -> None:
    """Add bytes to the end of a regular file, all of them or none.

    Raises
    ------
    OSError
        If it is not a regular file, or has no room.
    """
    handle = os.open(path, os.O_WRONLY | os.O_APPEND | _FLAGS | getattr(os, "O_NONBLOCK", 0))
    with os.fdopen(handle, "ab", buffering=0) as file:
        status = os.fstat(file.fileno())
        if not stat.S_ISREG(status.st_mode):
            raise OSError(errno.EINVAL, "it is not a regular file")
        try:
            left = memoryview(data)
            while left:
                left = left[file.write(left) :]
        except OSError:
            with contextlib.suppress(OSError):
                file.truncate(status.st_size)
            raise


@contextmanager
def written_folder(
    target: Path,
    *,
    error: type[CnnumError] = ReportError,
    force: bool = False,
    owns: Callable[[Path], bool] = lambda _: False,
    synced: bool = True,
) -> Generator[Path, None, None]:
    """Give an empty folder to fill; after the block it stands at `target`.

    Parameters
    ----------
    target : Path
        A name that is free, or an empty folder.
    error : type of CnnumError
    force : bool
        Whether a folder that is there is replaced, if `owns` says that it may be.
    owns : callable
        Says of a folder whether it holds nothing but what such an output has.
    synced : bool
        Whether its files are on the disk before it stands there: a power cut then loses none.

    Raises
    ------
    CnnumError
        The leaf that was given. Then nothing has changed at `target`.
    """
    replaces = refuse_folder(target, error=error, force=force, owns=owns)
    with sentences(target, error):
        name = target.parent / _draft_name()
        name.mkdir()
        try:
            yield name
            for path in _files(name) if synced else ():
                _sync(path)
            _put_folder(name, target, replaces=replaces, error=error, owns=owns)
        finally:
            shutil.rmtree(name, ignore_errors=True)
        sync_folder(target.parent)


def put_folder(
    name: Path,
    target: Path,
    *,
    error: type[CnnumError] = ReportError,
    force: bool = False,
    owns: Callable[[Path], bool] = lambda _: False,
) -> None:
    """Move a folder that was filled over several runs to its place, without drafts of killed ones.

    `name` is such a folder, next to `target`; the other arguments and the errors are those of
    `written_folder`.
    """
    replaces = refuse_folder(target, error=error, force=force, owns=owns)
    with sentences(target, error):
        for left in name.glob(f"{DRAFT}*"):
            shutil.rmtree(left)
        _put_folder(name, target, replaces=replaces, error=error, owns=owns)
        sync_folder(target.parent)


def refuse_folder(
    target: Path,
    *,
    error: type[CnnumError] = ReportError,
    force: bool = False,
    owns: Callable[[Path], bool] = lambda _: False,
) -> bool:
    """Check that a folder can be put in its place; arguments are those of `written_folder`.

    Returns
    -------
    bool
        Whether there is a folder that is to be replaced.
    """
    with sentences(target, error):
        if not target.parent.is_dir():
            raise FileNotFoundError(errno.ENOENT, "no such folder")
        old = _status(target)
        if old is None:
            return False
        if not stat.S_ISDIR(old.st_mode):
            raise OSError(errno.ENOTDIR, _A_FILE)
        if not any(target.iterdir()):
            return False
        if not owns(target):
            raise _of_others(target, error)
        if not force:
            raise FileExistsError(errno.EEXIST, "it already exists")
        return True


def _of_others(target: Path, error: type[CnnumError]) -> CnnumError:
    return error(
        f"'{target}' is a folder that holds other files, and is never emptied: choose another name."
    )


def _put_folder(
    name: Path,
    target: Path,
    *,
    replaces: bool,
    error: type[CnnumError],
    owns: Callable[[Path], bool],
) -> None:
    """Move a folder to its place; the old one goes when the new one is there.

    Raises
    ------
    CnnumError
        If the old folder has got other files since it was looked at; it stays as it is.
    OSError
        If something came to a place that was free, or cannot be moved.
    """
    old = _status(target)
    if old is not None and stat.S_ISDIR(old.st_mode):
        name.chmod(stat.S_IMODE(old.st_mode))
    if not replaces:
        _rename_to_free(name, target)
        return
    aside = target.parent / _draft_name()
    target.rename(aside)
    try:
        if not (aside.is_dir() and owns(aside)):  # under this name no other program writes to it
            raise _of_others(target, error)
        _rename_to_free(name, target)
    except BaseException:
        try:
            aside.rename(target)
        except OSError:
            raise error(
                f"Something came to '{target}' while it was to be replaced: the folder that was "
                f"there is kept as '{aside}'; move it to another name."
            ) from None
        raise
    shutil.rmtree(aside, ignore_errors=True)


def _rename_to_free(name: Path, target: Path) -> None:
    """Move a folder to a name that is free, or to the place of an empty folder.

    Raises
    ------
    FileExistsError
        If the target is a file, or a folder that is not empty.
    """
    if os.name == "nt":  # where a rename replaces no folder, not even an empty one
        with contextlib.suppress(OSError):
            target.rmdir()
    try:
        name.rename(target)
    except OSError as reason:
        if reason.errno in (errno.ENOTEMPTY, errno.EEXIST, errno.ENOTDIR):
            raise FileExistsError(errno.EEXIST, "it already exists") from None
        raise


def _files(folder: Path) -> Iterator[Path]:
    return (path for path in folder.rglob("*") if path.is_file())


def _sync(path: Path) -> None:
    with path.open("rb") as file:
        os.fsync(file.fileno())


@contextmanager
def held_folder(folder: Path, error: type[CnnumError]) -> Generator[None, None, None]:
    """Make a folder, and keep it for this process until the block ends, however the process ends.

    Raises
    ------
    CnnumError
        If it cannot be made, or another process has it.
    """
    with sentences(folder, error):
        make_folder(folder)
    try:
        import fcntl
    except ImportError:  # there are no such locks on Windows
        yield
        return
    handle = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(handle)
        raise error(
            f"Another process works on the results in '{folder}': wait until it ends, or choose "
            "another --output."
        ) from None
    except OSError:  # nor on some network file systems
        pass
    try:
        yield
    finally:
        os.close(handle)


def make_folder(folder: Path) -> None:
    """Make a folder, and those above it, where they are not there.

    Raises
    ------
    OSError
        If one cannot be made, or something else has its name.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except FileExistsError:
        raise OSError(errno.ENOTDIR, _A_FILE) from None
    except ValueError:
        raise OSError(errno.EINVAL, "the name is not a valid file name") from None


def sync_folder(folder: Path) -> None:
    """Bring the names of a folder to the disk, where the system can."""
    with contextlib.suppress(OSError):  # Windows opens no folders
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


def _link(name: Path, place: Path) -> None:
    # a rename would replace a file that has come in the meantime; a link never does
    try:
        place.hardlink_to(name)
    except FileExistsError:
        raise
    except (OSError, NotImplementedError):  # a file system without hard links
        os.close(os.open(place, _NEW | _FLAGS, 0o600))  # claims the name: no other program has it
        try:
            name.replace(place)
        except BaseException:
            place.unlink()
            raise
    else:
        name.unlink()
