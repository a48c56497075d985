"""Fixed-point formats, and the format of each value.

A format holds q · 2^−fraction for whole q of a width in bits. Larger numbers saturate.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from math import ceil, log2

from cnnum.errors import UnknownNameError

REGISTER = 31
"""Bits of values that are not stored: numbers, and values within a loop over cells. A sum of two of
them, and the half that rounds it, fit in 32 bits."""

LONGEST = 32
"""Bits of the longest word."""

FACTOR = 24
"""Bits of the longest weight, as float32 has: 64 bits hold a sum of 256 products with words."""

FINEST, COARSEST = 46, -30
"""Fractions beyond these are of no use: shifts of 64 bits would follow."""


@dataclass(frozen=True, slots=True)
class Format:
    """Numbers q · 2^−fraction with q of `bits` bits in two's complement.

    Attributes
    ----------
    bits : int
    fraction : int
    """

    bits: int
    fraction: int

    @property
    def least(self) -> int:
        """The smallest whole number."""
        return -(1 << (self.bits - 1))

    @property
    def largest(self) -> int:
        """The largest whole number."""
        return (1 << (self.bits - 1)) - 1

    @property
    def step(self) -> float:
        """The distance between adjacent values."""
        return 2.0**-self.fraction

    def quantised(self, value: float) -> int:
        """Return the nearest whole number, halves up, saturated."""
        shifted = value * 2.0**self.fraction
        return max(self.least, min(self.largest, ceil(shifted - 0.5)))

    def __str__(self) -> str:
        return f"q{self.bits - 1 - self.fraction}.{self.fraction}"


def fitting(bits: int, largest: float) -> Format:
    """Return the finest format of a width in bits that holds a magnitude."""
    size = largest if largest > 0.0 else 1.0
    # the largest whole number is one less than a power of two
    whole = ceil(log2(size * (1.0 + 2.0 ** (1 - bits))))
    return Format(bits, max(COARSEST, min(FINEST, bits - 1 - whole)))


@dataclass(frozen=True, slots=True)
class Precision:
    """The number representation of a program.

    Attributes
    ----------
    name : str
        Name by which users select it.
    word : int
        Bits of a stored map and of an input; 0 for float32.
    fraction : int or None
        The fraction of every stored map; by default it follows from the map's range.
    """

    name: str
    word: int
    fraction: int | None = None

    @property
    def integer(self) -> bool:
        """Whether it is a fixed-point precision."""
        return self.word > 0

    @property
    def weight(self) -> int:
        """Bits of a constant factor."""
        return min(self.word, FACTOR)

    @property
    def container(self) -> int:
        """Bits of the C type that a stored map is kept in."""
        return next(bits for bits in (8, 16, LONGEST) if self.word <= bits)

    @property
    def memory(self) -> int:
        """Bits of a map that outlives the frame: twice a word, so that slow averages move."""
        return max(self.word, min(REGISTER, 2 * self.container))

    def stored(self, largest: float) -> Format:
        """Return the format of a stored map with values up to a magnitude."""
        return self._fixed() or fitting(self.word, largest)

    def kept(self, largest: float) -> Format:
        """Return the format of a map that outlives the frame."""
        return fitting(self.memory, largest)

    def _fixed(self) -> Format | None:
        return None if self.fraction is None else Format(self.word, self.fraction)


def precision_named(name: str) -> Precision:
    """Return a precision by its name.

    Raises
    ------
    UnknownNameError
        If it is not float32, q7, q15, or qM.N with 4 to 32 bits.
    """
    if name == "float32":
        return Precision(name, 0)
    if result := re.fullmatch(r"q(\d{1,2})", name):
        word = 1 + int(result[1])
        if 4 <= word <= LONGEST:
            return Precision(name, word)
    if result := re.fullmatch(r"q(\d{1,2})\.(\d{1,2})", name):
        word = 1 + int(result[1]) + int(result[2])
        if 4 <= word <= LONGEST:
            return Precision(name, word, int(result[2]))
    raise UnknownNameError(
        f"Unknown precision {name!r:.60}: expected 'float32', 'q15', 'q7', another 'qN', or a "
        "'qM.N' with M + N from 3 to 31."
    )


def is_integer(name: str | None) -> bool:
    """Return whether a precision's name is a fixed-point one."""
    return isinstance(name, str) and bool(re.fullmatch(r"q\d{1,2}(\.\d{1,2})?", name))


STORED, KEPT, REGISTERS = 1.25, 4.0, 16.0
"""Room above the largest value seen: a word has few bits, a memory more, and a register many."""

SHORT = 16
"""Bits of a word up to which a stored map has little room; a longer one has a memory's."""

EARLY = 64.0
"""Factor that the first frames may add to a register's range: memories are empty then, and
quotients by them may be as large as any number."""

UNSEEN = 1.0
"""Magnitude of a value that was always 0."""


@dataclass(frozen=True, slots=True)
class Sizes:
    """Formats by name.

    Attributes
    ----------
    precision : Precision
    seen, early : mapping of str to float
        Largest magnitude of every variable and array, as measured; and in the first frames.
    """

    precision: Precision
    seen: Mapping[str, float]
    early: Mapping[str, float] = field(default_factory=dict[str, float])

    def register(self, name: str) -> Format:
        """Return the format of a number, or of a value within a loop."""
        return fitting(REGISTER, REGISTERS * self._ever(name))

    def stored(self, name: str) -> Format:
        """Return the format of a map that ends with the frame."""
        room = STORED if self.precision.word <= SHORT else KEPT
        return self.precision.stored(room * self._seen(name))

    def kept(self, name: str) -> Format:
        """Return the format of a map that outlives the frame, or of a sum on the way."""
        return self.precision.kept(KEPT * self._ever(name))

    def _ever(self, name: str) -> float:
        later, early = self._seen(name), self.early.get(name, 0.0)
        return max(later, min(early, EARLY * later))

    def _seen(self, name: str) -> float:
        return self.seen.get(name, 0.0) or self.early.get(name, 0.0) or UNSEEN


@dataclass(frozen=True, slots=True)
class NoFormats:
    """Reals have none."""

    precision: Precision

    def register(self, name: str) -> None:
        """Return nothing."""

    def stored(self, name: str) -> None:
        """Return nothing."""

    def kept(self, name: str) -> None:
        """Return nothing."""


Formats = Sizes | NoFormats
