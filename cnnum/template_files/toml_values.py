"""What the value of each key of a TOML template must be: one reader a kind of value."""

from collections.abc import Callable, Mapping
from typing import Any, cast

from cnnum.errors import TemplateError
from cnnum.template import Check


def text(file: str, key: str, value: object) -> str:
    """Return a text.

    Raises
    ------
    TemplateError
        If it is something else.
    """
    if not isinstance(value, str):
        raise _wrong(file, key, "a text", value)
    return value


def names(file: str, key: str, value: object) -> tuple[str, ...]:
    """Return a list of names.

    Raises
    ------
    TemplateError
        If it is something else.
    """
    if not isinstance(value, list):
        raise _wrong(file, key, "a list of names", value)
    return tuple(text(file, key, item) for item in cast("list[object]", value))


def number(file: str, key: str, value: object) -> float:
    """Return a number; true and false are none.

    Raises
    ------
    TemplateError
        If it is something else, or too large for a float64.
    """
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise _wrong(file, key, "a number", value)
    try:
        return float(value)
    except OverflowError:
        raise _wrong(file, key, "a number within the range of a float64", value) from None


def number_or_text(file: str, key: str, value: object) -> float | str:
    """Return a number or a text.

    Raises
    ------
    TemplateError
        If it is something else.
    """
    if isinstance(value, str):
        return value
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise _wrong(file, key, "a number or a text", value)
    return number(file, key, value)


def per_layer(file: str, key: str, value: object) -> float | list[float]:
    """Return a number, or a list with one a layer.

    Raises
    ------
    TemplateError
        If it is something else.
    """
    if isinstance(value, list):
        return [number(file, key, item) for item in cast("list[object]", value)]
    return number(file, key, value)


def matrix(file: str, key: str, value: object) -> list[object]:
    """Return a matrix as lists of equal length, two or four deep.

    Raises
    ------
    TemplateError
        If it is no list, or the lists differ in length or depth.
    """
    if not isinstance(value, list):
        raise _wrong(file, key, "a matrix, as a list of rows", value)
    rows = cast("list[object]", value)
    shape = _shape(file, key, rows)
    if len(shape) not in (2, 4):
        raise TemplateError(
            f"'{file}': the key '{key}' must be a matrix of rows, or [to][from][row][col], "
            f"got lists nested {len(shape)} deep."
        )
    return rows


def _shape(file: str, key: str, value: object) -> tuple[int, ...]:
    if not isinstance(value, list):
        number(file, key, value)
        return ()
    items = cast("list[object]", value)
    shapes = {_shape(file, key, item) for item in items}
    if len(shapes) != 1:
        raise TemplateError(
            f"'{file}': the key '{key}' must have rows of equal length, got a ragged or empty one."
        )
    return (len(items), *shapes.pop())


def check(file: str, key: str, value: object) -> Check:
    """Return the check that the table [check] names.

    Raises
    ------
    TemplateError
        If it is no table, has no name, or a parameter is neither a number nor a text.
    """
    if not isinstance(value, dict):
        raise _wrong(file, key, "a table", value)
    table = dict(cast("dict[str, object]", value))
    if "name" not in table:
        raise TemplateError(f"'{file}': the table '{key}' needs the key 'name' of a closed form.")
    form = text(file, f"{key}.name", table.pop("name"))
    return Check(
        form,
        tuple((name, number_or_text(file, f"{key}.{name}", item)) for name, item in table.items()),
    )


def _wrong(file: str, key: str, expected: str, value: object) -> TemplateError:
    return TemplateError(f"'{file}': the key '{key}' must be {expected}, got {value!r:.60}.")


READERS: Mapping[str, Callable[[str, str, object], Any]] = {
    "name": text,
    "A": matrix,
    "B": matrix,
    "z": per_layer,
    "tau": per_layer,
    "boundary": number_or_text,
    "input_boundary": number_or_text,
    "initial": number_or_text,
    "duration": number_or_text,
    "output": text,
    "description": text,
    "source": text,
    "check": check,
}
"""The reader of each key, in the order that the error for an unknown key lists them."""
