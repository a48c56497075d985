"""From the table of a scene file to a driver's record of options, checked key by key."""

import math
import os
import types
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, fields, is_dataclass
from pathlib import Path
from typing import Any, Literal, TypeVar, Union, cast, get_args, get_origin, get_type_hints

from cnnum.errors import ArrayError, SceneError, unreadable
from cnnum.frame import Limits, limits_of
from cnnum.recordings.recording import channel_names
from cnnum.renamed import by_new_names
from cnnum.safety.reading import LARGEST as LARGEST_FILE
from cnnum.safety.reading import parse_toml, read_text
from cnnum.safety.values import shown

Record = TypeVar("Record")

LARGEST = 2**63 - 1
"""The largest whole number of an option, as in TOML."""

LONGEST_PATH = 4096
"""Signs of a path; Linux, whose paths are longest, takes fewer."""


def read_options(record: type[Record], table: Mapping[str, object], base: Path) -> Record:
    """Return the record that a table of options describes.

    Parameters
    ----------
    record : dataclass
        Its fields are the options; a field without a default must be in the table.
    table : mapping of str to object
        As a TOML file gives it: strings, numbers, lists, tables.
    base : Path
        Folder that relative paths start from: the scene file's own.

    Raises
    ------
    SceneError
        If an option is unknown, missing or of the wrong type; the record itself refuses values
        outside its range.
    """
    hints = get_type_hints(record)
    table = by_new_names(table, getattr(record, "RENAMED", {}))
    known = {field.name: field for field in fields(cast(Any, record)) if field.init}
    for key in table:
        if key not in known:
            choices = ", ".join(f"'{name}'" for name in known)
            raise SceneError(f"Unknown option {shown(key)}: expected one of {choices}.")
    for name, field in known.items():
        required = field.default is MISSING and field.default_factory is MISSING
        if required and name not in table:
            raise SceneError(f"The option '{name}' is missing, and this driver requires it.")
    values = {key: convert(key, value, hints[key], base) for key, value in table.items()}
    return record(**values)


def read_options_file(
    record: type[Record], kind: str, path: Path, changes: Mapping[str, object]
) -> Record:
    """Return the record that a TOML file describes; `kind` names the file, as "The layout".

    Raises
    ------
    SceneError
        If the file cannot be read, is not TOML, or a key is unknown, missing or wrong.
    """
    try:
        table = parse_toml(read_text(path, most=LARGEST_FILE))
        return read_options(record, {**table, **changes}, path.parent)
    except OSError as error:
        raise unreadable(SceneError, f"{kind} '{path}'", error) from None
    except SceneError as error:
        raise SceneError(f"{kind} '{path}': {error}") from None
    except ValueError as error:
        raise SceneError(f"{kind} '{path}' is not TOML: {error}.") from None


def convert(key: str, value: object, kind: Any, base: Path) -> Any:
    """Return `value` as the type that the field's annotation names.

    Raises
    ------
    SceneError
        If it is of another type; the sentence names the key.
    """
    origin = get_origin(kind)
    if origin is Literal:
        return _choice(key, value, get_args(kind))
    if origin in (Union, types.UnionType):
        return _either(key, value, get_args(kind), base)
    if origin is tuple:
        return _items(key, value, get_args(kind), base)
    if is_dataclass(kind):
        if not isinstance(value, Mapping):
            raise _wrong(key, "a table", value)
        return read_options(cast(type[Any], kind), cast(Mapping[str, object], value), base)
    return _scalar(key, value, kind, base)


def _scalar(key: str, value: object, kind: Any, base: Path) -> object:
    if kind is Path and isinstance(value, str | Path):
        return _path(key, value, base)
    if kind is float and isinstance(value, int | float) and not isinstance(value, bool):
        return _number(key, value)
    if kind is int and isinstance(value, int) and not -LARGEST <= value <= LARGEST:
        raise _wrong(key, "a whole number of at most 63 bits", value)
    if isinstance(value, kind) and not (kind is int and isinstance(value, bool)):
        return value
    names: dict[Any, str] = {
        int: "a whole number",
        float: "a number",
        str: "a string",
        bool: "true or false",
    }
    raise _wrong(key, names.get(kind, "a path"), value)


def _number(key: str, value: float) -> float:
    try:
        number = float(value)
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        raise _wrong(key, "a finite number", value)
    return number


def _path(key: str, value: str | Path, base: Path) -> Path:
    try:
        path = base / Path(value).expanduser()
        os.fsencode(path)
    except (RuntimeError, ValueError):  # the folder of an unknown user; a lone surrogate
        raise _wrong(key, "a path", value) from None
    if "\0" in str(path) or len(str(path)) > LONGEST_PATH:
        raise _wrong(key, "a path", value)
    return path


def _choice(key: str, value: object, choices: tuple[object, ...]) -> object:
    for choice in choices:
        if value == choice and type(value) is type(choice):
            return value
    raise _wrong(key, "one of " + ", ".join(repr(choice) for choice in choices), value)


def _either(key: str, value: object, kinds: tuple[Any, ...], base: Path) -> object:
    if value is None and type(None) in kinds:
        return None
    rest = [kind for kind in kinds if kind is not type(None)]
    for kind in rest[:-1]:
        try:
            return convert(key, value, kind, base)
        except SceneError:
            continue
    return convert(key, value, rest[-1], base)


def _items(key: str, value: object, kinds: tuple[Any, ...], base: Path) -> tuple[object, ...]:
    items = cast(Sequence[object], value)
    if isinstance(value, str) or not isinstance(value, Sequence):
        raise _wrong(key, "a list", items)
    if len(kinds) == 2 and kinds[1] is Ellipsis:
        return tuple(convert(f"{key}[{i}]", v, kinds[0], base) for i, v in enumerate(items))
    if len(items) != len(kinds):
        raise _wrong(key, f"a list of {len(kinds)} items", items)
    pairs = enumerate(zip(items, kinds, strict=True))
    return tuple(convert(f"{key}[{i}]", v, kind, base) for i, (v, kind) in pairs)


def _wrong(key: str, expected: str, value: object) -> SceneError:
    return SceneError(f"The option '{key}' must be {expected}, got {shown(value)}.")


def require_limits(limits: Limits | None, channels: int) -> None:
    """Check that limits are a pair of raw values, or one per channel; errors as in `require`."""
    if limits is not None:
        try:
            limits_of(limits, channels)
        except ArrayError as error:
            raise SceneError(str(error)) from None


def require(key: str, holds: bool, expected: str, value: object) -> None:
    """Check an option's value in the ``__post_init__`` of a record: an error unless `holds`.

    Raises
    ------
    SceneError
        ``The option '{key}' must be {expected}, got {value}.``
    """
    if not holds:
        raise _wrong(key, expected, value)


def require_channels(channels: Sequence[str]) -> None:
    """Check the names of channels.

    Raises
    ------
    SceneError
        With the sentence of `channel_names`.
    """
    try:
        channel_names(channels, len(channels))
    except ArrayError as error:
        raise SceneError(str(error)) from None
