"""Storage of values while a plan's kernel runs: arrays, their slots, and constant data."""

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
"""Largest array, in cells, that a work item keeps in private memory. With 32×32 cells, a step takes
1.6 times as long there as in scratch, and the program `contact` twice as long."""

DATA = ir.Name("data")
"""The plan's constant numbers."""

Place = tuple[slice, tuple[int, ...]]
"""Place of a value among a frame's numbers, and its shape."""

Places = Mapping[str, Place]
"""Places of outputs, by name."""

UNFINISHED = ir.Name("unfinished")
"""Whether a transient or a loop of a frame did not finish."""

MINE = ir.Name("mine")
"""A frame's scratch."""

ALIGNED = 16
"""Scratch arrays begin at multiples of this, so that vectors do not cross cache lines."""

APART = 5 * ALIGNED
"""Padding between scratch arrays. Without it, arrays of 1024×1024 cells would all begin at the same
page offset, and writing to one would stall reads of another."""


@dataclass(slots=True)
class Arena:
    """Allocates arrays of `real`: private ones, or pieces of global scratch for large arrays.

    Attributes
    ----------
    private : bool
    size : int
        Largest number of values allocated at any time.
    top : int
        Where the next array begins; resetting it frees all later arrays.
    places : dict of str to int
        Offsets of arrays, by name.
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
    """Index tables in constant memory, and numbers in the data buffer, without duplicates.

    Attributes
    ----------
    dtype : dtype
        Data type of the kernel's numbers.
    lanes : int
        Frames interleaved in the kernel's type.
    width : int
        Vector width of the device, for adjacent cells.
    near_bytes : int
        Bytes of cache per core that keep up with its arithmetic.
    by_vectors : bool
        Whether a work item computes in vectors, as on a CPU.
    vectors : bool
        Whether the target language has vector types, as OpenCL C does.
    types : dict of str to str
        Source of further types and functions that the kernel uses, by name.
    places : dict of str to (n,) int
        Index tables, by name.
    strips : list of str
        Source of kernels that take steps of large arrays.
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
        """Printer of records in the kernel's type."""
        return OpenCLPrinter(number_type(self.dtype))

    def halo(
        self, boundary: Boundary, shape: tuple[int, int], radius: int
    ) -> tuple[ir.Name, ir.Name, int]:
        """Return the names of two tables (padded cell, padded source) and their length.

        A constant rim has no table of sources, since nothing reads them.
        """
        name = f"halo_{boundary.pad_mode}_{shape[0]}x{shape[1]}_{radius}"
        rim, sources = rim_copies(boundary, shape, radius)
        self.places[f"{name}_to"] = rim
        if boundary.constant is None:
            self.places[f"{name}_from"] = sources
        return ir.Name(f"{name}_to"), ir.Name(f"{name}_from"), rim.size

    def constant(self, values: Floats, at: ir.Operand) -> ir.Expression:
        """Add these values to the data buffer, and return the one at `at`."""
        return self.number_at(ir.after(ir.Integer(self.data(values)), at))

    def number_at(self, at: ir.Expression) -> ir.Expression:
        """Return the expression of the number at an offset in the data buffer."""
        return ir.real(DATA[at])

    def data(self, values: Floats) -> int:
        """Add these values to the data buffer and return their offset."""
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
        """Contents of the data buffer (at least one number)."""
        flat = np.concatenate(self._data) if self._data else np.zeros(1)
        return flat.astype(self.dtype)


@dataclass(slots=True)
class Values:
    """Expressions of nodes' values in cell `i`; slots of dead maps are reused.

    Attributes
    ----------
    tables : Tables
    placed : mapping of int to Array
        Maps, by node index, that are written directly to a frame's outputs rather than to a slot.
    slots : dict of Name to int
        Number of maps in each slot.
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
        """Return the name of a new per-frame scalar variable."""
        name = self._values[node.index] = ir.Name(f"n{node.index}")
        return name

    def alias(self, node: Node, value: ir.Expression) -> None:
        """Bind a node's value to this expression."""
        self._values[node.index] = value

    def take_slot(self, node: Node) -> ir.Name:
        """Allocate an array for this map or stack, and return its name."""
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
        """Return the name of the array that holds only this node's value, or None."""
        return self._held.get(node.index)

    def hand_over(self, old: Node, new: Node) -> None:
        """Transfer the name and the array of a value to another node."""
        self._values[new.index] = self._values[old.index]
        if old.index in self._held:
            self._held[new.index] = self._held.pop(old.index)

    def free_slot(self, node: Node) -> None:
        """Release the array of a map that is no longer read."""
        if node.index in self._held:
            self._free.append(self._held.pop(node.index))
