"""Finite elements of the bump: patch test, equilibrium, energy, symmetry, limits, convergence."""

import numpy as np
import pytest
from scipy import sparse
from scipy.sparse.linalg import spsolve

from cnnum.errors import PhysicsError
from cnnum.tactile import halfspace
from cnnum.tactile.cover import plane_figures
from cnnum.tactile.cover.bump import STRETCH, load_arrays, load_tables

pytest.importorskip("skfem", reason="finite elements are in the extra 'fem'")

from cnnum.tactile.cover.fem.body import make_body
from cnnum.tactile.cover.fem.generate import regenerate
from cnnum.tactile.cover.fem.geometry import (
    DRAGGED,
    PLANE,
    PUSHED,
    Hooke,
    Shape,
    full_section,
    half_section,
)
from cnnum.tactile.cover.fem.plate import cap, make_bodies, make_plane_bump, move, press

SMALL = Shape(3.0, 1.0, growth=1.4)
CORNER = np.sin(np.pi / 8)
"""Radius of a patch whose rim is a corner of every mesh of even fineness."""


@pytest.fixture(scope="module")
def deep():
    return make_bodies(Shape(150.0, 150.0, growth=1.15), 8)


@pytest.fixture(scope="module")
def plane():
    return make_plane_bump(8, indentations=(0.05, 0.15, 0.25, 0.35, 0.5))


def solved_with_rim(body, field):
    """Hold a displacement field (n, 2) -> (fields, n) on the whole outline, solve the inside."""
    values = field(*body.nodes.T)
    count = values.shape[1]
    rim = body.space.displacement.get_dofs().all()
    held = np.concatenate([n * count + rim for n in range(len(values))])
    x = np.zeros(body.system.shape[0])
    x[held] = values.reshape(-1)[held]
    inside = np.setdiff1d(np.arange(len(x)), held)
    system = sparse.csr_array(body.system)
    right = -(system @ x)[inside]
    x[inside] = spsolve(sparse.csc_array(system[inside][:, inside]), right)
    return x, values


@pytest.mark.parametrize(
    ("section", "mesh", "field", "stress"),
    [
        (
            PLANE,
            full_section,
            lambda x, z: np.stack([0.3 * x + 0.2 * z, 0.1 * x - 0.4 * z]),
            # plane stress, ν = 0.3: (ε_xx + ν ε_zz)/(1 - ν²) and so on
            {"rr": 0.18 / 0.91, "zz": -0.31 / 0.91, "rz": 0.3 / 2.6},
        ),
        (
            PUSHED,
            half_section,
            lambda r, z: np.stack([0.1 * r, -0.3 * z]),
            # Hooke, ν = 0.3: λ = 0.3/0.52, 2G = 1/1.3, div u = -0.1
            {
                "rr": -0.1 * 0.3 / 0.52 + 0.1 / 1.3,
                "tt": -0.1 * 0.3 / 0.52 + 0.1 / 1.3,
                "zz": -0.1 * 0.3 / 0.52 - 0.3 / 1.3,
                "rz": 0.0,
            },
        ),
        (
            DRAGGED,
            half_section,
            lambda r, z: np.stack([1 + 0.2 * z, 0 * r, 0.4 * r]),
            # u_x = 1 + 0.2 z, u_z = 0.4 x: a shear of 0.6 along x, (cos θ, -sin θ) around
            {"rr": 0.0, "tt": 0.0, "zz": 0.0, "rz": 0.6 / 2.6, "rt": 0.0, "tz": -0.6 / 2.6},
        ),
    ],
)
def test_patch(section, mesh, field, stress):
    """A linear field is met exactly, on curved and distorted cells alike."""
    body = make_body(mesh(SMALL, 4), Hooke(section, 0.3))
    solution, wanted = solved_with_rim(body, field)
    np.testing.assert_allclose(solution[: wanted.size], wanted.reshape(-1), atol=1e-11)
    for name, values in body.stresses(solution).items():
        np.testing.assert_allclose(values, stress[name], atol=1e-10, err_msg=name)


