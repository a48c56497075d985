"""Tractions on the cells of a map: exact averages, and the loads that come back from them."""

import math
from typing import Any

import numpy as np
import pytest

from cnnum.errors import ArrayError, PhysicsError
from cnnum.tactile import contact
from cnnum.tactile.grid import Grid, make_grid

SPHERE: dict[str, Any] = {"load": 0.5, "sphere_radius": 5e-3, "modulus": 1.2e6, "friction": 0.5}
A = float(contact.hertz(0.5, 5e-3, 1.2e6).contact_radius)
LIMIT = 0.25  # friction times load
TORQUE = float(contact.sliding_torque(0.5, A, 0.5))
SHAPE, SPACING, CENTRE = (40, 32), (1e-4, 1.2e-4), (2.3e-4, -1.1e-4)
# a contact over many cells, and one that lies in one
CASES = [((16, 20), (0.1, 0.12), 0.63, (0.03, -0.11)), ((8, 8), (1.0, 1.0), 0.2, (0.1, 0.3))]


def totals(traction: Any, grid: Grid, centre: tuple[float, float]) -> tuple[Any, float]:
    """Return the force and the torque about the centre that a map carries."""
    x, y = grid.x - centre[0], (grid.y - centre[1])[:, None]
    moment = (x * traction[..., 1] - y * traction[..., 0]).sum() * grid.cell_area
    return traction.sum(axis=(0, 1)) * grid.cell_area, float(moment)


@pytest.mark.parametrize("case", CASES)
def test_closed_averages_are_the_integrals(case: Any) -> None:
    shape, spacing, a, centre = case
    grid = make_grid(shape, spacing)

    def average(profile: Any) -> Any:
        return contact.cell_average(profile, grid, radius=a, centre=centre, nodes=16)

    def root(x: Any, y: Any) -> Any:
        return np.sqrt(a * a - x * x - y * y)

    # the quadrature's 16 points; near the rim a² - ρ² rounds, which the inverse root feels
    np.testing.assert_allclose(
        contact.root_average(grid, centre, a), average(root), rtol=0, atol=1e-10
    )
    np.testing.assert_allclose(
        contact.inverse_average(grid, centre, a),
        average(lambda x, y: 1 / root(x, y)),
        rtol=0,
        atol=1e-7,
    )
    twist = contact.twist_average(grid, centre, a)
    for n, field in enumerate((lambda x, y: -y / root(x, y), lambda x, y: x / root(x, y))):
        np.testing.assert_allclose(twist[..., n], average(field), rtol=0, atol=1e-7)


@pytest.mark.parametrize("case", CASES)
def test_the_whole_load_is_on_the_cells(case: Any) -> None:
    shape, spacing, a, centre = case
    grid = make_grid(shape, spacing)
    total = contact.root_average(grid, centre, a).sum() * grid.cell_area
    assert total == pytest.approx(2 / 3 * math.pi * a**3, rel=1e-12)
    total = contact.inverse_average(grid, centre, a).sum() * grid.cell_area
    assert total == pytest.approx(2 * math.pi * a, rel=1e-12)
    total = contact.cell_average(
        lambda x, y: np.sqrt(a * a - x * x - y * y), grid, radius=a, centre=centre
    ).sum()
    # twelve points over the whole disc where it lies in one cell; 1e-6 is asked for
    assert total * grid.cell_area == pytest.approx(2 / 3 * math.pi * a**3, rel=1e-8)


@pytest.mark.parametrize("case", CASES)
def test_line_integrals_give_the_stuck_twist(case: Any) -> None:
    shape, spacing, a, centre = case
    grid = make_grid(shape, spacing)
    swirl = contact.swirl_average(
        lambda rho: np.sqrt(np.maximum(a * a - rho * rho, 0.0)), grid, centre, (a,)
    )
    # ten points on an edge that all but touches the rim leave 1e-6
    np.testing.assert_allclose(swirl, contact.twist_average(grid, centre, a), rtol=0, atol=5e-6)


@pytest.mark.parametrize("centre", [(10.0, 0.0), (-10.0, 10.0), (2.0, 0.0), (1.9, -2.1)])
def test_a_twist_across_the_maps_edge(centre: tuple[float, float]) -> None:
    grid = make_grid((4, 4), 1.0)
    swirl = contact.swirl_average(
        lambda rho: np.sqrt(np.maximum(1 - rho * rho, 0.0)), grid, centre, (1.0,)
    )
    # as above, with edges that lie further from touching the rim
    np.testing.assert_allclose(swirl, contact.twist_average(grid, centre, 1.0), atol=1e-7)


