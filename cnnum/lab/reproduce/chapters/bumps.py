"""Section 6.4: the elastic hemisphere by finite elements (Fig. 6.9–6.12, 6.14, 6.16).

Checks compute the coarse model anew; the pictures show the finer data that ships with the package.
"""

from collections.abc import Callable
from functools import cache, partial
from importlib import import_module
from typing import Any

import numpy as np

from cnnum.arrays import Floats
from cnnum.lab.reproduce.chapters.hair import FRICTION
from cnnum.lab.reproduce.faults import changed, scaled
from cnnum.lab.reproduce.figure import Curve, Dots, Field, Figure, Panel
from cnnum.lab.reproduce.record import Chapter, Item
from cnnum.lab.reproduce.setup import MM, UM, E, Z
from cnnum.tactile.bump_loads import shear_over_normal
from cnnum.tactile.cover.bump import BumpCover, PlaneFigures, plane_figures
from cnnum.tactile.cover.fem.body import Body
from cnnum.tactile.cover.fem.generate import plane_tables
from cnnum.tactile.cover.fem.geometry import Hooke
from cnnum.tactile.cover.fem.library import load_skfem
from cnnum.tactile.cover.fem.plate import POISSON, PlaneBump, make_plane_bump, move

DOWN, ASIDE = 0, 1
"""First axis of the figures: pressed down, dragged sideways."""

U_X, U_Z = 0, 1
RADIUS_MM = 0.2
COARSE = 4
"""Cells along an eighth of the bump's circle; the shipped data has 16."""


@cache
def model() -> PlaneFigures:
    """Return the shipped results of the plane model."""
    return plane_figures()


@cache
def bump() -> PlaneBump:
    """Return the coarse model, computed now."""
    return make_plane_bump(COARSE)


@cache
def computed() -> PlaneFigures:
    """Return the results of the coarse model."""
    return PlaneFigures.of_tables(plane_tables(bump()))


def middle() -> int:
    """Return the number of x = 0."""
    return model().x.size // 2


def shipped_gap(name: str) -> float:
    """Return how far shipped values below a pressed bump are from those of the coarse model.

    Of equal forces, as a share of the largest: the contact grows by whole nodes, so that equal
    indentations of two meshes differ by 1.5 % in their force.
    """
    ours, theirs = (
        getattr(figures, name)[DOWN] / figures.force[DOWN] for figures in (model(), computed())
    )
    return float(np.abs(ours - theirs).max() / np.abs(ours).max())


def library_gap() -> float:
    """Return how far the displacements are from scikit-fem's own elasticity on the same mesh.

    Its vector element, its form and its condensation take the place of the package's assembly and
    compliance. Both hold the block below and the bump's top where the plate has it.
    """
    skfem = load_skfem()
    elasticity: Any = import_module("skfem.models.elasticity")
    body, count = bump().body, len(bump().body.nodes)
    scalar = body.space.displacement
    basis = skfem.Basis(scalar.mesh, skfem.ElementVector(scalar.elem), intorder=6)
    number = np.empty((2, count), dtype=np.intp)  # of a field at a node, in the library's vector
    for ours, theirs in (
        (scalar.nodal_dofs, basis.nodal_dofs),
        (scalar.facet_dofs, basis.facet_dofs),
        (scalar.interior_dofs, basis.interior_dofs),
    ):
        number[:, ours[0]] = theirs
    mu, lame = 0.5 / (1.0 + POISSON), POISSON / (1.0 - POISSON**2)  # of plane stress, E = 1
    stiffness = elasticity.linear_elasticity(Lambda=lame, Mu=mu).assemble(basis)
    below = np.flatnonzero(body.nodes[:, 1] > body.nodes[:, 1].max() - 1e-9)
    held = number[:, np.concatenate([below, bump().working.nodes])].reshape(-1)
    gaps: list[float] = []
    for ours in bump().solutions():
        fields = np.stack([body.field(k, ours) for k in (U_X, U_Z)])
        start = np.zeros(basis.N)
        start[held] = fields[:, np.concatenate([below, bump().working.nodes])].reshape(-1)
        theirs = skfem.solve(*skfem.condense(stiffness, x=start, D=held))[number]
        gaps.append(float(np.abs(fields - theirs).max() / np.abs(theirs).max()))
    return max(gaps)


