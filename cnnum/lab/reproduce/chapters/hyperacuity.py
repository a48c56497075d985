"""Section 5.3: one taxel that finds the place of a needle, far finer than its own size."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, partial
from math import sqrt

import numpy as np
from numpy.typing import NDArray

from cnnum.arrays import Floats
from cnnum.lab.reproduce.chapters import printed
from cnnum.lab.reproduce.chapters.silicon import table_change
from cnnum.lab.reproduce.faults import misled, scaled
from cnnum.lab.reproduce.figure import Curve, Dots, Figure, Panel
from cnnum.lab.reproduce.record import Chapter, Item
from cnnum.lab.reproduce.setup import (
    BETA,
    LOAD,
    MM,
    NOISE,
    RATE,
    UM,
    E,
    Z,
    covered_taxel,
    largest_strain,
    point_strain,
)
from cnnum.tactile.halfspace import strain
from cnnum.tactile.inverse import locate, locate_signals

GAIN, SUPPLY, GAP = 55.0, 5.0, 5.0 / 2.0**12
"""Of the amplifier, V of the bridges, and V of a step of the converter (Table 3.II)."""

STEPS = 320
"""Of the stage in a millimetre (3.4.2)."""

SPEED = 0.5
"""Of the stage, mm/s (Fig. 5.4)."""

THIN = 0.9 * Z
"""A cover that is taken for a tenth thinner than it is, m."""

BETAS = (0.5, 0.75, 1.0, 1.25, 1.5, 2.0)
FINE = 150e-6
"""Radius within which the dissertation states its precision, m."""


@dataclass(frozen=True, slots=True, eq=False)
class Scan:
    """Where a needle stood, and where and how hard the taxel says it did.

    Attributes
    ----------
    x, y, x_seen, y_seen : (n,) float, m
    force : (n,) float, N
    """

    x: Floats
    y: Floats
    x_seen: Floats
    y_seen: Floats
    force: Floats

    def error(self, keep: NDArray[np.bool_]) -> float:
        """Return the RMS distance of places seen and true, µm."""
        gap = (self.x_seen - self.x) ** 2 + (self.y_seen - self.y) ** 2
        return float(UM * np.sqrt(np.mean(gap[keep])))


def observe(x: Floats, y: Floats, load: float, seed: int) -> Scan:
    """Return a noisy taxel's estimate of a needle."""
    taxel = covered_taxel()
    calibration = taxel.calibration(Z)
    strain = point_strain(x, y, load)[:, np.newaxis, np.newaxis]
    reading = taxel.read(strain, rng=np.random.default_rng(seed))
    result = locate(
        calibration.to_strain(reading.volts)[:, 0, 0],
        depth=Z,
        youngs_modulus=E,
        noise=calibration.strain_noise(NOISE),
    )
    return Scan(x, y, result.x, result.y, result.force)


@cache
def raster(load: float = LOAD, half: float = 250e-6) -> Scan:
    """Return the scan of Fig. 5.3: parallel lines 25 µm apart, 50 frames per second."""
    along = np.arange(-half, half + 1e-9, 1e-3 * SPEED / RATE)
    across = np.arange(-half, half + 1e-9, 25e-6)
    x, y = (v.reshape(-1) for v in np.meshgrid(along, across))
    return observe(x, y, load, 53)


def precision(load: float = LOAD) -> float:
    """Return the RMS error of place within 150 µm of the middle, µm."""
    scan = raster(load)
    return scan.error(np.hypot(scan.x, scan.y) <= FINE + 1e-9)


def hyperacuity(load: float = LOAD) -> float:
    """Return the RMS error of place over the square of 300 × 300 µm, µm."""
    scan = raster(load)
    return scan.error(np.maximum(np.abs(scan.x), np.abs(scan.y)) <= FINE + 1e-9)


def force_error() -> float:
    """Return the RMS error of the force within 150 µm, per cent."""
    scan = raster()
    near = np.hypot(scan.x, scan.y) <= FINE + 1e-9
    return float(100.0 * np.sqrt(np.mean((scan.force[near] / LOAD - 1.0) ** 2)))


