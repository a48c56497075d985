"""Files elsewhere: what an address names, and copies of it here. The one user of fsspec."""

import re
from collections.abc import Generator
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path, PurePosixPath
from tempfile import TemporaryDirectory
from typing import Any

from cnnum.errors import CnnumError, RecordingError, missing_extra
from cnnum.safety.values import shown

MARK, LINK = "://", "::"
"""Signs of an address, and between the parts of one within another."""

LAYOUT = ".toml"

PASSWORD = re.compile(r"(?<!github://)(?<=://)([^/@:\s]*):[^/\s]*@")
"""As in "ftp://name:password@host/"; in "github://owner:name@branch/" the same place has none."""


def is_address(word: str) -> bool:
    """Return whether a word is an address such as "s3://bucket/day1/", and no path."""
    return MARK in word


def public(text: str) -> str:
    """Return a text with addresses without their passwords, for tables and messages."""
    return PASSWORD.sub(r"\1:***@", text)


def layout_of(path: str) -> str:
    """Return the path of the layout that would lie next to a file."""
    return path.removesuffix(PurePosixPath(path).suffix) + LAYOUT


@contextmanager
def _said(address: str) -> Generator[None]:
    """Turn what fsspec and its file systems raise into one sentence."""
    try:
        yield
    except CnnumError:
        raise
    except Exception as error:  # each file system has errors of its own
        said = str(error).strip().splitlines() or [type(error).__name__]
        why = public(said[0])
        raise RecordingError(f"{shown(public(address))} cannot be read: {why:.200}.") from None


def _opened(address: str) -> tuple[Any, str]:
    """Return the file system of an address, and the path in it."""
    try:
        core: Any = import_module("fsspec.core")
    except ImportError:
        raise missing_extra(f"the address {shown(public(address))}", "fsspec", "remote") from None
    system, path = core.url_to_fs(address)
    return system, str(path)


def files_at(word: str) -> dict[str, str]:
    """Return the addresses of all files that an address of a file, folder or pattern names, sorted,
    with their paths.

    Raises
    ------
    MissingExtraError
        If fsspec is not installed.
    RecordingError
        If the address cannot be read.
    """
    with _said(word):
        system, path = _opened(word)
        named = sorted(system.glob(path)) if any(sign in path for sign in "*?[") else [path]
        paths = [
            str(inner)
            for name in named
            for inner in (sorted(system.find(name)) if system.isdir(name) else [name])
        ]
    if paths == [path]:
        return {word: path}
    parts = word.split(LINK)
    which = next(number for number, part in enumerate(parts) if MARK in part)
    begin = _before(parts[which], path)

    def whole(path: str) -> str:
        own = path if MARK in path else f"{begin}{path}"
        return LINK.join([*parts[:which], own, *parts[which + 1 :]])

    with _said(word):
        for inner in paths[:1]:  # a host that is lost would be that of other files
            if _opened(whole(inner)) != (system, inner):
                raise RecordingError(
                    f"The files in {shown(public(word))} have no addresses of their own: name each."
                )
    return {whole(path): path for path in paths}


def _before(part: str, path: str) -> str:
    """Return what an address has before its path, such as a host that the path does not name."""
    own, end = part.rstrip("/"), path.rstrip("/")
    if not end:
        return part if part.endswith(MARK) else part.removesuffix("/")
    return own.removesuffix(end) if own.endswith(end) else part.partition(MARK)[0] + MARK


def facts_of(address: str) -> str:
    """Return what distinguishes a file from another of the same name, and its layout.

    It raises as `files_at`.
    """
    with _said(address):
        system, path = _opened(address)
        return " ".join(
            str(system.ukey(name)) for name in (path, layout_of(path)) if system.exists(name)
        )


@contextmanager
def copied(address: str) -> Generator[Path]:
    """Yield a copy of a file, with its layout, which is there until the block ends.

    Raises
    ------
    MissingExtraError, RecordingError
        As `files_at`, or if there is no such file.
    """
    with TemporaryDirectory(prefix="cnnum-") as folder:
        with _said(address):
            system, path = _opened(address)
            if not system.isfile(path):
                raise RecordingError(f"There is no file {shown(public(address))}.")
            # a name from elsewhere is not to say where in a folder of ours it goes
            copy = Path(folder) / f"recording{PurePosixPath(path).suffix}"
            system.get_file(path, str(copy))
            if system.isfile(layout_of(path)):
                system.get_file(layout_of(path), str(copy.with_suffix(LAYOUT)))
        yield copy