def rises(load: int, component: int) -> float:
    """Return how many steps along the depth the displacement grows instead of falling."""
    return float(np.count_nonzero(np.diff(np.abs(computed().axis[load, component])) >= 0.0))


def edge() -> float:
    """Return where the dragged σ_zz is lowest, towards the drag, mm."""
    return MM * computed().stress_extrema[0]


def figure_6_9() -> Figure:
    """Return displacement maps of both loads."""
    fields = model()
    titles = {
        (DOWN, U_Z): "pressed: u_z",
        (DOWN, U_X): "pressed: u_x",
        (ASIDE, U_Z): "dragged: u_z",
        (ASIDE, U_X): "dragged: u_x",
    }
    panels = [
        Panel(title, "x (mm)", "depth (mm)",
              [Field(MM * fields.x, MM * fields.z, UM * fields.field[key], "µm", levels=11)],
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
    fields = model()
    curves = ((DOWN, U_Z, "pressed: u_z"), (ASIDE, U_X, "dragged: u_x"))
    panels = [
        Panel(title, "depth (mm)", "displacement (µm)",
              [Curve(MM * fields.z, UM * fields.axis[load, part], colour=load)],
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
    result = model()
    depth = UM * result.indentation
    # the dragged part sticks as it did at 50 µm: that part is linear by construction
    aside = result.line[ASIDE, U_X, middle()] / 50e-6 * result.indentation
    return Figure(
        "fig-6.11",
        "Fig. 6.11",
        "Response at the taxel",
        "At x = 0, z = 200 µm. FiUj is displacement j under load i. The contact grows as the "
        "plate presses, so FzUz bends a little. The ratio is 1.5 here and “about two” in the "
        "dissertation, whose mesh of the bump's top is not published.",
        (
            Panel("Displacement", "indentation (µm)", "displacement (µm)",
                  [Curve(depth, UM * result.growth[:, 1], "FzUz", colour=0),
                   Curve(depth, UM * aside, "FxUx", colour=1),
                   Curve(depth, UM * result.growth[:, 0], "FzUx", "dotted", 2),
                   Curve(depth, np.zeros_like(depth), "FxUz", "dashed", 3)]),
        ),
    )  # fmt: skip


def figure_6_12() -> Figure:
    """Return the stress at 200 µm below a dragged bump."""
    result = model()
    x = MM * result.x
    near = np.abs(x) <= 0.8
    return Figure(
        "fig-6.12",
        "Fig. 6.12",
        "Stress 200 µm below a bump",
        "A sideways load presses one edge of the bump down and lifts the other; a push is even. "
        "Two pressure taxels below the edges measure both.",
        (
            Panel("Dragged by 50 µm", "x (mm)", "σ_zz (kPa)",
                  [Curve(x[near], result.stress[ASIDE, 1][near] / 1e3)],
                  marks=[(-RADIUS_MM, "edge"), (RADIUS_MM, "edge")]),
            Panel("Pressed by 50 µm", "x (mm)", "σ_zz (kPa)",
                  [Curve(x[near], result.stress[DOWN, 1][near] / 1e3)],
                  marks=[(-RADIUS_MM, "edge"), (RADIUS_MM, "edge")]),
        ),
    )  # fmt: skip


def pad_curves() -> tuple[Floats, dict[str, Floats]]:
    """Return indentation, µm, and the components of (6.1) made of u_z, µm."""
    result = model()
    place = int(result.line[ASIDE, U_Z].argmax())
    dragged = result.line[ASIDE, U_Z, place] / 50e-6 * result.indentation
    pressed = result.growth[:, 3]
    shares = {
        "FzTz": result.growth[:, 2] + pressed,
        "FxTx": 2.0 * dragged,
        "FzTx": pressed - result.growth[:, 2],
        "FxTz": np.zeros_like(pressed),
    }
    return UM * result.indentation, {name: UM * values for name, values in shares.items()}


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
QUARTER = "meshes of a quarter and of three eighths of the cells are 0.23 % off, at equal forces"


def _all_times(factor: float, parts: dict[str, Floats]) -> dict[str, Floats]:
    return {name: factor * values for name, values in parts.items()}


HOOKE = scaled(Hooke.matrix, 1.01, entry=(2, 2))

CHAPTER = Chapter(
    "Section 6.4 — the elastic hemisphere",
    (
        Item("fig-6.9", "displacement, pressed and dragged, against scikit-fem's own elasticity",
             "Fig. 6.9, the section of Fig. 6.8", 0.0, library_gap, 1e-8,
             "the same elements: rounding of two solvers, stiffness over ten decades",
             "of the largest", figure="fig-6.9", faults=(HOOKE, scaled(Hooke.matrix, 1.01,
                                                                     entry=(0, 1)))),
        Item("fig-6.9-shipped", "the shipped displacements against a coarse mesh, computed now",
             "Fig. 6.9, 6.10, pressed", 0.0, partial(shipped_gap, "field"), 0.004, QUARTER,
             "of the largest", figure="fig-6.9",
             faults=(scaled(Hooke.matrix, 1.01),)),
        Item("fig-6.12-shipped", "the shipped stresses against a coarse mesh, computed now",
             "Fig. 6.12, pressed", 0.0, partial(shipped_gap, "stress"), 0.004, QUARTER,
             "of the largest", figure="fig-6.12",
             faults=(changed(Body.stresses, "× 1.01", partial(_all_times, 1.01), share=0.01),)),
        Item("fig-6.14-shipped", "FzTz over FxTx, shipped, over that of a coarse mesh", "Fig. 6.14",
             1.0, lambda: model().pad_ratio / computed().pad_ratio, 0.004, QUARTER,
             figure="fig-6.14", faults=(scaled(move, 0.99, part="solution"),)),
        Item("fig-6.10-normal", "steps of depth at which u_z below a pressed bump grows",
             "Fig. 6.10 (left): falls with depth", 0.0, lambda: rises(DOWN, U_Z), 0.0,
             "no digits: the shape, 50 steps of 20 µm", kind="comparison", figure="fig-6.10"),
        Item("fig-6.10-shear", "steps of depth at which u_x below a dragged bump grows",
             "Fig. 6.10 (right): falls with depth", 0.0, lambda: rises(ASIDE, U_X), 0.0,
             "no digits: the shape, 50 steps of 20 µm", kind="comparison", figure="fig-6.10"),
        Item("fig-6.11-linear", "bend of FzUz up to 100 µm, share of its range",
             "Fig. 6.11: “close to linear”", 0.0, lambda: computed().nonlinearity, 0.0,
             "no digits; the contact grows with the load", kind="comparison", figure="fig-6.11"),
        Item("fig-6.11-ratio", "FzUz over FxUx at 200 µm", "Fig. 6.11: “about two”", 2.0,
             lambda: computed().normal_to_shear, 0.0,
             "depends on how much of the top sticks, and that mesh is not published",
             kind="comparison", figure="fig-6.11"),
        Item("fig-6.12-edges", "where σ_zz is lowest below a bump that is dragged towards +x",
             "Fig. 6.12: below the edges of the bump", RADIUS_MM, edge, 0.0,
             "no digits: read to a tenth of the bump's width at best", "mm", kind="comparison",
             figure="fig-6.12"),
        Item("fig-6.14-ratio", "FzTz over FxTx of a pad's taxel", "Fig. 6.14: “around 4”", 4.0,
             lambda: computed().pad_ratio, 0.0, "one digit is published: ± 0.5", kind="comparison",
             figure="fig-6.14"),
        *(
            Item(name, title, source, expected, compute, 0.0, reason, kind="comparison",
                 figure=figure)
            for name, title, source, expected, compute, reason, figure in (
                ("section-6.4.2-strain", "ε_zz pressed over ε_xz dragged, equal indentations",
                 "section 6.4.2: strain is “similar” to deformation, “about two”", 2.0,
                 lambda: computed().strain[DOWN, 1, middle()]
                 / computed().strain[ASIDE, 0, middle()],
                 "not similar: ε_xz right below a bump is mostly the bump's tilt, and has the "
                 "opposite sign of u_x", "fig-6.11"),
                ("section-6.4.2-force", "strain of a shear force over that of an equal normal one",
                 "section 6.4.2: half, of equal displacements", 0.5,
                 lambda: shear_over_normal("strain", Z * MM / RADIUS_MM),
                 "forces are not displacements; of the body of revolution, and of its patch",
                 "fig-6.11"),
                ("section-6.4.3-stress", "FzTz over FxTx of a pad that feels σ_zz",
                 "Fig. 6.14: “around 4”, of deformation", 4.0,
                 lambda: computed().pad_stress_ratio,
                 "pressure taxels feel stress, not displacement", "fig-6.14"),
            )
        ),
    ),
    FIGURES,
)  # fmt: skip


PITCH = 1.5e-3
"""Pitch of the taxels, m."""

FINGER = 4e-3
"""Radius of the contact of a finger, m."""


def finger(turn: Floats) -> Floats:
    """Return (n, 3) traction of a finger going round, at the taxel, Pa.

    A Hertz pressure of 2 N whose middle goes round at 1 mm; its shear is half of it.
    """
    away = 1e-3 * np.stack([np.cos(turn), np.sin(turn)], axis=-1)
    peak = 1.5 * 2.0 / (np.pi * FINGER**2)
    wobble = 1.0 + 0.15 * np.sin(5.0 * turn)
    pressure = peak * wobble * np.sqrt(1.0 - np.sum(away**2, axis=-1) / FINGER**2)
    way = np.stack([-np.sin(turn), np.cos(turn)], axis=-1)
    return np.concatenate([FRICTION * pressure[:, None] * way, pressure[:, None]], axis=-1)


def lateral(bump: bool) -> tuple[Floats, Floats]:
    """Return ε_xz and ε_yz (sign turned) under a finger, with or without a bump."""
    traction = finger(np.linspace(0.0, 6.0 * np.pi, 400))
    if not bump:
        # the finger is twenty times as wide as the cover is thick: σ_iz = −q_i
        return 1.5 * traction[:, 0] / E, 1.5 * traction[:, 1] / E
    cover = BumpCover(Z, E)
    strain = -cover.strain([0.0, 0.0], [0.0, 0.0], PITCH**2 * traction)
    return strain[:, 0], strain[:, 1]


def bump_gain() -> float:
    """Return how much larger the lateral strain is under a bump."""
    sizes = [np.hypot(*lateral(bump)).mean() for bump in (True, False)]
    return float(sizes[0] / sizes[1])


def figure_6_16() -> Figure:
    """Return the lateral strains of a circling finger with and without a bump."""
    dots = [
        Dots(100 * x, 100 * y, np.full(x.size, 4.0), colour, name)
        for (x, y), colour, name in ((lateral(True), 1, "bump"), (lateral(False), 0, "flat"))
    ]
    return Figure(
        "fig-6.16",
        "Fig. 6.16",
        "A finger going round, with and without a bump",
        "Finite-element bump of Ø 0.4 mm on 200 µm, which takes the load of a taxel's square of "
        "1.5 mm; the finger presses with 2 N over a radius of 4 mm and rubs at half of that. "
        "Right below a bump the moment of the rub turns the strain's sign. So the loop is on "
        "the other side.",
        (Panel("Tangential strains", "ε_xz (%)", "ε_yz (%)", dots, equal=True),),
    )


FINGER_CHAPTER = Chapter(
    "Section 6.4.4 — a finger on a bump",
    (
        Item("fig-6.16", "lateral strain under a bump over that without one",
             "Fig. 6.16: “increased lateral sensitivity”", 1.0, bump_gain, 0.0,
             "no digits; two models, one of a bump that bears all of its square's load", "",
             "at least", kind="comparison", figure="fig-6.16"),
    ),
    {
        "fig-6.16": figure_6_16,
    },
)  # fmt: skip