@cache
def propagated() -> tuple[float, float]:
    """Return the RMS errors of place, µm, and of force, per cent, that follow from the noise.

    Within 150 µm, with no part of the library: the slopes of the printed strain (4.12) by place and
    force turn the noise of three signals into errors. A half-bridge gives 2.9 mV/mN/V of a tenth of
    the load, with all the digits of Table 3.I.
    """
    scan = raster()
    near = np.hypot(scan.x, scan.y) <= FINE + 1e-9
    values = np.stack([scan.x[near], scan.y[near], np.full(int(near.sum()), LOAD)])

    def strains(x: Floats, y: Floats, force: Floats) -> Floats:
        load = np.stack([0.0 * force, 0.0 * force, force])
        place = np.stack([-x, -y, np.full_like(x, Z)])
        return np.asarray(printed.strain(place, load, E)[2], dtype=np.float64)

    steps = np.diag([1e-3 * Z, 1e-3 * Z, 1e-3 * LOAD])
    around = [(values + h[:, np.newaxis], values - h[:, np.newaxis], 2.0 * h.sum()) for h in steps]
    slopes = [(strains(*above) - strains(*below)) / apart for above, below, apart in around]
    inverse = np.linalg.inv(np.moveaxis(np.array(slopes), -1, 0).swapaxes(1, 2))
    volts = np.hypot(NOISE, GAP / sqrt(12.0))
    top = 2.0 * GAIN * 0.25 * SUPPLY * abs(table_change(LOAD / 10.0))  # S_n over the middle
    unit = volts / top * largest_strain(LOAD)
    noise = unit * np.array([sqrt(2.0) * BETA, sqrt(2.0) * BETA, 1.0])
    spread = np.sum((inverse * noise) ** 2, axis=-1)
    place, force = UM**2 * (spread[:, 0] + spread[:, 1]), (100.0 / LOAD) ** 2 * spread[:, 2]
    return float(np.sqrt(place.mean())), float(np.sqrt(force.mean()))


def stage_run() -> tuple[Floats, Scan]:
    """Return times, s, and the scan of the middle line by a stage that moves in whole steps."""
    time = np.arange(0.0, 0.6 + 1e-9, 1.0 / RATE)
    steps = np.floor(SPEED * time * STEPS + 1e-9)
    x = -FINE + 1e-3 * steps / STEPS
    return time, observe(x, np.zeros_like(x), LOAD, 54)


def speed(depth: float = THIN) -> float:
    """Return the speed of the stage that exact strain gives, with a cover of that thickness, mm/s.

    The true cover is `Z` thick.
    """
    time, scan = stage_run()
    strain = point_strain(scan.x, scan.y, LOAD)
    x = locate(strain, depth=depth, youngs_modulus=E).x
    return float(np.polyfit(time, x, 1)[0] / np.polyfit(time, scan.x, 1)[0] * SPEED)


def mapped(beta: float, x: Floats, y: Floats) -> tuple[Floats, Floats, Floats]:
    """Return places and forces found with another β_ns than the taxel's, which is 1."""
    signals = -point_strain(x, y, 1.0)
    load = locate_signals(signals, depth=Z, youngs_modulus=E, alpha_normal=1.0, beta_ns=beta)
    return load.x, load.y, load.force


def magnification_gap() -> float:
    """Return the largest relative error of the size of the map's middle, β_ns of (5.15)."""
    near = np.array([1e-4 * Z])
    sizes = [mapped(beta, near, np.zeros(1))[0][0] / near[0] / beta for beta in BETAS]
    return float(np.abs(np.array(sizes) - 1.0).max())


def _grid() -> tuple[Floats, Floats]:
    side = np.linspace(-1.25, 1.25, 11) * Z
    x, y = np.meshgrid(side, side)
    return x.reshape(-1), y.reshape(-1)


def figure_5_2() -> Figure:
    """Return the maps of a grid of points with six values of β_ns."""
    x, y = _grid()
    panels: list[Panel] = []
    for beta in BETAS:
        u, v, force = mapped(beta, x, y)
        size = np.clip(24.0 * force, 2.0, 90.0)
        dots = Dots(MM * u, MM * v, size, 0)
        title = f"β_ns = {beta:g}"
        panels.append(Panel(title, "x (mm)", "y (mm)", [dots], equal=True, reach=0.34))
    return Figure(
        "fig-5.2",
        "Fig. 5.2",
        "A wrong β_ns bends the map",
        "A square grid of exact data of a taxel with β_ns = 1, read with the values above the "
        "panels; the size of a dot is the force found. Near the middle the map is β_ns times "
        "too large; right, it is the grid.",
        panels,
    )


def figure_5_3() -> Figure:
    """Return the raster scan as the taxel sees it, and its error over the load."""
    scan = raster()
    share = scan.force / LOAD
    loads = np.array([1e-3, 2e-3, 3e-3, 5e-3, 1e-2, 1.5e-2])
    errors = np.array([hyperacuity(load) for load in loads.tolist()])
    return Figure(
        "fig-5.3",
        "Fig. 5.3",
        "A needle drawn over one taxel along parallel lines",
        f"{1e3 * LOAD:.0f} mN at 0.5 mm/s and 50 Hz under 200 µm, with the noise of Table 3.II. "
        "Colour: force found over the true one. The dissertation's own map bends outwards, since "
        "a real cover's β_ns changes with distance; published: 3–5 µm within 150 µm.",
        (
            Panel("Places found", "x (mm)", "y (mm)",
                  [Dots(MM * scan.x_seen, MM * scan.y_seen, np.full(scan.x.size, 7.0), share,
                        "force found / true")], equal=True),
            Panel("Error over 300 × 300 µm", "load (mN)", "RMS error of place (µm)",
                  [Curve(1e3 * loads, errors, "2.5 mV noise, 12 bits", "points", 0),
                   Curve(1e3 * loads, errors[0] * loads[0] / loads, "∝ 1/load", "dotted", 0),
                   Curve(1e3 * loads, np.full(loads.size, 3.0), "published: 3 µm", "dashed", 1)],
                  log="xy"),
        ),
    )  # fmt: skip


