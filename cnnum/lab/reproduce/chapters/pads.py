"""Section 6.4.3: a pad of pressure taxels that reads shear through bumps (Fig. 6.13, 6.17)."""

from collections.abc import Callable
from functools import cache, partial
from math import inf, pi, sqrt

import numpy as np

from cnnum.arrays import Floats
from cnnum.lab.reproduce.chapters import printed
from cnnum.lab.reproduce.faults import changed, scaled
from cnnum.lab.reproduce.figure import Arrows, Curve, Dots, Figure, Panel
from cnnum.lab.reproduce.record import Chapter, Item
from cnnum.tactile.grid import make_grid
from cnnum.tactile.halfspace import SurfaceToDepth
from cnnum.tactile.pad import Pad

PITCH = 1.5e-3
"""Pitch of the pressure taxels, m."""

RADIUS = 1e-3
"""Radius of the bumps."""

LAYER = 0.5e-3
"""Thickness of the rubber below the bumps."""

CELLS = 6
"""Cells of the map of tractions in a pitch."""

TURNS = 24
SLANT = 0.3
"""Shear over normal force of the load that is moved round."""

NOISE = 0.01
"""RMS of a taxel, of the largest pressure: so that idle arrows are as small as printed."""

PAD = Pad.regular((9, 9))
SHAPE = (9 * CELLS + 1, 9 * CELLS + 1)


def centres() -> Floats:
    """Return (4, 4, 2) places of the bumps, m, the middle of the pad at (0, 0)."""
    side = (np.arange(4) * 2 + 0.5 - 4) * PITCH
    x, y = np.meshgrid(side, side)
    return np.stack([x, y], axis=-1).astype(np.float64)


def foot(force: Floats, centre: Floats) -> Floats:
    """Return the traction on the foot of one bump, Pa, pushed at its top.

    The pressure leans: sideways force times the bump's height is a moment. The foot bears it as a
    beam does: p = F/(πa²) + 4 h (Q x + R y)/(πa⁴).
    """
    grid = make_grid(SHAPE, PITCH / CELLS)
    x, y = grid.x - centre[0], grid.y[:, np.newaxis] - centre[1]
    inside = np.hypot(x, y) <= RADIUS
    area = float(inside.sum()) * grid.cell_area
    lean = 4.0 * RADIUS / (pi * RADIUS**4) * (force[0] * x + force[1] * y)
    maps = [np.broadcast_to(f / area, inside.shape) for f in force]
    maps[2] = maps[2] + lean
    return np.where(inside[..., np.newaxis], np.stack(maps, axis=-1), 0.0)


@cache
def per_force() -> Floats:
    """Return (3, 9, 9): pressure at each taxel of one bump pushed along x, y and z by 1 N."""
    deep = SurfaceToDepth(SHAPE, PITCH / CELLS, LAYER, components=("zz",))
    middle = np.full(2, 0.0)
    loads = np.stack([foot(unit, middle) for unit in np.eye(3)])
    return -deep(loads)[..., 0]


