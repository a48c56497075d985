"""Kernel templates: OpenCL C in `kernels/*.cl` with `$names`, substituted strictly."""

import re
from collections.abc import Iterable, Sequence
from functools import cache
from importlib import resources
from string import Template as Text

from cnnum import kernels as ir

WIDE_BYTES = 64
"""Vector size in bytes from which not every compiler can handle the built-ins."""


@cache
def _kernel_text(name: str) -> Text:
    return Text((resources.files("cnnum.engines.opencl") / "kernels" / f"{name}.cl").read_text())


def names_of(name: str) -> set[str]:
    """Return the names that the kernel template in this file contains."""
    return set(_kernel_text(name).get_identifiers())


Value = str | int | ir.Expression | Sequence[ir.Statement]


def filled(name: str, **values: Value) -> ir.Verbatim:
    """Return the kernel template in this file with records substituted for its names.

    Raises
    ------
    KeyError
        If a name in the template has no value.
    ValueError
        If a value has no name in the template.
    """
    text, at = _kernel_text(name), 0
    unused = set(values) - names_of(name)
    if unused:
        raise ValueError(f"Kernel text '{name}.cl' has no placeholder for {sorted(unused)}.")
    pieces: list[str | ir.Expression | tuple[ir.Statement, ...]] = []
    for place in text.pattern.finditer(text.template):
        value = values[place["named"] or place["braced"]]
        pieces.append(text.template[at : place.start()])
        if isinstance(value, str | int):
            pieces.append(str(value))
        else:
            pieces.append(value if isinstance(value, ir.Expression) else tuple(value))
        at = place.end()
    return ir.Verbatim((*pieces, text.template[at:]))


def fill(name: str, **values: str | int) -> str:
    """Return the kernel template in this file with names substituted; raises as `filled` does."""
    return "".join(map(str, filled(name, **values).pieces))


def comment(words: str) -> ir.Note:
    """Return a one-line comment, without characters that would end it."""
    return ir.Note(f"// {re.sub('[^A-Za-z0-9 _.,:+*=-]', '_', words)}")


def indented(lines: Iterable[str], depth: int) -> str:
    """Return the lines joined, each indented by `depth` levels of four spaces."""
    pad = "    " * depth
    return "\n".join(pad + line if line else line for line in lines)


def owned(text: str, names: Iterable[str], suffix: str) -> str:
    """Return a text with a suffix appended to some names, to make them unique."""
    return re.sub(rf"\b({'|'.join(names)})\b", rf"\1_{suffix}", text)
