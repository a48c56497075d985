"""The cache folder of cnnum, and entries in it that show when they are damaged.

Every entry is one file that holds the checksum of its own content. It is written whole or not at
all. So processes share the folder without a lock. An entry that a fault of the disk or of a program
has changed is never used: it is dropped, and made anew.
"""

import hashlib
import os
import shutil
import stat
from dataclasses import dataclass
from pathlib import Path

import platformdirs

from cnnum.engines.notices import say_once
from cnnum.safety.files import draft

VARIABLE = "CNNUM_CACHE"
"""Names another folder; "off" means that nothing is kept."""

OFF = "off"

MOST_ENTRIES = 20_000
"""Entries of one kind, after which the oldest half goes: with 100 kB each they take 2 GB."""

_OTHERS_WRITE = stat.S_IWGRP | stat.S_IWOTH


def cache_folder(variable: str = VARIABLE) -> Path | None:
    """Return the cache folder, which is made if need be; None where none can be trusted or made.

    One sentence says why there is none, unless the user has switched it off.

    Parameters
    ----------
    variable : str
        One that may name another folder instead.
    """
    named = os.environ.get(VARIABLE, "")
    if named == OFF:
        return None
    named = os.environ.get(variable, "") or named
    folder = Path(named) if named else platformdirs.user_cache_path("cnnum")
    try:
        why = _distrust(folder)
    except OSError as error:
        why = f"'{folder}' cannot be used ({error.strerror})"
    if why:
        say_once(
            f"Nothing is kept for the next start: {why}; set {variable} to a folder of your own, "
            f"or {VARIABLE} to '{OFF}'."
        )
        return None
    return folder


def _distrust(folder: Path) -> str:
    """Return why a folder is not used; nothing where it is."""
    if not folder.is_absolute():
        return f"'{folder}' is not a full path"
    try:
        found = folder.lstat()
    except FileNotFoundError:
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        found = folder.lstat()
    if not stat.S_ISDIR(found.st_mode):
        return f"'{folder}' is a link or a file, not a folder"
    if os.name != "posix":
        return ""
    if found.st_uid != os.getuid():
        return f"'{folder}' belongs to another user"
    if found.st_mode & _OTHERS_WRITE:
        return f"others may write to '{folder}'"
    above = folder.parent.stat().st_mode
    if above & stat.S_IWOTH and not above & stat.S_ISVTX:
        return f"others may replace '{folder}'"
    return ""


@dataclass(frozen=True, slots=True)
class Shelf:
    """Entries of one kind in a folder of their own.

    Attributes
    ----------
    kind : str
        Name of their folder.
    variable : str
        One that may name another folder that theirs lies in.
    """

    kind: str
    variable: str = VARIABLE

    def get(self, name: str) -> bytes | None:
        """Return the content of an entry; None where there is none, or none that is whole."""
        folder = cache_folder(self.variable)
        return None if folder is None else _read(folder / self.kind / name)

    def put(self, name: str, content: bytes) -> None:
        """Keep an entry, in place of the one of that name; one sentence says if it cannot be."""
        folder = cache_folder(self.variable)
        if folder is None:
            return
        try:
            _write(folder / self.kind / name, content)
        except OSError as error:
            say_once(
                f"Not all is kept for the next start: '{folder}' cannot be written "
                f"({error.strerror})."
            )

    def drop(self, name: str) -> None:
        """Remove an entry that proves to be of no use."""
        folder = cache_folder(self.variable)
        if folder is not None:
            _remove(folder / self.kind / name)


def _read(place: Path) -> bytes | None:
    try:
        # a pipe in the place of an entry would wait for ever
        raw = place.read_bytes() if stat.S_ISREG(place.lstat().st_mode) else b""
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


def _checksum(content: bytes) -> bytes:
    return hashlib.sha256(content).hexdigest().encode()


def _write(place: Path, content: bytes) -> None:
    folder = place.parent
    if folder.is_symlink() or (folder.exists() and not folder.is_dir()):
        folder.unlink()
    folder.mkdir(exist_ok=True, mode=0o700)
    if place.is_dir():
        _remove(place)
    with draft(place, force=True) as file:
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
    """Remove the file or link in the place of an entry, and no target of a link."""
    try:
        if place.is_dir() and not place.is_symlink():
            shutil.rmtree(place, ignore_errors=True)
        else:
            place.unlink(missing_ok=True)
    except OSError:  # a folder that is read-only: the entry stays, and is passed over
        return
