"""Chapter 2: bars felt through the skin (Fig. 2.8), and the after-image of a touch (2.3.3)."""

import numpy as np

from cnnum.arrays import Floats
from cnnum.lab.reproduce.chapters.fields import flat_lines, flat_punch_stress
from cnnum.lab.reproduce.faults import changed, misled, scaled
from cnnum.lab.reproduce.figure import Curve, Figure, Panel
from cnnum.lab.reproduce.record import Chapter, Item
from cnnum.tactile.cover import StandardLinearSolid, at_rest, creep_step
from cnnum.tactile.halfspace import line_load_stress

BAR, RECEPTOR = 3.0e-3, 0.75e-3
"""Width of a bar, and depth of a receptor, m; neither is given with Fig. 2.8."""

E_SKIN = 50e3
"""Young's modulus of skin, Pa: only the size of strain and energy depends on it."""

SOLID = StandardLinearSolid(instant_modulus=2.0, relaxed_modulus=1.0, creep_time=0.4)
HELD = 1.0
"""s of a touch; the constants of the skin are not given."""

X = np.linspace(-4e-3, 4e-3, 161)


PRESSURE = 1e3
"""Of the bar on average, Pa."""


def bar_stress(x: Floats) -> Floats:
    """Return (n, 3, 3) stresses below a rigid flat bar, Pa."""
    nodes = 0.5 * BAR * flat_lines()
    nodal = np.array([0.0, 0.0, PRESSURE * BAR / nodes.size])
    lines = line_load_stress(x[:, np.newaxis] - nodes, RECEPTOR, nodal)
    return np.asarray(lines.sum(axis=1), dtype=np.float64)


def below_a_bar(x: Floats) -> tuple[Floats, Floats]:
    """Return the vertical strain, compression positive, and the energy density below a bar.

    Plane strain of an incompressible skin.
    """
    stress = bar_stress(x)
    middle = 0.5 * (stress[:, 0, 0] + stress[:, 2, 2])
    half = stress[:, 2, 2] - middle
    strain = -1.5 * half / E_SKIN  # ε_zz of plane strain at ν = ½: 3(σ_zz − σ_xx)/4E
    energy = 1.5 * (half**2 + stress[:, 0, 2] ** 2) / E_SKIN
    return np.asarray(strain, dtype=np.float64), np.asarray(energy, dtype=np.float64)


def edges_over_middle(energy: bool) -> float:
    """Return the largest signal near the edges over that below the bar's middle."""
    signal = below_a_bar(X)[1 if energy else 0]
    return float(signal.max() / signal[X.size // 2])


def strip_gap() -> float:
    """Return how far the stress below the bar is from a punch's closed form, in mean pressures."""
    exact = flat_punch_stress(X / (0.5 * BAR), RECEPTOR / (0.5 * BAR))
    return float(np.abs(bar_stress(X)[:, 2, 2] / PRESSURE - exact).max())


def touch(step: float = 10e-3) -> tuple[Floats, Floats]:
    """Return times and strains over those of the touch at once, of a touch held for a second."""
    time = step * np.arange(1, round(2.5 / step) + 1)
    memory, strains = at_rest(()), list[float]()
    for t in time:
        memory = creep_step(SOLID, memory, 1.0 if t <= HELD else 0.0, step)
        strains.append(float(memory.strain))
    return np.asarray(time, dtype=np.float64), np.array(strains)


def after_image_gap() -> float:
    """Return how far the strain after a touch is from a sum of exponentials.

    The load rises in the first step and falls in the one after a second. Both ramps are in the
    closed form: the integral of the creep over their length.
    """
    step = 10e-3
    time, strains = touch(step)
    tau, gain = SOLID.creep_time, SOLID.instant_modulus / SOLID.relaxed_modulus - 1.0

    def delayed(t: Floats) -> Floats:
        """Return the late strain under a ramp of one step that began at 0."""

        def integral(s: Floats) -> Floats:
            return np.where(s > 0.0, s + tau * np.expm1(-np.maximum(s, 0.0) / tau), 0.0)

        return np.asarray(gain * (integral(t) - integral(t - step)) / step)

    elastic = np.where(time <= HELD, 1.0, 0.0)
    exact = elastic + delayed(time) - delayed(time - HELD)
    return float(np.abs(strains - exact).max())


def figure_2_8() -> Figure:
    """Return strain and energy density below a bar, and the after-image of a touch."""
    strain, energy = below_a_bar(X)
    time, strains = touch()
    mm = 1e3 * X
    return Figure(
        "fig-2.8",
        "Fig. 2.8; section 2.3.3",
        "A bar felt through the skin, and what stays of a touch",
        "Left: strain and strain energy density 0.75 mm below a rigid bar 3 mm wide. Both stand "
        "at its edges, as the impulses of a Merkel cell do; the energy does more. Right: the "
        "strain of a standard linear solid after a touch of a second. Its constants are chosen.",
        (
            Panel("Below a bar", "x (mm)", "share of the largest",
                  [Curve(mm, strain / strain.max(), "strain ε_zz"),
                   Curve(mm, energy / energy.max(), "energy density")],
                  marks=[(-0.5e3 * BAR, "edge"), (0.5e3 * BAR, "edge")]),
            Panel("After-image", "time (s)", "strain / that at once",
                  [Curve(time, strains, "strain")], marks=[(HELD, "let go")]),
        ),
    )  # fmt: skip


CHAPTER = Chapter(
    "Chapter 2 — the skin",
    (
        Item("fig-2.8-stress", "stress below a bar, line loads against the closed form of a punch",
             "Fig. 2.8; section 2.3.1", 0.0, strip_gap, 1e-9,
             "400 lines half a bar's width deep: they converge to rounding", "mean p",
             figure="fig-2.8",
             faults=(scaled(line_load_stress, 1.0001),
                     misled(line_load_stress, 1, "z", factor=1.001))),
        *(
            Item(name, title, "Fig. 2.8: the response stands at the edges of the bar", 1.0,
                 compute, 0.0, "no digits; width and depth are chosen", "", "at least",
                 kind="comparison", figure="fig-2.8")
            for name, title, compute in (
                ("fig-2.8-strain", "largest strain over that below the bar's middle",
                 lambda: edges_over_middle(False)),
                ("fig-2.8-energy", "largest energy density over that below the bar's middle",
                 lambda: edges_over_middle(True)),
            )
        ),
        Item("section-2.3.3", "strain during and after a touch, against a sum of exponentials",
             "section 2.3.3: the after-image of viscoelasticity", 0.0, after_image_gap, 1e-12,
             "exact from sample to sample: rounding", "of the strain at once", figure="fig-2.8",
             faults=(misled(creep_step, 3, "Δt", factor=1.01),
                     changed(creep_step, "nothing stays", lambda m: type(m)(m.elastic,
                                                                          0.0 * m.delayed)))),
    ),
    {"fig-2.8": figure_2_8},
)  # fmt: skip
