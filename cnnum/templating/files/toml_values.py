"""Values of a TOML template: one reader a kind of value."""

from typing import cast

from cnnum.errors import TemplateError
from cnnum.templating.template import Check


def text(file: str, key: str, value: object) -> str:
    """Return a text.

    Raises
    ------
    TemplateError
        If it is something else.
    """
    if not isinstance(value, str):
        raise wrong(file, key, "a text", value)
    return value


def names(file: str, key: str, value: object) -> tuple[str, ...]:
    """Return a list of names.

    Raises
    ------
    TemplateError
        If it is something else.
    """
    if not isinstance(value, list):
        raise wrong(file, key, "a list of names", value)
    return tuple(text(file, key, item) for item in cast("list[object]", value))


def number(file: str, key: str, value: object) -> float:
    """Return a number; true and false are none.

    Raises
    ------
    TemplateError
        If it is something else.
    """
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise wrong(file, key, "a number", value)
    return float(value)


def whole(file: str, key: str, value: object) -> int:
    """Return a whole number from 0 up.

    Raises
    ------
    TemplateError
        If it is something else.
    """
    if isinstance(value, bool) or not isinstance(value, int) or value < 0:
        raise wrong(file, key, "a whole number from 0 up", value)
    return value


def flag(file: str, key: str, value: object) -> bool:
    """Return true or false.

    Raises
    ------
    TemplateError
        If it is something else.
    """
    if not isinstance(value, bool):
        raise wrong(file, key, "true or false", value)
    return value


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
        raise wrong(file, key, "a number or a text", value)
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
        raise wrong(file, key, "a matrix, as a list of rows", value)
    rows = cast("list[object]", value)
    shape = _shape(file, key, rows)
    if len(shape) not in (2, 4):
        raise TemplateError(
            f"'{file}': the key '{key}' must be a matrix of rows, or [to][from][row][col], "
            f"got lists nested {len(shape)} deep."
        )
    return rows


def points(file: str, key: str, value: object) -> list[list[float]]:
    """Return the points of a function table: pairs of numbers (argument, value).

    Raises
    ------
    TemplateError
        If it is something else.
    """
    if not isinstance(value, list):
        raise wrong(file, key, "a list of pairs [argument, value]", value)
    return [_pair(file, key, item) for item in cast("list[object]", value)]


def _pair(file: str, key: str, value: object) -> list[float]:
    pair = _listed(value)
    if len(pair) != 2:
        raise wrong(file, key, "a list of pairs [argument, value]", value)
    return [number(file, key, item) for item in pair]


def _listed(value: object) -> list[object]:
    return cast("list[object]", value) if isinstance(value, list) else []


def table(file: str, key: str, value: object) -> dict[str, object]:
    """Return a table.

    Raises
    ------
    TemplateError
        If it is something else.
    """
    if not isinstance(value, dict):
        raise wrong(file, key, "a table", value)
    return dict(cast("dict[str, object]", value))


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
    parts = table(file, key, value)
    if "name" not in parts:
        raise TemplateError(f"'{file}': the table '{key}' needs the key 'name' of a closed form.")
    form = text(file, f"{key}.name", parts.pop("name"))
    return Check(
        form,
        tuple((name, number_or_text(file, f"{key}.{name}", item)) for name, item in parts.items()),
    )


def wrong(file: str, key: str, expected: str, value: object) -> TemplateError:
    """Return the error that a key has not the expected value."""
    return TemplateError(f"'{file}': the key '{key}' must be {expected}, got {value!r:.60}.")
