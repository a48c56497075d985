"""Fig. 4.10: the bent response under a thick cover, by a mesh that follows the needle."""

from functools import cache, partial

import numpy as np

from cnnum.arrays import Floats
from cnnum.lab.reproduce.faults import changed, scaled
from cnnum.lab.reproduce.figure import Curve, Figure, Panel
from cnnum.lab.reproduce.record import Chapter, Item
from cnnum.tactile.contact import punch_pressure
from cnnum.tactile.cover import LayerCover
from cnnum.tactile.cover.fem.body import Body, make_body
from cnnum.tactile.cover.fem.geometry import PUSHED, Hooke, QuadMesh
from cnnum.tactile.cover.fem.plate import move

NEEDLE = 50e-6
"""Radius of the needle, m: a flat tip, since it sinks in deeper than the round one is high."""

E_COVER = 2.4e6
"""Young's modulus of the covers, Pa (4.3.1)."""

PLATE = 50e-6
"""Half of the plate's side, m, over which the pressure on the silicon is averaged."""

THICK, THIN = 500e-6, 220e-6
TOP = {THICK: 70e-3, THIN: 30e-3}
"""Largest load, N, by the thickness, m: that of 4.3.2, and what it calls small."""

STEPS = 6
"""Of the load up to its largest; twice as many change the last slope by 3 %."""


def block(thickness: float) -> QuadMesh:
    """Return half of the section of a cover, lengths in radii of the needle."""
    depth = thickness / NEEDLE
    inner, beyond = np.linspace(0.0, 1.0, 5), np.linspace(0.0, 1.0, 11)[1:]
    columns = np.concatenate([inner, 1.0 + (4.0 * depth - 1.0) * beyond**2])
    r, z = np.meshgrid(columns, np.linspace(0.0, depth, 9), indexing="ij")
    number = np.arange(r.size).reshape(r.shape)
    corners = [number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]]
    points = np.stack([r.reshape(-1), z.reshape(-1)], axis=-1)
    return QuadMesh(points, np.stack([c.reshape(-1) for c in corners], axis=-1))


@cache
def response(thickness: float, steps: int = STEPS) -> tuple[Floats, Floats, Floats]:
    """Return loads, N, pressures on the plate, Pa, and depths of the needle, m, of some steps.

    Every step presses a little further on the mesh as the steps before have left it. The rubber's
    own law stays linear; what bends the response is that the needle comes nearer.
    """
    mesh = block(thickness)
    depth, points = thickness / NEEDLE, mesh.points
    indentation = TOP[thickness] / STEPS
    pressures, depths = [0.0], [0.0]
    rings = np.linspace(0.05, PLATE / NEEDLE, 9)
    places = np.stack([rings, np.full_like(rings, depth)], axis=-1)
    under = np.empty(0, dtype=np.int64)
    for _ in range(steps):
        body = make_body(QuadMesh(points, mesh.cells), Hooke(PUSHED, 0.5))
        if under.size == 0:  # the needle does not slide: its nodes remain its own
            under = np.flatnonzero((body.nodes[:, 1] < 1e-9) & (body.nodes[:, 0] < 1.0 + 1e-9))
        pushed = move(body, under, (0.0, 1.0))
        step = indentation / (E_COVER * NEEDLE**2 * pushed.stiffness)
        below = body.space.smoothed(body.stresses(pushed.solution)["zz"][np.newaxis], places)[0]
        pressures.append(pressures[-1] - E_COVER * step * float(below @ rings / rings.sum()))
        depths.append(depths[-1] + NEEDLE * step)
        moved = np.stack([body.field(k, pushed.solution) for k in (0, 1)], axis=-1)
        points = points + step * moved[body.space.displacement.nodal_dofs[0]]
    loads: Floats = indentation * np.arange(steps + 1, dtype=np.float64)
    return loads, np.array(pressures), np.array(depths)


def steepening(thickness: float) -> float:
    """Return the slope of the response in its last step over that in its first."""
    slopes = np.diff(response(thickness)[1])
    return float(slopes[-1] / slopes[0])


