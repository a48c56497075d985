"""The machine as a program sees it: the frame's channels, its geometry, and local memories."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Sequence
from math import ceil
from numbers import Integral
from typing import NamedTuple, TypeVar, cast

import numpy as np
from numpy.typing import ArrayLike

from cnnum.arrays import Floats, Shape
from cnnum.errors import ProgramError, UnknownNameError, name_error
from cnnum.frame import FORCE_AXES
from cnnum.graph.nodes import FirstFrame, Graph, Input, Memory, Node, Read
from cnnum.programs.fields import Field, constant, most, sqrt, square, total, where
from cnnum.safety.values import checked_name

Made = TypeVar("Made")

SATURATED = "saturated"
"""Channel in which a scene marks the taxels at an end of their range: 1, else 0."""

BEGINS, ENOUGH = 0.08, 8
"""s at the start of a stream that are rest, and frames at least: the mean of eight is known to a
third of the noise."""

NOMINAL = 200.0
"""Hz at which a program is traced while nothing says a rate: good for its cost and its bounds. No
stream begins at it."""


class LocalMemory:
    """Local memory of every cell, or one number, kept from frame to frame."""

    __slots__ = ("_graph", "_number", "value")

    def __init__(
        self, graph: Graph, name: str, *, scalar: bool, logic: bool, maps: int = 1
    ) -> None:
        if name:
            checked_name("a memory", name, ProgramError)
        self._graph = graph
        self._number = len(graph.memories)
        read = graph.add(Read(self._number, name), scalar=scalar, logic=logic, maps=maps)
        graph.memories[self._number] = Memory(read, read)
        self.value = Field(graph, read)
        """The value stored at the end of the frame before; 0 on the first frame."""

    def store(self, value: Field) -> None:
        """Set the value of the memory at the end of the frame.

        Raises
        ------
        ProgramError
            If the memory was already stored in this frame, or if a map is stored in a memory of one
            number, or numbers in a memory of logic values.
        """
        if value.graph is not self._graph:
            raise ProgramError("A memory must be stored once per frame, outside loops.")
        memory = self._graph.memories[self._number]
        if memory.store is not memory.read:
            raise ProgramError(f"Memory {self._number} is stored twice in one frame.")
        held, given = _kind(memory.read), _kind(value.node)
        if held != given:
            raise ProgramError(
                f"Memory {self._number} holds {held}, got {given}; give scalar= or maps= where it "
                "is created."
            )
        if memory.read.logic and not value.logic:
            raise ProgramError(
                f"Memory {self._number} holds logic values, got numbers: compare them first, or "
                "leave out logic=True where it is created."
            )
        self._graph.memories[self._number] = Memory(memory.read, value.node)

    def latch(self, sets: Field, stays: Field) -> Field:
        """Store and return a flag or logic map that `sets` switches on and `stays` keeps on."""
        return self._now(sets | (self.value & stays))

    def hold(self, value: Field, when: Field) -> Field:
        """Store and return the value where `when` holds, and the last such value elsewhere."""
        return self._now(where(when, value, self.value))

    def count(self, when: Field) -> Field:
        """Store and return the number of consecutive frames in which `when` has held."""
        return self._now(where(when, self.value + 1.0, 0.0))

    def mean(self, value: Field, share: Field | float) -> Field:
        """Store and return a running mean in which the current value has the weight `share`.

        A constant share gives an exponential moving average; a share of 1/n in the n-th frame
        gives the arithmetic mean.
        """
        return self._now(self.value + share * (value - self.value))

    def _now(self, value: Field) -> Field:
        self.store(value)
        return value


def _kind(node: Node) -> str:
    if node.scalar:
        return "one number"
    return "a map" if node.maps == 1 else f"a stack of {node.maps} maps"


class FrameFields:
    """Frame inside a program, with its channels as attributes, its geometry and its memories."""

    def __init__(self, graph: Graph, channels: Sequence[str], rate: float | None = None) -> None:
        self._graph = graph
        graph.rate = rate
        if isinstance(channels, str) or not isinstance(cast(object, channels), Sequence):
            raise ProgramError(
                f"Channels must be a sequence of names, as in ('normal',), got {channels!r:.60}."
            )
        given = tuple(checked_name("a channel", c, ProgramError) for c in channels)
        # no reading of the array: programs that go through all channels do not meet it
        self.channels = tuple(name for name in given if name != SATURATED)
        self._marked = SATURATED in given
        self._made: dict[tuple[object, ...], object] = {}

    def __getattr__(self, name: str) -> Field:
        if name.startswith("_") or name not in self.channels:
            raise ProgramError(str(self._missing(name)))
        return self.channel(name)

    def channel(self, name: str) -> Field:
        """Return one channel of the frame as a map."""
        if name not in self.channels:
            raise self._missing(name)
        return Field(self._graph, self._graph.add(Input(name)))

    def _missing(self, name: str) -> UnknownNameError:
        if name not in FORCE_AXES or not {*FORCE_AXES} & {*self.channels}:
            return name_error("channel", name, self.channels)
        read = ", ".join(f"'{channel}'" for channel in self.channels)
        return UnknownNameError(
            f"The program needs '{name}', which the array does not read (it reads {read}): take "
            "one that needs less, or an array that reads this axis, too."
        )

    def within_range(self, marks: Field) -> Field:
        """Return a logic map without the taxels that are at an end of their range.

        A flag is off while there is any such taxel. Scenes mark these taxels in the channel
        "saturated"; without that channel, nothing is removed.
        """
        at_end = self.at_end
        if at_end is None:
            return marks
        return marks & ~(at_end.any() if marks.scalar else at_end)

    @property
    def at_end(self) -> Field | None:
        """Logic map of the taxels at an end of their range, or None if nothing marks them."""
        if not self._marked:
            return None
        return Field(self._graph, self._graph.add(Input(SATURATED))) > 0.5

    @property
    def rate(self) -> float:
        """Frame rate in Hz, of the scene's array or as bound to the program.

        A program uses it to convert times to weights and durations: a leaky mean over a time T
        takes a share of ``1 - exp(-1 / (frame.rate * T))`` of each frame. If the rate is not known,
        the program can be compiled and inspected, but its first stream requires it.
        """
        self._graph.timed = True
        return NOMINAL if self._graph.rate is None else self._graph.rate

    def run_at(self, rate: float, program: str, *, uses: bool = False) -> None:
        """Adopt the rate of a program that is called inside this one, if no rate is set yet.

        Parameters
        ----------
        rate : float, Hz
        program : str
            Name of the inner program, for error messages.
        uses : bool
            Whether the inner program has the rate among its own parameters.

        Raises
        ------
        ProgramError
            If an enclosing program, or one called earlier, runs at another rate.
        """
        if self._graph.rate is None and not self._graph.timed:
            self._graph.rate = rate
        elif self._graph.rate != rate:
            raise ProgramError(
                f"Program '{program}' is bound to {rate:g} Hz inside a program of "
                f"{self.rate:g} Hz: bind the outer program to the rate, which then applies to "
                "all of it."
            )
        self._graph.timed = self._graph.timed or uses

    def sees(self, frequency: float, *outputs: str) -> None:
        """Declare the frequency up to which outputs follow the signal.

        A frame rate below twice this frequency (Nyquist) loses part of the signal; compiling the
        program for such a rate reports so.

        Parameters
        ----------
        frequency : float, Hz
        outputs : str
            Names of outputs of the program.
        """
        self._graph.quickest |= dict.fromkeys(outputs, frequency)

    def frames_of(self, seconds: float, least: int = 1) -> int:
        """Return the number of frames in a time, rounded up, and at least `least`.

        Parameters
        ----------
        seconds : float
        least : int
            Smallest number to return, for example the frames that a mean needs at any rate.
        """
        return max(least, ceil(round(seconds * self.rate, 6)))

    @property
    def shape(self) -> Shape:
        """Rows and columns of the array that the program is compiled for."""
        return self._graph.shape

    @property
    def first(self) -> Field:
        """Flag that holds on the first frame of a stream."""
        return Field(self._graph, self._graph.add(FirstFrame(), scalar=True, logic=True))

    @property
    def age(self) -> Field:
        """Number of frames before this one, up to 2²⁴, the limit of float32."""
        return self.once(_age)

    @property
    def row(self) -> Field:
        """Row number of every cell."""
        return self.constant(np.indices(self.shape)[0])

    @property
    def column(self) -> Field:
        """Column number of every cell."""
        return self.constant(np.indices(self.shape)[1])

    def centroid(self, weight: Field) -> tuple[Field, Field]:
        """Return the row and column of a map's centroid, in cells; 0 if the map's sum is 0."""
        whole = weight.sum()
        return (weight * self.row).sum() / whole, (weight * self.column).sum() / whole

    def constant(self, values: ArrayLike) -> Field:
        """Return a constant field, given as a number, (rows, cols) or (maps, rows, cols)."""
        return constant(self._graph, values)

    def memory(
        self, name: str = "", *, scalar: bool = False, logic: bool = False, maps: int = 1
    ) -> LocalMemory:
        """Return a new memory, which keeps its value from frame to frame and starts at 0.

        Parameters
        ----------
        name : str
            Name of the memory in traces.
        scalar : bool
            Whether it holds one number instead of a map.
        logic : bool
            Whether it is a local logic memory (0 or 1).
        maps : int
            Number of maps; more than one makes a stack.

        Raises
        ------
        ProgramError
            If the name is not one line of printable characters, or `maps` is not a positive whole
            number.
        """
        if not isinstance(maps, Integral) or maps < 1:
            raise ProgramError(f"A memory must hold at least 1 map, got {maps!r:.60}.")
        return LocalMemory(self._graph, name, scalar=scalar, logic=logic, maps=int(maps))

    def once(self, make: Callable[..., Made], **settings: Hashable) -> Made:
        """Return `make(frame, **settings)`, computed once for all callers.

        Programs that are called inside another one share fields and memories in this way.
        """
        key = (make, *sorted(settings.items()))
        if key not in self._made:
            self._made[key] = make(self, **settings)
        return cast(Made, self._made[key])

    def previous(self, value: Field) -> Field:
        """Return `value` as of the previous frame; on the first frame, as of the current one."""
        memory = self.memory(scalar=value.scalar, logic=value.logic, maps=value.maps)
        memory.store(value)
        return where(self.first, value, memory.value)


def _age(frame: FrameFields) -> Field:
    memory = frame.memory("age", scalar=True)
    memory.store(memory.value + 1.0)
    return memory.value


Sums = Callable[[Field], Field]
"""A sum of a map over some of its cells."""


class Block(NamedTuple):
    """A block of the array.

    Attributes
    ----------
    cells : int
    share : (rows, cols) float
        1 in its cells, 0 elsewhere.
    total, inner : callable
        `total` sums a map over its cells. `inner` does so over those that touch no other block, for
        the results of templates, which would mix both.
    """

    cells: int
    share: Floats
    total: Sums
    inner: Sums


def blocks(frame: FrameFields, rows: int, cols: int) -> list[Block]:
    """Return the equal blocks of an array, row by row.

    Raises
    ------
    ProgramError
        If the array does not divide into as many rows and columns of blocks.
    """
    if rows < 1 or cols < 1 or any(np.mod(frame.shape, (rows, cols))):
        raise ProgramError(
            f"An array of {frame.shape[0]}×{frame.shape[1]} cells does not divide into "
            f"{rows}×{cols} equal blocks."
        )
    row, column = (np.arange(n) * k // n for n, k in zip(frame.shape, (rows, cols), strict=True))
    number = row[:, np.newaxis] * cols + column
    around = np.pad(number, 1, mode="edge")
    alone = (around[2:, 1:-1] == around[:-2, 1:-1]) & (around[1:-1, 2:] == around[1:-1, :-2])
    shares = [1.0 * (number == n) for n in range(rows * cols)]
    cells = number.size // len(shares)
    return [
        Block(cells, share, _over(frame, share), _over(frame, share * alone)) for share in shares
    ]


def place_on(frame: FrameFields, weight: Field, pads: int) -> tuple[Field, Field]:
    """Return row and column of the centre of a weight, on the pad that has most of it.

    Parameters
    ----------
    frame : FrameFields
    weight : Field
        Map, 0 or above.
    pads : int
        Pads next to one another in the columns.

    Raises
    ------
    ProgramError
        If the columns do not divide into them.
    """
    if pads == 1:
        return frame.centroid(weight)
    rows: list[tuple[Field, ...]] = []
    for pad in blocks(frame, 1, pads):
        part = weight * frame.constant(pad.share)
        rows.append((part.sum(), *frame.centroid(part)))
    _, row, column = most(rows)
    return row, column


def root_sum(sums: Sums, maps: Iterable[Field]) -> Field:
    """Return the root of a sum of the squares of some maps."""
    return sqrt(sums(total(map(square, maps))))


def _over(frame: FrameFields, share: Floats) -> Sums:
    return Field.sum if share.all() else lambda values: (values * frame.constant(share)).sum()
