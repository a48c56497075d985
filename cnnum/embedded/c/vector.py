"""The test vector of an export: streams that show as much of the program as they can, and how much.

A vector that a wrong program passes proves nothing. So the streams are chosen among many by the
answers of the emulator, and constants are flipped in it to see which of them no answer shows.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from cnnum import kernels as ir
from cnnum.embedded.emulator import Emulator, Numbers, cleared
from cnnum.embedded.program import IntegerProgram
from cnnum.errors import ArrayError
from cnnum.kernels.expressions import operands

Frames = Sequence[Mapping[str, Numbers]]
"""Inputs of one frame after another, (batch, cells) each."""

STREAMS = 4
"""Streams of a vector at most, each after a reset."""

AGAIN = 4
"""The first part of the first stream comes once more, after a last reset: one in so many frames."""

FLIPPED = 64
"""Constants that are flipped at most; of more, as many that are evenly spread."""

OFF = 1e-3
"""Share of an output's largest number by which a float may be off: libraries of mathematics and
contracted products round otherwise, and a memory hands such roundings on."""


@dataclass(frozen=True, slots=True, eq=False)
class Vector:
    """Frames and their answers.

    Attributes
    ----------
    frames, answers : sequence of mapping of str to (1, length) int or float
    begins : sequence of bool
        Before which frames the memory is cleared.
    still : tuple of str
        Outputs that are the same in all frames: the vector tells nothing of them.
    remembers : bool
        Whether an answer differs where the memory is not cleared between the streams.
    flipped, constants : int
        Constants whose sign was flipped, and those that there are.
    unseen : mapping of str to int
        Flipped constants that no answer shows, by the table or the value in which they stand.
    """

    frames: Frames
    answers: Sequence[Mapping[str, Numbers]]
    begins: Sequence[bool]
    still: tuple[str, ...]
    remembers: bool
    flipped: int
    constants: int
    unseen: Mapping[str, int]

    def about(self, program: IntegerProgram) -> list[str]:
        """Return what the vector shows, and what it does not, a sentence each."""
        result = list[str]()
        if self.still:
            names = ", ".join(f"'{name}'" for name in self.still)
            result.append(f"It tells nothing of {names}: no frame changes them.")
        if program.of_kind("state") and not self.remembers:
            result.append("No answer shows whether the memory is cleared.")
        seen = self.flipped - sum(self.unseen.values())
        result.append(
            f"Of {self.flipped} constants with another sign (of {self.constants} in all), {seen} "
            "change an answer."
        )
        if self.unseen:
            places = ", ".join(
                name if count == 1 else f"{name} ({count})" for name, count in self.unseen.items()
            )
            result.append(f"None shows those of {places}.")
        return result


def vector_of(program: IntegerProgram, streams: Frames) -> Vector:
    """Return the test vector of a program.

    Parameters
    ----------
    program : IntegerProgram
    streams : sequence of mapping of str to (batch, cells) int or float
        Frames of streams side by side, among which some are chosen.

    Raises
    ------
    ArrayError
        If an output is not finite in any of the streams.
    """
    batch = max([1, *(len(numbers) for frame in streams for numbers in frame.values())])
    known = _answers(program, [(streams, batch)])
    lanes = _chosen(_moving(known), batch, _finite(program, known, batch))
    parts = [
        [{n: numbers[at : at + 1] for n, numbers in frame.items()} for frame in streams]
        for at in lanes
    ]
    parts.append(parts[0][: max(1, len(streams) // AGAIN)])
    frames = [frame for part in parts for frame in part]
    begins = [number == 0 for part in parts for number in range(len(part))]
    answers = _answers(program, [(part, 1) for part in parts])
    changing = _moving(answers)
    still = tuple(name for name, array in program.outputs.items() if not changing[array].any())
    kept = _answers(program, [(frames, 1)])
    constants = list(_constants(program))
    tried = constants[:: -(-len(constants) // FLIPPED) or 1]
    unseen = _unseen(program, parts, answers, tried)
    remembers = not _same(program, answers, kept)[0]
    return Vector(frames, answers, begins, still, remembers, len(tried), len(constants), unseen)


def _answers(
    program: IntegerProgram, parts: Sequence[tuple[Frames, int]]
) -> list[Mapping[str, Numbers]]:
    """Return the answers to frames, of which each part begins with a reset."""
    result = list[Mapping[str, Numbers]]()
    for frames, batch in parts:
        state = cleared(program, batch)
        for number, frame in enumerate(frames):
            emulator = Emulator(program, single=program.real)
            result.append(emulator.run(frame, state, first=number == 0, batch=batch))
    return result


def _moving(answers: Sequence[Mapping[str, Numbers]]) -> dict[str, Numbers]:
    """Return how often each output changes from frame to frame, (batch,) each."""
    result = dict[str, Numbers]()
    for name in answers[0]:
        values = np.stack([answer[name] for answer in answers])
        result[name] = (values[1:] != values[:-1]).any(axis=-1).sum(axis=0)
    return result


def _finite(
    program: IntegerProgram, answers: Sequence[Mapping[str, Numbers]], batch: int
) -> NDArray[np.bool_]:
    """Return of each stream whether all its answers are finite, (batch,); some must be."""
    result = np.ones(batch, dtype=bool)
    for name, array in program.outputs.items():
        for answer in answers:
            result &= np.isfinite(answer[array]).all(axis=-1)
        if not result.any():
            raise ArrayError(
                f"Output '{name}' is not finite in float32 in any stream of the test vector: "
                "rescale the quantity, or leave it out of the requested outputs."
            )
    return result


def _chosen(moving: Mapping[str, Numbers], batch: int, finite: NDArray[np.bool_]) -> list[int]:
    """Return the streams that change the most outputs which those before do not."""
    changing = np.stack([np.broadcast_to(flags, batch) for flags in moving.values()])
    left, result = np.ones(len(changing), dtype=bool), list[int]()
    while len(result) < STREAMS:
        gain = (changing[left] > 0).sum(axis=0) + changing.mean(axis=0) / (1.0 + changing.max())
        gain[result] = gain[~finite] = -1.0
        best = int(np.argmax(gain))
        if gain[best] < 0.0 or (result and not (changing[left, best] > 0).any()):
            break
        result.append(best)
        left &= changing[:, best] == 0
    return result


def _same(
    program: IntegerProgram,
    wanted: Sequence[Mapping[str, Numbers]],
    given: Sequence[Mapping[str, Numbers]],
) -> np.ndarray:
    """Return of each lane whether the vector takes its answers for the wanted ones."""
    same = np.ones(1, dtype=bool)
    for array in program.of_kind("output"):
        real = array.format is None and not array.logic
        most = tolerance([answer[array.name] for answer in wanted]) if real else 0.0
        for first, other in zip(wanted, given, strict=True):
            off = np.abs(other[array.name] - first[array.name])
            same = same & (off <= most).all(axis=-1)
    return same


def tolerance(values: Sequence[Numbers]) -> float:
    """Return by how much a float of an output may be off."""
    largest = max(float(np.abs(value).max()) for value in values)
    return OFF * largest if largest > 0.0 else OFF**2


@dataclass(frozen=True, slots=True)
class _Constant:
    """A constant: a literal in a value, or a number of a table.

    Attributes
    ----------
    place : str
    literal : Integer or Number, optional
    at : int
    """

    place: str
    literal: ir.Integer | ir.Number | None = None
    at: int = 0


def _constants(program: IntegerProgram) -> Iterator[_Constant]:
    """Yield the constants of a program that are not 0; places in arrays are none."""
    for name, value in _values(program.body):
        for literal in _literals(value):
            yield _Constant(name, literal)
    for table in program.of_kind("table"):
        assert table.values is not None
        if not table.places:
            for at in np.flatnonzero(table.values).tolist():
                yield _Constant(table.name, at=at)


def _values(body: Sequence[ir.Statement]) -> Iterator[tuple[str, ir.Expression]]:
    for statement in body:
        if isinstance(statement, ir.Declare) and statement.type == "real":
            yield from (
                (name.text, value) for name, value in statement.variables if value is not None
            )
        elif isinstance(statement, ir.Assign | ir.Accumulate):
            target = statement.target
            yield (target.array if isinstance(target, ir.Element) else target).text, statement.value
        elif isinstance(statement, ir.Sweep | ir.Loop | ir.Counted):
            yield from _values(statement.body)


def _literals(value: ir.Expression) -> Iterator[ir.Integer | ir.Number]:
    """Yield the literals of an expression: no places, and no numbers of places to shift by."""
    if isinstance(value, ir.Element):
        return
    inner = operands(value)
    if isinstance(value, ir.Binary) and value.sign == ">>":
        inner = inner[:1]
    for statement in inner:
        if isinstance(statement, ir.Integer | ir.Number):
            if statement.value:
                yield statement
        else:
            yield from _literals(statement)


@dataclass(slots=True, eq=False)
class _Flipping(Emulator):
    """Runs the program with another constant flipped in each lane."""

    flips: dict[int, Numbers] = field(default_factory=dict[int, Numbers])
    tables: dict[str, Numbers] = field(default_factory=dict[str, Numbers])

    def value(self, expression: ir.Expression) -> Numbers:
        """Return the value of an expression, (batch or 1, 1 or cells)."""
        flips = self.flips.get(id(expression))
        result = Emulator.value(self, expression)
        return result if flips is None else result * flips

    def table(self, name: str, values: Numbers) -> Numbers:
        """Return the numbers of a table."""
        written, flips = Emulator.table(self, name, values), self.tables.get(name)
        return written if flips is None else written * flips


def _unseen(
    program: IntegerProgram,
    parts: Sequence[Frames],
    wanted: Sequence[Mapping[str, Numbers]],
    tried: Sequence[_Constant],
) -> dict[str, int]:
    """Return how many of the constants may be flipped without a change, by their places."""
    batch = len(tried)
    if not batch:
        return {}
    flips, tables = dict[int, Numbers](), dict[str, Numbers]()
    for lane, fault in enumerate(tried):
        if fault.literal is not None:
            flips.setdefault(id(fault.literal), np.ones((batch, 1), dtype=np.int64))[lane] = -1
        else:
            length = program.arrays[fault.place].length
            ones = tables.setdefault(fault.place, np.ones((batch, length), dtype=np.int64))
            ones[lane, fault.at] = -1
    given = list[Mapping[str, Numbers]]()
    for frames in parts:
        state = cleared(program, batch)
        for number, frame in enumerate(frames):
            emulator = _Flipping(program, single=program.real, flips=flips, tables=tables)
            given.append(emulator.run(frame, state, first=number == 0, batch=batch))
    same = np.broadcast_to(_same(program, wanted, given), batch)
    result = dict[str, int]()
    for fault in (tried[at] for at in np.flatnonzero(same).tolist()):
        result[fault.place] = result.get(fault.place, 0) + 1
    return result
