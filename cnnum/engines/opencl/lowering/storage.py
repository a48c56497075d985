"""Where values live while a plan's kernel runs: arrays, their slots, and constant data."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from cnnum import kernels as ir
from cnnum.arrays import Floats
from cnnum.graph.nodes import Constant, ConstantMap, Node
from cnnum.kernels.number_types import number_type
from cnnum.kernels.printer import OpenCLPrinter
from cnnum.templating.boundary import Boundary, rim_copies

PRIVATE_CELLS = 16 * 16
"""Largest array that a work item keeps in private memory. Of 32×32 cells a step takes 1.6 times as
long there as in scratch. The program `contact` takes twice as long."""

DATA = ir.Name("data")
"""The plan's constant numbers."""

Place = tuple[slice, tuple[int, ...]]
"""Where a value stands among a frame's numbers, and its shape."""

Places = Mapping[str, Place]
"""Of outputs, by their names."""

UNFINISHED = ir.Name("unfinished")
"""Whether a transient or a loop of a frame did not reach its end."""

MINE = ir.Name("mine")
"""A frame's scratch."""

ALIGNED = 16
"""Arrays of scratch begin at multiples of this, so that vectors lie within a cache's lines."""

APART = 5 * ALIGNED
"""Numbers between arrays of scratch: those of 1024×1024 cells would else all begin at the same
place of a page. Writing one there holds up reading another."""


