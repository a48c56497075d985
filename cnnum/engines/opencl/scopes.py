"""The names of a parted kernel's body: each means one register, array or number, by its scope."""

import re
from collections.abc import Iterator
from dataclasses import dataclass, field

NAME = re.compile(r"\b[A-Za-z_]\w*")
_DECLARED = re.compile(r"\b(?:real|int|scalar) (\w[^;]*)")


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
class Array:
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


Meaning = Register | Array | Fixed


@dataclass(slots=True)
class Scope:
    """What names mean between two braces, and around them."""

    outer: "Scope | None" = None
    meanings: dict[str, Meaning] = field(default_factory=dict[str, Meaning])

    def find(self, name: str) -> Meaning | None:
        """Return what a name means, None if it is no name of the body."""
        if name in self.meanings:
            return self.meanings[name]
        return None if self.outer is None else self.outer.find(name)

    def used(self, text: str) -> tuple[Meaning, ...]:
        """Return what a text uses, each once, in the order of the text."""
        own = set(declared(text))
        found = (self.find(name) for name in NAME.findall(text) if name not in own)
        return tuple({meaning: None for meaning in found if meaning is not None})

    def renamed(self, text: str) -> str:
        """Return the text with every name of the body replaced by one that is unique."""
        own = set(declared(text))

        def unique(word: re.Match[str]) -> str:
            meaning = None if word[0] in own else self.find(word[0])
            return word[0] if meaning is None else meaning.name

        return NAME.sub(unique, text)


def declared(text: str) -> Iterator[str]:
    """Yield the names that a text declares itself."""
    for names in _DECLARED.findall(text):
        for part in parted_at_commas(names):
            match = NAME.match(part)
            if match is not None:
                yield match[0]


def parted_at_commas(text: str) -> list[str]:
    """Return what stands between the commas that stand in no bracket."""
    parts, depth = [""], 0
    for letter in text:
        depth += (letter in "([") - (letter in ")]")
        if letter == "," and depth == 0:
            parts.append("")
        else:
            parts[-1] += letter
    return [part.strip() for part in parts]
