"""Edges: where outlines are found under a cover, against Love's and Hankel's solutions."""

from dataclasses import replace

import numpy as np
import pytest

from cnnum.lab.bench.programs.edge_errors import told_apart
from cnnum.lab.bench.programs.smooth_edges import (
    Several,
    drawn_pairs,
    drawn_pulls,
    drawn_small,
    drawn_threes,
)
from cnnum.lab.bench.programs.surround import GAPS, beside, hat
from cnnum.programs import program
from cnnum.tactile.halfspace import SurfaceToDepth
from cnnum.tactile.indenters import Disc, Rectangle, Ring, frame_under, two_bars
from cnnum.tactile.touches import readings
from cnnum.templates.tactile.contact_mechanics.edge_crossings import links_of
from cnnum.templates.tactile.edges import edges

NOISE = 5e-3
"""Of one reading, as a share of the peak: 2.5 mV (Table 3.II) of 500 mV."""

SKINS = [
    ("strain", 8, 0.3),
    ("strain", 8, 0.6),
    ("strain", 16, 0.6),
    ("strain", 32, 1.0),
    ("stress", 8, 0.3),
    ("stress", 8, 1.0),
    ("stress", 16, 0.6),
    ("stress", 32, 0.3),
]
"""What taxels read, how many stand on a side, and how deep they lie, pitches."""

FINER = {8: 1.0, 16: 1.6, 32: 2.6}
"""How much larger indenters are on finer arrays."""


def pressed(loads, seed=0):
    """Frames of rest and then of loads side by side, with the sign of strain and stress."""
    loads = np.asarray(loads) / np.max(loads, axis=(-2, -1), keepdims=True)
    frames = NOISE * np.random.default_rng(seed).normal(size=(20, *loads.shape, 3))
    frames[18:, ..., 2] -= loads
    return frames


def places(right, below):
    """Row and column of every place where the outline crosses a link."""
    row, col = np.argwhere(right >= 0).T
    across = np.stack([row, col + right[row, col]], axis=-1)
    row, col = np.argwhere(below >= 0).T
    return np.concatenate([across, np.stack([row + below[row, col], col], axis=-1)])


def errors(indenter, found, cells):
    """Distance of every place from the true outline, cells."""
    x, y = found[:, 1] - (cells - 1) / 2, found[:, 0] - (cells - 1) / 2
    return np.abs(indenter.distance(x, y))


def missed(indenter, found, cells):
    """Share of the outline that is more than a cell from every place."""
    axis = np.linspace(-cells / 2, cells / 2, 20 * cells + 1)
    x, y = np.meshgrid(axis, axis)
    on = np.abs(indenter.distance(x, y)) < 0.03
    outline = np.stack([y[on], x[on]], axis=-1) + (cells - 1) / 2
    return float((np.linalg.norm(outline[:, None] - found, axis=-1).min(axis=1) > 1.0).mean())


def indenters(cells, seed):
    """One of each kind, at angles and places of its own."""
    rng, s = np.random.default_rng(seed), FINER[cells]
    angle, at = rng.uniform(0, np.pi), tuple(rng.uniform(-0.5, 0.5, 2) * s)
    return [
        Disc(s * rng.uniform(1.8, 2.8), at),
        Ring(s * rng.uniform(0.9, 1.1), s * rng.uniform(2.5, 2.9), at),
        Rectangle(s * rng.uniform(2.3, 3.0), s * rng.uniform(3.0, 4.0), angle, at),
        two_bars(s * rng.uniform(1.5, 2.0), s * rng.uniform(3.5, 4.0), 1.6 * s, angle, at),
        Disc(s * rng.uniform(1.8, 2.8), at, "punch"),
    ]


def found_by(run, engine, bodies, cells, depth, reads):
    program = edges.bind(depth=depth, reads=reads)
    loads = [frame_under(body, (cells, cells), depth, reads) for body in bodies]
    names = ["edge_to_right", "edge_to_below", "edges", "edge_count"]
    got = run(engine, program, pressed(loads), names)
    return got, [places(got[names[0]][-1, k], got[names[1]][-1, k]) for k in range(len(bodies))]


