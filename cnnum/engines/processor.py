"""The processor of this machine: its name, and the instructions that it has."""

import platform
from dataclasses import dataclass
from functools import cache
from pathlib import Path

CPUINFO = Path("/proc/cpuinfo")
"""Linux has it; other systems give a name alone."""


@dataclass(frozen=True, slots=True)
class Processor:
    """A processor.

    Attributes
    ----------
    name : str
    family, model : str
        Numbers of its maker; empty where the system does not give them.
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
    """Return the first processor that a text in the form of Linux's `/proc/cpuinfo` describes."""
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
