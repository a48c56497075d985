"""A program in whole numbers, or in reals: its arrays, and the statements of one frame."""

import re
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from cnnum import kernels as ir
from cnnum.arrays import Shape
from cnnum.embedded.formats import Format


def array_name(prefix: str, name: str) -> str:
    """Return the name of the array of a channel or an output, which is one that C allows."""
    return re.sub(r"\W", "_", f"{prefix}_{name}")


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
    def bounds(self) -> ir.Bounds | None:
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
    body: tuple[ir.Statement, ...]
    outputs: dict[str, str]
    fractions: dict[str, int] = field(default_factory=dict[str, int])

    def of_kind(self, kind: Kind) -> list[Array]:
        """Return the arrays of a kind."""
        return [one for one in self.arrays.values() if one.kind == kind]