@pytest.mark.parametrize(("reads", "cells", "depth"), SKINS)
def test_outlines_are_found_to_half_a_cell(numba, run, cells, reads, depth):
    bodies = [body for seed in range(3 if cells == 32 else 6) for body in indenters(cells, seed)]
    got, found = found_by(run, numba, bodies, cells, depth, reads)
    assert got["edge_count"][:18].max() == 0
    for number, (body, where) in enumerate(zip(bodies, found, strict=True)):
        assert len(where) >= 8
        off = errors(body, where, cells)
        if number % 5 == 4:
            # a fit of all taxels meets a punch's rim to the noise
            assert off.max() < 0.05
        else:
            # the tail of 1 link in 500 that noise and a rectangle's corners move
            assert np.quantile(off, 0.95) < 0.5
            assert off.max() < 0.6
        # corners of rectangles are rounded by the cover, thin bars end in a cell
        assert missed(body, where, cells) < 0.35


@pytest.mark.parametrize(("reads", "cells", "depth"), SKINS)
def test_a_smooth_contact_has_no_edge(numba, run, cells, reads, depth):
    """Hertz's pressure from 3 cells in radius on; what fits on the array, at any place."""
    rng = np.random.default_rng(4)
    radii = rng.uniform(3.0, max(3.6, 0.4 * cells), 24)
    bodies = [Disc(a, tuple(rng.uniform(-0.5, 0.5, 2)), "hertz") for a in radii]
    got, _ = found_by(run, numba, bodies, cells, depth, reads)
    assert got["edge_count"].max() == 0


@pytest.mark.parametrize("depth", [0.3, 0.5, 1.0])
@pytest.mark.parametrize("reads", ["strain", "stress"])
def test_a_small_smooth_contact_has_none(numba, run, reads, depth):
    """Drawn as docs/programs/edges.md draws them, with other seeds than its bounds were set on."""
    rng = np.random.default_rng(21)
    radii = np.repeat([2.0, 2.5], 15)
    bodies = [Disc(a, tuple(rng.uniform(-0.5, 0.5, 2)), "hertz") for a in radii]
    for radius in (0.7, 1.0, 1.3, 1.6, 1.8):
        bodies += drawn_small(rng, "sphere", radius, 12)
    got, _ = found_by(run, numba, bodies, 8, depth, reads)
    # by the rise alone it was half of those of 2 cells, and all of less than one
    assert (got["edge_count"][-1] > 0).sum() == 0


@pytest.mark.parametrize("depth", [0.3, 1.0])
@pytest.mark.parametrize("reads", ["strain", "stress"])
def test_punches_have_their_rim(numba, run, reads, depth):
    """Their whole outline, other punches than docs/programs/edges.md draws."""
    rng = np.random.default_rng(25)
    bodies = [Disc(a, tuple(rng.uniform(-0.5, 0.5, 2)), "punch") for a in rng.uniform(1.8, 2.8, 60)]
    _, found = found_by(run, numba, bodies, 8, depth, reads)
    off = np.concatenate([errors(b, where, 8) for b, where in zip(bodies, found, strict=True)])
    # centre and radius are known to 0.01 cells under this noise
    assert off.max() < 0.05
    assert max(missed(b, where, 8) for b, where in zip(bodies, found, strict=True)) == 0.0


@pytest.mark.parametrize(("reads", "depth"), [("strain", 0.3), ("strain", 0.75), ("stress", 1.0)])
def test_two_smooth_contacts_have_no_edge(numba, run, reads, depth):
    """By the rise of their load alone three in four would; of uniform ones all do.

    Under a whole pitch noise hides how flat one of them is, but not how flat both are.
    """
    rng = np.random.default_rng(41)
    edged = {}
    for pressure in ("hertz", "uniform"):
        pairs = drawn_pairs(rng, 8, (1.5, 1.9), 24, pressure)
        seen = [pair.frame(8, depth, reads) for pair in pairs]
        program = edges.bind(depth=depth, reads=reads)
        edged[pressure] = run(numba, program, pressed(seen), ["edge_count"])["edge_count"][-1] > 0
    # seen: 1 of 240 in stress under a whole pitch, none of 240 else
    assert edged["hertz"].sum() <= (1 if depth == 1.0 else 0)
    assert edged["uniform"].all()