def first_pressure() -> float:
    """Return the pressure on the plate per newton in the first step under 500 µm, MPa/N."""
    loads, pressures, _ = response(THICK, 1)
    return float(1e-6 * pressures[1] / loads[1])


@cache
def layer_pressure() -> float:
    """Return the same of a bonded layer in closed form, under a punch's pressure, MPa/N."""
    nodes, weights = np.polynomial.legendre.leggauss(12)
    turn = 0.25 * np.pi * (nodes + 1.0)  # ρ = a sin θ takes the root out of the pressure
    rho = NEEDLE * np.sin(turn)
    shares = 0.25 * np.pi * weights * NEEDLE * np.cos(turn) * 2.0 * np.pi * rho
    shares = shares * np.asarray(punch_pressure(rho, 1.0, NEEDLE))
    around = 2.0 * np.pi * (np.arange(12) + 0.5) / 12
    spots = rho[:, np.newaxis, np.newaxis] * np.stack([np.cos(around), np.sin(around)], axis=-1)
    rings = NEEDLE * np.linspace(0.05, PLATE / NEEDLE, 9)
    taxels = np.stack([rings, 0.0 * rings], axis=-1)[:, np.newaxis, np.newaxis]
    cover = LayerCover(THICK, E_COVER)
    below = -cover.stress(spots, taxels, [0.0, 0.0, 1.0])[..., 2].mean(axis=-1) @ shares
    return float(1e-6 * below @ rings / rings.sum())


def figure_4_10() -> Figure:
    """Return the response of a taxel under a thick and a thin cover."""
    panels = list[Panel]()
    for thickness in (THICK, THIN):
        loads, pressures, depths = response(thickness)
        line = pressures[1] / loads[1] * loads
        panels.append(
            Panel(f"{1e6 * thickness:.0f} µm of rubber", "load F (mN)", "pressure (kPa)",
                  [Curve(1e3 * loads, 1e-3 * pressures, f"needle {1e6 * depths[-1]:.0f} µm deep"),
                   Curve(1e3 * loads, 1e-3 * line, "as it begins", "dashed")])
        )  # fmt: skip
    return Figure(
        "fig-4.10",
        "Fig. 4.10",
        "Exponential-like response under a thick cover",
        "Pressure on the plate below a needle of Ø 100 µm, E = 2.4 MPa. Finite elements whose mesh "
        "follows the needle, with a linear law of the rubber. The line steepens because the needle "
        "comes nearer to the chip. The print has no digits. It calls the response under 220 µm "
        "linear, without its load; at 30 mN the model bends under that cover, too.",
        panels,
    )


STEEPER = (
    "own model: the dissertation names the rubber's non-linear behaviour, and this is the part of "
    "it that a needle's depth makes. No digits"
)

CHAPTER = Chapter(
    "Section 4.3.2 — the response under a thick cover",
    (
        Item("fig-4.10-start", "pressure per load before the mesh has moved, over a bonded layer's",
             "Fig. 4.10, its first part; section 4.3.2", 1.0,
             lambda: first_pressure() / layer_pressure(), 0.005,
             "a coarse mesh, 0.14 % from one of cells half as large, under the pressure of a punch "
             "on a half-space: 0.36 % together", "", "relative", figure="fig-4.10",
             faults=(changed(Body.stresses, "σ_zz × 1.01",
                             lambda found: {**found, "zz": 1.01 * found["zz"]}, share=0.01),
                     scaled(LayerCover.stress, 0.99))),
        Item("fig-4.10", "slope at 70 mN over that at the start, 500 µm of rubber",
             "Fig. 4.10: “exponential-like response”", 1.0, partial(steepening, THICK), 0.0,
             STEEPER, "", "at least", kind="comparison", figure="fig-4.10"),
        Item("fig-4.10-thin", "slope at 30 mN over that at the start, 220 µm of rubber",
             "section 4.3.2: “did not change its linear characteristics”", 1.0,
             partial(steepening, THIN), 0.0, STEEPER, kind="comparison", figure="fig-4.10"),
    ),
    {"fig-4.10": figure_4_10},
)  # fmt: skip
