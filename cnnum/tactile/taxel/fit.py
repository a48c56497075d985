"""A calibration from a scan: known point loads on the cover, and the voltages they gave."""

from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cnnum.arrays import Floats, finite
from cnnum.errors import CalibrationError
from cnnum.tactile import halfspace
from cnnum.tactile.taxel.bridge import COMBINE
from cnnum.tactile.taxel.calibration import Calibration
from cnnum.tactile.taxel.readout import Heat
from cnnum.tactile.taxel.receptive_field import ReceptiveField, receptive_field


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
            f"{needed} unsaturated frames per taxel, got {len(flat)} rows; check both, or press "
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
            f"'taxels' must give the position of each taxel, ({shape[0]}, {shape[1]}, 2), got "
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


_DEPTHS = np.geomspace(
    20e-6, 20e-3, 31
)  # m, any cover; 1.26 apart, inside the width of the minimum
_WEAK = 1e-4  # a strain component this small against the normal one was not excited by the scan
_OUTLIER = 6.0  # standard deviations: of 10⁸ normal numbers none is farther off
_HUBER = 3.0  # standard deviations at which the influence of a reading ends; 0.3 % are beyond
_MAD = 1.4826  # standard deviation over the median size of a normal number
_ROUNDING = 1e-6  # of a taxel's range: residuals of this size are no noise
_ROUNDS = 20  # fits with weights of the one before; spikes take some five
_ABSOLUTE_ROUNDS = 6  # the same at the start, which need not be the end
_ILL = 1e8  # condition of the scan beyond which its answer is rounding


@dataclass(frozen=True, slots=True, eq=False)
class CalibrationFit:
    """A fitted calibration and how well it explains its scan.

    Attributes
    ----------
    calibration : Calibration
        With offsets, drift and cross sensitivity of every taxel.
    depth : float, m
        Thickness of the half-space cover that explains the scan best, or as given.
    residual : float, V
        RMS of the fit's residual without the outliers; near the noise if the model holds.
    outliers : (n, taxels) bool
        Readings that are off by more than six standard deviations of the noise, in any bridge. The
        noise is that of the middle half of the residuals. They count in the fit as if they were off
        by three. Taxels are in row order.
    field : ReceptiveField or None
        W, A and β_ns by (4.20), where the scan has a line across a taxel.
    """

    calibration: Calibration
    depth: float
    residual: float
    outliers: NDArray[np.bool_]
    field: ReceptiveField | None