@pytest.mark.parametrize(("reads", "depth"), [("strain", 0.3), ("stress", 0.75)])
def test_three_smooth_contacts_have_no_edge(numba, run, reads, depth):
    """Each alone is as narrow as what has an edge; three uniform loads have one."""
    rng, edged = np.random.default_rng(46), {}
    for pressure in ("hertz", "uniform"):
        threes = drawn_threes(rng, 16, (1.6, 2.4), 16, pressure)
        seen = [three.frame(16, depth, reads) for three in threes]
        program = edges.bind(depth=depth, reads=reads)
        edged[pressure] = run(numba, program, pressed(seen), ["edge_count"])["edge_count"][-1] > 0
    assert not edged["hertz"].any()
    assert edged["uniform"].all()


@pytest.mark.parametrize("reads", ["strain", "stress"])
def test_a_sphere_beside_a_disc_keeps_the_disc_s_edge(numba, run, reads):
    """One smooth contact does not make the other so."""
    pairs = drawn_pairs(np.random.default_rng(45), 8, (1.7, 2.0), 24)
    discs = [(one, replace(two, pressure="uniform")) for one, two in (p.discs for p in pairs)]
    seen = [
        Several(both, pair.shares).frame(8, 0.75, reads)
        for both, pair in zip(discs, pairs, strict=True)
    ]
    got = run(numba, edges.bind(depth=0.75, reads=reads), pressed(seen), ["edge_count"])
    # one in 240 where the disc lies half beyond the array
    assert (got["edge_count"][-1] > 0).sum() >= 23


@pytest.mark.parametrize(("reads", "depth"), [("strain", 0.3), ("strain", 1.0), ("stress", 0.75)])
def test_a_hole_three_cells_inside_is_no_punch_s(numba, run, reads, depth):
    """What lies beyond a body as wide as that took its outline inwards, by 0.7 cells."""
    rng = np.random.default_rng(47)
    bodies = [
        *(Ring(a, a + 3.0, tuple(rng.uniform(-0.5, 0.5, 2))) for a in rng.uniform(1.5, 1.8, 12)),
        *(
            Rectangle(a, 5.5, rng.uniform(-0.05, 0.05), tuple(rng.uniform(-0.5, 0.5, 2)))
            for a in rng.uniform(3.6, 4.0, 12)
        ),
    ]
    _, found = found_by(run, numba, bodies, 16, depth, reads)
    off = [errors(body, where, 16) for body, where in zip(bodies, found, strict=True)]
    assert np.concatenate(off).max() < 0.5


@pytest.mark.parametrize("share", [0.3, 0.6, 0.999])
@pytest.mark.parametrize("reads", ["strain", "stress"])
def test_a_pulled_sphere_has_no_edge(numba, run, reads, share):
    """From partial to gross slip, by Cattaneo and Mindlin; it was up to 13 of 40."""
    rng = np.random.default_rng(43)
    touches = [*drawn_pulls(rng, (1.2, 2.0), share, 24), *drawn_pulls(rng, (2.0, 3.3), share, 24)]
    seen = [-readings(touch, 8, 1.0, reads)[..., 2] for touch in touches]
    got = run(numba, edges.bind(depth=1.0, reads=reads), pressed(seen), ["edge_count"])
    assert got["edge_count"].max() == 0


@pytest.mark.parametrize("depth", [0.5, 1.0])
@pytest.mark.parametrize("reads", ["strain", "stress"])
def test_what_has_an_edge_is_not_taken_for_a_sphere(numba, run, reads, depth):
    """Small squares and discs are most like one."""
    rng, spread = np.random.default_rng(22), (-0.5, 0.5)
    sides = rng.uniform(2.3, 3.0, (20, 2))
    squares = [
        Rectangle(min(s), max(s), rng.uniform(0, np.pi), tuple(rng.uniform(*spread, 2)))
        for s in sides
    ]
    discs = [Disc(a, tuple(rng.uniform(*spread, 2))) for a in rng.uniform(1.5, 2.3, 30)]
    punches = [Disc(a, tuple(rng.uniform(*spread, 2)), "punch") for a in rng.uniform(1.7, 2.3, 20)]
    _, found = found_by(run, numba, [*squares, *discs, *punches], 8, depth, reads)
    # a square of two cells crosses four links at least
    assert all(len(where) >= 4 for where in found)


