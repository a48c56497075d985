"""Filling kernel texts: real OpenCL C in `kernels/*.cl` with `$names`, filled strictly."""

import re
from collections.abc import Iterable
from functools import cache
from importlib import resources
from string import Template as Text

import numpy as np

from cnnum.errors import ArrayError

WIDE_BYTES = 64
"""Vectors from this size on have no built-ins that every compiler can handle."""


@cache
def _kernel_text(name: str) -> Text:
    return Text((resources.files("cnnum.engines.opencl") / "kernels" / f"{name}.cl").read_text())


def fill(name: str, **values: object) -> str:
    """Return the kernel text of that file with its names filled in.

    Raises
    ------
    KeyError
        If a name of the text gets no value.
    ValueError
        If a value has no place in the text.
    """
    text = _kernel_text(name)
    unused = set(values) - set(text.get_identifiers())
    if unused:
        raise ValueError(f"Kernel text '{name}.cl' has no place for {sorted(unused)}.")
    return text.substitute({key: str(value) for key, value in values.items()})


def comment(words: str) -> str:
    """Return a comment: a line of signs that end none, and neither open nor close a bracket."""
    return f"// {re.sub('[^A-Za-z0-9 _.,:+*=-]', '_', words)}"


def number(value: float, dtype: np.dtype[np.floating]) -> str:
    """Return the shortest literal that is exactly the value rounded to the kernel's type.

    Raises
    ------
    ArrayError
        If the value is not finite, or too large for the type.
    """
    with np.errstate(over="ignore"):
        rounded = dtype.type(value)
    if not np.isfinite(rounded):
        raise ArrayError(
            f"A kernel holds finite numbers of {dtype.name}, got {float(value):g}: scale what the "
            "number is of, or use precision='float64'."
        )
    digits = repr(float(value)) if dtype == np.float64 else repr(float(str(rounded)))
    if "." not in digits and "e" not in digits:
        digits += ".0"
    return f"R({digits}{'' if dtype == np.float64 else 'f'})"


def indented(lines: list[str], depth: int) -> str:
    """Return the lines joined, each indented by `depth` levels of four spaces."""
    pad = "    " * depth
    return "\n".join(pad + line if line else line for line in lines)


def rename(expression: str, names: dict[str, str]) -> str:
    """Return the expression with whole words replaced."""
    return re.sub(
        r"\b[a-z]+\b",
        lambda word: f"({names[word[0]]})" if word[0] in names else word[0],
        expression,
    )


def owned(text: str, names: Iterable[str], suffix: str) -> str:
    """Return a text in which some names end with a suffix, so that they are its own."""
    return re.sub(rf"\b({'|'.join(names)})\b", rf"\1_{suffix}", text)
