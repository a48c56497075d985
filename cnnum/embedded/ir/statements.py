"""Statements of a program in whole numbers (or reals), as records that are run or printed.

Let, Set     a variable, and its new value
Store        a number of an array
Fold         a sum over the cells of a loop, or the largest or smallest value
Total        a sum over terms, one after the other
Cells        a loop over cells whose rounds do not see each other
Repeat       rounds one after the other
Rounds       rounds as long as a flag holds, up to a limit
"""

import re
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from cnnum.arrays import Shape
from cnnum.embedded.formats import Format
from cnnum.embedded.ir.expressions import Expression
from cnnum.embedded.ir.primitives import Bounds


def array_name(prefix: str, name: str) -> str:
    """Return the name of the array of a channel or an output, which is one that C allows."""
    return re.sub(r"\W", "_", f"{prefix}_{name}")


Kind = Literal["input", "state", "work", "table", "output"]


@dataclass(frozen=True, slots=True)
class Let:
    """A new variable; `bounds` are those of all that it will hold, where it is set again."""

    name: str
    value: Expression
    bounds: Bounds | None = None


@dataclass(frozen=True, slots=True)
class Set:
    """A number of the state or of the outputs, or a variable, gets a value."""

    name: str
    value: Expression


@dataclass(frozen=True, slots=True)
class Store:
    """A number of an array gets a value."""

    array: str
    at: Expression
    value: Expression


@dataclass(frozen=True, slots=True)
class Fold:
    """A variable takes in a value of each cell: "add", "maximum" or "minimum"."""

    name: str
    how: str
    value: Expression


@dataclass(frozen=True, slots=True)
class Total:
    """A new variable: the sum of a term over `variable` from 0 up to `count`."""

    name: str
    variable: str
    count: int
    term: Expression
    bounds: Bounds | None


@dataclass(frozen=True, slots=True)
class Cells:
    """A loop over `i` from 0 up to `count`.

    Attributes
    ----------
    count : int
    body : tuple of Statement
    cols, halo : int
        Of a loop over rows `r` and columns `c`: how many columns, and the width of the rim of
        padded arrays, in which the cell is number `p`. 0 columns where the body needs neither.
    """

    count: int
    body: "tuple[Statement, ...]"
    cols: int = 0
    halo: int = 0


@dataclass(frozen=True, slots=True)
class Repeat:
    """The same statements `count` times."""

    count: int
    body: "tuple[Statement, ...]"


@dataclass(frozen=True, slots=True)
class Rounds:
    """Statements that run while the variable `running` holds, at most `limit` times."""

    running: str
    limit: int
    body: "tuple[Statement, ...]"


Statement = Let | Set | Store | Fold | Total | Cells | Repeat | Rounds


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
        In words.
    values : int or float array, optional
        Of a table.
    logic : bool
    """

    name: str
    kind: Kind
    length: int
    format: Format | None
    about: str = ""
    values: NDArray[np.generic] | None = None
    logic: bool = False

    @property
    def bounds(self) -> Bounds | None:
        """The interval of its numbers."""
        if self.logic:
            return 0, 1
        if self.values is not None and self.format is not None:
            return int(self.values.min()), int(self.values.max())
        return None if self.format is None else (self.format.least, self.format.largest)


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
        Of variables: the bits of their whole numbers after the point.
    """

    name: str
    shape: Shape
    arrays: dict[str, Array]
    body: tuple[Statement, ...]
    outputs: dict[str, str]
    fractions: dict[str, int] = field(default_factory=dict[str, int])

    def of_kind(self, kind: Kind) -> list[Array]:
        """Return the arrays of a kind."""
        return [one for one in self.arrays.values() if one.kind == kind]