def fit_calibration(
    positions: ArrayLike,
    forces: ArrayLike,
    volts: ArrayLike,
    *,
    youngs_modulus: float,
    depth: float | None = None,
    taxels: ArrayLike | None = None,
    times: ArrayLike | None = None,
    heat_time: float | None = None,
    limit: float = float("inf"),
) -> CalibrationFit:
    """Return the calibration that best explains a scan of point loads.

    For one thickness of the cover the voltages are linear in the unknowns: offsets, drift, and a
    gain for each strain component (4.16). Least squares over all points replaces reading β_ns off
    two extrema (4.20), and also gives the cross sensitivity. The influence of readings far from the
    others, such as spikes, is bounded (Huber 1964).

    Parameters
    ----------
    positions : (n, 2) float, m
        Place of the load on the cover.
    forces : (n,) or (n, 3) float, N
        Normal force, or (Q, R, F), of each load; zero for an unloaded frame.
    volts : (n, 4) or (n, rows, cols, 4) float, V
        Amplified bridge voltages of one taxel or of the array.
    youngs_modulus : float, Pa
        Young's modulus of the cover; α_n scales with its inverse.
    depth : float, m, optional
        Thickness of the cover; fitted if not given.
    taxels : (rows, cols, 2) float, m, optional
        Places of the taxels; a single taxel is at the origin.
    times : (n,) float, s, optional
        Time since switch-on; if given, a linear drift of the offsets is fitted.
    heat_time : float, s, optional
        Time constant of the heat transient, whose amplitude is fitted if this and `times` are
        given.
    limit : float, V
        Frames of a taxel with a voltage at or beyond ±`limit` are left out.

    Returns
    -------
    CalibrationFit

    Raises
    ------
    CalibrationError
        If the shapes do not fit, or the scan does not determine the sensitivities.

    References
    ----------
    Vásárhelyi 2007, (4.14)–(4.20).
    """
    scan = make_scan(positions, forces, volts, taxels, times, heat_time, limit, youngs_modulus)
    if depth is not None and not 0.0 < depth < np.inf:
        raise CalibrationError(f"'depth' must be a positive thickness in metres, got {depth}.")
    fit = _least_squares(scan, depth)
    if fit is None or _far(fit, _OUTLIER).any():
        fit = _without_influence(scan, depth)
    outliers = np.asarray(_far(fit, _OUTLIER).any(axis=-1) & scan.usable)
    _check(fit.scan, fit.depth, fit.found)
    calibration = _assemble(fit.scan, fit.found, fit.depth, fit.heat)
    kept = replace(fit.scan, usable=fit.scan.usable & ~outliers)
    residual = float(np.sqrt(np.mean(fit.residuals[kept.usable] ** 2)))
    return CalibrationFit(
        calibration, fit.depth, residual, outliers, _line(kept, calibration, fit.depth)
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Fit:
    """A fit for given weights: `scan` is without the heat, `residuals` (n, taxels, 4) are in V."""

    scan: Scan
    depth: float
    heat: Heat
    found: Floats
    residuals: Floats


def _least_squares(scan: Scan, depth: float | None) -> _Fit | None:
    """Return the plain fit, None if it finds no thickness: spikes may hide it."""
    try:
        return _fitted(scan, depth)
    except CalibrationError:
        return None


def _without_influence(scan: Scan, depth: float | None) -> _Fit:
    """Return the fit in which no reading has more influence than one that is a little off.

    It starts from least absolute residuals, which a minority of spikes does not move far, at the
    thickness where their sum is least.
    """
    starts = [_absolute(scan, float(z)) for z in (_DEPTHS if depth is None else [depth])]
    start = min(starts, key=lambda fit: float(np.abs(fit.residuals).sum()))
    fit = _fitted(replace(scan, weights=_weights(start, _HUBER)), depth)
    for _ in range(_ROUNDS):
        before, fit = fit, _fitted(replace(scan, weights=_weights(fit, _HUBER)), depth)
        if np.allclose(fit.found, before.found, rtol=1e-6, atol=1e-9 * np.abs(fit.found).max()):
            break
    return fit


def _absolute(scan: Scan, depth: float) -> _Fit:
    """Return about the fit of least absolute residuals, by weights of the one before."""
    fit = _fitted(scan, depth)
    for _ in range(_ABSOLUTE_ROUNDS):
        fit = _fitted(replace(scan, weights=_weights(fit, 1.0)), depth)
    return fit


def _fitted(scan: Scan, depth: float | None) -> _Fit:
    z = _best_depth(scan) if depth is None else float(depth)
    heat = _heat(scan, z)
    warm = scan if heat is None else scan.without_heat(heat.amplitude)
    result, _ = _solve(warm, z)
    explained = [warm.design(i, z) @ result[i] for i in range(warm.taxel_count)]
    return _Fit(warm, z, heat or Heat(), result, warm.volts - np.stack(explained, axis=1))


def _far(fit: _Fit, deviations: float) -> NDArray[np.bool_]:
    """Return which readings, (n, taxels, 4), are off by more than some standard deviations."""
    return np.abs(fit.residuals) > deviations * _noise(fit)


def _weights(fit: _Fit, deviations: float) -> Floats:
    """Return Huber's weights: 1, and falling as one over the residual beyond some deviations."""
    size = np.maximum(np.abs(fit.residuals), np.finfo(np.float64).tiny)
    return np.minimum(1.0, deviations * _noise(fit) / size)


def _noise(fit: _Fit) -> Floats:
    """Return the noise of each taxel, (taxels, 1): of its median residual, or of roundings."""
    sizes = np.where(fit.scan.usable[..., np.newaxis], np.abs(fit.residuals), np.nan)
    middle = np.nanmedian(sizes, axis=(0, 2))
    moved = np.ptp(fit.scan.volts, axis=(0, 2))
    return np.asarray(np.maximum(_MAD * middle, _ROUNDING * moved))[:, np.newaxis]


def _heat(scan: Scan, depth: float) -> Heat | None:
    """Return the transient common to all bridges: the mean over the bridges."""
    if "heat" not in scan.extras:
        return None
    result, _ = _solve(scan, depth)
    return Heat(float(result[:, 3 + scan.extras.index("heat")].mean()), scan.heat_time)


def _solve(scan: Scan, depth: float) -> tuple[Floats, float]:
    """Return (taxels, 3 + extras, 4) coefficients and the sum of squares of the residual."""
    result: list[Floats] = []
    squares = 0.0
    for i in range(scan.taxel_count):
        use = scan.usable[:, i]
        design = scan.design(i, depth)[use]
        scale = np.linalg.norm(design, axis=0)
        scale[scale == 0.0] = 1.0
        volts = scan.volts[use, i]
        if scan.weights is None:
            solution = _least(design / scale, volts)
            left = volts - (design / scale) @ solution
        else:  # each bridge by itself, as its readings have weights of their own
            root = np.sqrt(scan.weights[use, i])
            solution = np.stack(
                [
                    _least(design / scale * r[:, np.newaxis], v * r)
                    for r, v in zip(root.T, volts.T, strict=True)
                ],
                axis=-1,
            )
            left = root * (volts - (design / scale) @ solution)
        squares += float(np.sum(left**2))
        result.append(solution / scale[:, np.newaxis])
    return np.stack(result), squares


def _least(design: Floats, volts: Floats) -> Floats:
    result = cast(Any, np.linalg.lstsq(design, volts, rcond=1e-10))
    return np.asarray(result[0], dtype=np.float64)


def _best_depth(scan: Scan) -> float:
    """Return the thickness with the least squares left: a coarse search, then Brent's."""

    def left(log_depth: float) -> float:
        return _solve(scan, float(np.exp(log_depth)))[1]

    grid = np.log(_DEPTHS)
    costs = np.array([left(value) for value in grid])
    best = int(np.argmin(costs))
    if best in (0, len(grid) - 1) or not costs.max() > costs.min():
        raise CalibrationError(
            "The scan does not determine the thickness of the cover: expected one between "
            f"{_DEPTHS[1]:.3g} m and {_DEPTHS[-2]:.3g} m; pass 'depth', or scan more places."
        )
    from scipy import optimize

    bounds = (grid[best - 1], grid[best + 1])
    result = cast(
        Any,
        optimize.minimize_scalar(left, bounds=bounds, method="bounded", options={"xatol": 1e-9}),
    )
    return float(np.exp(result.x))


def _excited(scan: Scan, depth: float) -> tuple[bool, bool]:
    """Return whether the loads made shear strain along x and along y at some taxel."""
    squares = [np.sum(scan.strain(i, depth) ** 2, axis=0) for i in range(scan.taxel_count)]
    sizes = np.sqrt(np.sum(np.stack(squares), axis=0))
    return bool(sizes[0] > _WEAK * sizes[2]), bool(sizes[1] > _WEAK * sizes[2])


def _check(scan: Scan, depth: float, values: Floats) -> None:
    """Check that a scan determines every sensitivity, with the right sign."""
    along_x, along_y = _excited(scan, depth)
    if not (along_x or along_y):
        raise CalibrationError(
            "The scan has no shear strain: expected loads off the taxels' centres; "
            "scan a line or a field."
        )
    kept = [j for j, used in enumerate((along_x, along_y, True)) if used]
    for i in range(scan.taxel_count):
        design = scan.design(i, depth)[scan.usable[:, i]]
        design = design[:, [*kept, *range(3, design.shape[1])]]
        sizes = np.linalg.norm(design, axis=0)
        if not (sizes > 0.0).all() or np.linalg.cond(design / sizes) > _ILL:
            raise CalibrationError(
                f"The scan does not determine taxel {scan.name(i)}: expected loads at several "
                "places around it; add some, or leave the taxel out."
            )
        gain = -(COMBINE @ values[i, :3].T)
        if any(gain[j, j] <= 0.0 for j in kept):
            raise CalibrationError(
                f"Taxel {scan.name(i)} answers a push with the wrong sign: expected bridges in the "
                "order left, right, top, bottom, and a load in newtons that pushes; check both."
            )


def _assemble(scan: Scan, values: Floats, depth: float, heat: Heat) -> Calibration:
    """Return the calibration: mean sensitivities, and each taxel's departure as its cross."""
    gains = -(COMBINE @ np.swapaxes(values[:, :3], 1, 2))  # (taxels, signals, −strain), V
    used = [j for j, excited in enumerate(_excited(scan, depth)) if excited]
    normal = float(gains[:, 2, 2].mean())
    shear = float(np.mean([gains[:, j, j].mean() for j in used]))
    cross = gains / np.array([shear, shear, normal])
    for j in {0, 1} - set(used):
        cross[:, :, j] = np.eye(3)[j]
    extras = {name: values[:, 3 + k] for k, name in enumerate(scan.extras)}
    rows, cols = scan.shape
    return Calibration(
        alpha_normal=1.0 / normal,
        beta_ns=normal / shear,
        offsets=extras["offset"].reshape(rows, cols, 4),
        cross=cross.reshape(rows, cols, 3, 3),
        drift=extras.get("drift", np.zeros((rows * cols, 4))).reshape(rows, cols, 4),
        heat=heat,
        limit=scan.limit,
        depth=depth,
    )


def _line(scan: Scan, calibration: Calibration, depth: float) -> ReceptiveField | None:
    """Return the figures of merit of the best line of normal loads across a taxel along x."""
    for i in scan.by_signal():
        use = scan.usable[:, i] & scan.on_line(i, 0.05 * depth)
        if np.count_nonzero(use) < 10:
            continue
        scale = scan.forces[use, 2] / scan.forces[use, 2].mean()
        background = scan.design(i, depth)[use, 3:]
        known = {
            "offset": calibration.offsets.reshape(-1, 4)[i],
            "drift": calibration.drift.reshape(-1, 4)[i],
        }
        clean = scan.volts[use, i] - background @ np.stack([known[name] for name in scan.extras])
        signals = (clean @ COMBINE.T) / scale[:, np.newaxis]
        try:
            return receptive_field(scan.positions[use, 0], signals[:, 0], signals[:, 2])
        except CalibrationError:
            continue
    return None
