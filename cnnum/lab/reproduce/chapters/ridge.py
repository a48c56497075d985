"""Section 6.3: a screw drawn over a fingerprint's ridge (Fig. 6.7)."""

from functools import cache, partial
from importlib import import_module
from typing import Any

import numpy as np

from cnnum.arrays import Floats
from cnnum.lab.reproduce.chapters.hair import FRICTION
from cnnum.lab.reproduce.figure import Curve, Figure, Panel
from cnnum.lab.reproduce.record import Chapter, Item
from cnnum.lab.reproduce.setup import BETA, MM, E, Z
from cnnum.tactile.cover.fem.library import load_skfem
from cnnum.tactile.cover.hair import RidgeCover
from cnnum.tactile.cover.protocol import Cover, FlatCover

FORCE = 10e-3
"""N, of each turn of the screw."""

THREAD = 0.7e-3
"""Pitch of the screw, m: M4; the screw of Fig. 6.7 is not named."""

STATICS = (
    "beam statics on a half-space: friction at the ridge's height is a moment on its foot, whose "
    "shear right below is turned against the friction; a real ridge sits on a rigid chip"
)

MESHED = (
    "finite elements, plane strain, ν = 0.49: a ridge of 0.5 × 0.265 mm on 0.2 mm of rubber bonded "
    "to a rigid chip, strain 50 µm above the chip, averaged over the plate of 0.1 mm"
)

WIDTH, HEIGHT, LAYER, ABOVE, PLATE = 0.5, 0.265, 0.2, 0.05, 0.1
"""Of the ridge, the layer, the place of sensing above the chip, and the plate, mm."""


def screw_signals(cover: Cover, angle: float, shift: Floats) -> Floats:
    """Return (n, 2) shear along the motion × β and normal signal under a screw, strain.

    The turns are point loads a pitch apart along the motion, each with its share of friction. Over
    a ridge only those count that stand on it.
    """
    turns = THREAD * np.arange(-3, 4)
    along = np.array([np.cos(angle), np.sin(angle)])
    place = (shift[:, np.newaxis] + turns)[..., np.newaxis] * along
    force = FORCE * np.array([*(FRICTION * along), 1.0])
    strain = cover.strain(place, [0.0, 0.0], force)
    if isinstance(cover, RidgeCover):
        strain = strain * (np.abs(place[..., :1]) <= cover.width / 2)
    total = -strain.sum(axis=1)
    return np.stack([(total[:, :2] @ along) / BETA, total[:, 2]], axis=-1)


def flat_cover() -> FlatCover:
    """Return the flat cover of 200 µm."""
    return FlatCover(Z, E)


def ridge() -> RidgeCover:
    """Return the ridge of the dissertation, along y."""
    return RidgeCover(Z, E)


@cache
def screw(case: str) -> Floats:
    """Return the signals over three pitches: "flat", "along" or "across" the ridge."""
    shift = np.linspace(-1.5 * THREAD, 1.5 * THREAD, 241)
    if case == "flat":
        return screw_signals(flat_cover(), 0.0, shift)
    return screw_signals(ridge(), np.pi / 2 if case == "along" else 0.0, shift)


def wrong_way(case: str) -> float:
    """Return the largest shear against the friction over the largest along it."""
    shear = screw(case)[:, 0]
    return float(max(-shear.min(), 0.0) / shear.max())


def likeness() -> float:
    """Return the correlation of the shear along a ridge with that of a flat cover."""
    swings = [screw(case)[:, 0] - screw(case)[:, 0].mean() for case in ("flat", "along")]
    return float(np.corrcoef(*swings)[0, 1])


def directness(case: str) -> float:
    """Return the correlation of S_n with the load that stands on the place of the ridge."""
    shift = np.linspace(-1.5 * THREAD, 1.5 * THREAD, 241)
    turns = shift[:, np.newaxis] + THREAD * np.arange(-3, 4)
    load = np.count_nonzero(np.abs(turns) <= ridge().width / 2, axis=1)
    return float(np.corrcoef(screw(case)[:, 1], load)[0, 1])


