"""A scan of known point loads: the data of a calibration."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cnnum.arrays import Floats, finite
from cnnum.errors import CalibrationError
from cnnum.tactile import halfspace


@dataclass(frozen=True, slots=True, eq=False)
class Scan:
    """Loads, places and voltages, checked, with the taxels in one axis.

    Attributes
    ----------
    positions : (n, 2) float, m
    forces : (n, 3) float, N
    volts : (n, taxels, 4) float, V
    taxels : (taxels, 2) float, m
    usable : (n, taxels) bool
        Nothing saturated.
    shape : (rows, cols) int
    extras : tuple of str
        Parts of the background: "offset", "drift", "heat".
    background : (n, len(extras)) float
    heat_time : float, s
    limit : float, V
    youngs_modulus : float, Pa
    weights : (n, taxels, 4) float or None
        Weights of the readings in the fit; all alike without.
    """

    positions: Floats
    forces: Floats
    volts: Floats
    taxels: Floats
    usable: NDArray[np.bool_]
    shape: tuple[int, int]
    extras: tuple[str, ...]
    background: Floats
    heat_time: float
    limit: float
    youngs_modulus: float
    weights: Floats | None = None

    @property
    def taxel_count(self) -> int:
        """Number of taxels."""
        return len(self.taxels)

    def name(self, taxel: int) -> str:
        """Return row and column of a taxel, for a sentence."""
        row, col = divmod(taxel, self.shape[1])
        return f"({row}, {col})"

    def strain(self, taxel: int, depth: float) -> Floats:
        """Return (n, 3) ε_xz, ε_yz, ε_zz of the loads at a taxel, (4.16)."""
        x, y = (self.taxels[taxel] - self.positions).T
        tensor = halfspace.strain(x, y, depth, self.forces, youngs_modulus=self.youngs_modulus)
        return tensor[:, 2, :]

    def design(self, taxel: int, depth: float) -> Floats:
        """Return (n, 3 + len(extras)): strains and background."""
        return np.concatenate([self.strain(taxel, depth), self.background], axis=1)

    def by_signal(self) -> list[int]:
        """Return the taxels, the one that moved most first."""
        moved = np.ptp(self.volts, axis=0).max(axis=-1)
        return [int(i) for i in np.argsort(-moved)]

    def without_heat(self, amplitude: float) -> "Scan":
        """Return the scan with a known transient taken off and out of the background."""
        keep = [k for k, name in enumerate(self.extras) if name != "heat"]
        transient = amplitude * self.background[:, self.extras.index("heat")]
        return replace(
            self,
            volts=self.volts - transient[:, np.newaxis, np.newaxis],
            extras=tuple(self.extras[k] for k in keep),
            background=self.background[:, keep],
        )

    def on_line(self, taxel: int, tolerance: float) -> NDArray[np.bool_]:
        """Return which frames are normal loads on the line y = 0 of a taxel."""
        aside = np.abs(self.positions[:, 1] - self.taxels[taxel, 1]) <= tolerance
        normal = (self.forces[:, 2] > 0.0) & ~self.forces[:, :2].any(axis=1)
        return np.asarray(aside & normal)


def make_scan(
    positions: ArrayLike,
    forces: ArrayLike,
    volts: ArrayLike,
    taxels: ArrayLike | None,
    times: ArrayLike | None,
    heat_time: float | None,
    limit: float,
    youngs_modulus: float,
) -> Scan:
    """Return the scan of `fit_calibration`'s arguments.

    Raises
    ------
    CalibrationError
        If the shapes do not belong together, or there are too few usable frames.
    """
    place, readings = finite("positions", positions), finite("volts", volts)
    count = len(place) if place.ndim else 0
    if place.shape != (count, 2) or readings.ndim not in (2, 4) or readings.shape[-1] != 4:
        raise CalibrationError(
            "A scan needs 'positions' (n, 2) and 'volts' (n, 4) or (n, rows, cols, 4), got "
            f"{place.shape} and {readings.shape}."
        )
    shape = (1, 1) if readings.ndim == 2 else (readings.shape[1], readings.shape[2])
    flat = readings.reshape(len(readings), -1, 4)
    extras, background = _background(count, times, heat_time)
    usable = np.asarray((np.abs(flat) < limit).all(axis=-1))
    needed = 3 + len(extras)
    if len(flat) != count or usable.sum(axis=0).min(initial=count) < needed:
        raise CalibrationError(
            f"A scan needs one row of 'volts' for each of the {count} positions and at least "
            f"{needed} unsaturated frames a taxel, got {len(flat)} rows; check both, or press "
            "less hard."
        )
    return Scan(
        place,
        _forces(forces, count),
        flat,
        _taxels(taxels, shape),
        usable,
        shape,
        extras,
        background,
        float("inf") if heat_time is None else heat_time,
        limit,
        youngs_modulus,
    )


def _forces(forces: ArrayLike, count: int) -> Floats:
    """Return (n, 3) forces from (n,) normal or (n, 3) full ones."""
    load = finite("forces", forces)
    if load.shape == (count,):
        return np.stack([np.zeros(count), np.zeros(count), load], axis=-1)
    if load.shape != (count, 3):
        raise CalibrationError(
            f"'forces' must have the shape ({count},) or ({count}, 3), as many as positions, got "
            f"{load.shape}."
        )
    return load


def _taxels(taxels: ArrayLike | None, shape: tuple[int, int]) -> Floats:
    """Return (rows · cols, 2) places."""
    if taxels is None and shape == (1, 1):
        return np.zeros((1, 2))
    place = finite("taxels", () if taxels is None else taxels)
    if place.shape not in {(*shape, 2), (2,) if shape == (1, 1) else (*shape, 2)}:
        raise CalibrationError(
            f"'taxels' must give the place of each taxel, ({shape[0]}, {shape[1]}, 2), got "
            f"{place.shape}."
        )
    return place.reshape(-1, 2)


def _background(
    count: int, times: ArrayLike | None, heat_time: float | None
) -> tuple[tuple[str, ...], Floats]:
    """Return the names and the (n, k) columns of the background without load."""
    names, columns = ["offset"], [np.ones(count)]
    if times is not None:
        t = finite("times", times)
        if t.shape != (count,):
            raise CalibrationError(f"'times' must have the shape ({count},), got {t.shape}.")
        names, columns = [*names, "drift"], [*columns, t]
        if heat_time is not None:
            if not 0.0 < heat_time < np.inf:
                raise CalibrationError(f"'heat_time' must be positive seconds, got {heat_time}.")
            names, columns = [*names, "heat"], [*columns, np.exp(-t / heat_time)]
    elif heat_time is not None:
        raise CalibrationError("A heat transient needs 'times', seconds since switch-on.")
    return tuple(names), np.stack(columns, axis=-1)
