"""Cycles of instructions as intervals, by the tables of Arm's manuals, from what a core executed.

Cortex-M4: "Technical Reference Manual r0p1" (DDI 0439), table 3-1; loads and stores take 2 cycles,
or 1 behind another one. Cortex-M0: DDI 0432, table 3-1. Arm states no cycles of a Cortex-M7: it
issues up to two instructions per cycle, and there is no upper bound.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import inf

Interval = tuple[float, float]

Fetch = Callable[[int], int]
"""Returns the 16 bits at an address."""


@dataclass(frozen=True, slots=True)
class Timing:
    """The cycles of the kinds of instructions of a core, the least and the most.

    Attributes
    ----------
    single : (least, most)
        A load or a store.
    several : float
        Least cycles of a transfer of several registers, besides one each; at most it is 1.
    taken : (least, most)
        A branch that is taken.
    multiply, divide, call : (least, most)
    """

    single: Interval
    several: float
    taken: Interval
    multiply: Interval
    divide: Interval
    call: Interval


TIMINGS = {
    "m0": Timing((2, 2), 1, (3, 3), (1, 32), (1, 1), (4, 4)),
    "m4": Timing((1, 2), 0, (2, 4), (1, 1), (2, 12), (2, 4)),
}


@dataclass(frozen=True, slots=True)
class Kind:
    """One instruction: its cycles, its half-words, and the words that it loads or stores."""

    least: float
    most: float
    size: int = 1
    words: int = 0


def kind_of(core: str, address: int, fetch: Fetch) -> Kind:
    """Return what an instruction of a core takes, without wait states."""
    first, timing = fetch(address), TIMINGS[core]
    if first >> 11 in (0b11101, 0b11110, 0b11111):
        return _wide(first, fetch(address + 2), timing)
    top, single, branch = first >> 12, timing.single, timing.taken
    if top in (5, 6, 7, 8, 9) or first >> 11 == 0b01001:
        return Kind(*single, words=1)
    if first & 0xF600 == 0xB400 or top == 0xC:  # push, pop; store and load multiple
        jumps = first & 0xFF00 == 0xBD00
        count = (first & (0x1FF if first & 0xFE00 == 0xB400 else 0xFF)).bit_count() + jumps
        return _several(count, timing, jumps=jumps)
    if (top == 0xD and first >> 8 & 15 < 14) or first & 0xF500 == 0xB100:
        return Kind(1, branch[1])
    if first & 0xFF80 == 0x4780:
        return Kind(*branch)
    if first >> 11 == 0b11100 or first & 0xFF00 == 0x4700 or first & 0xFD87 == 0x4487:
        return Kind(*branch)
    if first & 0xFFC0 == 0x4340:
        return Kind(*timing.multiply)
    return Kind(0 if first & 0xFF00 == 0xBF00 else 1, 1)  # "if-then" may be folded


def _several(count: int, timing: Timing, *, jumps: bool, size: int = 1) -> Kind:
    """Return what it takes to load or store several registers; the last may be the way back."""
    least, most = timing.taken if jumps else (0, 0)
    return Kind(timing.several + count + least, 1 + count + most, size, count)


def _wide(first: int, second: int, timing: Timing) -> Kind:
    least, most = timing.taken
    if first & 0xFE40 == 0xE800:
        return _several(second.bit_count(), timing, jumps=bool(first & 16 and second >> 15), size=2)
    if first & 0xFFF0 == 0xE8D0 and second & 0xFFE0 == 0xF000:  # table branch
        return Kind(1 + least, 1 + most, 2, 1)
    if first & 0xFE40 == 0xE840:  # two words
        return Kind(2, 3, 2, 2)
    if first & 0xFE00 == 0xF800:
        jumps = bool(first & 16) and second >> 12 == 15
        low, high = timing.single
        return Kind(low + jumps * least, high + jumps * most, 2, 1)
    if first & 0xF800 == 0xF000 and second >> 15:
        if second & 0x5000 == 0x5000:
            return Kind(*timing.call, 2)
        conditional = not second & 0x1000 and first >> 6 & 15 < 14
        plain = bool(second & 0x1000)
        return Kind(least if plain else 1, most if plain or conditional else 4, 2)
    if first & 0xFF80 == 0xFB80 and first & 0x50 == 0x10 and second & 0xF0 == 0xF0:
        return Kind(*timing.divide, 2)
    if first & 0xEC00 == 0xEC00 and first >> 12 in (0xE, 0xF) and first & 0xFF00 != 0xFB00:
        return Kind(1, 14 if first & 0xEF00 == 0xEE00 else 33, 2)  # of the floating-point unit
    return Kind(1, 1, 2)


def cycles_of(
    core: str, executed: Mapping[int, int], fetch: Fetch, wait_states: int = 0
) -> Interval:
    """Return the least and the most cycles of what a core executed.

    Parameters
    ----------
    core : "m0", "m4" or "m7"
    executed : mapping of int to int
        How often each address was executed.
    fetch : callable
    wait_states : int
        Of the flash, for the upper bound: without a cache, each word of code waits for them, and
        each word that is loaded or stored, as if all stood in flash.

    Returns
    -------
    (least, most)
        The least without wait states.
    """
    if core not in TIMINGS:
        return sum(executed.values()) / 2, inf
    least = most = 0.0
    for address, times in executed.items():
        kind = kind_of(core, address, fetch)
        words = (kind.size + 1) // 2 + kind.words
        least += times * kind.least
        most += times * (kind.most + wait_states * words)
    return least, most
