"""The cache folder of cnnum, whose entries carry checksums so that damage is detected.

Every entry is one file that holds a checksum of its content and is written atomically, so processes
share the folder without a lock. An entry that has been corrupted is never used: it is dropped and
rebuilt.

Entries hold machine code, and Numba's are pickles of it: whoever can write one can run code as the
user. The checksum has no key, so it detects damage, not malice. The protection against malice is
file ownership: the folders and each entry must belong to the user (parent folders may also belong
to root), and nobody else may write to them. Otherwise nothing is read.
"""

import hashlib
import os
import shutil
import stat
from dataclasses import dataclass
from pathlib import Path

import platformdirs

from cnnum.errors import say_once
from cnnum.safety.files import draft
from cnnum.safety.reading import open_regular

VARIABLE = "CNNUM_CACHE"
"""Environment variable that names another folder; "off" disables the cache."""

OFF = "off"

MOST_ENTRIES = 20_000
"""Number of entries of one kind above which the oldest half is deleted: 2 GB at 100 kB each."""

_OTHERS_WRITE = stat.S_IWGRP | stat.S_IWOTH


def cache_folder(variable: str = VARIABLE) -> Path | None:
    """Return the cache folder, created if needed, or None if none can be trusted or created.

    A warning says why there is none, unless the user has disabled the cache.

    Parameters
    ----------
    variable : str
        Environment variable that may name another folder instead.
    """
    named = os.environ.get(VARIABLE, "")
    if named == OFF:
        return None
    named = os.environ.get(variable, "") or named
    try:
        folder = Path(named) if named else platformdirs.user_cache_path("cnnum")
        why = _distrust(folder)
    except RuntimeError:
        folder, why = Path(), "this user has no home folder"
    except OSError as error:
        folder, why = Path(named), f"'{error.filename or named}' cannot be used ({error.strerror})"
    if why:
        say_once(
            f"Nothing is kept for the next start: {why}; set {variable} to a folder of your own, "
            f"or {VARIABLE} to '{OFF}'."
        )
        return None
    return folder


def _distrust(folder: Path) -> str:
    """Return why a folder is not used, or an empty string if it is."""
    if not folder.is_absolute():
        return f"'{folder}' is not a full path"
    try:
        status = folder.lstat()
    except FileNotFoundError:
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        status = folder.lstat()
    if why := why_not_ours(folder, status):
        return why
    if os.name == "posix":
        for above in {*folder.parents, *folder.resolve().parents}:
            if _replaceable(above.stat()):
                return f"others may replace '{folder}', by what they may do in '{above}'"
    return ""


def why_not_ours(folder: Path, status: os.stat_result) -> str:
    """Return why a folder with this status is not the user's alone, or an empty string if it is."""
    if not stat.S_ISDIR(status.st_mode):
        return f"'{folder}' is a link or a file, not a folder"
    if os.name != "posix":
        return ""
    if status.st_uid != os.getuid():
        return f"'{folder}' belongs to another user"
    if status.st_mode & _OTHERS_WRITE:
        return f"others may write to '{folder}'"
    return ""


def _replaceable(above: os.stat_result) -> bool:
    """Return whether a user other than this one or root may replace the contents of a folder."""
    if above.st_uid not in (0, os.getuid()):
        return True
    group = above.st_mode & stat.S_IWGRP and not _is_alone_in(above.st_gid)
    return bool(group or above.st_mode & stat.S_IWOTH) and not above.st_mode & stat.S_ISVTX


def _is_alone_in(group: int) -> bool:
    """Return whether a group is root's or the user's private group, with no other member."""
    if group == 0 or group != os.getgid():
        return group == 0
    import grp
    import pwd

    try:
        user, result = pwd.getpwuid(os.getuid()).pw_name, grp.getgrgid(group)
    except KeyError:  # the owner of a nameless group is unknown
        return False
    return result.gr_name == user and set(result.gr_mem) <= {user}


@dataclass(frozen=True, slots=True)
class Shelf:
    """Cache entries of one kind, in their own folder.

    Attributes
    ----------
    kind : str
        Name of their folder.
    variable : str
        Environment variable that may name another folder that theirs lies in.
    """

    kind: str
    variable: str = VARIABLE

    def get(self, name: str) -> bytes | None:
        """Return the content of an entry, or None if it is missing or damaged."""
        folder = self._folder()
        return None if folder is None else _read(folder / name)

    def put(self, name: str, content: bytes) -> None:
        """Write an entry, replacing any of that name; warn if it cannot be written."""
        folder = self._folder()
        if folder is None:
            return
        try:
            _write(folder / name, content)
        except OSError as error:
            say_once(
                f"Not all is kept for the next start: '{folder}' cannot be written "
                f"({error.strerror})."
            )

    def drop(self, name: str) -> None:
        """Remove an unusable entry."""
        folder = self._folder()
        if folder is not None:
            _remove(folder / name)

    def _folder(self) -> Path | None:
        """Return the folder of the entries, which need not exist, or None if it is not ours."""
        cache = cache_folder(self.variable)
        if cache is None:
            return None
        folder = cache / self.kind
        try:
            status = folder.lstat()
        except OSError:
            return folder
        why = why_not_ours(folder, status) if stat.S_ISDIR(status.st_mode) else ""
        if why:
            say_once(f"Nothing of it is kept for the next start: {why}; remove that folder.")
        return None if why else folder


def _read(place: Path) -> bytes | None:
    try:
        raw = _content(place)
    except (FileNotFoundError, NotADirectoryError):
        return None
    except OSError:
        raw = b""
    checksum, _, content = raw.partition(b"\n")
    if checksum == _checksum(content):
        return content
    say_once(f"A damaged entry of the cache in '{place.parent}' is dropped and made anew.")
    _remove(place)
    return None


def _content(place: Path) -> bytes:
    """Return the bytes of an entry; empty for links and files not the user's alone."""
    if place.is_symlink() or place.parent.is_symlink():
        return b""
    with open_regular(place) as file:  # a pipe in the place of an entry would wait for ever
        result = os.fstat(file.fileno())
        ours = os.name != "posix" or result.st_uid == os.getuid()
        return file.read() if ours and not result.st_mode & _OTHERS_WRITE else b""


def _checksum(content: bytes) -> bytes:
    return hashlib.sha256(content).hexdigest().encode()


def _write(place: Path, content: bytes) -> None:
    folder = place.parent
    if folder.is_symlink() or (folder.exists() and not folder.is_dir()):
        folder.unlink()
    folder.mkdir(exist_ok=True, mode=0o700)
    if place.is_dir():
        _remove(place)
    with draft(place, force=True, private=True) as file:
        file.write(_checksum(content) + b"\n" + content)
    _thin_out(folder)


def _thin_out(folder: Path) -> None:
    places = list(folder.iterdir())
    if len(places) > MOST_ENTRIES:
        for place in sorted(places, key=_written)[: len(places) // 2]:
            _remove(place)


def _written(place: Path) -> float:
    try:
        return place.lstat().st_mtime
    except OSError:  # another process has removed it
        return 0.0


def _remove(place: Path) -> None:
    """Remove the file or link in the place of an entry, never the target of a link."""
    try:
        if place.is_dir() and not place.is_symlink():
            shutil.rmtree(place, ignore_errors=True)
        else:
            place.unlink(missing_ok=True)
    except OSError:  # a folder that is read-only: the entry stays, and is passed over
        return
