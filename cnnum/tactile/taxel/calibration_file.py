"""Calibrations as TOML files."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, cast

import numpy as np

from cnnum.arrays import Floats
from cnnum.errors import CalibrationError, CnnumError, unreadable
from cnnum.safety.files import write_whole
from cnnum.safety.names import shown
from cnnum.safety.reading import read_text
from cnnum.safety.toml_reading import LARGEST, parse_toml
from cnnum.tactile.taxel.readout import Heat

_KIND = "taxel calibration"
_REQUIRED = ("kind", "alpha_normal")
_NUMBERS = ("alpha_normal", "beta_ns", "limit", "depth")
_ARRAYS = ("offsets", "drift", "cross")
_HEAT = ("amplitude", "time_constant")
KEYS = (*_NUMBERS, *_ARRAYS, "heat")
"""The content of a calibration file."""


def save(path: Path, values: Mapping[str, Any], *, force: bool) -> None:
    """Write the values of a calibration, whole or not at all.

    Raises
    ------
    CalibrationError
        If there is such a file and `force` is not set, or it cannot be written.
    """
    write_whole(path, to_text(values), error=CalibrationError, force=force)


def load(path: Path) -> dict[str, Any]:
    """Return the values of a calibration file, by the names of its attributes.

    Raises
    ------
    CalibrationError
        If the file cannot be read, or a key of it is missing, unknown or wrong.
    """
    try:
        return from_text(read_text(path, most=LARGEST), path)
    except OSError as error:
        raise unreadable(CalibrationError, f"Calibration {str(path)!r}", error) from None
    except UnicodeDecodeError as error:
        raise CalibrationError(f"Calibration '{path}' is not a TOML file: {error}.") from None


def from_text(text: str, path: Path) -> dict[str, Any]:
    """Return the values of a calibration's TOML text; `path` names it in an error.

    Raises
    ------
    CalibrationError
        If a key is missing, unknown or wrong.
    """
    try:
        data = parse_toml(text)
    except ValueError as error:
        raise CalibrationError(f"Calibration '{path}' is not a TOML file: {error}.") from None
    _check_keys(path, data)
    values: dict[str, Any] = {name: _number(path, data, name) for name in _NUMBERS if name in data}
    values |= {name: _array(path, data, name) for name in _ARRAYS if name in data}
    return values | {"heat": _heat(path, data)}


def _check_keys(path: Path, data: Mapping[str, object]) -> None:
    for name in _REQUIRED:
        if name not in data:
            raise CalibrationError(f"Calibration '{path}' has no key '{name}', which it needs.")
    if data["kind"] != _KIND:
        raise CalibrationError(
            f"Calibration '{path}': key 'kind' must be \"{_KIND}\", got {shown(data['kind'])}."
        )
    known = ("kind", *KEYS)
    for name in data:
        if name not in known:
            raise CalibrationError(
                f"Calibration '{path}' has an unknown key {shown(name)}; known are "
                f"{', '.join(known)}."
            )


def _number(path: Path, data: Mapping[str, object], name: str) -> float:
    value = data[name]
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise CalibrationError(
            f"Calibration '{path}': key '{name}' must be a number, got {shown(value)}."
        )
    return float(value)


def _array(path: Path, data: Mapping[str, object], name: str) -> Floats:
    try:
        return np.asarray(data[name], dtype=np.float64)
    except (TypeError, ValueError):
        raise CalibrationError(
            f"Calibration '{path}': key '{name}' must be a list of numbers (nested for an array)."
        ) from None


def _heat(path: Path, data: Mapping[str, object]) -> Heat:
    table = data.get("heat", {})
    if not isinstance(table, dict):
        raise CalibrationError(
            f"Calibration '{path}': key 'heat' must be a table, got {shown(table)}."
        )
    entries = cast("dict[str, object]", table)
    for name in entries:
        if name not in _HEAT:
            raise CalibrationError(
                f"Calibration '{path}' has an unknown key 'heat.{name}'; known are "
                f"{', '.join(_HEAT)}."
            )
    try:
        return Heat(**{name: _number(path, entries, name) for name in entries})
    except CnnumError as error:
        raise CalibrationError(f"Calibration '{path}': key 'heat': {error}") from None


def to_text(values: Mapping[str, Any]) -> str:
    """Return the TOML text of a calibration's values; repr keeps every digit of a float."""
    lines = [f'kind = "{_KIND}"']
    for name in _NUMBERS:
        value = values[name]
        if value is not None:
            lines.append(f"{name} = {float(value)!r}")
    lines += [f"{name} = {values[name].tolist()!r}" for name in _ARRAYS]
    lines.append("\n[heat]")
    lines += [f"{name} = {float(getattr(values['heat'], name))!r}" for name in _HEAT]
    return "\n".join(lines) + "\n"
