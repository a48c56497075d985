"""Filling kernel texts: real OpenCL C in `kernels/*.cl` with `$names`, filled strictly."""

import re
from collections.abc import Iterable, Mapping, Sequence
from functools import cache
from importlib import resources
from string import Template as Text

from cnnum import kernels as ir

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
    _check_places(name, values)
    return _kernel_text(name).substitute({key: str(value) for key, value in values.items()})


def _check_places(name: str, values: Mapping[str, object]) -> None:
    unused = set(values) - set(_kernel_text(name).get_identifiers())
    if unused:
        raise ValueError(f"Kernel text '{name}.cl' has no place for {sorted(unused)}.")


def filled(name: str, **values: str | int | ir.Expression | Sequence[ir.Statement]) -> ir.Verbatim:
    """Return the kernel text of that file with records in the places of its names.

    Raises
    ------
    KeyError
        If a name of the text gets no value.
    ValueError
        If a value has no place in the text.
    """
    _check_places(name, values)
    pieces: list[str | ir.Expression | tuple[ir.Statement, ...]] = []
    at, text = 0, _kernel_text(name)
    for place in text.pattern.finditer(text.template):
        value = values[place["named"] or place["braced"]]
        pieces.append(text.template[at : place.start()])
        if isinstance(value, str | int):
            pieces.append(str(value))
        else:
            pieces.append(value if isinstance(value, ir.Expression) else tuple(value))
        at = place.end()
    return ir.Verbatim((*pieces, text.template[at:]))


def comment(words: str) -> ir.Note:
    """Return a comment: a line of signs that do not end it."""
    return ir.Note(f"// {re.sub('[^A-Za-z0-9 _.,:+*=-]', '_', words)}")


def indented(lines: Iterable[str], depth: int) -> str:
    """Return the lines joined, each indented by `depth` levels of four spaces."""
    pad = "    " * depth
    return "\n".join(pad + line if line else line for line in lines)


def owned(text: str, names: Iterable[str], suffix: str) -> str:
    """Return a text in which some names end with a suffix, so that they are its own."""
    return re.sub(rf"\b({'|'.join(names)})\b", rf"\1_{suffix}", text)