@pytest.mark.parametrize("share", [0.2, 0.9, 0.999, 1.0])
def test_line_integrals_give_lubkins_twist(share: float) -> None:
    grid = make_grid((9, 9), 0.25)
    slip = contact.torsion_slip(1.0, 1.0, share * 3 * math.pi / 16, 1.0)
    swirl = contact.swirl_average(slip.potential, grid, (0.02, 0.01), (1.0, slip.stick_radius))

    def along_y(x: Any, y: Any) -> Any:
        rho = np.hypot(x, y)
        return x / rho * slip.traction(rho)

    expected = contact.cell_average(along_y, grid, radius=1.0, centre=(0.02, 0.01), nodes=120)
    # the reference crosses the kink at the stick radius: 120 points leave 1e-3 of a cell's peak
    assert np.abs(swirl[..., 1] - expected).max() < 1e-3 * slip.peak_traction
    np.testing.assert_allclose(swirl.sum(axis=(0, 1)), 0, atol=1e-12)


@pytest.mark.parametrize("angle", [0.0, 2.0, 4.5])
@pytest.mark.parametrize(
    ("share", "regime"), [(0.0, "stick"), (0.4, "partial"), (1.0, "sliding"), (2.0, "sliding")]
)
def test_force_alone_comes_back(share: float, regime: str, angle: float) -> None:
    pull = share * LIMIT * np.array([math.cos(angle), math.sin(angle)])
    traction, state = contact.sphere_traction(
        SHAPE, SPACING, **SPHERE, centre=CENTRE, tangential=tuple(pull)
    )
    force, torque = totals(traction, make_grid(SHAPE, SPACING), CENTRE)
    assert state.regime == regime
    carried = pull / max(share, 1.0)
    # closed averages: the load is conserved to rounding, 1e-6 is asked for
    np.testing.assert_allclose(force, [*carried, 0.5], rtol=0, atol=1e-13)
    # a cell's average acts at its middle: the moment is lost to order h²
    assert abs(torque) < 1e-4 * LIMIT * A
    assert state.stick_radius == pytest.approx(A * (1 - min(share, 1.0)) ** (1 / 3), rel=1e-12)
    size = np.hypot(traction[..., 0], traction[..., 1])
    assert (size <= 0.5 * traction[..., 2] * (1 + 1e-9) + 1e-9).all()


@pytest.mark.parametrize("sign", [-1, 1])
@pytest.mark.parametrize(("share", "regime"), [(0.3, "partial"), (1.5, "sliding")])
def test_torque_alone_comes_back(share: float, regime: str, sign: int) -> None:
    errors = []
    for n in (24, 48):
        traction, state = contact.sphere_traction(
            (n, n), 3 * A / n, **SPHERE, torque=sign * share * TORQUE
        )
        force, torque = totals(traction, make_grid((n, n), 3 * A / n), (0.0, 0.0))
        assert state.regime == regime
        np.testing.assert_allclose(force[:2], 0, atol=1e-12)
        errors.append(abs(torque / (sign * min(share, 1.0) * TORQUE) - 1))
    # a cell's average acts at its middle: the moment is lost to order h² or better
    assert errors[1] < 1e-4
    assert errors[1] < errors[0] / 3


@pytest.mark.parametrize("share", [0.2, 0.5, 0.8])
def test_force_and_torque_together_are_both_carried(share: float) -> None:
    pull, torque = (0.6 * share * LIMIT, -0.8 * share * LIMIT / 2), -share * TORQUE / 2
    kind = {**SPHERE, "centre": CENTRE}
    traction, state = contact.sphere_traction(
        SHAPE, SPACING, **kind, tangential=pull, torque=torque
    )
    alone, _ = contact.sphere_traction(SHAPE, SPACING, **kind, torque=torque)
    grid = make_grid(SHAPE, SPACING)
    force, moment = totals(traction, grid, CENTRE)
    assert state.regime == "partial"
    # across the pull, cells of unequal cut leave a part in a thousand
    np.testing.assert_allclose(force[:2], pull, rtol=0, atol=1e-3 * LIMIT)
    along = np.dot(force[:2], pull) / np.dot(pull, pull)
    assert along == pytest.approx(1.0, rel=1e-6)
    assert moment == pytest.approx(totals(alone, grid, CENTRE)[1], rel=1e-6)
    size = np.hypot(traction[..., 0], traction[..., 1])
    assert (size <= 0.5 * traction[..., 2] * (1 + 1e-12)).all()


