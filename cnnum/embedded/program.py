"""A program in fixed or floating point: its arrays, and the statements of one frame."""

import re
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from cnnum import kernels as ir
from cnnum.arrays import Shape
from cnnum.embedded.formats import Format


def plain(name: str) -> str:
    """Return a name with '_' in place of all that no identifier of C holds."""
    return re.sub(r"[^0-9A-Za-z_]", "_", name)


def array_names(prefix: str, names: Iterable[str]) -> dict[str, str]:
    """Return the names of the arrays of channels or outputs, which C allows; no two are the same.

    Names that C allows stay as they are, and names that would collide get a number. Because macros
    are made of them as well, upper and lower case count as equal.
    """
    result, taken = dict[str, str](), set[str]()
    for name in sorted(names, key=lambda name: plain(name) != name):
        array = base = f"{prefix}_{plain(name)}"
        number = 1
        while array.lower() in taken:
            number += 1
            array = f"{base}_{number}"
        taken.add(array.lower())
        result[name] = array
    return result


UNFINISHED = "unfinished"
"""The answer that says whether a loop of the frame came to its limit; outputs have a prefix."""

Kind = Literal["input", "state", "work", "table", "output"]


@dataclass(frozen=True, slots=True, eq=False)
class Array:
    """Numbers of one format.

    Attributes
    ----------
    name : str
    kind : str
        "input", "state", "work", "table" or "output".
    length : int
        0 for a single number.
    format : Format or None
        None of reals.
    about : str
        Description.
    values : int or float array, optional
        Values of a table.
    logic : bool
    places : bool
        Whether its numbers are places in another array.
    exact : bool
        Whether a table holds its numbers without rounding them.
    """

    name: str
    kind: Kind
    length: int
    format: Format | None
    about: str = ""
    values: NDArray[np.generic] | None = None
    logic: bool = False
    places: bool = False
    exact: bool = False

    @property
    def bounds(self) -> ir.Bounds | None:
        """The interval of its numbers."""
        if self.logic:
            return 0, 1
        if self.values is not None and self.format is not None:
            return int(self.values.min()), int(self.values.max())
        return None if self.format is None else (self.format.least, self.format.largest)

    @property
    def bits(self) -> int:
        """Bits of the C type of its whole numbers; that of logic has no sign."""
        if self.logic or self.format is None:
            return 8
        return next(bits for bits in (8, 16, 32) if self.format.bits <= bits)

    @property
    def held(self) -> ir.Bounds | None:
        """The interval of all that may lie in it: of inputs and the state, what the type holds."""
        if self.kind not in ("input", "state") or (self.format is None and not self.logic):
            return self.bounds
        if self.logic:
            return 0, (1 << self.bits) - 1
        return -1 << (self.bits - 1), (1 << (self.bits - 1)) - 1


@dataclass(frozen=True, slots=True, eq=False)
class IntegerProgram:
    """A program that is run by the emulator and printed as C.

    Attributes
    ----------
    name : str
    shape : (rows, cols)
    arrays : mapping of str to Array
    body : tuple of Statement
        One frame.
    outputs : mapping of str to str
        From outputs to arrays.
    fractions : dict of str to int
        Number of fractional bits of each variable.
    """

    name: str
    shape: Shape
    arrays: dict[str, Array]
    body: tuple[ir.Statement, ...]
    outputs: dict[str, str]
    fractions: dict[str, int] = field(default_factory=dict[str, int])

    @property
    def real(self) -> bool:
        """Whether it counts in reals."""
        return any(array.format is None and not array.logic for array in self.arrays.values())

    @property
    def may_not_finish(self) -> bool:
        """Whether an answer says that a loop came to its limit."""
        return UNFINISHED in self.arrays

    def of_kind(self, kind: Kind) -> list[Array]:
        """Return the arrays of a kind."""
        return [array for array in self.arrays.values() if array.kind == kind]
