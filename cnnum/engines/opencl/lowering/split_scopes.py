"""Scopes of the names of a plan's statements where every sweep is a kernel of its own."""

from collections.abc import Iterable
from dataclasses import dataclass, field

from cnnum import kernels as ir

BATCH, FRAME, REGISTERS = ir.names("batch frame registers")


@dataclass(frozen=True, slots=True)
class Register:
    """A number of a frame that outlives the kernel that computes it.

    Attributes
    ----------
    name : Name
        Its own among all registers.
    type : str
        In the kernels; it is kept as a `scalar`.
    place : int
        Among the registers.
    """

    name: ir.Name
    type: str
    place: int

    @property
    def where(self) -> ir.Element:
        """Where it is kept: the frames of a batch lie side by side."""
        return REGISTERS[ir.Integer(self.place) * BATCH + FRAME]

    @property
    def load(self) -> ir.Statement:
        """The statement that brings it into a kernel."""
        return ir.declare(self.name, ir.Cast(self.type, self.where), of=self.type)

    @property
    def store(self) -> ir.Statement:
        """The statement that keeps it."""
        return ir.Assign(self.where, ir.Cast("scalar", self.name))


@dataclass(frozen=True, slots=True)
class GlobalArray:
    """Values of a frame in global memory, from `start` on, be it in scratch or in its outputs."""

    name: ir.Name
    start: ir.Expression

    @property
    def load(self) -> ir.Statement:
        """The statement that brings it into a kernel."""
        return ir.Array(self.name, 0, self.start)


@dataclass(frozen=True, slots=True)
class Fixed:
    """A number that is the same wherever it is named."""

    name: ir.Expression


Meaning = Register | GlobalArray | Fixed


@dataclass(slots=True)
class Scope:
    """The scope of names between two braces, and around them."""

    outer: "Scope | None" = None
    meanings: dict[str, Meaning] = field(default_factory=dict[str, Meaning])

    def find(self, name: str) -> Meaning | None:
        """Return the meaning of a name, None if it is no name of the plan."""
        if name in self.meanings:
            return self.meanings[name]
        return None if self.outer is None else self.outer.find(name)

    def found(self, names: Iterable[str]) -> dict[str, Meaning]:
        """Return the meanings of names, those alone that are the plan's."""
        meanings = {name: self.find(name) for name in names}
        return {name: meaning for name, meaning in meanings.items() if meaning is not None}