def test_reaction_is_the_integral_of_traction_at_any_depth(deep):
    rho = np.concatenate([np.linspace(0, 8, 401), np.geomspace(8, 149, 400)[1:]])
    for depth in (0.5, 1.0, 2.0):
        zz, _, _, dragged, rz, tz, _ = deep.profiles(depth, rho)
        # smoothing and the trapezoid rule leave 1e-3; 1e-4 goes to the far sides of the block
        assert np.trapezoid(2 * np.pi * rho * zz, rho) == pytest.approx(-1, abs=2e-3)
        assert np.trapezoid(np.pi * rho * (rz - tz), rho) == pytest.approx(-1, abs=4e-3)
        # the moment fades slowest: the sides, 150 radii away, take about depth/150 of it
        moment = -np.trapezoid(np.pi * rho**2 * dragged, rho)
        assert moment == pytest.approx(deep.lever + depth, rel=0.03)


def test_energy_is_half_the_work(deep):
    for body, movement in ((deep.pushed, deep.press), (deep.dragged, deep.drag)):
        energy = body.energy(movement.solution)
        assert energy == pytest.approx(movement.stiffness / 2, rel=1e-9)  # of the solver


def test_reciprocity(deep):
    """Betti: a sideways force moves the cover down as much as a downward force moves it aside."""
    body = deep.pushed
    nodes = cap(body, 0.6)[1:6]
    count = len(body.nodes)
    unknowns = np.concatenate([nodes, count + nodes])
    compliance = body.compliance(unknowns)
    np.testing.assert_allclose(compliance, compliance.T, atol=1e-9 * compliance.max())
    assert np.abs(compliance[:5, 5:]).max() > 1e-3 * compliance.max()


def test_far_below_only_the_force_counts(deep):
    """The stress tends to Boussinesq's; the rest falls as 1/z, and is extrapolated away."""
    depths = np.array([12.0, 24.0])
    shares = []
    for depth in depths:
        got = deep.profiles(depth, np.array([0.0, depth / 2]))[:2]
        point = halfspace.stress([0.0, depth / 2], 0.0, depth, [0, 0, 1.0])
        shares.append(
            [got[0, 0] / point[0, 2, 2], got[0, 1] / point[1, 2, 2], got[1, 1] / point[1, 0, 2]]
        )
    # twice the finer minus the coarser; 1/z² terms and 2 % of the sides' effect remain
    np.testing.assert_allclose(2 * np.array(shares[1]) - shares[0], 1, atol=0.03)


def test_plane_bump_far_below_is_flamant():
    """Line load, and the couple of a drag that acts above the surface."""
    body = make_body(full_section(Shape(900.0, 900.0, growth=1.15), 4), Hooke(PLANE, 0.499))
    nodes, count = cap(body, CORNER), len(body.nodes)
    places = np.array([[4.0, 12.0], [-12.0, 12.0], [2.0, 12.0]])
    for direction, force in (((0, 1.0), [0, 0, 1.0]), ((1.0, 0), [1.0, 0, 0])):
        moved = move(body, nodes, direction)
        forces = np.zeros(2 * count)
        forces[moved.unknowns] = moved.forces / moved.stiffness
        lever = forces[count:] @ body.nodes[:, 0] - forces[:count] @ body.nodes[:, 1]
        stress = body.stresses(moved.solution)
        got = body.space.smoothed(np.stack([stress["rz"], stress["zz"]]), places)

        def line(shift, load):
            field = halfspace.line_load_stress(places[:, 0] - shift, 12.0, load)
            return np.stack([field[:, 0, 2], field[:, 2, 2]])

        wanted = line(0, force) + line(0.5, [0, 0, lever]) + line(-0.5, [0, 0, -lever])
        # the bump's spread is (1/12)² of the distance, its sideways push another 1/12, the
        # sides are 75 depths away
        error = np.abs(got / moved.stiffness - wanted).max() / np.abs(wanted).max()
        assert error < 0.04


def test_stiffness_converges_from_above():
    """Displacement elements are too stiff; refining halves the error at least (corners: r^0.5)."""
    values = []
    for fineness in (4, 8, 16):
        body = make_body(half_section(SMALL, fineness), Hooke(PUSHED, 0.5))
        values.append(move(body, cap(body, CORNER), (0.0, 1.0)).stiffness)
    coarse, fine = values[0] - values[1], values[1] - values[2]
    assert coarse > 0
    assert fine > 0
    assert np.log2(coarse / fine) > 0.85  # the rim of a bonded patch allows order 1
    assert fine / values[2] < 0.01


