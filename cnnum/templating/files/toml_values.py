"""Values of a TOML template: one reader a kind of value.

A reader takes the file's name, the key and the value. It raises a TemplateError where the value is
something else, and the error names file and key.
"""

from collections.abc import Iterable
from pathlib import Path
from typing import cast

from cnnum.errors import TemplateError, TemplateFileError, unreadable
from cnnum.safety.reading import LARGEST, parse_toml, read_text
from cnnum.templating.template import Check


def read_table(kind: str, path: Path) -> dict[str, object]:
    """Return the whole table of a TOML file; `kind` names it in errors, as "design".

    Raises
    ------
    TemplateFileError
        If the file cannot be read.
    TemplateError
        If it is not TOML.
    """
    try:
        return parse_toml(read_text(path, most=LARGEST))
    except OSError as error:
        what = f"The {kind} '{path}'"
        raise unreadable(TemplateFileError, what, error, "; check the path") from None
    except ValueError as error:
        raise TemplateError(f"'{path}' is not valid TOML: {error}.") from None


def refuse_unknown(file: str, keys: Iterable[str], known: Iterable[str], place: str = "") -> None:
    """Check the keys of a table; `place` is a prefix that ends in a full stop, or empty."""
    choices = tuple(known)
    for key in keys:
        if key not in choices:
            raise TemplateError(
                f"'{file}': unknown key {place + key!r:.60}, expected one of {', '.join(choices)}."
            )


def text(file: str, key: str, value: object) -> str:
    """Return a text."""
    if not isinstance(value, str):
        raise wrong(file, key, "a text", value)
    return value


def names(file: str, key: str, value: object) -> tuple[str, ...]:
    """Return a list of names."""
    if not isinstance(value, list):
        raise wrong(file, key, "a list of names", value)
    return tuple(text(file, key, item) for item in cast("list[object]", value))


def number(file: str, key: str, value: object) -> float:
    """Return a number; true and false are none."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise wrong(file, key, "a number", value)
    return float(value)


def whole(file: str, key: str, value: object) -> int:
    """Return a whole number from 0 up."""
    if isinstance(value, bool) or not isinstance(value, int) or value < 0:
        raise wrong(file, key, "a whole number from 0 up", value)
    return value


def flag(file: str, key: str, value: object) -> bool:
    """Return true or false."""
    if not isinstance(value, bool):
        raise wrong(file, key, "true or false", value)
    return value


def number_or_text(file: str, key: str, value: object) -> float | str:
    """Return a number or a text."""
    if isinstance(value, str):
        return value
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise wrong(file, key, "a number or a text", value)
    return number(file, key, value)


def per_layer(file: str, key: str, value: object) -> float | list[float]:
    """Return a number, or a list with one per layer."""
    if isinstance(value, list):
        return [number(file, key, item) for item in cast("list[object]", value)]
    return number(file, key, value)


def matrix(file: str, key: str, value: object) -> list[object]:
    """Return a matrix as lists of equal length, two or four deep."""
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
    """Return the points of a function table: pairs of numbers (argument, value)."""
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
    """Return a table."""
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
    """Return the check that the table [check] names."""
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
