"""Section 4.3: the receptive field of a covered taxel, and its evidence on the cover."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache, partial
from math import pi, sqrt

import numpy as np

from cnnum.arrays import Floats
from cnnum.lab.reproduce.chapters import printed
from cnnum.lab.reproduce.chapters.fields import epsilon, highest
from cnnum.lab.reproduce.faults import misled, scaled
from cnnum.lab.reproduce.figure import Curve, Field, Figure, Panel
from cnnum.lab.reproduce.record import Chapter, Item
from cnnum.lab.reproduce.setup import (
    LOAD,
    MM,
    NOISE,
    E,
    Z,
    covered_taxel,
    largest_strain,
    point_strain,
)
from cnnum.tactile.halfspace import strain
from cnnum.tactile.taxel import Bridge, Coupling, ReceptiveField, receptive_field

X = np.linspace(-1.2e-3, 1.2e-3, 2401)
THICKNESS = np.array([0.18, 0.2, 0.25, 0.3, 0.4, 0.5]) * 1e-3
TRIALS, PASSES = 6, 16
"""Scans that are read alone, and scans that are averaged."""

MEASURED_BETA = 1.46
THICK, PITCH = 0.5e-3, 1.5e-3
"""Rubber of Fig. 4.11, and distance of the taxels of the 2 × 2 array, m."""

SENSITIVITIES = (0.7, 1.0, 1.46, 2.0, 3.0)
"""β_ns of taxels that are scanned."""


def exact_field(depth: float) -> ReceptiveField:
    """Return the figures of merit of an ideal strain sensor below a half-space."""
    strain = point_strain(X, np.zeros_like(X), LOAD, depth)
    return receptive_field(X, -strain[:, 0], -strain[:, 2])


def scan(beta_ns: float, seed: int, x: Floats = X) -> Floats:
    """Return (n, 4) voltages of a taxel while a needle is drawn across it, with noise, V."""
    strain = point_strain(x, np.zeros_like(x), LOAD)[:, np.newaxis, np.newaxis]
    taxel = covered_taxel(beta_ns)
    return taxel.read(strain, rng=np.random.default_rng(seed)).volts[:, 0, 0]


def repeated(beta_ns: float, passes: int) -> Floats:
    """Return (n, 4) mean voltages of scans on the same line, V."""
    return np.asarray(np.mean([scan(beta_ns, seed) for seed in range(passes)], axis=0))


def zero_found() -> float:
    """Return where S_n changes its sign, from the middle, mm."""
    tangential, _, normal = signals(repeated(BETA_SHOWN, PASSES))
    return 0.5 * MM * receptive_field(X, tangential, normal).width


def signals(volts: Floats) -> tuple[Floats, Floats, Floats]:
    """Return T_x, T_y, S_n of left, right, top, bottom (4.14)."""
    left, right, top, bottom = volts.T
    return left - right, bottom - top, -0.5 * (left + right + top + bottom)


@cache
def sensitivities() -> tuple[float, ...]:
    """Return β_ns of six noisy scans, by (4.20)."""
    result: list[float] = []
    for trial in range(TRIALS):
        tangential, _, normal = signals(scan(MEASURED_BETA, trial))
        result.append(receptive_field(X, tangential, normal).beta_ns)
    return tuple(result)


def sensitivity_gap() -> float:
    """Return the largest relative error of β_ns by (4.20), over scans of unlike taxels."""
    result = [
        receptive_field(X, *signals(scan(beta, 10 + trial))[::2]).beta_ns / beta
        for trial, beta in enumerate(SENSITIVITIES)
    ]
    return float(np.abs(np.array(result) - 1.0).max())


def slope_of_width() -> float:
    """Return the slope of W against thickness on a half-space."""
    widths = [exact_field(float(z)).width for z in THICKNESS]
    return float(np.polyfit(THICKNESS, widths, 1)[0])


def power_of_amplitude() -> float:
    """Return the power of thickness with which A falls on a half-space."""
    tops = [exact_field(float(z)).amplitude for z in THICKNESS]
    return float(np.polyfit(np.log(THICKNESS), np.log(tops), 1)[0])


def amplitude() -> float:
    """Return |ε_zz| right below 1 N, per cent."""
    return float(-100.0 * point_strain(np.zeros(1), np.zeros(1), 1.0)[0, 2])


def extrema_ratio() -> float:
    """Return |ε_zz| at its peak over |ε_xz| at its own."""
    aside = highest(partial(epsilon, 0), 0.0, 2.0 * Z) / MM
    return abs(epsilon(2, 0.0) / epsilon(0, aside))


def compensated_gap() -> float:
    """Return the RMS difference of measured and theoretical strain, share of the peak."""
    measured = compensated(PASSES)
    theory = point_strain(X, np.zeros_like(X), 1.0) / largest_strain(1.0)
    return float(np.sqrt(np.mean((measured + theory) ** 2)))


def compensated(passes: int = 1) -> Floats:
    """Return (n, 3) signals of mean scans, shear times their β_ns, over the peak of S_n."""
    tangential, across, normal = signals(repeated(MEASURED_BETA, passes))
    field = receptive_field(X, tangential, normal)
    beta, top = field.beta_ns, field.amplitude
    return np.stack([beta * tangential, beta * across, normal], axis=-1) / top


def plane(depth: float = Z, reach: float = 0.5e-3) -> tuple[Floats, Floats, Floats]:
    """Return x, y, m, of a square of places, and (n, n, 4) voltages of a needle there."""
    side = np.linspace(-reach, reach, 61)
    x, y = np.meshgrid(side, side)
    taxel = covered_taxel(MEASURED_BETA, depth)
    exact = replace(taxel, readout=replace(taxel.readout, noise=0.0, bits=None))
    seen = point_strain(x, y, LOAD, depth)[:, np.newaxis, np.newaxis]
    return x, y, exact.read(seen.reshape(-1, 1, 1, 3)).volts.reshape(*x.shape, 4)


def plane_gap() -> float:
    """Return how far the three signals over the plane are from the strain of (4.16), by (4.15)."""
    x, y, volts = plane()
    left, right, top, bottom = np.moveaxis(volts, -1, 0)
    ours = np.stack([left - right, bottom - top, -0.5 * (left + right + top + bottom)], axis=-1)
    place = np.stack([-x, -y, np.full_like(x, Z)])
    load = np.broadcast_to(LOAD * np.array([0.0, 0.0, 1.0])[:, None, None], place.shape)
    theirs = -np.moveaxis(printed.strain(place, load, E)[2], 0, -1)
    theirs = theirs / theirs[..., 2].max() / [MEASURED_BETA, MEASURED_BETA, 1.0]
    return float(np.abs(ours / ours[..., 2].max() - theirs).max())


def collapse() -> float:
    """Return how far profiles of ε_zz at six thicknesses are from one, over x/z and times z²."""
    share = np.linspace(-4.0, 4.0, 161)
    rows = [
        z**2 * point_strain(share * z, 0.0 * share, LOAD, float(z))[:, 2]
        for z in THICKNESS.tolist()
    ]
    gaps = np.array(rows) - rows[0]
    return float(np.abs(gaps).max() / np.abs(rows[0]).max())


def best_place() -> float:
    """Return where along x a load makes the right bridge answer most under 500 µm, mm."""
    x = np.linspace(-0.5e-3, 0.5e-3, 100001)
    strain = point_strain(x, 0.0 * x, LOAD, THICK)
    taxel = covered_taxel(MEASURED_BETA, THICK)
    right = -taxel.bridge.voltages(taxel.coupling.force(strain))[:, 1]
    return float(MM * x[np.argmax(right)])


def best_place_by_hand() -> float:
    """Return the same from (4.12), with signals as (4.14) and (4.15) have them, mm.

    Half of S_n and half of T_x are the right bridge's. With s = x/z that is ((2 − s²) − 3 s/β) over
    (1 + s²)^{5/2}: a load on the left moves the rubber below it outwards, to the right.
    """
    s = np.linspace(-1.0, 1.0, 200001)
    right = ((2.0 - s**2) - 3.0 * s / MEASURED_BETA) / (1.0 + s**2) ** 2.5
    return float(MM * THICK * s[np.argmax(right)])


def half_width(depth: float) -> float:
    """Return the width in which S_n exceeds a half of its peak, mm."""
    strain = -point_strain(X, 0.0 * X, LOAD, depth)[:, 2]
    return float(MM * np.ptp(X[strain > 0.5 * strain.max()]))


def figure_4_11() -> Figure:
    """Return maps of the four bridges under 500 µm, and of a 2 × 2 array."""
    x, y, volts = plane(THICK, 1.0e-3)
    panels = [
        Panel(f"{name} bridge (× −1)", "x (mm)", "y (mm)",
              [Field(MM * x[0], MM * y[:, 0], -1e3 * volts[..., n], "mV", levels=9)], equal=True)
        for n, name in enumerate(("left", "right", "top", "bottom"))
    ]  # fmt: skip
    side = np.linspace(-1.75e-3, 1.75e-3, 71)
    x, y = np.meshgrid(side, side)
    apart = 0.5 * PITCH
    places = [(a, b) for a in (-apart, apart) for b in (-apart, apart)]
    taxel = covered_taxel(MEASURED_BETA, THICK)
    signals_there = [
        -0.5 * taxel.bridge.voltages(
            taxel.coupling.force(point_strain(x - a, y - b, LOAD, THICK))).sum(axis=-1)
        for a, b in places
    ]  # fmt: skip
    four = 1e3 * taxel.readout.gain * np.max(signals_there, axis=0)
    panels.append(
        Panel("2 × 2 array, the taxel that answers most", "x (mm)", "y (mm)",
              [Field(MM * side, MM * side, four, "mV", levels=9)], equal=True)
    )  # fmt: skip
    return Figure(
        "fig-4.11",
        "Fig. 4.11",
        "Receptive fields of four bridges, and of four taxels",
        f"Simulated under 500 µm, {1e3 * LOAD:.0f} mN, without noise. A load moves the rubber "
        "below it outwards, so each bridge answers most to loads on the other side of the middle. "
        "Four taxels 1.5 mm apart leave places between them where none answers much. The measured "
        "fields are drawn from single touches 75 µm apart, in grey and without a scale.",
        panels,
    )


def figure_4_14() -> Figure:
    """Return maps of the three signals, over the place of the needle, and profiles of each."""
    x, y, volts = plane()
    left, right, top, bottom = np.moveaxis(volts, -1, 0)
    maps = {
        "T_x": left - right,
        "T_y": bottom - top,
        "S_n": -0.5 * (left + right + top + bottom),
    }
    panels = [
        Panel(name, "x (mm)", "y (mm)", [Field(MM * x[0], MM * y[:, 0], field, "V", levels=9)],
              equal=True)
        for name, field in maps.items()
    ]  # fmt: skip
    return Figure(
        "fig-4.14",
        "Fig. 4.14",
        "Three-axial receptive field over the plane",
        f"A simulated taxel under 200 µm, {1e3 * LOAD:.0f} mN, without noise. The sum of the "
        "bridges is round with a negative rim, and their differences have two lobes.",
        panels,
    )


def figure_4_15() -> Figure:
    """Return the normal strain at six thicknesses, as it is and over its peak."""
    rows = {
        f"{MM * z:.2f} mm": -point_strain(X, 0.0 * X, LOAD, z)[:, 2] for z in THICKNESS.tolist()
    }
    shown = slice(None, None, 6)
    return Figure(
        "fig-4.15",
        "Fig. 4.15",
        "Normal strain as the cover grows",
        "Half-space, 15 mN. It widens with the thickness and falls as its square. On the real "
        "covers it widens and falls less (Fig. 4.16).",
        (
            Panel("Strain", "x (mm)", "−ε_zz (%)",
                  [Curve(MM * X[shown], 100 * v[shown], n) for n, v in rows.items()]),
            Panel("Over the peak", "x (mm)", "share of the peak",
                  [Curve(MM * X[shown], v[shown] / v.max(), n) for n, v in rows.items()]),
        ),
    )  # fmt: skip


def figure_4_13() -> Figure:
    """Return the four bridges of a scan and the three signals made of them."""
    volts = scan(BETA_SHOWN, 0, X[::4])
    names = ("left", "right", "top", "bottom")
    three = zip(("T_x", "T_y", "S_n"), signals(volts), strict=True)
    return Figure(
        "fig-4.13",
        "Fig. 4.12, 4.13",
        "Receptive field along one bridge",
        f"A needle with {1e3 * LOAD:.0f} mN drawn across a simulated taxel under 200 µm, "
        "amplifier ×55, noise 2.5 mV, 12 bits. Measured on the real cover the brim is three "
        "times deeper (1 : 19 instead of 1 : 56).",
        (
            Panel("Four bridges (× −1)", "x (mm)", "output (V)",
                  [Curve(MM * X[::4], -volts[:, n], name) for n, name in enumerate(names)]),
            Panel("Three components", "x (mm)", "signal (V)",
                  [Curve(MM * X[::4], v, n) for n, v in three],
                  marks=[(MM * sqrt(2.0) * Z, "√2 z")]),
        ),
    )  # fmt: skip


BETA_SHOWN = 1.5


def figure_4_16() -> Figure:
    """Return W and A against thickness, with the fits published for the real cover."""
    fields = [exact_field(float(z)) for z in THICKNESS]
    width = MM * np.array([f.width for f in fields])
    height = np.array([f.amplitude for f in fields])
    share = height / height[1]
    z = np.linspace(0.15, 0.52, 75)
    return Figure(
        "fig-4.16",
        "Fig. 4.16",
        "Width and amplitude of the strain as the cover grows",
        "Half-space against the two fits published for real covers: slope 1.14 of W and power "
        "−1.45 of A. Only these two numbers are published: the measured lines are laid through "
        "our value at 0.2 mm.",
        (
            Panel("Width W between the zeros", "thickness z (mm)", "W (mm)",
                  [Curve(z, 2 * sqrt(2) * z, "2√2 z (4.17)", colour=0),
                   Curve(MM * THICKNESS, width, "from scans", "points", 0),
                   Curve(z, width[1] + 1.14 * (z - 0.2), "measured slope 1.14", "dashed", 1)]),
            Panel("Amplitude A", "thickness z (mm)", "A / A(0.2 mm)",
                  [Curve(z, (z / 0.2) ** -2.0, "1/z² (4.18)", colour=0),
                   Curve(MM * THICKNESS, share, "from scans", "points", 0),
                   Curve(z, (z / 0.2) ** -1.45, "measured, power −1.45", "dashed", 1)], log="xy"),
        ),
    )  # fmt: skip


def figure_4_17() -> Figure:
    """Return compensated signals and the strain of the half-space."""
    shown = slice(None, None, 4)
    measured = compensated()[shown]
    theory = -point_strain(X, np.zeros_like(X), 1.0)[shown] / largest_strain(1.0)
    parts = (("normal", 2), ("shear x", 0), ("shear y", 1))
    panels = [
        Panel(title, "x (mm)", "share of the peak",
              [Curve(MM * X[shown], values[:, i], name) for name, i in parts])
        for title, values in (("Simulated taxel, shear × β_ns", measured),
                              ("Half-space (4.16), sign turned", theory))
    ]  # fmt: skip
    return Figure(
        "fig-4.17",
        "Fig. 4.17",
        "Signals against theory",
        "Shear is compensated with the β_ns found from the same scans, as in the dissertation.",
        panels,
    )


FIGURES: dict[str, Callable[[], Figure]] = {
    "fig-4.11": figure_4_11,
    "fig-4.13": figure_4_13,
    "fig-4.14": figure_4_14,
    "fig-4.15": figure_4_15,
    "fig-4.16": figure_4_16,
    "fig-4.17": figure_4_17,
}

REAL = "the cover is finite and bonded to silicon; a half-space is neither"
SCANNED = "read from a scan in 1 µm steps: parabolas and straight lines between points"

CHAPTER = Chapter(
    "Section 4.3 — a taxel under a flat cover",
    (
        Item("W", "width W of the strain's peak at 0.2 mm", "(4.17): 2√2 z",
             2.0 * sqrt(2.0) * 0.2, lambda: MM * exact_field(Z).width, 1e-5, SCANNED, "mm",
             figure="fig-4.16",
             faults=(scaled(receptive_field, 1.001, part="width"),
                     misled(strain, 2, "z", factor=1.001))),
        Item("W-slope", "slope of W against thickness", "section 4.3.3",
             2.82, slope_of_width, 0.01, "the text cuts 2.828 to two decimals",
             figure="fig-4.16", faults=(scaled(receptive_field, 0.99, part="width"),)),
        Item("W-slope-measured", "slope of W on real covers", "Fig. 4.16, section 4.3.3", 1.14,
             slope_of_width, 0.0, REAL, kind="comparison", figure="fig-4.16"),
        Item("A", "amplitude A: |ε_zz| below 1 N at 0.2 mm, E = 0.87 MPa", "(4.18)",
             100.0 * 3.0 / (2.0 * pi * E * Z**2), amplitude, 1e-12,
             "closed form against closed form", "%", "relative", figure="fig-4.16",
             faults=(scaled(strain, 1.0 + 1e-9),)),
        Item("A-power", "power of thickness with which A falls", "(4.18): −2", -2.0,
             power_of_amplitude, 1e-3, SCANNED, figure="fig-4.16",
             faults=(misled(strain, 2, "z", shift=1e-6, of=Z),)),
        Item("A-power-measured", "power of A on real covers", "Fig. 4.16, section 4.3.3", -1.45,
             power_of_amplitude, 0.0, REAL, kind="comparison", figure="fig-4.16"),
        Item("56", "largest over most negative strain, 25√5", "section 4.3.3: 56", 25.0 * sqrt(5.0),
             lambda: exact_field(Z).inhibition, 0.1,
             "the fits over the top and the rim of a scan are 1e-3 off: 0.06",
             figure="fig-4.13", faults=(scaled(receptive_field, 0.99, part="inhibition"),)),
        Item("56-measured", "the same ratio on a real cover", "Fig. 4.13, section 4.3.3", 19.0,
             lambda: exact_field(Z).inhibition, 0.0, REAL, kind="comparison",
             figure="fig-4.13"),
        Item("25√5/24", "|ε_zz| at x = 0 over |ε_xz| at x = z/2", "(4.20)",
             25.0 * sqrt(5.0) / 24.0,
             extrema_ratio, 1e-9, "extrema found by search on our strain", figure="fig-4.13",
             faults=(scaled(strain, 1.0 + 1e-6, entry=(0, 2)),)),
        Item("fig-4.13-zero", "zero of S_n of a noisy taxel, from its middle",
             "Fig. 4.13; section 4.3.3: √2 z", sqrt(2.0) * 0.2,
             zero_found, 1e-3,
             "the mean of 16 scans has 0.6 mV of noise, on a slope of 6.6 V/mm: 0.1 µm, and the "
             "scan's steps are of 1 µm", "mm", figure="fig-4.13",
             faults=(scaled(receptive_field, 1.01, part="width"),
                     misled(strain, 2, "z", factor=1.01))),
        Item("fig-4.11", "place of the load to which the right bridge answers most, 500 µm",
             "Fig. 4.11; (4.12), (4.14), (4.15)", best_place_by_hand(), best_place, 2e-5,
             "two searches in steps of 10 and 5 nm", "mm", figure="fig-4.11",
             faults=(scaled(Coupling.force, 1.01, entry=0),
                     scaled(Bridge.matrix, -1.0, entry=(1, 0)),
                     scaled(strain, 1.01, entry=(0, 2)))),
        Item("fig-4.11-width", "width of S_n at half its peak, 500 µm of rubber",
             "section 4.3.2: a sensitive area of 500 × 500 µm", 0.5,
             lambda: half_width(THICK), 0.0,
             "how the area was read from the figure is not said; a half-space", "mm",
             kind="comparison", figure="fig-4.11"),
        Item("eq-4.15", "three signals over the plane against the strain of (4.16), with β_ns",
             "Fig. 4.11, 4.14; (4.14), (4.15)", 0.0, plane_gap, 1e-12,
             "without noise and converter: rounding", "of the peak", figure="fig-4.14",
             faults=(scaled(Coupling.force, 1.001, entry=1), scaled(Bridge.matrix, -1.0, entry=2),
                     scaled(strain, 1.001, entry=(0, 2)))),
        Item("fig-4.15", "six thicknesses as one profile, over x/z and times z²",
             "Fig. 4.15; (4.12)", 0.0, collapse, 1e-12, "a formula's own scaling: rounding",
             "of the peak", figure="fig-4.15", faults=(misled(strain, 2, "z", shift=1e-9, of=Z),)),
        Item("eq-4.20", "β_ns from noisy scans of five unlike taxels, the worst error",
             "(4.20); section 4.3.3", 0.0, sensitivity_gap, 4e-3,
             "the polynomials over the tops are 1e-3 off, and 2.5 mV of noise makes 9e-4 of the "
             "smallest shear, 0.34 V: three deviations",
             "relative", figure="fig-4.17",
             faults=(scaled(receptive_field, 1.01, part="beta_ns"),
                     scaled(Coupling.force, 1.01, entry=0))),
        Item("beta-ns-scatter", "scatter of the six β_ns", "section 4.3.3: ± 0.04", 0.04,
             lambda: float(np.std(sensitivities(), ddof=1)), 0.0,
             "electronics' noise alone; the real scatter is that of placing the needle",
             kind="comparison", figure="fig-4.17"),
        Item("fig-4.17", "compensated signals against the strain of (4.16), RMS",
             "Fig. 4.17", 0.0, compensated_gap, 7e-4,
             f"{1e3 * NOISE} mV a bridge make 4.5 mV of all three signals: 4.7e-4 of the peak of "
             "2.4 V in the mean of 16 scans; β_ns is off by 7e-4",
             "of the peak", figure="fig-4.17",
             faults=(scaled(receptive_field, 1.01, part="beta_ns"),
                     scaled(receptive_field, 0.99, part="beta_ns"))),
    ),
    FIGURES,
)  # fmt: skip
