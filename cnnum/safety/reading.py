"""Reading files that others wrote: regular files, within the limit of their kind, and TOML."""

import errno
import os
import re
import stat
import struct
import tokenize
import tomllib
import zipfile
import zlib
from pathlib import Path
from typing import IO, Any, cast

KINDS = (
    (stat.S_ISDIR, "a folder"),
    (stat.S_ISFIFO, "a pipe"),
    (stat.S_ISSOCK, "a socket"),
    (stat.S_ISCHR, "a device"),
    (stat.S_ISBLK, "a device"),
)
"""Kinds of path that are no regular file: to read one could wait or go on for ever."""

MEGABYTE = 1 << 20

LONGEST_POINTER = 1024
POINTERS = (
    (
        b"version https://git-lfs.github.com/spec/",
        "Git LFS",
        "fetch these with 'git lfs pull' in their repository",
    ),
    (b"/annex/objects/", "git-annex", "fetch these with 'git annex get' in their repository"),
)
"""Beginnings of small files that stand in a checkout for large ones, their makers, and the cure."""

DAMAGE = (
    zipfile.BadZipFile,
    zlib.error,
    struct.error,
    EOFError,
    ValueError,
    TypeError,
    AttributeError,
    LookupError,
    ArithmeticError,
    RuntimeError,
    SyntaxError,
    tokenize.TokenError,
)
"""Errors of zipfile, zlib and NumPy where an array file or an archive of them is damaged."""

# Reading a pipe must not wait for its writer; Windows has no such flag, but needs the other one.
_FLAGS = (
    os.O_RDONLY
    | getattr(os, "O_NONBLOCK", 0)
    | getattr(os, "O_CLOEXEC", 0)
    | getattr(os, "O_BINARY", 0)
)


def names_something(path: Path) -> bool:
    """Return whether there is anything of that name, of any kind; never raises."""
    try:
        path.stat()
    except (OSError, ValueError):
        return False
    return True


def open_regular(path: Path, *, most: int | None = None) -> IO[bytes]:
    """Return a regular file, open for reading bytes.

    Parameters
    ----------
    path : Path
    most : int, optional
        Bytes that a file of this kind may have; any number unless given.

    Raises
    ------
    OSError
        If the path names no file, another thing than a regular file, a file that is too large, or
        a pointer to data that were not fetched. `strerror` says which.
    """
    try:
        _refuse_other(path.stat(), most)  # before it is opened: opening a device can have effects
        handle = os.open(path, _FLAGS)
    except ValueError:  # a NUL, or letters that no file name can have
        raise OSError(errno.EINVAL, "the name is not a valid file name") from None
    try:
        status = os.fstat(handle)
        _refuse_other(status, most)  # another thing may have come to the path since
        if status.st_size <= LONGEST_POINTER:
            _refuse_pointer(os.read(handle, LONGEST_POINTER))
            os.lseek(handle, 0, os.SEEK_SET)
        return os.fdopen(handle, "rb")
    except BaseException:
        os.close(handle)
        raise


def read_bytes(path: Path, *, most: int) -> bytes:
    """Return the content of a regular file of a limited size.

    Raises
    ------
    OSError
        As `open_regular`.
    """
    with open_regular(path, most=most) as file:
        content = file.read(most + 1)  # the file may grow meanwhile, and some state no size
    _refuse_size(len(content), most)
    return content


def read_text(path: Path, *, most: int) -> str:
    """Return the text of a regular file in UTF-8 of a limited size, without a byte-order mark.

    Raises
    ------
    OSError
        As `open_regular`.
    UnicodeDecodeError
        If it is not UTF-8.
    """
    return read_bytes(path, most=most).decode("utf-8-sig")


def _refuse_pointer(content: bytes) -> None:
    for begin, what, how in POINTERS:
        if content.startswith(begin):
            raise OSError(errno.EINVAL, f"it is a {what} pointer instead of the data: {how}")


def _refuse_other(status: os.stat_result, most: int | None) -> None:
    for holds, name in KINDS:
        if holds(status.st_mode):
            raise OSError(errno.EINVAL, f"it is {name}, expected a regular file")
    if most is not None:
        _refuse_size(status.st_size, most)


def _refuse_size(size: int, most: int) -> None:
    if size > most:
        raise OSError(
            errno.EFBIG,
            f"it has more than {most // MEGABYTE} MiB, which is beyond any file of its kind",
        )


LARGEST = 8 << 20
"""Bytes of the longest TOML file: a calibration of 128×128 taxels has 6 million."""

DEEPEST = 32
"""Lists and tables within each other, and parts of a dotted key."""

# `tomllib` takes time in the square of the number of parts of a key.
_PART = r"""(?:[\w-]++|"[^"\n]*+"|'[^'\n]*+')"""
_LONG_KEY = re.compile(rf"(?<![\w-]){_PART}(?:[ \t]*+\.[ \t]*+{_PART}){{{DEEPEST}}}")


def parse_toml(text: str) -> dict[str, Any]:
    """Return the table that a TOML text describes.

    Raises
    ------
    ValueError
        If it is not TOML, is nested too deep, or holds a whole number of more than 64 bits. The
        message says which and ends without a full stop.
    """
    # the pattern is tried where a line has the dots for it alone: it takes a fifth of a file's time
    dotted = any(line.count(".") >= DEEPEST for line in text.split("\n"))
    if dotted and (long := _LONG_KEY.search(text)):
        raise ValueError(f"the key '{long[0]:.40}…' has more than {DEEPEST} parts")
    try:
        table = tomllib.loads(text)
    except RecursionError:
        raise ValueError(_TOO_DEEP) from None
    except tomllib.TOMLDecodeError:
        raise
    except ValueError:  # of int(): thousands of digits
        raise ValueError(_TOO_LONG) from None
    _check(table)
    return table


_TOO_DEEP = f"it is nested more than {DEEPEST} deep"
_TOO_LONG = "it holds a whole number of more than 64 bits"


def _check(table: dict[str, Any]) -> None:
    level: list[object] = [table]
    for _ in range(DEEPEST + 1):
        if any(isinstance(item, int) and not -(2**63) <= item < 2**64 for item in level):
            raise ValueError(_TOO_LONG)
        level = [inner for item in level for inner in _inside(item)]
        if not level:
            return
    raise ValueError(_TOO_DEEP)


def _inside(item: object) -> list[object]:
    if isinstance(item, dict):
        return list(cast("dict[str, object]", item).values())
    return cast("list[object]", item) if isinstance(item, list) else []
