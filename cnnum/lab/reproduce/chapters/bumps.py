"""Section 6.4: the elastic hemisphere by finite elements (Fig. 6.9–6.12, 6.14)."""

from collections.abc import Callable
from functools import cache

import numpy as np

from cnnum.arrays import Floats
from cnnum.lab.reproduce.figure import Curve, Field, Figure, Panel
from cnnum.lab.reproduce.record import Chapter, Item
from cnnum.lab.reproduce.setup import MM, UM, Z
from cnnum.tactile.cover.plane import PlaneFigures, plane_figures

DOWN, ASIDE = 0, 1
"""First axis of the shipped figures: pressed down, dragged sideways."""

U_X, U_Z = 0, 1
RADIUS_MM = 0.2


@cache
def model() -> PlaneFigures:
    """Return the shipped results of the plane model."""
    return plane_figures()


def middle() -> int:
    """Return the number of x = 0."""
    return model().x.size // 2


def asymmetry() -> float:
    """Return how far the dragged σ_zz at 200 µm is from being odd in x, share of its peak."""
    stress = model().stress[ASIDE, 1]
    return float(np.abs(stress + stress[::-1]).max() / np.abs(stress).max())


def rises(load: int, component: int) -> float:
    """Return how many steps along the depth the displacement grows instead of falling."""
    return float(np.count_nonzero(np.diff(np.abs(model().axis[load, component])) >= 0.0))


def edge() -> float:
    """Return how far from the middle the extrema of the dragged σ_zz stand, mm."""
    low, high = model().stress_extrema
    return MM * 0.5 * abs(low - high)


def independence() -> float:
    """Return the sum of the pad's signals under a drag over that under a press, of u_z."""
    x, line = model().x, model().line[:, U_Z]
    place = int(line[ASIDE].argmax())
    pair = [place, x.size - 1 - place]
    return float(abs(line[ASIDE][pair].sum() / line[DOWN][pair].sum()))


def figure_6_9() -> Figure:
    """Return displacement maps of both loads."""
    found = model()
    titles = {
        (DOWN, U_Z): "pressed: u_z",
        (DOWN, U_X): "pressed: u_x",
        (ASIDE, U_Z): "dragged: u_z",
        (ASIDE, U_X): "dragged: u_x",
    }
    panels = [
        Panel(title, "x (mm)", "depth (mm)",
              [Field(MM * found.x, MM * found.z, UM * found.field[key], "µm", levels=11)],
              depth=True)
        for key, title in titles.items()
    ]  # fmt: skip
    return Figure(
        "fig-6.9",
        "Fig. 6.8, 6.9",
        "Displacement below a bump",
        "Plane stress, bump of Ø 0.4 mm on 4 × 2 mm, ν = 0.499, under a rigid plate that sticks: "
        "50 µm down, and 50 µm sideways. Shown is the block below the bump. On x = 0 neither "
        "load moves the rubber the other's way.",
        panels,
    )


def figure_6_10() -> Figure:
    """Return displacement along the axis."""
    found = model()
    curves = ((DOWN, U_Z, "pressed: u_z"), (ASIDE, U_X, "dragged: u_x"))
    panels = [
        Panel(title, "depth (mm)", "displacement (µm)",
              [Curve(MM * found.z, UM * found.axis[load, part], colour=load)],
              marks=[(MM * Z, "taxel")])
        for load, part, title in curves
    ]  # fmt: skip
    return Figure(
        "fig-6.10",
        "Fig. 6.10",
        "Displacement on the axis",
        "Below the surface, x = 0, 50 µm of indentation. The deeper, the less: hence the thinnest "
        "layer that can be handled, 200 µm.",
        panels,
    )


def figure_6_11() -> Figure:
    """Return displacement at the taxel against indentation."""
    found = model()
    depth = UM * found.indentation
    # the dragged part sticks as it did at 50 µm: that part is linear by construction
    aside = found.line[ASIDE, U_X, middle()] / 50e-6 * found.indentation
    return Figure(
        "fig-6.11",
        "Fig. 6.11",
        "Response at the taxel",
        "At x = 0, z = 200 µm. FiUj is displacement j under load i. The contact grows as the "
        "plate presses, so FzUz bends a little. The ratio is 1.5 here and “about two” in the "
        "dissertation, whose mesh of the bump's top is not published.",
        (
            Panel("Displacement", "indentation (µm)", "displacement (µm)",
                  [Curve(depth, UM * found.growth[:, 1], "FzUz", colour=0),
                   Curve(depth, UM * aside, "FxUx", colour=1),
                   Curve(depth, UM * found.growth[:, 0], "FzUx", "dotted", 2),
                   Curve(depth, np.zeros_like(depth), "FxUz", "dashed", 3)]),
        ),
    )  # fmt: skip


