"""The pass that puts other expressions in the places of names."""

from collections.abc import Callable, Mapping
from dataclasses import fields, is_dataclass
from functools import cache
from typing import Any, TypeVar, cast

from cnnum.kernels.expressions import Expression, Name

Record = TypeVar("Record")


def substituted(record: Record, by: Mapping[str, Expression]) -> Record:
    """Return a record, or a tuple of them, with other expressions in the places of names."""
    changed: Record = _changed(record, by)
    return changed


def _changed(value: Any, by: Mapping[str, Expression]) -> Any:
    if isinstance(value, Name):
        return by.get(value.text, value)
    if isinstance(value, tuple):
        return tuple([_changed(each, by) for each in value])  # pyright: ignore[reportUnknownVariableType]
    kind = cast("Callable[..., Any]", type(value))
    names = _fields_of(kind)
    return kind(*[_changed(getattr(value, name), by) for name in names]) if names else value


@cache
def _fields_of(kind: Callable[..., Any]) -> tuple[str, ...]:
    return tuple(field.name for field in fields(kind)) if is_dataclass(kind) else ()