@pytest.mark.parametrize("ratio", [0.1, 1.0, 10.0])
def test_sliding_with_a_twist_uses_all_friction_and_keeps_the_ratio(ratio: float) -> None:
    pull = (0.6 * LIMIT, 0.8 * LIMIT)
    traction, state = contact.sphere_traction(
        (61, 61), A / 25, **SPHERE, tangential=pull, torque=ratio * A * LIMIT
    )
    force, torque = totals(traction, make_grid((61, 61), A / 25), (0.0, 0.0))
    assert state.regime == "sliding"
    # where the pole crosses a cell's middle the sum jumps by that cell
    assert torque / math.hypot(*force[:2]) == pytest.approx(ratio * A, rel=1e-4)
    # a grid is not round, most felt by the small pull of a fast twist: up to a part in a hundred
    np.testing.assert_allclose(force[:2] / math.hypot(*force[:2]), [0.6, 0.8], rtol=1e-2)
    size = np.hypot(traction[..., 0], traction[..., 1])
    np.testing.assert_allclose(size, 0.5 * traction[..., 2], rtol=1e-9, atol=1e-9)
    # close to the ellipse through the two single loads (within a few per cent for Hertz)
    share = math.hypot(math.hypot(*force[:2]) / LIMIT, torque / TORQUE)
    assert share == pytest.approx(1.0, abs=0.05)


def test_unlimited_friction_sticks_and_carries_all() -> None:
    kind = {**SPHERE, "friction": math.inf}
    traction, state = contact.sphere_traction(
        (48, 48), A / 16, **kind, tangential=(0.2, -3.0), torque=1e-4
    )
    force, torque = totals(traction, make_grid((48, 48), A / 16), (0.0, 0.0))
    assert (state.regime, state.stick_radius) == ("stick", state.contact_radius)
    np.testing.assert_allclose(force, [0.2, -3.0, 0.5], rtol=0, atol=1e-12)
    # the moment of the rim's cells, singular traction: first order in h
    assert torque == pytest.approx(1e-4, rel=1e-2)


def test_without_friction_there_is_no_shear_and_without_load_no_contact() -> None:
    traction, state = contact.sphere_traction(
        (8, 8), 3e-4, **{**SPHERE, "friction": 0.0}, tangential=(0.1, 0.0), torque=1e-4
    )
    assert state.regime == "sliding"
    assert not traction[..., :2].any()
    traction, state = contact.sphere_traction(
        (8, 8), 3e-4, **{**SPHERE, "load": 0.0}, tangential=(0.1, 0.0)
    )
    assert (state.regime, state.contact_radius) == ("none", 0.0)
    assert not traction.any()


def test_a_contact_over_the_maps_edge_is_cut_not_changed() -> None:
    kind = {**SPHERE, "tangential": (0.1, -0.05), "torque": 0.3 * TORQUE}
    large, _ = contact.sphere_traction((60, 60), 1e-4, **kind, centre=(1.5e-3, 0.0))
    small, _ = contact.sphere_traction((40, 40), 1e-4, **kind, centre=(1.5e-3, 0.0))
    # the balance stops at 1e-9 of the loads
    np.testing.assert_allclose(small, large[10:50, 10:50], rtol=0, atol=1e-4)
    away, _ = contact.sphere_traction((8, 8), 1e-4, **kind, centre=(1.0, 0.0))
    assert not away.any()


@pytest.mark.parametrize(
    ("change", "error"),
    [
        ({"load": -1.0}, PhysicsError),
        ({"friction": -0.1}, PhysicsError),
        ({"sphere_radius": 0.0}, PhysicsError),
        ({"torque": math.inf}, PhysicsError),
        ({"tangential": (1.0, 0.0, 0.0)}, ArrayError),
        ({"spacing": -1e-4}, PhysicsError),
        ({"shape": (3,)}, ArrayError),
    ],
)
def test_bad_spheres_are_refused(change: dict[str, Any], error: type[Exception]) -> None:
    kind = {"shape": (8, 8), "spacing": 1e-4, **SPHERE} | change
    with pytest.raises(error):
        contact.sphere_traction(kind.pop("shape"), kind.pop("spacing"), **kind)
