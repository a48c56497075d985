"""Arrays from outside are checked once, here: finite numbers of the promised shape."""

import hashlib
import math
import operator
from collections.abc import Sequence
from typing import Any, SupportsIndex, TypeVar, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cnnum.errors import ArrayError

Floats = NDArray[np.float64]
"""Any array of real numbers inside the house; float64 until an engine rounds it."""

Number = TypeVar("Number", bound=np.generic)

Shape = tuple[int, int]
"""Rows and columns of a cell array."""

HELD = {name: float(np.finfo(name).max) for name in ("float32", "float64")}
"""The largest number that a precision holds."""


def number_type(precision: str) -> str:
    """Return in which real numbers a precision is given its values; whole numbers in float64."""
    return precision if precision in HELD else "float64"


def held(precision: str) -> float:
    """Return the largest number that a precision is given; whole numbers saturate on their own."""
    return HELD[number_type(precision)]


FEW = 4096
"""Numbers whose squares OpenBLAS sums in one thread; 16,384 are shared."""


def finite(name: str, value: ArrayLike) -> Floats:
    """Return `value` as a float64 array, refusing all but finite real numbers.

    Raises
    ------
    ArrayError
        If `value` is not numeric, or holds NaN or infinity.
    """
    array = _real(name, value, np.float64)
    if not all_finite(array):
        bad = int(array.size - np.isfinite(array).sum())
        got = (
            str(array.flat[0])
            if array.size == 1
            else f"{bad} NaN or infinite of {array.size:,} numbers"
        )
        raise ArrayError(f"{_quoted(name)} must be finite, got {got}.")
    return np.asarray(array, dtype=np.float64)


def numbers(name: str, value: ArrayLike) -> Floats:
    """Return `value` as a float64 array of real numbers, not yet checked for NaN.

    Raises
    ------
    ArrayError
        If `value` is not numeric.
    """
    return cast(Floats, _real(name, value, np.float64))


def real_numbers(name: str, value: ArrayLike) -> NDArray[np.floating]:
    """Return `value` as an array of real numbers, not yet checked for NaN.

    Those of single precision stay so: whoever looks at them converts them, too.

    Raises
    ------
    ArrayError
        If `value` is not numeric.
    """
    single = getattr(value, "dtype", None) == np.float32
    return _real(name, value, np.float32 if single else np.float64)


def _real(name: str, value: ArrayLike, dtype: type[np.floating]) -> NDArray[np.floating]:
    if type(value) is np.ndarray and value.dtype == dtype:
        return value  # frames come so: the checks below take 0.2 µs
    if cast(object, value) is None:  # NumPy would make it NaN
        raise ArrayError(f"{_quoted(name)} must be an array of real numbers, got None.")
    try:
        is_complex = np.iscomplexobj(value)
        array = np.zeros(0, dtype) if is_complex else np.asarray(value, dtype=dtype)
    except (TypeError, ValueError, OverflowError):  # of lists, rows of different lengths too
        raise ArrayError(
            f"{_quoted(name)} must be an array of real numbers, got {_in_words(value)}."
        ) from None
    if is_complex:
        raise ArrayError(
            f"{_quoted(name)} must be real, got complex numbers: pass their real or imaginary part."
        )
    return array


def _quoted(name: str) -> str:
    """Return a name in quotes; a description that has quotes of its own stays as it is."""
    return name if "'" in name else f"'{name}'"


def _in_words(value: object) -> str:
    """Describe a value that is no array of numbers."""
    kind = type(value).__name__
    if isinstance(value, list | tuple):
        parts = cast(Sequence[Any], value)
        rows = [len(part) for part in parts if type(part) in (list, tuple)]
        if len(set(rows)) > 1:
            return f"a {kind} of rows of different lengths ({min(rows)} to {max(rows)})"
    return kind


def all_finite(array: NDArray[np.floating]) -> bool:
    """Return whether no number of an array is NaN or infinite.

    The sum of squares of a small array takes a third of the time of looking at every number. Where
    it overflows, every number is looked at. BLAS shares large sums between threads, whose waiting
    for each other takes milliseconds on a busy machine.
    """
    if array.size > FEW:
        return bool(np.isfinite(array).all())
    # np.dot would warn of the overflow
    return math.isfinite(np.vdot(array, array)) or bool(np.isfinite(array).all())


def magnitude(array: NDArray[np.floating]) -> float:
    """Return a bound of the magnitudes in an array, in the time that `all_finite` takes.

    It is the root of the sum of squares of a small array. It is the largest magnitude of a large
    one, or where that sum overflows. It is NaN or infinite only if a number of the array is.
    """
    if array.size <= FEW:
        bound = math.sqrt(np.vdot(array, array))
        if math.isfinite(bound):
            return bound
    return largest(array)


def largest(array: NDArray[np.floating]) -> float:
    """Return the largest magnitude in an array; NaN if a number of it is, 0 of an empty one."""
    return max(abs(float(array.max())), abs(float(array.min()))) if array.size else 0.0


def maps(name: str, array: NDArray[np.floating], shape: Shape, layers: int) -> NDArray[np.floating]:
    """Return an array as (..., layers, rows, cols); one layer comes without an axis of its own.

    Raises
    ------
    ArrayError
        If the trailing axes are not the array's.
    """
    if layers == 1 and array.shape[-2:] == shape:
        return array[..., np.newaxis, :, :]
    if layers > 1 and array.shape[-3:] == (layers, *shape):
        return array
    wanted = (
        f"(..., {layers}, {shape[0]}, {shape[1]})"
        if layers > 1
        else f"(..., {shape[0]}, {shape[1]})"
    )
    raise ArrayError(f"'{name}' must have the shape {wanted}, got {array.shape}.")


def as_shape(value: object) -> Shape:
    """Return rows and columns as a tuple of two positive integers.

    Raises
    ------
    ArrayError
        If there are not two of them, or one is below 1.
    """
    try:
        rows, cols = (operator.index(n) for n in cast(Sequence[SupportsIndex], value))
    except (TypeError, ValueError):
        rows = cols = 0
    if rows < 1 or cols < 1:
        raise ArrayError(
            "The shape of a cell array must be two positive whole numbers, rows and columns, "
            f"such as (8, 8), got {value!r:.60}."
        )
    return rows, cols


def frozen(array: ArrayLike) -> Floats:
    """Return a read-only float64 copy."""
    copy = np.array(array, dtype=np.float64)
    copy.setflags(write=False)
    return copy


def distinct(values: NDArray[Number]) -> NDArray[Number]:
    """Return the different values in order, flat."""
    # without an index NumPy imports numpy.ma, which takes 10 ms of a process' first plan
    return values.ravel()[np.unique(values, return_index=True)[1]]


def digest(*parts: object) -> str:
    """Return a short content hash of arrays and printable values, for caches and interning."""
    sha = hashlib.sha256()
    for part in parts:
        if isinstance(part, np.ndarray):
            array = np.asarray(part, dtype=np.float64)
            sha.update(repr(array.shape).encode() + array.tobytes())
        else:
            sha.update(repr(part).encode())
        sha.update(b"\0")
    return sha.hexdigest()[:24]
