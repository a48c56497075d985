"""Heat after the current is switched on: bare (Fig. 3.21) and under a cover (Fig. 4.9)."""

from functools import cache

import numpy as np

from cnnum.arrays import Floats
from cnnum.lab.reproduce.chapters.silicon import table_change
from cnnum.lab.reproduce.faults import misled, scaled
from cnnum.lab.reproduce.figure import Curve, Figure, Panel
from cnnum.lab.reproduce.record import Chapter, Item
from cnnum.lab.reproduce.setup import LOAD, NOISE, E, Z, covered_taxel, point_strain
from cnnum.tactile.taxel import Bridge, Coupling, Heat, Readout, Taxel, fit_calibration

BARE, COVERED = 1e-3, 10e-3
"""The transient without amplification, V (4.3.2)."""

GAIN, SETTLING = 55.0, 180.0
"""Of the amplifier, and the time constant, s; "a quarter of an hour" (3.4.3) is five of these."""

OFFSETS = np.array([0.31, -0.12, 0.05, -0.27])
"""Of the four bridges after the amplifier, V: they differ, "quite a bit"; no digits."""

WAIT = 900.0
"""s, a quarter of an hour."""

BRIDGES = ("left", "right", "top", "bottom")


def taxel(transient: float, noise: float = NOISE) -> Taxel:
    """Return a taxel whose bridges warm up by these volts before the amplifier.

    Without noise it has no converter, either.
    """
    readout = Readout(
        gain=GAIN, noise=noise, offsets=OFFSETS, heat=Heat(GAIN * transient, SETTLING),
        bits=12 if noise else None,
    )  # fmt: skip
    return Taxel(Coupling.nominal(depth=Z, youngs_modulus=E), readout=readout)


def unloaded(transient: float, noise: float = NOISE) -> tuple[Floats, Floats]:
    """Return times since switch-on, s, and (n, 4) volts of an unloaded taxel."""
    time = np.linspace(0.0, WAIT, 361)
    rng = np.random.default_rng(21) if noise else None
    reading = taxel(transient, noise).read(np.zeros((time.size, 1, 1, 3)), time=time, rng=rng)
    return time, reading.volts[:, 0, 0]


def unloaded_gap() -> float:
    """Return how far the volts are from offsets and one decaying exponential, mV."""
    time, volts = unloaded(BARE, noise=0.0)
    exact = OFFSETS + (GAIN * BARE * np.exp(-time / SETTLING))[:, np.newaxis]
    return float(1e3 * np.abs(volts - exact).max())


@cache
def amplitude_found() -> float:
    """Return the transient under the cover that a calibration finds in a noisy scan, mV."""
    place = np.linspace(-0.4e-3, 0.4e-3, 400)
    time = np.linspace(0.0, WAIT, place.size)
    strain = point_strain(place, 0.0 * place, LOAD)[:, np.newaxis, np.newaxis]
    volts = taxel(COVERED).read(strain, time=time, rng=np.random.default_rng(9)).volts
    fit = fit_calibration(
        np.stack([place, 0.0 * place], axis=-1), np.full(place.size, LOAD), volts[:, 0, 0],
        youngs_modulus=E, depth=Z, times=time, heat_time=SETTLING,
    )  # fmt: skip
    return float(1e3 * fit.calibration.heat.amplitude / GAIN)


def mistaken_for() -> float:
    """Return the load above a taxel that reads as the transient does, mN."""
    taxel = covered_taxel()
    strain = point_strain(np.zeros(1), np.zeros(1), 1.0)
    per_newton = taxel.bridge.voltages(taxel.coupling.force(strain))[0, 0]
    return float(1e3 * COVERED / abs(per_newton))


def force_of_transient() -> float:
    """Return the force on bare silicon that warm bridges are taken for, mN, towards the skin."""
    return float(-1e3 * Bridge().force(np.full(4, COVERED))[2])


def figure_4_9() -> Figure:
    """Return the four bridges of an unloaded taxel after switching on, bare and covered."""
    titles = {"Bare (Fig. 3.21)": BARE, "Under a cover (Fig. 4.9)": COVERED}
    panels = list[Panel]()
    for title, transient in titles.items():
        time, volts = unloaded(transient)
        panels.append(
            Panel(title, "time since switch-on (min)", "output (V)",
                  [Curve(time / 60.0, volts[:, n], name) for n, name in enumerate(BRIDGES)])
        )  # fmt: skip
    return Figure(
        "fig-4.9",
        "Fig. 3.21, 4.9",
        "Four bridges after the current is switched on",
        "Simulated, unloaded, amplifier ×55. The transients of 1 mV and 10 mV before the amplifier "
        "and the quarter of an hour are the dissertation's; the offsets and the form, one "
        "exponential, are assumed. All four bridges move alike, so the shear stays zero, and the "
        "transient looks like a pull on the taxel.",
        panels,
    )


CHAPTER = Chapter(
    "Sections 3.4.3, 4.3.2 — heat after switching on",
    (
        Item("fig-3.21", "four bridges of an unloaded taxel against offsets and one exponential",
             "Fig. 3.21; section 3.4.3", 0.0, unloaded_gap, 1e-9,
             "without noise and converter: rounding", "mV", figure="fig-4.9",
             faults=(scaled(Heat.at, 1.001), misled(Heat.at, 1, "time", factor=1.001))),
        Item("fig-4.9", "transient under a cover, found in software from a noisy scan",
             "Fig. 4.9; section 4.3.2: 10 mV", 1e3 * COVERED, amplitude_found, 0.04,
             "the noise of 400 frames, with offsets and drift fitted as well, scatters 60 such "
             "scans by 0.012 mV: three times that", "mV", figure="fig-4.9",
             faults=(scaled(Heat.at, 1.01), misled(Heat.at, 1, "time", factor=1.1))),
        Item("fig-4.9-force", "force on the silicon that the transient is taken for",
             "Fig. 4.9; section 4.3.2", -1e3 * COVERED / (0.25 * 5.0 * table_change(1.0)),
             force_of_transient, 1e-9,
             "a quarter of 5 V times ΔR/R of Table 3.I by (3.7): rounding", "mN",
             figure="fig-4.9",
             faults=(scaled(Bridge.force, 1.001), scaled(Bridge.force, -1.0))),
        Item("fig-4.9-load", "load on a cover that divides by ten, which the transient looks like",
             "Fig. 4.9; Table 3.II: loads of 0–3 mN", (0.0, 3.0), mistaken_for, 0.0,
             "no digits: why the text waits a quarter of an hour, or compensates", "mN", "within",
             kind="comparison", figure="fig-4.9"),
    ),
    {"fig-4.9": figure_4_9},
)  # fmt: skip
