"""The way back: amplified bridge voltages to signals (4.14) and strain (4.15), kept as TOML."""

import hashlib
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cnnum.arrays import Floats, finite, frozen
from cnnum.errors import CalibrationError, CnnumError, unreadable
from cnnum.frame import FORCE_AXES
from cnnum.safety.files import write_whole
from cnnum.safety.reading import LARGEST, parse_toml, read_text
from cnnum.safety.values import is_real, shown
from cnnum.tactile.taxel.bridge import COMBINE, SIDES, rows_of, trailing
from cnnum.tactile.taxel.readout import Heat, frame_times


def identity_of(text: str) -> str:
    """Return the id of a calibration: 12 hexadecimal digits of the SHA-256 of its TOML text.

    Raises
    ------
    CalibrationError
        If it is not text.
    """
    if not isinstance(cast(object, text), str):
        raise CalibrationError(f"A calibration must be TOML text, got {type(text).__name__}.")
    try:
        return hashlib.sha256(text.encode()).hexdigest()[:12]
    except UnicodeEncodeError:
        raise CalibrationError("A calibration must be UTF-8 text, got a lone surrogate.") from None


@dataclass(frozen=True, slots=True, eq=False)
class Calibration:
    """The map from the voltages of an array to strain at its taxels.

    Attributes
    ----------
    alpha_normal : float, 1/V
        α_n: −ε_zz for one volt of S_n.
    beta_ns : float
        Normal-to-shear sensitivity α_s/α_n (4.19), usually 1.5.
    offsets : (4,) or (rows, cols, 4) float, V
        Offsets of the warm bridges without load at time 0.
    cross : (3, 3) or (rows, cols, 3, 3) float
        Signals read = cross · signals of an ideal taxel; its diagonal gives the relative
        sensitivities of the taxels.
    drift : (4,) or (rows, cols, 4) float, V/s
        Drift of the offsets.
    heat : Heat
        Transient after switch-on.
    limit : float, V
        A voltage at or beyond ±`limit` is saturated.
    depth : float or None, m
        Thickness of the cover under which the strain is measured, if known.

    References
    ----------
    Vásárhelyi 2007, (4.14), (4.15), (4.19).
    """

    alpha_normal: float
    beta_ns: float = 1.5
    offsets: Floats = field(default_factory=lambda: np.zeros(4))
    cross: Floats = field(default_factory=lambda: np.eye(3))
    drift: Floats = field(default_factory=lambda: np.zeros(4))
    heat: Heat = field(default_factory=Heat)
    limit: float = float("inf")
    depth: float | None = None
    _decoder: Floats = field(init=False, repr=False)

    def __post_init__(self) -> None:
        for name in ("alpha_normal", "beta_ns", "limit"):
            _positive(name, getattr(self, name))
        if self.depth is not None:
            _positive("depth", self.depth)
        for name, tail in (("offsets", (4,)), ("drift", (4,)), ("cross", (3, 3))):
            object.__setattr__(self, name, _per_taxel(name, getattr(self, name), tail))
        object.__setattr__(self, "_decoder", frozen(_inverse(self.cross) @ COMBINE))

    def bridges(self, wanted: Sequence[str] = FORCE_AXES) -> tuple[str, ...]:
        """Return the bridges that the requested channels read; the others need no scanning."""
        used = np.any(self._decoder[..., rows_of(wanted), :].reshape(-1, 4), axis=0).tolist()
        return tuple(side for i, side in enumerate(SIDES) if used[i])

    def saturated(self, volts: ArrayLike) -> NDArray[np.bool_]:
        """Return where a voltage is at an end of the range.

        Parameters
        ----------
        volts : (..., rows, cols, 4) float, V

        Returns
        -------
        (..., rows, cols, 4) bool
        """
        return np.asarray(np.abs(finite("volts", volts)) >= self.limit)

    def to_signals(
        self,
        volts: ArrayLike,
        wanted: Sequence[str] = FORCE_AXES,
        *,
        time: ArrayLike | None = None,
    ) -> Floats:
        """Return T_x, T_y and S_n (4.14), free of offsets, drift, heat and cross sensitivity.

        Parameters
        ----------
        volts : (..., rows, cols, 4) float, V
            Amplified: left, right, top, bottom.
        wanted : sequence of str
            The channels to compute, in that order: "shear_x" (T_x), "shear_y", "normal" (S_n).
        time : (...) float, s, optional
            Time since switch-on, one per frame; by default, the sensor is warm and has not drifted.

        Returns
        -------
        (..., rows, cols, len(wanted)) float, V

        Raises
        ------
        ArrayError
            If the last axis does not have four bridges, or a value is not finite.
        UnknownNameError
            If a wanted channel is not one of the three.
        """
        return self._decode(volts, self._decoder[..., rows_of(wanted), :], time)

    def to_strain(
        self,
        volts: ArrayLike,
        wanted: Sequence[str] = FORCE_AXES,
        *,
        time: ArrayLike | None = None,
    ) -> Floats:
        """Return the strain rows ε_xz, ε_yz, ε_zz at the taxels (4.15).

        Parameters and errors are those of `to_signals`.

        Returns
        -------
        (..., rows, cols, len(wanted)) float
            Tension positive.
        """
        return self._decode(volts, self.strain_weights(wanted), time)

    def strain_weights(self, wanted: Sequence[str] = FORCE_AXES) -> Floats:
        """Return the strain per volt of each bridge, in the requested strain rows (4.15).

        Returns
        -------
        (len(wanted), 4) or (rows, cols, len(wanted), 4) float, 1/V

        Raises
        ------
        UnknownNameError
            If a wanted channel is not one of the three.
        """
        rows = rows_of(wanted)
        alpha = self.strain_per_volt[rows]
        return np.asarray(alpha[:, np.newaxis] * self._decoder[..., rows, :], dtype=np.float64)

    @property
    def wanders(self) -> bool:
        """Whether heat after switch-on, or drift, adds anything to the offsets."""
        return bool(self.heat.amplitude != 0.0 or self.drift.any())

    def wander(self, time: ArrayLike) -> Floats:
        """Return the change of the offsets up to a time, V.

        Parameters
        ----------
        time : (...) float, s
            Time since switch-on, one per frame.

        Returns
        -------
        float, V
            To be broadcast over (..., rows, cols, 4).

        Raises
        ------
        PhysicsError
            If a time is negative or NaN.
        """
        return self._wander(time, np.arange(4))

    @property
    def strain_per_volt(self) -> Floats:
        """(3,) float, 1/V: −α_s, −α_s, −α_n."""
        return -self.alpha_normal * np.array([self.beta_ns, self.beta_ns, 1.0])

    def strain_noise(self, volts: float) -> tuple[float, float]:
        """Return the white noise of the bridges as shear strain and normal strain.

        Parameters
        ----------
        volts : float, V
            RMS, after the amplifier (Table 3.II: 2–3 mV).

        Returns
        -------
        shear, normal : float
            RMS for the least sensitive taxel.
        """
        spread = np.linalg.norm(self._decoder, axis=-1) * np.abs(self.strain_per_volt) * volts
        worst = spread.reshape(-1, 3).max(axis=0)
        return float(worst[:2].max()), float(worst[2])

    def _decode(self, volts: ArrayLike, weights: Floats, time: ArrayLike | None) -> Floats:
        """Return weights · (volts − offsets), reading only the bridges that have a weight."""
        raw = trailing("volts", finite("volts", volts), 4, f"bridges {SIDES}")
        used = np.flatnonzero(weights.reshape(-1, 4).any(axis=0))
        clean = raw[..., used] - self.offsets[..., used]
        if time is not None:
            clean = clean - self._wander(time, used)
        kept = weights[..., used]
        if kept.ndim == 2:
            return np.asarray(clean @ kept.T, dtype=np.float64)
        return np.asarray(np.einsum("...ij,...j->...i", kept, clean), dtype=np.float64)

    def _wander(self, time: ArrayLike, used: NDArray[np.intp]) -> Floats:
        """Return the drift of the offsets of the used bridges, V."""
        wander = self.heat.at(time)
        if self.drift.any():
            wander = wander + self.drift[..., used] * frame_times(time)
        return wander

    def save(self, path: str | Path, *, force: bool = False) -> None:
        """Write the calibration as TOML, completely or not at all.

        Parameters
        ----------
        path : str or Path
        force : bool
            Whether an existing file is replaced.

        Raises
        ------
        CalibrationError
            If the file exists already or cannot be written.
        """
        save(Path(path), self._values(), force=force)

    def to_text(self) -> str:
        """Return the TOML text that `save` writes."""
        return to_text(self._values())

    @property
    def identity(self) -> str:
        """Id by which frames and recordings refer to the calibration."""
        return identity_of(self.to_text())

    @classmethod
    def load(cls, path: str | Path) -> "Calibration":
        """Return the calibration of a TOML file.

        Raises
        ------
        CalibrationError
            If the file cannot be read, or a key of it is missing, unknown or wrong.
        """
        return cls._of(load(Path(path)), Path(path))

    @classmethod
    def from_text(cls, text: str, path: str | Path) -> "Calibration":
        """Return the calibration of a TOML text; `path` names its place in an error.

        Raises
        ------
        CalibrationError
            If a key of it is missing, unknown or wrong.
        """
        return cls._of(from_text(text, Path(path)), Path(path))

    @classmethod
    def _of(cls, values: dict[str, Any], path: Path) -> "Calibration":
        try:
            return cls(**values)
        except CnnumError as error:
            raise CalibrationError(f"Calibration '{path}': {error}") from None

    def _values(self) -> dict[str, Any]:
        return {name: getattr(self, name) for name in KEYS}


def _positive(name: str, value: float) -> None:
    endless = name == "limit" and isinstance(value, float) and value == math.inf
    if not (endless or (is_real(value) and value > 0.0)):
        raise CalibrationError(f"'{name}' must be a positive number, got {value!r:.60}.")


def _per_taxel(name: str, value: ArrayLike, tail: tuple[int, ...]) -> Floats:
    """Return a read-only array with that tail, the same for all taxels or one each."""
    array = frozen(finite(name, value))
    if array.ndim not in (len(tail), len(tail) + 2) or array.shape[-len(tail) :] != tail:
        size = ", ".join(str(n) for n in tail)
        raise CalibrationError(
            f"'{name}' must have the shape ({size}) or (rows, cols, {size}), got {array.shape}."
        )
    return array


def _inverse(cross: Floats) -> Floats:
    """Return the inverse of the cross sensitivity."""
    worst = float(np.max(np.linalg.cond(cross)))
    if not worst < 1e6:  # volts carry 12 bits; beyond this nothing of the signals is left
        raise CalibrationError(
            f"'cross' cannot be inverted: its condition number is {worst:.3g}, expected below "
            "1e6; leave out the taxel, or fit it again."
        )
    return np.asarray(np.linalg.inv(cross), dtype=np.float64)


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
