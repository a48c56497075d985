"""Values are equal by their content; what holds a device or a port stays in its process."""

from collections.abc import Mapping
from dataclasses import fields
from typing import Any, NoReturn, cast

import numpy as np
from numpy.typing import NDArray

from cnnum.errors import OtherProcessError

FEW = 64
"""Numbers of an array that its hash looks at."""


class ByContent:
    """Equality and hash of a dataclass by the content of its compared fields.

    Arrays are equal where their types, shapes and numbers are; NaN equals NaN, so that a copy is
    always equal to its original.
    """

    __slots__ = ()

    def __eq__(self, other: object) -> bool:
        if other.__class__ is not self.__class__:
            return NotImplemented
        names = _compared(self)
        return self is other or all(same(getattr(self, n), getattr(other, n)) for n in names)

    def __hash__(self) -> int:
        return hash((type(self), *(_hashable(getattr(self, n)) for n in _compared(self))))


def _compared(record: Any) -> list[str]:
    return [field.name for field in fields(record) if field.compare]


def same(this: Any, other: Any) -> bool:
    """Return whether two values are equal, arrays and what holds them included."""
    if hasattr(this, "dtype") or hasattr(other, "dtype"):
        return _same_arrays(np.asarray(this), np.asarray(other))
    if type(this) is not type(other):
        return bool(this == other)
    if isinstance(this, Mapping):
        mine, theirs = cast("tuple[Mapping[Any, Any], Mapping[Any, Any]]", (this, other))
        return mine.keys() == theirs.keys() and all(same(mine[k], theirs[k]) for k in mine)
    if isinstance(this, list | tuple):
        parts, others = cast("tuple[list[Any], list[Any]]", (this, other))
        return len(parts) == len(others) and all(map(same, parts, others))
    return bool(this == other or (this != this and other != other))


def _same_arrays(this: NDArray[Any], other: NDArray[Any]) -> bool:
    if this.dtype != other.dtype or this.shape != other.shape:
        return False
    return bool(np.array_equal(this, other, equal_nan=this.dtype.kind in "fc"))


def _hashable(value: Any) -> Any:
    """Return what stands for a value in a hash: equal for equal values."""
    if isinstance(value, np.ndarray):
        array = cast(NDArray[Any], value)
        few: Any = array.ravel()[:FEW]
        # 0 and -0 are equal, and so are all NaN
        numbers: list[Any] = []
        if array.dtype.kind in "fiub":
            numbers = np.nan_to_num(few + 0.0).tolist()
        return (array.shape, *numbers)
    if isinstance(value, Mapping):
        table: Any = cast(Any, value)
        return frozenset((key, _hashable(item)) for key, item in table.items())
    if isinstance(value, list | tuple):
        return tuple(_hashable(item) for item in cast("list[Any]", value))
    if isinstance(value, float) and value != value:
        return "NaN"
    return value


def read_only(array: NDArray[Any]) -> NDArray[Any]:
    """Return a view of an array that cannot be written to."""
    if not array.flags.writeable:
        return array
    view = array.view()
    view.flags.writeable = False
    return view


class OfThisProcess:
    """What holds a device, compiled code or a port: it cannot be pickled or copied."""

    __slots__ = ()

    def _elsewhere(self) -> str:
        """Return how to get its like in another process, as a clause."""
        raise NotImplementedError

    def __reduce_ex__(self, protocol: object) -> NoReturn:
        raise OtherProcessError(
            f"A {type(self).__name__} belongs to the process that created it, and cannot be "
            f"pickled or copied: {self._elsewhere()}."
        )