def shear_gain() -> float:
    """Return how far the shear swings across a ridge, over its swing on a flat cover."""
    return float(np.ptp(screw("across")[:, 0]) / np.ptp(screw("flat")[:, 0]))


@cache
def influence(ridged: bool) -> tuple[Floats, Floats]:
    """Return places on the top, mm, and what a unit line load there makes at the taxel.

    By reciprocity: loads that stand for the two strains at the taxel move the top by their
    influence lines, so two solutions give the response to a load anywhere.

    Returns
    -------
    x : (n,) float, mm
    response : (2, n, 2) float
        [along x or down, place, ε_xz or ε_zz], over the Young's modulus.
    """
    skfem, poisson = load_skfem(), 0.49
    inner = np.linspace(0.0, 0.5 * WIDTH, 11)
    outer = 0.5 * WIDTH + (3.5 - 0.5 * WIDTH) * np.linspace(0.0, 1.0, 41)[1:] ** 1.5
    half = np.concatenate([inner, outer])
    x = np.concatenate([-half[:0:-1], half])
    z = np.concatenate([np.linspace(-HEIGHT, 0.0, 11)[:-1], np.linspace(0.0, LAYER, 9)])
    mesh = skfem.MeshQuad.init_tensor(x, z)
    middle = mesh.p[:, mesh.t].mean(axis=1)
    stands = np.abs(middle[0]) < (0.5 * WIDTH if ridged else 0.0)
    mesh = mesh.restrict(np.flatnonzero((middle[1] > 0.0) | stands))
    element = skfem.ElementVector(skfem.ElementQuad2())
    basis = skfem.Basis(mesh, element, intorder=5)
    middle = mesh.p[:, mesh.t].mean(axis=1)
    near = np.abs(middle[1] - (LAYER - ABOVE)) < 0.026  # the two rows of cells around it
    below = np.flatnonzero((np.abs(middle[0]) < 0.5 * PLATE) & near)
    plate = skfem.Basis(mesh, element, intorder=5, elements=below)
    gradient: Any = import_module("skfem.helpers").sym_grad
    elasticity: Any = import_module("skfem.models.elasticity")
    area = skfem.Functional(_one).assemble(plate)

    def strain(component: int) -> Any:
        def form(v: Any, _: Any) -> Any:
            return gradient(v)[component, 1] / area

        return skfem.LinearForm(form).assemble(plate)

    lame, shear = poisson / ((1 + poisson) * (1 - 2 * poisson)), 0.5 / (1 + poisson)
    stiffness = elasticity.linear_elasticity(Lambda=lame, Mu=shear).assemble(basis)
    chip = basis.get_dofs(_on_chip).all()
    moved = [skfem.solve(*skfem.condense(stiffness, strain(k), D=chip)) for k in (0, 1)]
    on_top = np.abs(mesh.p[1] + (HEIGHT if ridged else 0.0)) < 1e-9
    top = np.flatnonzero(on_top)[np.argsort(mesh.p[0, on_top])]
    response = np.stack([displacement[basis.nodal_dofs[:, top]] for displacement in moved], axis=-1)
    return np.asarray(mesh.p[0, top]), response


def _one(w: Any) -> Any:
    return 1.0 + 0.0 * w.x[0]


def _on_chip(place: Floats) -> Any:
    return np.abs(place[1] - LAYER) < 1e-9


def meshed_screw(ridged: bool) -> Floats:
    """Return (2, n): shear along the motion over β, and the normal signal, under a screw."""
    x, response = influence(ridged)
    shift = MM * np.linspace(-1.5 * THREAD, 1.5 * THREAD, 241)
    turns = shift[:, np.newaxis] + MM * THREAD * np.arange(-3, 4)
    reach = 0.5 * WIDTH if ridged else np.inf
    counts: Floats = np.where(np.abs(turns) <= reach, 1.0, 0.0)
    lines = FRICTION * response[0] + response[1]
    shear, normal = (np.asarray(np.interp(turns, x, lines[:, k]), np.float64) for k in (0, 1))
    forces = counts * np.stack([shear, normal])
    return np.asarray(-forces.sum(axis=-1) / np.array([[BETA], [1.0]]), dtype=np.float64)


