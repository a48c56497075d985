"""From raw values of every taxel to physical ones: offset, gain or matrix, and tare."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, cast

import numpy as np
from numpy.typing import ArrayLike

from cnnum.arrays import Floats, Shape, finite, frozen
from cnnum.errors import ArrayError, CalibrationError
from cnnum.frame import Frame
from cnnum.safety.reading import LARGEST, parse_toml, read_text
from cnnum.safety.values import checked_name, shown

KIND = "array calibration"
"""Kind of a calibration file; bridge taxels have another one."""

KEYS = ("offset", "gain", "unit", "tare")

MOST_TARE = 100_000
"""Frames."""

Form = Literal["channels", "taxels", "matrix", "matrices"]


@dataclass(frozen=True, slots=True, eq=False, init=False)
class ArrayCalibration:
    """The map from raw to physical values: value = gain · (raw − offset).

    Parameters
    ----------
    gain : float, (channels,), (rows, cols, channels), (channels, channels) or \
(rows, cols, channels, channels)
        One number, one a channel, or one a channel of every taxel. Or a matrix, as [to, from], for
        the whole array or for every taxel.
    offset : float, (channels,) or (rows, cols, channels)
        Raw values at rest.
    unit : str
        Unit of the values; empty if the driver's stays.
    tare : int
        Frames at the start whose mean is taken as the offset, in every taxel.

    Raises
    ------
    CalibrationError
        If a part is not finite, or the gain is 0 or has no unit. Or if the tare is no count of
        frames.
    """

    gain: Floats
    offset: Floats
    unit: str
    tare: int

    def __init__(
        self, gain: ArrayLike = 1.0, offset: ArrayLike = 0.0, unit: str = "", tare: int = 0
    ) -> None:
        try:
            given = {"gain": gain, "offset": offset}
            parts = {name: frozen(finite(name, value)) for name, value in given.items()}
        except ArrayError as error:
            raise CalibrationError(f"A calibration: {error}") from None
        if not parts["gain"].any():
            raise CalibrationError(
                "'gain' must not be 0 everywhere, which would remove every load."
            )
        if unit:
            checked_name("a unit", unit, CalibrationError)
        elif not (parts["gain"].ndim == 0 and float(parts["gain"]) == 1.0):
            raise CalibrationError(
                "A calibration with a 'gain' must state the resulting 'unit', as in unit = 'N'."
            )
        if (
            isinstance(tare, bool)
            or not isinstance(cast(object, tare), int)
            or not 0 <= tare <= MOST_TARE
        ):
            raise CalibrationError(
                f"'tare' must be a number of frames at rest from 0 to {MOST_TARE}, got "
                f"{shown(tare)}."
            )
        for name, value in {**parts, "unit": unit, "tare": tare}.items():
            object.__setattr__(self, name, value)

    def form(self, shape: Shape, channels: int) -> Form:
        """Return the gain for an array of that shape.

        Raises
        ------
        CalibrationError
            If gain or offset do not fit the array.
        """
        whole = (*shape, channels)
        forms: dict[tuple[int, ...], Form] = {
            (*whole, channels): "matrices",
            (channels, channels): "matrix",
            whole: "taxels",
            (channels,): "channels",
            (): "channels",
        }
        if self.offset.shape not in ((), (channels,), whole):
            raise CalibrationError(
                f"'offset' must be one number, or have the shape ({channels},) or {whole} for "
                f"this array, got {self.offset.shape}."
            )
        if self.gain.shape not in forms:
            choices = ", ".join(str(known) for known in forms if known)
            raise CalibrationError(
                f"'gain' must be one number, or have one of the shapes {choices} for this array, "
                f"got {self.gain.shape}."
            )
        return forms[self.gain.shape]

    def apply(self, raw: ArrayLike) -> Floats:
        """Return physical values of frames.

        Parameters
        ----------
        raw : (frames, rows, cols, channels) float

        Returns
        -------
        (frames, rows, cols, channels) float

        Raises
        ------
        CalibrationError
            If gain or offset do not fit the array, or there are fewer frames than the tare takes.
        """
        array = np.asarray(raw, dtype=np.float64)
        if array.ndim != 4 or len(array) < self.tare:
            raise CalibrationError(
                "A calibration needs values of shape (frames, rows, cols, channels) with at "
                f"least {max(1, self.tare)} frames, got {array.shape}."
            )
        shape, channels = (array.shape[1], array.shape[2]), array.shape[3]
        form = self.form(shape, channels)
        offset = array[: self.tare].mean(axis=0) if self.tare else self.offset
        return weighed(array - offset, self.gain, form)

    @classmethod
    def of_table(cls, table: Mapping[str, object], where: str) -> "ArrayCalibration":
        """Return the calibration of a table of a scene or a file.

        Raises
        ------
        CalibrationError
            If a part is wrong; `where` names the table.
        """
        unit = table.get("unit", "")
        if not isinstance(unit, str):
            raise CalibrationError(f"{where}: 'unit' must be a string, got {shown(unit)}.")
        given: dict[str, Any] = {key: table[key] for key in KEYS if key in table}
        try:
            return cls(**given)
        except CalibrationError as error:
            raise CalibrationError(f"{where}: {error}") from None


def weighed(values: Floats, gain: Floats, form: Form) -> Floats:
    """Return the gain times values without their offset."""
    if form in ("channels", "taxels"):
        return np.asarray(values * gain, dtype=np.float64)
    if form == "matrix":
        return np.asarray(values @ gain.T, dtype=np.float64)
    return np.asarray((gain @ values[..., np.newaxis])[..., 0], dtype=np.float64)


def read_array_calibration(path: Path) -> ArrayCalibration | None:
    """Read a calibration file of a whole array, or None if the file is of another kind.

    Raises
    ------
    CalibrationError
        If a key is unknown or wrong.
    """
    try:
        table = parse_toml(read_text(path, most=LARGEST))
    except (OSError, ValueError):  # the reader of the other kind names the fault
        return None
    if table.get("kind") != KIND:
        return None
    where = f"The calibration '{path}'"
    for key in table:
        if key not in ("kind", *KEYS):
            known = ", ".join(f"'{name}'" for name in KEYS)
            raise CalibrationError(f"{where}: unknown key {shown(key)}, expected {known}.")
    return ArrayCalibration.of_table(table, where)


class CalibratedReader:
    """Reads the wanted channels of single frames; with a tare it remembers the first frames.

    While it tares, values are those above the mean so far.

    Parameters
    ----------
    calibration : ArrayCalibration
    shape : (rows, cols)
    channels : sequence of str
        The driver's.
    wanted : sequence of str

    Raises
    ------
    CalibrationError
        If gain or offset do not fit the array.
    """

    __slots__ = ("_form", "_gain", "_left", "_offset", "_picked", "_seen", "_sum")

    def __init__(
        self,
        calibration: ArrayCalibration,
        shape: Shape,
        channels: Sequence[str],
        wanted: Sequence[str],
    ) -> None:
        self._form: Form = calibration.form(shape, len(channels))
        places = [channels.index(name) for name in wanted]
        gain, offset = calibration.gain, calibration.offset
        mixes = self._form in ("matrix", "matrices")
        # a matrix reads all channels for each that is wanted
        self._picked: slice | list[int] = slice(None) if mixes else places
        self._gain = gain[..., places, :] if mixes else gain[..., places] if gain.ndim else gain
        self._offset = np.broadcast_to(offset, (*shape, len(channels)))[..., self._picked]
        self._left, self._seen = calibration.tare, 0
        self._sum = np.zeros(self._offset.shape)

    def tare(self) -> None:
        """Take the next frames for the offset, where the calibration tares at all."""
        if self._seen:
            self._left, self._seen = self._seen + self._left, 0
            self._sum = np.zeros_like(self._sum)

    def __call__(self, frame: Frame) -> Floats:
        """Return (rows, cols, wanted) values.

        Raises
        ------
        ArrayError
            If a value is not finite.
        """
        raw = finite("frame", frame.values)[..., self._picked]
        if self._left:
            self._sum += raw
            self._seen, self._left = self._seen + 1, self._left - 1
            self._offset = self._sum / self._seen
        return weighed(raw - self._offset, self._gain, self._form)
