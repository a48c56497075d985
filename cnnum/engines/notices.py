"""Messages about engines: which is used instead, how to get OpenCL, and what went wrong."""

import platform
import sys
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cnnum.errors import MethodError

_CONDA = "'conda install -c conda-forge pyopencl pocl'"

_WAYS = {
    "linux": f"'apt install pocl-opencl-icd' (Debian, Ubuntu), {_CONDA}, or a GPU's driver",
    "darwin": _CONDA,
    "win32": f"{_CONDA}, or a GPU's driver",
}

_WHEEL = "'pip install \"pyopencl[pocl]\"', "


def how_to_get_opencl(system: str = sys.platform, machine: str = platform.machine()) -> str:
    """Return the advice as part of a sentence.

    Parameters
    ----------
    system, machine : str
        As `sys.platform` and `platform.machine()` name them.
    """
    # the wheel of PoCL is made for this one platform
    wheel = _WHEEL if (system, machine) == ("linux", "x86_64") else ""
    return f"to get OpenCL, take one of: {wheel}{_WAYS.get(system, _CONDA)}"


def refuse_unfinished(unfinished: NDArray[Any]) -> None:
    """Raise if a transient or a loop did not finish in any frame of a batch.

    Parameters
    ----------
    unfinished : (batch,) bool or float
        Nonzero for frames in which one did not finish.

    Raises
    ------
    MethodError
        If there is such a frame.
    """
    failed = np.flatnonzero(unfinished)
    if failed.size:
        raise MethodError(
            f"A transient or a loop did not reach its end in {failed.size} of {len(unfinished)} "
            f"frames (the first is frame {failed[0]}): loosen the tolerances, shorten the "
            "duration, or raise the loop's limit."
        )


CPUINFO = Path("/proc/cpuinfo")
"""Exists on Linux; other systems give only a name."""


@dataclass(frozen=True, slots=True)
class Processor:
    """A processor.

    Attributes
    ----------
    name : str
    family, model : str
        The vendor's numbers; empty if the system does not provide them.
    flags : frozenset of str
        Instruction sets, by their names in Linux; empty elsewhere.
    """

    name: str
    family: str
    model: str
    flags: frozenset[str]


@cache
def processor() -> Processor:
    """Return the processor of this machine."""
    try:
        text = CPUINFO.read_text(encoding="utf-8", errors="replace")
    except OSError:
        text = ""
    return read_cpuinfo(text)


def read_cpuinfo(text: str) -> Processor:
    """Return the first processor described by text in the format of Linux's `/proc/cpuinfo`."""
    facts = dict[str, str]()
    for line in text.split("\n\n")[0].splitlines():
        key, _, value = line.partition(":")
        facts[key.strip()] = value.strip()
    return Processor(
        facts.get("model name") or platform.processor() or platform.machine(),
        facts.get("cpu family", ""),
        facts.get("model", ""),
        frozenset(facts.get("flags", "").split()),
    )