@dataclass(slots=True)
class Arena:
    """Hands out arrays of `real`: private ones, or pieces of global scratch for large arrays.

    Attributes
    ----------
    private : bool
    size : int
        Numbers that were ever handed out at a time.
    top : int
        Where the next array begins; who sets it back gives back all that came since.
    places : dict of str to int
        Where arrays begin, by name.
    """

    private: bool
    size: int = 0
    top: int = 0
    places: dict[str, int] = field(default_factory=dict[str, int])

    def array(self, name: str, length: int) -> ir.Array:
        """Return the declaration of an array."""
        start = self.places[name] = self.top
        self.top += length if self.private else -(-length // ALIGNED) * ALIGNED + APART
        self.size = max(self.size, self.top)
        return ir.Array(ir.Name(name), length, None if self.private else MINE + start)


@dataclass(slots=True)
class Tables:
    """Index tables in constant memory and numbers in the data buffer, each stored once.

    Attributes
    ----------
    dtype : dtype
        Of the kernel's numbers.
    lanes : int
        Frames side by side in the kernel's type.
    width : int
        Numbers of a vector of the device, for cells side by side.
    near_bytes : int
        Cache of a core that keeps up with its arithmetic.
    by_vectors : bool
        Whether a work item's arithmetic goes by vectors, as a processor's does.
    vectors : bool
        Whether the target's numbers can be vectors, as those of OpenCL C.
    types : dict of str to str
        Texts of further types and functions that the kernel uses, by name.
    places : dict of str to (n,) int
        Index tables, by name.
    strips : list of str
        Texts of kernels that take steps of large arrays.
    """

    dtype: np.dtype[np.floating]
    lanes: int
    width: int
    near_bytes: int
    by_vectors: bool
    vectors: bool = True
    types: dict[str, str] = field(default_factory=dict[str, str])
    strips: list[str] = field(default_factory=list[str])
    places: dict[str, NDArray[np.int64]] = field(default_factory=dict[str, NDArray[np.int64]])
    _data: list[Floats] = field(default_factory=list[Floats])
    _length: int = 0
    _places: dict[bytes, int] = field(default_factory=dict[bytes, int])

    @property
    def printer(self) -> OpenCLPrinter:
        """The printer of records in the kernel's type."""
        return OpenCLPrinter(number_type(self.dtype))

    def halo(
        self, boundary: Boundary, shape: tuple[int, int], radius: int
    ) -> tuple[ir.Name, ir.Name, int]:
        """Return the names of two tables (padded cell, padded source) and their length.

        The sources of a constant rim are no table: nothing reads them.
        """
        name = f"halo_{boundary.pad_mode}_{shape[0]}x{shape[1]}_{radius}"
        rim, sources = rim_copies(boundary, shape, radius)
        self.places[f"{name}_to"] = rim
        if boundary.constant is None:
            self.places[f"{name}_from"] = sources
        return ir.Name(f"{name}_to"), ir.Name(f"{name}_from"), rim.size

    def constant(self, values: Floats, at: ir.Operand) -> ir.Expression:
        """Return the number that stands there among these, which the data buffer gets."""
        return self.number_at(ir.after(ir.Integer(self.data(values)), at))

    def number_at(self, at: ir.Expression) -> ir.Expression:
        """Return the number that stands at a place of the data buffer."""
        return ir.real(DATA[at])

    def data(self, values: Floats) -> int:
        """Return the offset of these numbers in the data buffer."""
        key = values.tobytes()
        if key not in self._places:
            self._places[key] = self._length
            self._data.append(values.ravel())
            self._length += values.size
        return self._places[key]

    @property
    def text(self) -> str:
        """Further types and functions, and the index tables, as OpenCL C."""
        tables = (
            f"__constant int {name}[{places.size}] = {{{', '.join(map(str, places.tolist()))}}};"
            for name, places in self.places.items()
        )
        return "\n".join([*self.types.values(), *tables])

    def buffer(self) -> NDArray[np.floating]:
        """Return the data buffer's contents (one number if there is nothing)."""
        flat = np.concatenate(self._data) if self._data else np.zeros(1)
        return flat.astype(self.dtype)


@dataclass(slots=True)
class Values:
    """Expressions of nodes' values in cell `i`; maps share slots once they are dead.

    Attributes
    ----------
    tables : Tables
    placed : mapping of int to Array
        Maps, by the index of their node, that stand among a frame's outputs: those are written
        there, and not to a slot.
    slots : dict of Name to int
        How many maps each slot holds.
    """

    tables: Tables
    placed: Mapping[int, ir.Array]
    slots: dict[ir.Name, int] = field(default_factory=dict[ir.Name, int])
    _values: dict[int, ir.Expression] = field(default_factory=dict[int, ir.Expression])
    _held: dict[int, ir.Name] = field(default_factory=dict[int, ir.Name])
    _free: list[ir.Name] = field(default_factory=list[ir.Name])

    def read(self, node: Node) -> ir.Expression:
        """Return the expression for a node's value in cell `i`."""
        operation = node.operation
        if isinstance(operation, Constant):
            return ir.Number(operation.value)
        if isinstance(operation, ConstantMap):
            return self.tables.constant(operation.values, ir.CELL)
        return self._values[node.index]

    def variable(self, node: Node) -> ir.Name | ir.Element:
        """Return the variable of a node's value, which can be assigned."""
        value = self._values[node.index]
        assert isinstance(value, ir.Name | ir.Element)
        return value

    def name_scalar(self, node: Node) -> ir.Name:
        """Return the name of a new variable for one number a frame."""
        name = self._values[node.index] = ir.Name(f"n{node.index}")
        return name

    def alias(self, node: Node, value: ir.Expression) -> None:
        """Say that a node's value is read by this expression."""
        self._values[node.index] = value

    def take_slot(self, node: Node) -> ir.Name:
        """Return the name of the array that holds this map, or stack, from now on."""
        if node.index in self.placed:
            name = self.placed[node.index].name
        else:
            fits = [slot for slot in self._free if self.slots[slot] == node.maps]
            name = fits[-1] if fits else ir.Name(f"s{len(self.slots)}")
            if fits:
                self._free.remove(name)
            self.slots[name] = node.maps
            self._held[node.index] = name
        self._values[node.index] = name[ir.CELL]
        return name

    def array_of(self, node: Node) -> ir.Name | None:
        """Return the name of the array that holds a node's value alone, None without one."""
        return self._held.get(node.index)

    def hand_over(self, old: Node, new: Node) -> None:
        """Let another node have the name, and the array, of a value."""
        self._values[new.index] = self._values[old.index]
        if old.index in self._held:
            self._held[new.index] = self._held.pop(old.index)

    def free_slot(self, node: Node) -> None:
        """Give back the array of a map that nothing reads any more."""
        if node.index in self._held:
            self._free.append(self._held.pop(node.index))