def meshed_gain(over_normal: bool) -> float:
    """Return the shear's swing across a ridge over a flat cover's; or both over the normal's."""
    swings = [np.ptp(meshed_screw(ridged), axis=1) for ridged in (True, False)]
    shear, normal = swings[0] / swings[1]
    return float(shear / normal) if over_normal else float(shear)


def figure_6_7() -> Figure:
    """Return the signals of a screw over three covers."""
    shift = MM * np.linspace(-1.5 * THREAD, 1.5 * THREAD, 241)
    titles = {"flat": "Flat cover", "along": "Along the ridge", "across": "Across the ridge"}
    panels = [
        Panel(title, "way of the screw (mm)", "strain signal (%)",
              [Curve(shift, 100 * screw(case)[:, 1], "normal S_n", colour=0),
               Curve(shift, 100 * screw(case)[:, 0], "shear T", colour=1)])
        for case, title in titles.items()
    ]  # fmt: skip
    return Figure(
        "fig-6.7",
        "Fig. 6.7",
        "A screw drawn over a ridge",
        "Turns 0.7 mm apart, 10 mN each, friction 0.5; the ridge is 0.5 mm wide and 0.265 mm "
        "high. Across the ridge only the turn that stands on it counts, and the signals switch "
        "on and off. The model is beam statics on a half-space: it selects directions as the "
        "measured ridge does, but not with the measured size and sign of the shear. A mesh of the "
        "ridge on its chip (rows below) has the right size: the shear is that of a flat cover, and "
        "four times as large a share of the signal.",
        panels,
    )


CHAPTER = Chapter(
    "Section 6.3 — a ridge like a fingerprint's",
    (
        Item("fig-6.7-flat", "shear against the friction over that along it, flat cover",
             "Fig. 6.7: point-load shape, both signs", 0.25, partial(wrong_way, "flat"), 0.0,
             "no digits: both signs are there", "", "at least", kind="comparison",
             figure="fig-6.7"),
        Item("fig-6.7-across", "correlation of S_n across a ridge with the load on it",
             "Fig. 6.7: “a more direct function of the surface load”", 0.9,
             partial(directness, "across"), 0.0,
             "no digits; the model lets only those turns count that stand on the ridge", "",
             "at least", kind="comparison", figure="fig-6.7"),
        Item("fig-6.7-along", "correlation of the shear along a ridge with a flat cover's",
             "Fig. 6.7: “acts the same way as a flat cover”", 1.0, likeness, 0.0, STATICS,
             kind="comparison", figure="fig-6.7"),
        Item("fig-6.7-gain", "shear's swing across a ridge over a flat cover's",
             "Fig. 6.7: “highly increased”", 1.0, shear_gain, 0.0, STATICS, "", "at least",
             kind="comparison", figure="fig-6.7"),
        Item("fig-6.7-mesh", "the same by a mesh of ridge and layer on a chip",
             "Fig. 6.7: “highly increased”", 1.0, partial(meshed_gain, False), 0.0,
             f"{MESHED}. The shear is as large as on a flat cover: the load is the same",
             "", "at least", kind="comparison", figure="fig-6.7"),
        Item("fig-6.7-mesh-share", "the same, of the shear over the normal signal's swing",
             "Fig. 6.7: “highly increased”; friction from the ratio of both", 1.0,
             partial(meshed_gain, True), 0.0,
             f"{MESHED}. What increases is the shear's share of the signal", "", "at least",
             kind="comparison", figure="fig-6.7"),
    ),
    {
        "fig-6.7": figure_6_7,
    },
)  # fmt: skip
