"""Fields: the maps and numbers of a program under trace; they record the operations."""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import reduce
from numbers import Real
from operator import add
from typing import NoReturn

import numpy as np

from cnnum.arrays import finite
from cnnum.errors import ArrayError, ProgramError
from cnnum.graph import elementwise as op
from cnnum.graph.nodes import Constant, ConstantMap, Graph, Node
from cnnum.safety.values import expect, shown

LARGEST_POWER = 1024
"""Largest exponent of a power of a field; whole ones take twice its bits of multiplications."""


def power(base: object, exponent: object) -> "Field":
    """Return a field raised to a number, or a number above 0 raised to a field.

    Whole powers are products; a negative one of 0 is 0, as 1 / 0 is. Others are 0 where the base is
    not above 0, as the root is.

    Raises
    ------
    ProgramError
        If neither is a number, or the number is out of range.
    """
    power, number = _number(exponent), _number(base)
    if power is not None and abs(power) <= LARGEST_POWER:
        if power.is_integer():
            whole = _product(base, abs(int(power)))
            return whole if power >= 0 else 1.0 / whole
        return combine(op.ROOT, base) if power == 0.5 else combine(op.POWER, base, power)
    if power is None and number is not None and 0 < number < math.inf:
        return combine(op.POWER, number, exponent)
    raise ProgramError(
        f"Expected a field raised to a number from -{LARGEST_POWER} to {LARGEST_POWER}, or a "
        f"number above 0 raised to a field; got {_shown(base)} raised to {_shown(exponent)}."
    )


def _shown(operand: object) -> str:
    number = _number(operand)
    if number is not None:
        return f"{number:g}" if math.isfinite(number) else shown(operand)
    return "a field" if isinstance(operand, Field) else f"{type(operand).__name__}"


def _number(operand: object) -> float | None:
    """Return the number that an operand is in every cell of every frame, None without one."""
    if isinstance(operand, Field):
        held = operand.node.operation
        return held.value if isinstance(held, Constant) else None
    if not isinstance(operand, Real):
        return None
    try:
        return float(operand)
    except OverflowError:  # of a whole number beyond all doubles, above or below
        return math.inf