def test_nothing_locks_near_incompressibility():
    """The stiffness is continuous up to ν = 0.5: between 0.49 and 0.5 it moves by percents."""
    values = []
    for poisson in (0.49, 0.4999, 0.5):
        body = make_body(half_section(SMALL, 4), Hooke(PUSHED, poisson))
        values.append(move(body, cap(body, CORNER), (0.0, 1.0)).stiffness)
    assert values[0] < values[1] < values[2]
    assert values[2] / values[0] < 1.1
    assert values[2] / values[1] < 1.001


def test_plane_bump_is_symmetric_and_balanced(plane):
    pressed, dragged = plane.solutions()
    x = np.linspace(-9.9, 9.9, 397)
    line = np.stack([x, np.ones_like(x)], axis=-1)
    for solution, signs, force in (
        (pressed, (-1, 1), [0, plane.working.force]),
        (dragged, (1, -1), [0.25 * plane.drag.stiffness, 0]),
    ):
        u = plane.displacement(solution, line)
        np.testing.assert_allclose(u[:, ::-1], np.array(signs)[:, None] * u, atol=1e-10)
        stress = plane.stress(solution, line)
        total = -np.trapezoid(stress, x)
        # the trapezoid rule and smoothing: 1e-3 of the force
        np.testing.assert_allclose(total, force, atol=2e-3 * np.abs(force).max())


def test_plate_neither_pulls_nor_overlaps():
    body = make_body(half_section(Shape(10.0, 10.0, growth=1.3), 8), Hooke(PUSHED, 0.5))
    count = len(body.nodes)
    rim = cap(body, 0.95)
    forces, widths = [], []
    for contact in press(body, [0.05, 0.1, 0.15, 0.2, 0.25]):
        down = body.nodes[rim, 1] + contact.solution[count + rim]
        plate = -1 + contact.indentation
        assert down.min() > plate - 1e-9
        assert np.abs(down[np.isin(rim, contact.nodes)] - plate).max() < 1e-9
        forces.append(contact.force)
        widths.append(body.nodes[contact.nodes, 0].max())
    assert (np.diff(widths) >= 0).all()
    # Hertz on a rigid plate, 16/9 E √R δ^1.5, less the strain of the bump and the block
    hertz = 16 / 9 * np.array([0.05, 0.1, 0.15, 0.2, 0.25]) ** 1.5
    assert (np.asarray(forces) < 1.02 * hertz).all()
    assert (np.asarray(forces) > 0.75 * hertz).all()


def test_shipped_plane_figures_come_from_this(plane):
    shipped = plane_figures()
    places = np.array([[0.0, 1.0], [1.3, 1.0]])
    pressed, dragged = plane.solutions()
    middle = shipped.x.size // 2
    edge = int(np.argmin(np.abs(shipped.x - 1.3 * 0.2e-3)))
    for row, solution in enumerate((pressed, dragged)):
        got = 0.2e-3 * plane.displacement(solution, places)
        wanted = shipped.line[row][:, [middle, edge]]
        # half as fine a mesh, and a contact whose edge moves by a cell
        np.testing.assert_allclose(got, wanted, atol=0.04 * np.abs(wanted).max())


@pytest.mark.in_full("test_reaction_is_the_integral_of_traction_at_any_depth")
def test_a_coarse_regeneration_agrees_with_the_shipped_tables():
    coarse = regenerate(fineness=8, depths=(1.0, 2.0), growth=1.1, plane_fineness=4)
    assert set(coarse) == set(load_arrays())
    shipped = load_tables()
    rows = [int(np.flatnonzero(np.isclose(shipped.depths, d))[0]) for d in (1.0, 2.0)]
    assert coarse["lever"] == pytest.approx(shipped.lever, rel=0.01)
    near = STRETCH < 4
    for name in ("half_space", "rigid_base"):
        got, wanted = coarse[name][..., near], getattr(shipped, name)[rows][..., near]
        scale = np.abs(wanted).max(axis=-1)
        error = np.abs(got - wanted).max(axis=-1) / scale
        keep = [0, 1, 3, 4, 5] if name == "rigid_base" else list(range(7))
        # cells grow twice as fast: 3 % of each profile's largest value
        assert error[:, keep].max() < 0.03, name


def test_refuses_nonsense():
    with pytest.raises(PhysicsError, match="fineness"):
        half_section(SMALL, 2)
    with pytest.raises(PhysicsError, match="fillet"):
        Shape(3.0, 1.0, fillet=0.7)
    with pytest.raises(PhysicsError, match="indentations"):
        make_plane_bump(4, indentations=(0.1,))
