"""Which format each value has: from the largest magnitude that was seen, with room above it."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from cnnum.embedded.formats import REGISTER, Format, Precision, fitting

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