def _product(base: object, count: int) -> "Field":
    """Return a field times itself, `count` factors in all, by squares; 1 in every cell for none."""
    if count == 0:
        return combine(op.SELECT, combine(op.EQUAL, base, base), 1.0, 1.0)
    if count == 1:
        return combine(op.MULTIPLY, base, 1.0)
    half = _product(base, count // 2)
    square = combine(op.MULTIPLY, half, half)
    return square if count % 2 == 0 else combine(op.MULTIPLY, square, base)


class Field:
    """A map of cells, or one number per frame (`scalar`), in a program that is being traced.

    It can also be a stack of several `maps`. Local operations apply to all of them and combine them
    with numbers or with stacks of equally many maps; global operations reduce over all of them.

    Arithmetic and comparisons work cell by cell, including `==` and `!=`. NumPy's
    corresponding functions accept fields, as in `numpy.sqrt(field)`.
    """

    __slots__ = ("_graph", "_node")

    def __init__(self, graph: Graph, node: Node) -> None:
        self._graph = graph
        self._node = node

    @property
    def node(self) -> Node:
        """Node of the graph that computes the field."""
        return self._node

    @property
    def graph(self) -> Graph:
        """Graph that the field belongs to."""
        return self._graph

    @property
    def scalar(self) -> bool:
        """Whether the field is one number per frame."""
        return self._node.scalar

    @property
    def logic(self) -> bool:
        """Whether the field is a flag or a logic map."""
        return self._node.logic

    @property
    def maps(self) -> int:
        """Number of maps; more than one in a stack."""
        return self._node.maps

    def __bool__(self) -> NoReturn:
        raise ProgramError(
            "A program is traced once and has no values yet: use cnnum.where(condition, a, b) "
            "instead of 'if', and & | ~ instead of 'and', 'or', 'not'."
        )

    def __iter__(self) -> NoReturn:
        raise _no_values("its own sum, mean, max or min in place of Python's")

    def __getitem__(self, _: object) -> NoReturn:
        raise _no_values("cnnum.where to pick cells, and cnnum.shift to look at other ones")

    def __float__(self) -> NoReturn:
        raise _no_values("NumPy's functions in place of those of 'math'")

    def __int__(self) -> NoReturn:
        raise _no_values("a comparison in place of a whole number")

    def __array_ufunc__(
        self, ufunc: np.ufunc, method: str, *operands: object, **options: object
    ) -> "Field":
        if method != "__call__" or options or ufunc not in _UFUNCS:
            function = ufunc.__name__ if method == "__call__" else f"{ufunc.__name__}.{method}"
            raise _unknown_to_fields(f"{function}({', '.join(options)})" if options else function)
        graph = graph_of(operands)
        return _UFUNCS[ufunc](*(as_field(graph, operand) for operand in operands))

    def __array_function__(self, function: Callable[..., object], *_: object) -> NoReturn:
        raise _unknown_to_fields(function.__name__)

    def __add__(self, other: object) -> "Field":
        return combine(op.ADD, self, other)

    def __radd__(self, other: object) -> "Field":
        return combine(op.ADD, self, other)

    def __sub__(self, other: object) -> "Field":
        return combine(op.SUBTRACT, self, other)

    def __rsub__(self, other: object) -> "Field":
        return combine(op.SUBTRACT, other, self)

    def __mul__(self, other: object) -> "Field":
        return combine(op.MULTIPLY, self, other)

    def __rmul__(self, other: object) -> "Field":
        return combine(op.MULTIPLY, self, other)

    def __truediv__(self, other: object) -> "Field":
        return combine(op.DIVIDE, self, other)

    def __rtruediv__(self, other: object) -> "Field":
        return combine(op.DIVIDE, other, self)

    def __neg__(self) -> "Field":
        return combine(op.NEGATE, self)

    def __abs__(self) -> "Field":
        return combine(op.ABSOLUTE, self)

    def __gt__(self, other: object) -> "Field":
        return combine(op.GREATER, self, other)

    def __ge__(self, other: object) -> "Field":
        return combine(op.AT_LEAST, self, other)

    def __lt__(self, other: object) -> "Field":
        return combine(op.GREATER, other, self)

    def __le__(self, other: object) -> "Field":
        return combine(op.AT_LEAST, other, self)

    def __eq__(self, other: object) -> "Field":  # type: ignore[override]
        return combine(op.EQUAL, self, other)

    def __ne__(self, other: object) -> "Field":  # type: ignore[override]
        return ~(self == other)

    # a field is a key by its node, not by its values, which it has not got yet
    __hash__ = object.__hash__

    def equals(self, other: object) -> "Field":
        """Return where the values are exactly equal, as `==` does."""
        return self == other

    def __pow__(self, exponent: object) -> "Field":
        return _raised(self, exponent)

    def __rpow__(self, base: object) -> "Field":
        return _raised(base, self)

    def __and__(self, other: object) -> "Field":
        return combine(op.AND, self, other)

    def __or__(self, other: object) -> "Field":
        return combine(op.OR, self, other)

    def __xor__(self, other: object) -> "Field":
        return combine(op.XOR, self, other)

    def __invert__(self) -> "Field":
        return combine(op.NOT, self)

    def picture(self) -> "Field":
        """Return a logic map as a picture for templates: +1 (black) where it holds, else −1."""
        return where(self, 1.0, -1.0)

    def black(self) -> "Field":
        """Return the logic map of a picture's black cells."""
        return self > 0.0

    def sum(self) -> "Field":
        """Return the sum over the array."""
        return self._reduce(op.SUM)

    def count(self) -> "Field":
        """Return the number of cells where a logic map holds."""
        return self._reduce(op.SUM)

    def max(self) -> "Field":
        """Return the largest value of the array."""
        return self._reduce(op.LARGEST)

    def min(self) -> "Field":
        """Return the smallest value of the array."""
        return self._reduce(op.SMALLEST)

    def mean(self) -> "Field":
        """Return the mean over the array."""
        rows, cols = self._graph.shape
        return self.sum() / (self.maps * rows * cols)

    def argmax(self) -> "tuple[Field, Field]":
        """Return the row and column of the largest value, the first one in reading order.

        Raises
        ------
        ProgramError
            If the field is a stack of maps.
        """
        if self.maps > 1:
            raise ProgramError(f"'argmax' needs a single map, got a stack of {self.maps}.")
        rows, cols = self._graph.shape
        number = constant(self._graph, np.arange(rows * cols, dtype=float).reshape(rows, cols))
        first = where(self.equals(self.max()), number, float(rows * cols)).min()
        row = constant(self._graph, np.indices((rows, cols))[0])
        result = where(number.equals(first), row, 0.0).max()
        return result, first - result * cols

    def any(self) -> "Field":
        """Return whether a logic map holds anywhere (global OR)."""
        return self._reduce(op.ANY)

    def all(self) -> "Field":
        """Return whether a logic map holds everywhere (global AND)."""
        return self._reduce(op.ALL)

    def _reduce(self, function: op.ReduceOp) -> "Field":
        if self.scalar:
            raise ProgramError(f"'{function.name}' needs a whole map, got one number per frame.")
        if function.logic and not self.logic:
            raise ProgramError(f"'{function.name}' needs a logic map; compare the values first.")
        return Field(self._graph, self._graph.reduce(function, self._node))


def graph_of(operands: Sequence[object]) -> Graph:
    """Return the graph that an operation on the operands belongs to: the innermost loop's."""
    graphs = [operand.graph for operand in operands if isinstance(operand, Field)]
    if not graphs:
        raise ProgramError("At least one argument must come from the frame of a program.")
    return max(graphs, key=lambda graph: graph.depth)


def as_field(graph: Graph, operand: object) -> Field:
    """Return the operand as a field of this graph.

    Numbers and maps become constants; a field from outside a loop is captured by its body.
    """
    if not isinstance(operand, Field):
        return constant(graph, operand)
    if operand.graph is graph:
        return operand
    outer = graph.parent
    while outer is not None and outer is not operand.graph:
        outer = outer.parent
    if outer is None:
        raise ProgramError(
            "A field cannot be used here: it belongs to another program, or to the inside of a "
            "loop, whose values are available only as the result of cnnum.loop."
        )
    return Field(graph, graph.capture(operand.node, outer))


def combine(function: op.ElementOp, *operands: object) -> Field:
    """Return local arithmetic or logic on fields, numbers and maps."""
    graph = graph_of(operands)
    nodes = [as_field(graph, operand).node for operand in operands]
    if function.name in ("and", "or", "xor", "not") and not all(node.logic for node in nodes):
        raise ProgramError(f"'{function.name}' combines logic values; compare the numbers first.")
    stacks = sorted({node.maps for node in nodes if not node.scalar})
    if len(stacks) > 1:
        raise ProgramError(
            f"'{function.name}' combines stacks of equally many maps, got {stacks[0]} and "
            f"{stacks[1]}."
        )
    return Field(graph, graph.apply(function, *nodes))


def where(condition: Field, yes: object, no: object) -> Field:
    """Return `yes` in the cells where `condition` holds, `no` elsewhere.

    Raises
    ------
    ProgramError
        If the condition is not a logic field.
    """
    expect("condition", condition, Field, ProgramError)
    if not condition.logic:
        raise ProgramError("cnnum.where needs a logic condition; compare the values first.")
    return combine(op.SELECT, condition, yes, no)


def minimum(a: object, b: object) -> Field:
    """Return the smaller of two values in every cell."""
    return combine(op.MINIMUM, a, b)


def maximum(a: object, b: object) -> Field:
    """Return the larger of two values in every cell."""
    return combine(op.MAXIMUM, a, b)


def sqrt(a: Field) -> Field:
    """Return the square root of every cell, 0 for negative values."""
    return combine(op.ROOT, a)


def square(a: Field) -> Field:
    """Return every cell times itself."""
    return a * a


def exp(a: Field) -> Field:
    """Return the exponential of every cell."""
    return combine(op.EXPONENTIAL, a)


def log(a: Field) -> Field:
    """Return the natural logarithm of every cell, 0 for values that are not positive."""
    return combine(op.LOGARITHM, a)


def constant(graph: Graph, values: object) -> Field:
    """Return the field of a number, a map or a stack of maps that is the same in every frame.

    Parameters
    ----------
    graph : Graph
    values : (), (rows, cols) or (maps, rows, cols) float

    Raises
    ------
    ArrayError
        If it is not finite, or not the array's shape.
    """
    array = finite("constant", values)  # type: ignore[arg-type]
    if array.ndim == 0:
        return Field(graph, graph.constant(float(array)))
    if array.shape[-2:] != graph.shape or array.ndim > 3 or array.size == 0:
        raise ArrayError(
            f"A constant map must have the shape {graph.shape}, or be a stack of such maps, "
            f"got {array.shape}."
        )
    below = array.reshape(-1, array.shape[-1])
    return Field(graph, graph.add(ConstantMap.of(below), maps=len(below) // graph.shape[0]))


def _raised(base: object, exponent: object) -> Field:

    return power(base, exponent)


_UFUNCS: Mapping[np.ufunc, Callable[..., Field]] = {
    np.add: Field.__add__,
    np.subtract: Field.__sub__,
    np.multiply: Field.__mul__,
    np.divide: Field.__truediv__,
    np.power: Field.__pow__,
    np.square: square,
    np.negative: Field.__neg__,
    np.absolute: Field.__abs__,
    np.fabs: Field.__abs__,
    np.sqrt: sqrt,
    np.exp: exp,
    np.log: log,
    np.minimum: minimum,
    np.maximum: maximum,
    np.greater: Field.__gt__,
    np.greater_equal: Field.__ge__,
    np.less: Field.__lt__,
    np.less_equal: Field.__le__,
    np.equal: Field.__eq__,
    np.not_equal: Field.__ne__,
    np.logical_and: Field.__and__,
    np.logical_or: Field.__or__,
    np.logical_xor: Field.__xor__,
    np.logical_not: Field.__invert__,
    np.bitwise_and: Field.__and__,
    np.bitwise_or: Field.__or__,
    np.bitwise_xor: Field.__xor__,
    np.invert: Field.__invert__,
}
"""NumPy's functions as operations; all their operands are fields."""


def _no_values(instead: str) -> ProgramError:
    return ProgramError(f"A program is traced once, and a field has no values yet: use {instead}.")


def _unknown_to_fields(function: str) -> ProgramError:
    known = ", ".join(sorted(ufunc.__name__ for ufunc in _UFUNCS))
    return ProgramError(
        f"NumPy's '{function}' does not accept a field of a program: expected one of {known}, or "
        "cnnum.where and the field's own sum, mean, max, min, any, all."
    )


def total(fields: Iterable[Field]) -> Field:
    """Return the sum of one field or more."""
    return reduce(add, fields)


def mean(fields: Sequence[Field]) -> Field:
    """Return the mean of one field or more."""
    return total(fields) / len(fields)


def length(fields: Iterable[Field]) -> Field:
    """Return the root of the sum of the squares: the length of a vector of one field per axis."""
    return sqrt(total(map(square, fields)))


def most(rows: Sequence[Sequence[Field]]) -> Sequence[Field]:
    """Return the row whose first number is the largest; of equal ones the first."""
    best = rows[0]
    for row in rows[1:]:
        best = [where(row[0] > best[0], new, old) for new, old in zip(row, best, strict=True)]
    return best
