"""TOML that others wrote: errors of Python's own reader are one sentence here."""

import re
import tomllib
from typing import Any, cast

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