@pytest.mark.parametrize("reads", ["strain", "stress"])
def test_a_pull_makes_no_edge_smooth(numba, run, reads):
    """A disc of 2 cells under a pull of 0.3 of its load, spread as its pressure is."""
    side, finer, depth = 8, 5, 0.75
    cover = SurfaceToDepth(
        (side * finer,) * 2,
        1.0 / finer,
        depth,
        youngs_modulus=1.5 if reads == "strain" else None,
    )
    axis = (np.arange(side * finer) + 0.5) / finer - side / 2
    rng, seen = np.random.default_rng(23), []
    for angle in rng.uniform(0, 2 * np.pi, 12):
        body = Disc(rng.uniform(1.9, 2.4), tuple(rng.uniform(-0.5, 0.5, 2)))
        inside = np.clip(0.5 - finer * body.distance(*np.meshgrid(axis, axis)), 0.0, 1.0)
        pull = np.array([0.3 * np.cos(angle), 0.3 * np.sin(angle), 1.0])
        seen.append(-cover(inside[..., None] * pull)[finer // 2 :: finer, finer // 2 :: finer, 2])
    got = run(numba, edges.bind(depth=depth, reads=reads), pressed(seen), ["edge_count"])
    assert (got["edge_count"][-1] >= 6).all()


@pytest.mark.parametrize("reads", ["strain", "stress"])
def test_noise_does_not_hide_a_sphere_of_two_cells(reads):
    """Not even under a whole pitch, from the disc most like it."""
    apart, likeness = told_apart(2.0, 1.0, reads)
    assert apart > 9.5
    assert 0.8 < likeness < 0.95
    # of a smaller one it nearly does, and of none all
    assert told_apart(1.0, 1.0, reads)[0] < apart / 3
    # as many standard deviations as the difference of two frames has, drawn
    sphere, disc = (
        frame_under(Disc(a, (0.2, 0.1), kind), (8, 8), 1.0, reads)
        for a, kind in ((2.0, "hertz"), (2.0 * likeness, "uniform"))
    )
    disc = disc * (sphere * disc).sum() / (disc * disc).sum()
    by_hand = np.sqrt((((sphere - disc) / (NOISE * sphere.max())) ** 2).sum())
    assert apart == pytest.approx(by_hand, rel=1e-6)


@pytest.mark.parametrize(
    ("engine", "shape"),
    [
        # test_sizes.py has 4×4 on OpenCL, whose kernels take some seconds each to build
        ("fast", (8, 8)),
        ("fast", (16, 16)),
        ("numba", (4, 4)),
        ("numba", (16, 16)),
        # it solves every filter anew: two shapes are enough
        ("reference", (4, 4)),
        ("reference", (8, 8)),
    ],
    indirect=["engine"],
)
def test_engines_and_shapes_agree(engine, run, shape):
    body = Disc(0.3 * shape[0], (0.2, -0.1))
    got = run(engine, edges, pressed(frame_under(body, shape, 0.5, "strain")))
    found = places(got["edge_to_right"][-1], got["edge_to_below"][-1])
    assert len(found) >= 4
    assert errors(body, found, shape[0]).max() < 0.5
    near = np.argwhere(got["edges"][-1] > 0)
    # the taxel nearest along a link is at most half a cell further than the place itself
    assert errors(body, near, shape[0]).max() < 1.0
    assert got["edge_count"][-1] == len(near)
    assert got["edge_row"][-1] == pytest.approx(near[:, 0].mean(), abs=1e-4)
    assert got["edge_column"][-1] == pytest.approx(near[:, 1].mean(), abs=1e-4)


@pytest.mark.parametrize("engine", ["fast", "reference"], indirect=True)
def test_engines_agree_on_two_contacts(engine, numba, run):
    """Smooth and uniform ones: fits of both are run."""
    rng, program = np.random.default_rng(51), edges.bind(depth=0.3)
    kinds = ("hertz", "uniform")
    pairs = [pair for kind in kinds for pair in drawn_pairs(rng, 8, (1.5, 1.9), 3, kind)]
    frames = pressed([pair.frame(8, 0.3, "strain") for pair in pairs])
    names = ["edge_count", "edges", "edge_to_right", "edge_to_below"]
    got, same = (run(each, program, frames, names) for each in (engine, numba))
    assert (got["edge_count"][-1] > 0).tolist() == [False] * 3 + [True] * 3
    assert np.array_equal(got["edges"][-1], same["edges"][-1])
    for name in names[2:]:
        # single precision, over a load that is known to 0.3 of its largest
        np.testing.assert_allclose(got[name][-1], same[name][-1], atol=1e-5)


@program
def hollows(frame):
    """What the loads lack that end towards the right."""
    least = frame.constant(0.1)
    return {"hollow": links_of(frame, frame.normal, least)[0].hollow}


@pytest.mark.parametrize(
    ("inwards", "lacks"),
    [
        ((1.0, 0.75, 0.62, 0.58), 0.42),
        # the hole of a ring, a narrow body's far side, and one whose near side is cut as well
        ((1.0, 1.0, 1.0, 0.1), 0.0),
        ((1.0, 1.0, 1.0, 0.5), 0.0),
        ((0.80, 0.90, 1.0, 0.79), 0.0),
    ],
)
def test_only_what_falls_inwards_and_stays_is_hollow(numba, run, inwards, lacks):
    load = np.zeros((4, 4))
    load[:] = inwards[::-1]
    frames = np.zeros((1, 4, 4, 3))
    frames[..., 2] = load
    got = run(numba, hollows, frames, ["hollow"])["hollow"]
    assert got[0, 0, 3] == pytest.approx(lacks, abs=1e-6)


def test_edge_load_is_the_pressure(fast, run):
    """Inside a wide uniform load, and two cells outside it, to the noise and 7×7 weights."""
    body = Rectangle(6.0, 6.0)
    seen = frame_under(body, (16, 16), 0.5, "stress")
    load = run(fast, edges.bind(reads="stress"), pressed(seen), ["edge_load"])["edge_load"][-1]
    inner, outer = load[6:10, 6:10] * seen.max(), load[:3]
    assert np.abs(inner - 1.0).max() < 0.08
    assert np.abs(outer).max() < 0.05


def test_surround_of_bars_and_points():
    """Figures of docs/programs/edges.md, the hat by its own formula."""
    shares = [beside(gap, "strain") for gap in GAPS]
    assert [round(100 * share, 1) for share in shares] == [7.1, 4.5, 3.0, 1.5]
    assert all(-0.004 < beside(gap, "stress") < 0.0 for gap in GAPS)
    # Boussinesq at ν = 0.5, z = 1: σ_zz less the mean stress goes as 3/R⁵ − 1/R³
    away = np.linspace(0.0, 10.0, 200001)
    far = np.hypot(away, 1.0)
    shape = (3.0 / far**2 - 1.0) / far**3
    assert hat() == pytest.approx(shape.max() / -shape.min(), rel=1e-4)
    assert hat() == pytest.approx(55.9, abs=0.05)


@pytest.mark.parametrize("depth", [0.5, 1.0])
def test_surround_inhibition_is_the_covers(fast, run, depth):
    """Beside a narrow load strain falls below rest as in the closed form; stress never does."""
    body = Disc(0.1)
    seen = frame_under(body, (9, 9), depth, "strain")
    got = run(fast, edges.bind(depth=depth), pressed(seen), ["surround_inhibition"])
    true = -seen.min() / seen.max()
    # the lowest of 81 noisy taxels lies up to 4 standard deviations lower; at 9×9 taxels the
    # hat of 1/56 is met between two of them
    if true > 4 * NOISE:
        assert got["surround_inhibition"][-1] == pytest.approx(true, abs=4 * NOISE)
    stress = pressed(frame_under(body, (9, 9), depth, "stress"))
    none = run(fast, edges.bind(depth=depth, reads="stress"), stress, ["surround_inhibition"])
    assert none["surround_inhibition"][-1] < 5 * NOISE
    wide = frame_under(Disc(2.0), (9, 9), depth, "strain")
    got = run(fast, edges.bind(depth=depth), pressed(wide), ["surround_inhibition"])
    assert got["surround_inhibition"][-1] == pytest.approx(-wide.min() / wide.max(), abs=4 * NOISE)
    assert got["surround_inhibition"][-1] > 0.05
