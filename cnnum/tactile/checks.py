"""Checks that physical parameters are within the range of a closed form."""

import inspect
from collections.abc import Callable
from functools import wraps
from typing import ParamSpec, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cnnum.errors import ArrayError, CnnumError, PhysicsError
from cnnum.safety.values import expect

Array = NDArray[np.float64]
P = ParamSpec("P")
R = TypeVar("R")


def finite(name: str, value: ArrayLike) -> Array:
    """Return `value` as float64, refused if any of it is NaN or infinite.

    Raises
    ------
    PhysicsError
        If a number is NaN or infinite, or not a number at all.
    """
    array = _numbers(name, value)
    if not np.isfinite(array).all():
        raise PhysicsError(
            f"'{name}' holds NaN or infinity: expected finite numbers; remove the others first."
        )
    return array


def positive(name: str, value: ArrayLike) -> Array:
    """Return `value` as finite float64 above zero, or raise `PhysicsError`."""
    array = finite(name, value)
    if not (array > 0).all():
        raise PhysicsError(f"'{name}': expected numbers above 0, got {array.min():g}.")
    return array


def not_negative(name: str, value: ArrayLike) -> Array:
    """Return `value` as finite float64 of zero or more, or raise `PhysicsError`."""
    array = finite(name, value)
    if not (array >= 0).all():
        raise PhysicsError(f"'{name}': expected numbers of at least 0, got {array.min():g}.")
    return array


def poisson_ratio(value: ArrayLike) -> Array:
    """Return Poisson's ratio as float64 within (-1, 0.5], or raise `PhysicsError`."""
    array = finite("poisson", value)
    if not ((array > -1) & (array <= 0.5)).all():
        raise PhysicsError(
            "'poisson': expected Poisson's ratio above -1 and at most 0.5, "
            f"got {array.min():g} to {array.max():g}."
        )
    return array


def vector(name: str, value: ArrayLike, length: int = 3) -> Array:
    """Return `value` as finite float64 whose last axis has `length` components.

    Raises
    ------
    PhysicsError
        If a number is NaN or infinite.
    ArrayError
        If the last axis has another length.
    """
    array = finite(name, value)
    if array.ndim == 0 or array.shape[-1] != length:
        raise ArrayError(
            f"'{name}': expected {length} components in the last axis, got shape {array.shape}."
        )
    return array


def record(name: str, value: object, kind: type) -> None:
    """Raise `PhysicsError` unless a value is a record of that kind, as `Grid` is one."""
    expect(name, value, kind, PhysicsError)


def scalar(name: str, value: Array) -> float:
    """Return the one number of `value`, or raise `ArrayError` if it has an axis."""
    if value.ndim != 0:
        raise ArrayError(f"'{name}': expected one number, got an array of shape {value.shape}.")
    return float(value)


def broadcasting(form: Callable[P, R]) -> Callable[P, R]:
    """Make a closed form refuse arguments that do not broadcast, each with its shape.

    NumPy finds them on the way, so that calls with good arguments cost nothing more.
    """

    @wraps(form)
    def checked(*args: P.args, **kwargs: P.kwargs) -> R:
        try:
            return form(*args, **kwargs)
        except ValueError as error:
            if isinstance(error, CnnumError) or "broadcast" not in str(error):
                raise
            given = inspect.signature(form).bind(*args, **kwargs).arguments
            shapes = ", ".join(f"'{name}' {np.shape(value)}" for name, value in given.items())
            raise ArrayError(f"Expected shapes that broadcast, got {shapes}.") from None

    return checked


def _numbers(name: str, value: ArrayLike) -> Array:
    try:
        array = np.asarray(value)
        if array.dtype.kind not in "biuf":
            raise TypeError
        return array.astype(np.float64)
    except (TypeError, ValueError, OverflowError):
        raise PhysicsError(f"'{name}': expected real numbers, got {value!r:.60}.") from None