def figure_6_12() -> Figure:
    """Return the stress at 200 µm below a dragged bump."""
    found = model()
    x = MM * found.x
    near = np.abs(x) <= 0.8
    return Figure(
        "fig-6.12",
        "Fig. 6.12",
        "Stress 200 µm below a bump",
        "A sideways load presses one edge of the bump down and lifts the other; a push is even. "
        "Two pressure taxels below the edges measure both.",
        (
            Panel("Dragged by 50 µm", "x (mm)", "σ_zz (kPa)",
                  [Curve(x[near], found.stress[ASIDE, 1][near] / 1e3)],
                  marks=[(-RADIUS_MM, "edge"), (RADIUS_MM, "edge")]),
            Panel("Pressed by 50 µm", "x (mm)", "σ_zz (kPa)",
                  [Curve(x[near], found.stress[DOWN, 1][near] / 1e3)],
                  marks=[(-RADIUS_MM, "edge"), (RADIUS_MM, "edge")]),
        ),
    )  # fmt: skip


def pad_curves() -> tuple[Floats, dict[str, Floats]]:
    """Return indentation, µm, and the components of (6.1) made of u_z, µm."""
    found = model()
    place = int(found.line[ASIDE, U_Z].argmax())
    dragged = found.line[ASIDE, U_Z, place] / 50e-6 * found.indentation
    pressed = found.growth[:, 3]
    shares = {
        "FzTz": found.growth[:, 2] + pressed,
        "FxTx": 2.0 * dragged,
        "FzTx": pressed - found.growth[:, 2],
        "FxTz": np.zeros_like(pressed),
    }
    return UM * found.indentation, {name: UM * values for name, values in shares.items()}


def figure_6_14() -> Figure:
    """Return the components of a pad's three-axial taxel against indentation."""
    depth, curves = pad_curves()
    styles = ("line", "line", "dotted", "dashed")
    return Figure(
        "fig-6.14",
        "Fig. 6.14",
        "A three-axial taxel made of pressure taxels",
        "Sum and difference of u_z at the two extrema of Fig. 6.12's drag, as in (6.1).",
        (
            Panel("Components", "indentation (µm)", "T (µm)",
                  [Curve(depth, v, n, style, k)  # type: ignore[arg-type]
                   for k, ((n, v), style) in enumerate(zip(curves.items(), styles, strict=True))]),
        ),
    )  # fmt: skip


FIGURES: dict[str, Callable[[], Figure]] = {
    "fig-6.9": figure_6_9,
    "fig-6.10": figure_6_10,
    "fig-6.11": figure_6_11,
    "fig-6.12": figure_6_12,
    "fig-6.14": figure_6_14,
}
SINGLE = "symmetry: zero but for the single precision of the shipped data"

CHAPTER = Chapter(
    "Section 6.4 — the elastic hemisphere",
    (
        Item("fig-6.9", "displacement the other's way on x = 0, share of the own",
             "Fig. 6.9: FxUz = FzUx = 0", 0.0, lambda: model().cross_talk, 1e-6, SINGLE,
             figure="fig-6.9"),
        Item("fig-6.10-normal", "steps of depth at which u_z below a pressed bump grows",
             "Fig. 6.10 (left): falls with depth", 0.0, lambda: rises(DOWN, U_Z), 0.0,
             "no digits: the shape, 50 steps of 20 µm", figure="fig-6.10"),
        Item("fig-6.10-shear", "steps of depth at which u_x below a dragged bump grows",
             "Fig. 6.10 (right): falls with depth", 0.0, lambda: rises(ASIDE, U_X), 0.0,
             "no digits: the shape, 50 steps of 20 µm", figure="fig-6.10"),
        Item("fig-6.11-linear", "bend of FzUz up to 100 µm, share of its range",
             "Fig. 6.11: “close to linear”", 0.0, lambda: model().nonlinearity, 0.05,
             "no digits: 5 % of the range is hardly seen in a figure", figure="fig-6.11"),
        Item("fig-6.11-steeper", "FzUz over FxUx at 200 µm: normal is steeper", "Fig. 6.11",
             1.0, lambda: model().normal_to_shear, 0.0,
             "no digits: the steeper of two lines", "", "at least", figure="fig-6.11"),
        Item("fig-6.11-ratio", "FzUz over FxUx at 200 µm", "Fig. 6.11: “about two”", 2.0,
             lambda: model().normal_to_shear, 0.0,
             "depends on how much of the top sticks, and that mesh is not published",
             kind="comparison", figure="fig-6.11"),
        Item("fig-6.12-odd", "even part of σ_zz below a dragged bump, share of its peak",
             "Fig. 6.12: “anti-symmetric”", 0.0, asymmetry, 1e-6, SINGLE, figure="fig-6.12"),
        Item("fig-6.12-edges", "where σ_zz below a dragged bump has its extrema",
             "Fig. 6.12: below the edges of the bump", RADIUS_MM, edge, 0.02,
             "one step of the shipped line; the figure has no digits", "mm", figure="fig-6.12"),
        Item("fig-6.14-ratio", "FzTz over FxTx of a pad's taxel", "Fig. 6.14: “around 4”", 4.0,
             lambda: model().pad_ratio, 0.5, "one digit is published", figure="fig-6.14"),
        Item("fig-6.14-independent", "T_z under a drag over T_z under a press",
             "Fig. 6.14: “independent”", 0.0, independence, 1e-6, SINGLE, figure="fig-6.14"),
    ),
    FIGURES,
)  # fmt: skip