def figure_5_4() -> Figure:
    """Return place against time on the middle line."""
    time, scan = stage_run()
    line = np.polyfit(time, MM * scan.x_seen, 1)
    fit = np.asarray(np.polyval(line, time), dtype=np.float64)
    slow = np.asarray(0.9 * MM * scan.x_seen)
    return Figure(
        "fig-5.4",
        "Fig. 5.4",
        "The stage's speed read back",
        "A stage of 320 steps/mm at 0.5 mm/s. The dissertation read 0.45 mm/s, as with a cover "
        "taken for a tenth thinner than it is: places scale with the thickness.",
        (
            Panel("Middle line, y = 0", "time (s)", "x found (mm)",
                  [Curve(time, MM * scan.x_seen, "frames", "points", 0),
                   Curve(time, fit, f"fit: {line[0]:.3f} mm/s", colour=0),
                   Curve(time, slow, "a tenth thinner: 0.45 mm/s", "dashed", 1)]),
            Panel("Less the true place", "time (s)", "error (µm)",
                  [Curve(time, UM * (scan.x_seen - scan.x), "from the stage's step", "points", 0)]),
        ),
    )  # fmt: skip


FIGURES: dict[str, Callable[[], Figure]] = {
    "fig-5.2": figure_5_2,
    "fig-5.3": figure_5_3,
    "fig-5.4": figure_5_4,
}

NEEDLE = (
    "the electronics' noise alone, which is not the published error's only source, and the load is "
    "not given"
)

CHAPTER = Chapter(
    "Section 5.3 — tactile hyper-accuracy",
    (
        Item("fig-5.2", "size of the map's middle over β_ns, the worst of six",
             "Fig. 5.2; (5.15): ρ → β_ns ρ for small ρ", 0.0, magnification_gap, 1e-6,
             "no digits: the limit of the printed formula, at ρ = 1e-4 z", "relative",
             figure="fig-5.2", faults=(scaled(locate_signals, 1.001, part="x"),)),
        Item("fig-5.3-place", "RMS error of place within 150 µm, over that which the noise makes",
             "Fig. 5.3; section 5.3", 1.0, lambda: precision() / propagated()[0], 0.06,
             "283 places with two errors each scatter by 3 %: two deviations", figure="fig-5.3",
             faults=(scaled(locate, 1.01, part="x"), scaled(locate, 0.99, part="y"))),
        Item("fig-5.3-force", "RMS error of the force within 150 µm, over that of the noise",
             "Fig. 5.3, “reliable amplitude values”", 1.0,
             lambda: force_error() / propagated()[1], 0.08,
             "283 forces scatter by 4 %: two deviations", figure="fig-5.3",
             faults=(scaled(locate, 1.01, part="force"), scaled(locate, 0.99, part="force"))),
        *(
            Item(name, title, source, expected, compute, 0.0, NEEDLE, "µm",
                 "within" if isinstance(expected, tuple) else "at most", kind="comparison",
                 figure="fig-5.3")
            for name, title, source, expected, compute in (
                ("fig-5.3-published", "RMS error of place within 150 µm, 15 mN", "section 5.3",
                 (3.0, 5.0), precision),
                ("fig-5.3-light", "the same at 3 mN, the top of Table 3.II's load range",
                 "section 5.3; Table 3.II", (3.0, 5.0), partial(precision, 3e-3)),
                ("hyperacuity", "RMS error of place over 300 × 300 µm", "section 5.4, thesis I.3",
                 3.0, hyperacuity),
            )
        ),
        Item("fig-5.4", "speed of a stage at 0.5 mm/s, with a cover taken for a tenth thinner",
             "Fig. 5.4: 0.45 mm/s, and its explanation in the text", 0.9 * SPEED, speed, 1e-9,
             "places scale with the thickness, exactly: rounding", "mm/s", figure="fig-5.4",
             faults=(scaled(locate, 1.001, part="x"), misled(strain, 2, "z", factor=1.001))),
    ),
    FIGURES,
)  # fmt: skip
