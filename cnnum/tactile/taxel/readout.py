"""From bridge voltages to the computer's readings: amplifier, offsets, heat, noise, converter."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cnnum.arrays import Floats, finite, frozen
from cnnum.errors import PhysicsError
from cnnum.tactile.taxel.bridge import SIDES, trailing


@dataclass(frozen=True, slots=True)
class Heat:
    """The transient after the current is switched on, the same in all bridges.

    Attributes
    ----------
    amplitude : float, V
        At switch-on, after the amplifier. Before the amplifier, 1 mV was measured on a bare array
        and 10 mV under a cover (4.3.2).
    time_constant : float, s
        The dissertation waits a quarter of an hour: five of these.
    """

    amplitude: float = 0.0
    time_constant: float = 180.0

    def __post_init__(self) -> None:
        if not (np.isfinite(self.amplitude) and 0.0 < self.time_constant < np.inf):
            raise PhysicsError(
                "A heat transient needs a finite amplitude and a positive time constant, got "
                f"{self.amplitude} V and {self.time_constant} s."
            )

    def at(self, time: ArrayLike) -> Floats:
        """Return the transient, ready to be added to the volts of frames at these times.

        Parameters
        ----------
        time : (...) float, s
            Time since switch-on, one per frame; infinity means warm.

        Returns
        -------
        () or (..., 1, 1, 1) float, V

        Raises
        ------
        PhysicsError
            If a time is negative or NaN.
        """
        return self.amplitude * np.exp(-frame_times(time) / self.time_constant)


def frame_times(time: ArrayLike) -> Floats:
    """Return times since switch-on with axes for rows, columns and bridges.

    Raises
    ------
    PhysicsError
        If a time is negative or NaN.
    """
    t = np.asarray(time, dtype=np.float64)
    if np.isnan(t).any() or (t < 0.0).any():
        raise PhysicsError(
            "'time' must be seconds since switch-on, neither negative nor NaN, got "
            f"a smallest value of {np.min(t)}; use infinity for a warm sensor."
        )
    return t if t.ndim == 0 else t[..., np.newaxis, np.newaxis, np.newaxis]


@dataclass(frozen=True, slots=True, eq=False)
class Reading:
    """The output of the converter, with flags for untrusted values.

    Attributes
    ----------
    volts : (..., rows, cols, 4) float, V
        Amplified voltages of left, right, top, bottom.
    saturated : (..., rows, cols, 4) bool
        Whether the converter was at an end of its range: the voltage is then a bound, not a value.
    overloaded : (..., rows, cols) bool
        Whether the force may have broken the bridges.
    """

    volts: Floats
    saturated: NDArray[np.bool_]
    overloaded: NDArray[np.bool_]

    @property
    def good(self) -> NDArray[np.bool_]:
        """(..., rows, cols) bool: neither saturated nor overloaded."""
        return ~(self.saturated.any(axis=-1) | self.overloaded)


@dataclass(frozen=True, slots=True, eq=False)
class Readout:
    """A linear amplifier and a converter (Table 3.II).

    Attributes
    ----------
    gain : float
        Gain of the amplifier, 50–60.
    noise : float, V
        White, RMS, after the amplifier: 2–3 mV.
    limit : float, V
        The converter's range is −limit … +limit; infinity for none.
    bits : int or None
        Bits of the converter; None for no quantisation.
    offsets : (4,) or (rows, cols, 4) float, V
        Offsets of the bridges, after the amplifier (unequal implanted resistors).
    heat : Heat
    """

    gain: float = 55.0
    noise: float = 2.5e-3
    limit: float = 2.5
    bits: int | None = 12
    offsets: Floats = field(default_factory=lambda: np.zeros(4))
    heat: Heat = field(default_factory=Heat)

    def __post_init__(self) -> None:
        offsets = frozen(trailing("offsets", finite("offsets", self.offsets), 4, f"{SIDES}"))
        object.__setattr__(self, "offsets", offsets)
        if not (np.isfinite(self.gain) and self.gain != 0.0 and self.noise >= 0.0):
            raise PhysicsError(
                "A readout needs a finite, non-zero gain and a non-negative noise, got "
                f"{self.gain} and {self.noise} V."
            )
        if not self.limit > 0.0:
            raise PhysicsError(f"'limit' must be positive volts, got {self.limit}.")
        if self.bits is not None and not (1 <= self.bits <= 32 and np.isfinite(self.limit)):
            raise PhysicsError(
                f"A converter needs 1 to 32 'bits' and a finite 'limit', got {self.bits} bits and "
                f"{self.limit} V; use bits=None for no quantisation."
            )

    @property
    def step(self) -> float:
        """Least significant bit, V; 0 without quantisation."""
        return 0.0 if self.bits is None else 2.0 * self.limit / 2.0**self.bits

    def read(
        self,
        voltages: ArrayLike,
        *,
        time: ArrayLike = np.inf,
        rng: np.random.Generator | None = None,
    ) -> tuple[Floats, NDArray[np.bool_]]:
        """Return the voltages as read, and where they are limited by the range.

        Parameters
        ----------
        voltages : (..., rows, cols, 4) float, V
            Voltages of the half bridges.
        time : (...) float, s
            Time since switch-on, one per frame.
        rng : numpy.random.Generator, optional
            Source of the noise; without it there is none.

        Returns
        -------
        volts : (..., rows, cols, 4) float, V
        saturated : (..., rows, cols, 4) bool

        Raises
        ------
        ArrayError
            If the last axis does not hold four bridges.
        """
        bare = trailing("voltages", finite("voltages", voltages), 4, f"bridges {SIDES}")
        volts = self.gain * bare + self.offsets
        if self.heat.amplitude != 0.0:
            volts = volts + self.heat.at(time)
        if rng is not None:
            volts = volts + rng.normal(0.0, self.noise, volts.shape)
        return self._convert(volts)

    def _convert(self, volts: Floats) -> tuple[Floats, NDArray[np.bool_]]:
        """Return the converter's values; |code| has its last value in common at both ends."""
        if self.bits is None:
            cut = np.clip(volts, -self.limit, self.limit)
            return cut, np.asarray(np.abs(volts) >= self.limit)
        top = 2.0 ** (self.bits - 1)
        code = np.clip(np.rint(volts / self.step), -top, top - 1.0)
        return code * self.step, np.asarray(np.abs(code) >= top - 1.0)
