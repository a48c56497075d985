"""The statements of a kernel's body, read back from the text that the other rooms wrote.

That text is a small part of C: declarations, assignments, blocks, branches on numbers, counted
loops, and sweeps: loops over `i` (values), `r` (rows) or `q` (cells of rims) whose rounds do not
depend on each other, but for what they add up.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass

_SPACE = re.compile(r"\s+")
_HEADER = re.compile(r"int (\w+) = (\d+); (.+); \+\+\1$")
_RANGE = re.compile(r"[irq] < (\d+)$")


@dataclass(frozen=True, slots=True)
class Note:
    """A comment on what follows."""

    text: str


@dataclass(frozen=True, slots=True)
class Plain:
    """A declaration or an assignment, or a loop on numbers alone."""

    text: str


@dataclass(frozen=True, slots=True)
class Sweep:
    """A loop over `count` values, rows or rims, called `variable`."""

    variable: str
    count: int
    body: str


@dataclass(frozen=True, slots=True)
class Block:
    """Statements whose declarations end with them."""

    body: "tuple[Statement, ...]"


@dataclass(frozen=True, slots=True)
class Branch:
    """Statements that run if a condition holds."""

    condition: str
    body: "tuple[Statement, ...]"


@dataclass(frozen=True, slots=True)
class Counted:
    """A loop that counts `variable` up from `start` while a condition holds.

    `counts` says whether its body asks for the count.
    """

    variable: str
    start: int
    condition: str
    body: "tuple[Statement, ...]"
    counts: bool


Statement = Note | Plain | Sweep | Block | Branch | Counted


def parse(text: str) -> tuple[Statement, ...]:
    """Return the statements of a body.

    Raises
    ------
    ValueError
        If the text is not of this language, which is a fault of the room that wrote it.
    """
    return tuple(_statements(text + "\n"))


def _statements(text: str) -> Iterator[Statement]:
    at = _skip(text, 0)
    while at < len(text):
        found, at = _statement(text, at)
        yield found
        at = _skip(text, at)


def _skip(text: str, at: int) -> int:
    match = _SPACE.match(text, at)
    return at if match is None else match.end()


def _statement(text: str, at: int) -> tuple[Statement, int]:
    if text.startswith("//", at):
        end = text.index("\n", at)
        return Note(text[at:end]), end
    if text[at] == "{":
        end = _closing(text, at)
        return Block(parse(text[at + 1 : end])), end + 1
    for word, read in (("for", _loop), ("if", _branch), ("while", _while)):
        if text.startswith(f"{word} (", at):
            opened = at + len(word) + 1
            closed = _closing(text, opened)
            begin = _skip(text, closed + 1)
            end = _closing(text, begin)
            return read(text[opened + 1 : closed], text[begin + 1 : end]), end + 1
    end = text.index(";", at)
    return Plain(text[at:end]), end + 1


def _loop(header: str, body: str) -> Statement:
    match = _HEADER.match(header)
    if match is None:
        raise ValueError(f"A kernel has a loop that nothing reads: for ({header}).")
    variable, start, condition = match.groups()
    over = _RANGE.match(condition)
    if over is not None:
        return Sweep(variable, int(over[1]), body)
    counts = re.search(rf"\b{variable}\b", body) is not None
    return Counted(variable, int(start), condition, parse(body), counts)


def _branch(condition: str, body: str) -> Statement:
    return Branch(condition, parse(body))


def _while(condition: str, body: str) -> Statement:
    return Plain(f"while ({condition}) {{ {body} }}")


def _closing(text: str, at: int) -> int:
    """Return where the bracket closes that opens there."""
    pairs = {"{": "}", "(": ")"}
    opening, closing, depth = text[at], pairs[text[at]], 0
    for place in range(at, len(text)):
        depth += (text[place] == opening) - (text[place] == closing)
        if depth == 0:
            return place
    raise ValueError("A kernel has a bracket that does not close.")
