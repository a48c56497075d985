"""Scopes of the names of a plan's statements where every sweep is a kernel of its own."""

from collections.abc import Iterable
from dataclasses import dataclass, field


@dataclass(frozen=True, slots=True)
class Register:
    """A number of a frame that outlives the kernel that computes it.

    Attributes
    ----------
    name : str
        Its own among all registers.
    type : str
        In the kernels; it is kept as a `scalar`.
    place : int
        Among the registers.
    """

    name: str
    type: str
    place: int

    @property
    def where(self) -> str:
        """Where it is kept: the frames of a batch lie side by side."""
        return f"registers[{self.place} * batch + frame]"

    @property
    def load(self) -> str:
        """The statement that brings it into a kernel."""
        return f"{self.type} {self.name} = ({self.type}){self.where};"

    @property
    def store(self) -> str:
        """The statement that keeps it."""
        return f"{self.where} = (scalar){self.name};"


@dataclass(frozen=True, slots=True)
class GlobalArray:
    """Values of a frame in global memory, from `start` on, be it in scratch or in its outputs."""

    name: str
    start: str

    @property
    def load(self) -> str:
        """The statement that brings it into a kernel."""
        return f"__global real *const {self.name} = {self.start};"


@dataclass(frozen=True, slots=True)
class Fixed:
    """A number that is the same wherever it is named."""

    name: str


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
