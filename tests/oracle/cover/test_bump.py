"""The shipped bump: equilibrium, symmetry, the far field, and the dissertation's own findings."""

import sys

import numpy as np
import pytest

from cnnum.errors import ArrayError, MissingExtraError, PhysicsError
from cnnum.tactile.cover import (
    BumpCover,
    BumpTables,
    FlatCover,
    LayerCover,
    load_tables,
    plane_figures,
)

R = 0.2e-3
E = 0.87e6
TOP = np.zeros(2)


def totals(cover, force, reach):
    """Return force and moment on the plane of the taxels, by polar Gauss points."""
    x, w = np.polynomial.legendre.leggauss(24)
    edges = np.append(0, np.geomspace(0.2, reach, 14)) * cover.depth
    half = np.diff(edges)[:, None] / 2
    rho = (edges[:-1, None] + half * (x + 1)).reshape(-1)
    weight = (half * w).reshape(-1) * rho * 2 * np.pi / 16
    angle = 2 * np.pi * np.arange(16) / 16
    places = rho[:, None, None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    stress = cover.stress(TOP, places, force)
    total = -np.einsum("rai,r->i", stress, weight)
    moment = -np.einsum("ra,raj,r->j", stress[..., 2], places, weight)
    return total, moment


@pytest.mark.parametrize("depth", [0.6, 1.0, 1.75, 3.3, 5.0])
@pytest.mark.parametrize("rigid_base", [False, True])
@pytest.mark.parametrize("force", [(0, 0, 1.0), (1.0, 0, 0), (0, 1.0, 0)])
def test_the_load_comes_back_at_taxel_depth(depth, rigid_base, force):
    cover = BumpCover(depth * R, E, R, rigid_base=rigid_base)
    total, moment = totals(cover, np.array(force), 2000.0 if not rigid_base else 60.0)
    # the tables' own error; the part beyond 2000 depths is less
    np.testing.assert_allclose(total, force, atol=0.01)
    arm = (load_tables().lever + depth) * R
    # far away the moment is that of small stress at long arms
    np.testing.assert_allclose(moment, np.asarray(force)[:2] * arm, atol=0.04 * arm)


def test_components_turn_with_the_load():
    cover = BumpCover(1.2 * R, E, R)
    rng = np.random.default_rng(1)
    taxels, force = rng.normal(size=(30, 2)) * 2 * R, rng.normal(size=3)
    angle = 0.7
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    for response in (cover.stress, cover.strain):
        straight = response(TOP, taxels, force)
        turned = response(TOP, taxels @ turn.T, [*(turn @ force[:2]), force[2]])
        # along and across are stored apart: rounding only
        scale = 1e-12 * np.abs(straight).max()
        np.testing.assert_allclose(turned[:, :2], straight[:, :2] @ turn.T, atol=scale)
        np.testing.assert_allclose(turned[:, 2], straight[:, 2], atol=scale)


@pytest.mark.parametrize("rigid_base", [False, True])
def test_scaling_and_superposition(rigid_base):
    a = BumpCover(1.5 * R, E, R, rigid_base=rigid_base)
    b = BumpCover(4.5 * R, 2 * E, 3 * R, rigid_base=rigid_base)
    taxels = np.array([[0.3, 0.1], [1.0, -2.0]]) * R
    force = np.array([0.2, -0.4, 1.0])
    np.testing.assert_allclose(
        9 * b.stress(TOP, 3 * taxels, force), a.stress(TOP, taxels, force), rtol=1e-9
    )
    np.testing.assert_allclose(
        18 * b.strain(TOP, 3 * taxels, force), a.strain(TOP, taxels, force), rtol=1e-9
    )
    parts = sum(a.stress(TOP, taxels, part) for part in np.diag(force))
    np.testing.assert_allclose(parts, a.stress(TOP, taxels, force), rtol=1e-9, atol=1e-9)


def test_below_the_middle_normal_and_shear_are_independent():
    """Fig. 6.11: at x = 0 neither load is felt as the other."""
    for rigid_base in (False, True):
        cover = BumpCover(R, E, R, rigid_base=rigid_base)
        table = cover.stress(TOP, TOP, np.eye(3))
        # rows are loads; the axis itself is 1e-7 radii away in the tables
        cross = np.abs([table[0, 2], table[1, 2], table[2, 0], table[2, 1], table[0, 1]])
        assert cross.max() < 1e-4 * np.abs(table[2, 2])


def test_far_away_the_table_meets_the_half_space():
    cover = BumpCover(R, E, R)
    seam = 16 * R
    around = np.array([[seam * (1 - 1e-6), 0], [seam * (1 + 1e-6), 0]])
    for force in np.eye(3):
        inside, outside = cover.stress(TOP, around, force)
        largest = np.abs(cover.stress(TOP, np.linspace(-4, 4, 81)[:, None] * [R, 0], force)).max()
        # mesh and block (200 radii) against a point load with its couple
        assert np.abs(inside - outside).max() < 1e-3 * largest
    far = np.array([30 * R, 5 * R])
    point = FlatCover(R, E).stress(TOP, far, [0, 0, 1.0])
    np.testing.assert_allclose(cover.stress(TOP, far, [0, 0, 1.0]), point, rtol=1e-9)


def test_a_small_bump_on_a_thick_layer_is_a_point_load():
    bump = BumpCover(5 * R, E, R, rigid_base=True)
    layer = LayerCover(5 * R, E)
    taxels = np.array([[0.0, 0], [3, 0], [5, 0], [8, 0]]) * R
    got, wanted = bump.stress(TOP, taxels, [0, 0, 1.0]), layer.stress(TOP, taxels, [0, 0, 1.0])
    # the bump pushes its foot outwards besides: one part in the depth over its radius
    assert np.abs(got - wanted).max() < 0.2 * np.abs(wanted).max()
    assert np.abs(got - wanted)[2:].max() < 0.05 * np.abs(wanted).max()


def test_incompressible_layer_strains_only_sideways_on_its_base():
    cover = BumpCover(R, E, R, rigid_base=True)
    taxels = np.array([[0.5, 0.2], [1.5, -1.0]]) * R
    stress, strain = (f(TOP, taxels, [0.3, 0.1, 1.0]) for f in (cover.stress, cover.strain))
    assert (strain[:, 2] == 0).all()
    np.testing.assert_allclose(strain[:, :2], 1.5 * stress[:, :2] / E, rtol=1e-12)


def test_the_nearest_bump_takes_the_load():
    cover = BumpCover(R, E, R, pitch=1.5e-3, origin=(0.75e-3, 0.75e-3))
    np.testing.assert_allclose(cover.touched([0.2e-3, -0.1e-3]), [0.75e-3, -0.75e-3])
    taxel, force = np.array([0.8e-3, -0.7e-3]), [0.1, 0.0, 1.0]
    near, far = np.array([0.5e-3, -0.3e-3]), np.array([0.9e-3, -1.2e-3])
    np.testing.assert_array_equal(cover.stress(near, taxel, force), cover.stress(far, taxel, force))
    beside = cover.stress([-0.2e-3, -0.3e-3], taxel, force)
    assert abs(beside[2]) < 0.05 * abs(cover.stress(near, taxel, force)[2])


def test_dissertation_plane_bump():
    """6.4.2–6.4.3: independent, "about two", extrema under the edges, "around 4", linear."""
    figures = plane_figures()
    assert figures.cross_talk < 1e-6  # single precision
    assert 1.3 < figures.normal_to_shear < 2.2  # ours 1.5 in contact, 1.7 bonded
    left, right = figures.stress_extrema
    assert left == pytest.approx(0.2e-3, abs=0.03e-3)  # the leading edge is pressed
    assert right == pytest.approx(-0.2e-3, abs=0.03e-3)
    assert figures.pad_ratio == pytest.approx(4, abs=0.5)
    assert figures.nonlinearity < 0.03
    np.testing.assert_allclose(figures.stress[1, 1], -figures.stress[1, 1, ::-1], atol=1e-2)
    np.testing.assert_allclose(figures.field[0, 1], figures.field[0, 1, :, ::-1], atol=1e-10)
    # deeper means less (6.10)
    assert (np.diff(figures.axis[0, 1]) < 0).all()
    assert (np.diff(figures.axis[1, 0]) < 0).all()


def test_refuses_what_the_tables_do_not_hold():
    with pytest.raises(PhysicsError, match="bump radii"):
        BumpCover(0.1 * R, E, R)
    with pytest.raises(PhysicsError, match="pitch"):
        BumpCover(R, E, R, pitch=R)
    tables = load_tables()
    with pytest.raises(ArrayError, match="rigid_base"):
        BumpTables(tables.depths, tables.lever, tables.half_space, tables.rigid_base[1:])
    with pytest.raises(ArrayError, match="broadcast"):
        BumpCover(R, E, R).stress(np.zeros((2, 2)), np.zeros((3, 2)), [0, 0, 1.0])


def test_nobody_needs_the_extra_to_use_the_tables(monkeypatch):
    from cnnum.tactile.cover.fem.generate import regenerate

    monkeypatch.setitem(sys.modules, "skfem", None)
    assert BumpCover(R, E, R).stress(TOP, TOP, [0, 0, 1.0])[2] < 0
    with pytest.raises(MissingExtraError, match=r"'\.\[fem\]'"):
        regenerate(fineness=4, depths=(1.0,), plane_fineness=4)