def pressures(forces: Floats) -> Floats:
    """Return (..., 9, 9) pressures at the taxels for (..., 4, 4, 3) forces on the bumps, Pa."""
    unit, middle = per_force(), SHAPE[0] // 2
    result = np.zeros((*forces.shape[:-3], 9, 9))
    for row, col in np.ndindex(4, 4):
        # taxel − bump in cells: taxels at (n − 4) pitches, bumps at (2k − 3.5)
        away = [CELLS * np.arange(9) - 2 * CELLS * k - CELLS // 2 for k in (row, col)]
        near = [np.abs(a) <= middle for a in away]
        cells = [(a + middle).clip(0, 2 * middle) for a in away]
        part = unit[:, cells[0][:, np.newaxis], cells[1]] * (near[0][:, np.newaxis] & near[1])
        result += np.einsum("...k,kij->...ij", forces[..., row, col, :], part)
    return result


def circling(touched: Floats) -> Floats:
    """Return (turns, 4, 4, 3) forces on the bumps: 1 N on each, its shear going round."""
    turn = np.linspace(0.0, 2.0 * pi, TURNS, endpoint=False)
    force = np.stack([SLANT * np.cos(turn), SLANT * np.sin(turn), np.ones(TURNS)], axis=-1)
    return touched[..., np.newaxis] * force[:, np.newaxis, np.newaxis]


def one_bump() -> Floats:
    """Return where only one bump is pressed."""
    touched = np.zeros((4, 4))
    touched[1, 2] = 1.0
    return touched


def one_column() -> Floats:
    """Return where a pencil's side lies on a column of bumps."""
    touched = np.zeros((4, 4))
    touched[:, 1] = 1.0
    return touched


@cache
def read(line: bool) -> Floats:
    """Return (turns, 4, 4, 3) vectors of the pad, as a sensor of compression with noise."""
    seen = pressures(circling(one_column() if line else one_bump()))
    noise = NOISE * seen.max() * np.random.default_rng(17).normal(size=seen.shape)
    return PAD.to_three_axial(np.maximum(seen + noise, 0.0))


def direction_error(line: bool) -> float:
    """Return the RMS error of the direction on pressed bumps, degrees."""
    touched = (one_column() if line else one_bump()) > 0.0
    vectors = read(line)[:, touched]
    turn = np.linspace(0.0, 2.0 * pi, TURNS, endpoint=False)[:, np.newaxis]
    gap = np.angle(np.exp(1j * (np.arctan2(vectors[..., 1], vectors[..., 0]) - turn)))
    return float(np.degrees(np.sqrt(np.mean(gap**2))))


def cross_talk() -> float:
    """Return the largest shear on the neighbours, share of the pressed bump's, no noise."""
    vectors = PAD.to_three_axial(pressures(circling(one_bump())))
    size = np.hypot(vectors[..., 0], vectors[..., 1])
    others = size[:, one_bump() == 0.0]
    return float(others.max() / size[:, 1, 2].min())


def turned_gap() -> float:
    """Return the largest difference of ours and (6.1) turned by 45°."""
    four = np.random.default_rng(6).normal(size=(500, 2, 2))
    s3, s4, s1, s2 = four.reshape(-1, 4).T  # rows run along y, which points up in Fig. 6.13
    raw = (s4 - s1) + 1j * (s2 - s3)
    turned = raw * np.exp(-0.25j * pi)
    third = 0.5 * (s1 + s2 + s3 + s4)
    theirs = np.stack([turned.real, turned.imag, third], axis=-1)
    return float(np.abs(PAD_ONE.to_three_axial(four)[:, 0, 0] - theirs).max())


PAD_ONE = Pad.regular((2, 2))


def slope_gap() -> float:
    """Return how far the vectors of a pad are from those by hand, of a pressure that rises evenly.

    By 1 along x and by 10 along y from taxel to taxel: so each vector shows where its bump is.
    """
    ours = PAD.to_three_axial(np.arange(9.0) + 10.0 * np.arange(9.0)[:, np.newaxis])
    rows, cols = PAD.bumps
    middle = 0.5 + 2.0 * np.arange(cols) + 10.0 * (0.5 + 2.0 * np.arange(rows)[:, np.newaxis])
    theirs = np.stack([0.0 * middle + sqrt(2.0), 0.0 * middle + 10.0 * sqrt(2.0), 2.0 * middle], -1)
    return float(np.abs(ours - theirs).max()) if ours.shape == theirs.shape == (4, 4, 3) else inf


def vector_gap() -> float:
    """Return how far a pressed bump's vectors are from point loads (4.11) summed over its foot.

    Of 1 N along x, y and z, as a share of the largest component.
    """
    touched = np.einsum("ij,lk->lijk", one_bump(), np.eye(3))
    ours = PAD.to_three_axial(pressures(touched))[:, 1, 2]
    nodes, weights = np.polynomial.legendre.leggauss(4)
    step = PITCH / CELLS
    grid = make_grid(SHAPE, step)
    spots = [(u, v, 0.25 * a * b) for u, a in zip(nodes, weights, strict=True)
             for v, b in zip(nodes, weights, strict=True)]  # fmt: skip
    taxels = 0.5 * PITCH * np.array([(-1.0, 1.0), (1.0, 1.0), (-1.0, -1.0), (1.0, -1.0)])
    theirs: list[Floats] = []
    for unit in np.eye(3):
        traction = foot(unit, np.zeros(2))
        row, col = np.nonzero(traction.any(axis=-1))
        load = grid.cell_area * traction[row, col].T
        four = list[float]()
        for x, y in taxels:
            total = 0.0
            for u, v, share in spots:
                away = np.stack([x - grid.x[col] - 0.5 * step * u, y - grid.y[row] - 0.5 * step * v,
                                 np.full(row.size, LAYER)])  # fmt: skip
                total -= share * float(printed.stress(away, load)[2, 2].sum())
            four.append(total)
        s1, s2, s3, s4 = four
        theirs.append(np.array([sqrt(0.5) * (s2 + s4 - s1 - s3), sqrt(0.5) * (s1 + s2 - s3 - s4),
                                0.5 * (s1 + s2 + s3 + s4)]))  # fmt: skip
    return float(np.abs(ours - theirs).max() / np.abs(theirs).max())


def _panel(line: bool, title: str) -> Panel:
    vectors = 1e3 * 0.25 * read(line) / np.abs(read(line)).max() * PITCH * 4
    place = 1e3 * centres()
    x, y = (np.broadcast_to(place[..., k], vectors.shape[:-1]).reshape(-1) for k in (0, 1))
    turn = np.linspace(0.0, 2.0 * pi, 73)
    circle: Floats = np.stack([np.cos(turn), np.sin(turn)]).astype(np.float64)
    rim = [
        Curve(spot[0] + circle[0], spot[1] + circle[1], colour=-2, style="dotted")
        for spot in place.reshape(-1, 2)
    ]
    tips = vectors[..., :2].reshape(-1, 2)
    arrows = Arrows(x, y, tips[:, 0], tips[:, 1])
    grid = 1e3 * (np.arange(9) - 4) * PITCH
    places = np.stack(np.meshgrid(grid, grid)).reshape(2, -1).astype(np.float64)
    dots = Dots(places[0], places[1], np.full(81, 11.0), 1, "")
    return Panel(title, "x (mm)", "y (mm)", [dots, *rim, arrows], equal=True, reach=7.0)


def figure_6_17() -> Figure:
    """Return the vectors of a pad while shear goes round."""
    return Figure(
        "fig-6.17",
        "Fig. 6.17",
        "Three-axial vectors from a 9×9 pressure pad",
        f"1 N on each touched bump, its shear of {SLANT:g} N going round in {TURNS} steps; taxels "
        f"(dots) feel pressure only, with {100 * NOISE:.0f} % noise. Simulated under bumps of "
        "Ø 2 mm on 0.5 mm of rubber. Their feet bear force and moment as a beam does.",
        (_panel(False, "One bump pressed"), _panel(True, "A line load on a column")),
    )


FIGURES: dict[str, Callable[[], Figure]] = {"fig-6.17": figure_6_17}

CHAPTER = Chapter(
    "Section 6.4.3 — shear from pressure taxels",
    (
        Item("eq-6.1", "shear by four taxels: ours against (6.1) turned by 45°", "(6.1)", 0.0,
             turned_gap, 1e-14, "rounding",
             faults=(scaled(Pad.to_three_axial, -1.0, entry=1),
                     scaled(Pad.to_three_axial, 1.0 + 1e-9, entry=2))),
        Item("fig-6.13", "vectors of a 9×9 pad under a pressure that rises evenly, by hand",
             "Fig. 6.13: 4×4 bumps", 0.0, slope_gap, 1e-12, "rounding",
             faults=(changed(Pad.bumps, "one row less", lambda n: (n[0] - 1, n[1])),
                     scaled(Pad.to_three_axial, 1.001, entry=0),
                     scaled(Pad.to_three_axial, 1.001, entry=2))),
        Item("fig-6.17-point", "vectors of one bump against point loads summed over its foot",
             "Fig. 6.17 (left); (4.11), (6.1)", 0.0, vector_gap, 1e-6,
             "four by four points a cell of 0.25 mm, half a millimetre away",
             "of the largest", figure="fig-6.17",
             faults=(scaled(Pad.to_three_axial, 1.001, entry=0),
                     scaled(SurfaceToDepth.__call__, 1.001))),
        *(
            Item(f"fig-6.17-{name}", f"direction of the vectors, {what}", source, 0.0,
                 partial(direction_error, line), 0.0, "no digits; with 1 % of noise", "°",
                 kind="comparison", figure="fig-6.17")
            for name, what, source, line in (
                ("direction", "one bump pressed",
                 "Fig. 6.17 (left): “nicely follow the circular shear motion”", False),
                ("line", "under a line load", "Fig. 6.17 (right)", True),
            )
        ),
        Item("fig-6.17-cross-talk", "shear read on unpressed neighbours, of the pressed one's",
             "section 6.4.4: “minimal cross-talk”", 0.1, cross_talk, 0.0,
             "no digits: arrows of that size hardly show a tenth", "", "at most",
             kind="comparison", figure="fig-6.17"),
    ),
    FIGURES,
)  # fmt: skip
