"""The bumpy cover of the simulated array."""

import numpy as np
import pytest

from cnnum.drivers.simulated.array import SimulatedOptions
from cnnum.drivers.simulated.cover import Layout, bumpy_influence, flat_influence
from cnnum.errors import PhysicsError
from cnnum.tactile import halfspace
from cnnum.tactile.cover import BumpCover
from cnnum.tactile.cover.bump import load_tables

LAYOUT = Layout((3, 4), 1.5e-3)
COVER = (1e-3, 0.87e6, 0.6e-3)


def test_every_cell_of_a_square_loads_its_bump() -> None:
    influence = bumpy_influence(LAYOUT, *COVER)
    taxels, surface = LAYOUT.taxels, LAYOUT.surface
    lattice = BumpCover(*COVER, pitch=1.5e-3, origin=(taxels.x[0], taxels.y[0]))
    rng = np.random.default_rng(5)
    traction = rng.normal(size=(*surface.shape, 3))
    got = np.tensordot(influence, traction, axes=([2, 3, 4], [0, 1, 2]))
    # each cell as a force of its own, on the bump that the lattice finds for it
    cells = np.stack(np.meshgrid(surface.x, surface.y), axis=-1).reshape(-1, 1, 1, 2)
    places = np.stack(np.meshgrid(taxels.x, taxels.y), axis=-1)
    forces = traction.reshape(-1, 1, 1, 3) * surface.cell_area
    wanted = lattice.strain(cells, places, forces).sum(axis=0)
    np.testing.assert_allclose(got, wanted, atol=1e-12 * np.abs(wanted).max())


def test_a_bumps_moment_turns_the_shear_below_it() -> None:
    """A drag tips its bump. Deep below, drag and moment act as a point force and a couple at the
    foot: the force's own ε_xz is zero on the axis, and the couple's opposes the drag's.

    Under a flat cover the same drag, spread evenly, reads with its own sign.
    """
    flat = flat_influence(LAYOUT, *COVER[:2])[1, 1, 12, 12]
    assert flat[0, 0] < 0.0
    assert bumpy_influence(LAYOUT, *COVER)[1, 1, 12, 12][0, 0] > 0.0
    lever = float(load_tables().lever)
    # the patch that is held sits at 0.88 radii, and does not turn with the bump
    assert 0.5 < lever < 0.88
    deep, arm = 5.0, 0.01
    pair = np.array([0.0, 0.0, lever / (2 * arm)])
    front, back = (
        halfspace.strain(-side * arm, 0.0, deep, side * pair, youngs_modulus=1.0)[0, 2]
        for side in (1.0, -1.0)
    )
    found = BumpCover(deep, 1.0, 1.0).strain([0, 0], [0, 0], [1, 0, 0])[0]
    # the next term, of the drag's spread over the foot, is radius over depth of this one
    assert found == pytest.approx(front + back, rel=1 / deep + 0.05)


def test_plane_and_round_finite_elements_agree_on_the_sign() -> None:
    """Coarse meshes of their own, at the dissertation's 200 µm below a bump of 200 µm."""
    pytest.importorskip("skfem")
    from cnnum.tactile.cover.fem.generate import DEEP
    from cnnum.tactile.cover.fem.geometry import Shape
    from cnnum.tactile.cover.fem.plate import make_bodies, make_plane_bump

    plane = make_plane_bump(4, indentations=(0.125, 0.25))
    dragged = plane.strain(plane.solutions()[1], np.array([[0.0, 1.0]]))
    assert dragged[0, 0] > 0.0
    sheared = make_bodies(Shape(DEEP, DEEP, growth=1.2), 4).profiles(1.0, np.zeros(1))[4, 0]
    # the shipped mesh is twice as fine, and its cells grow by 5 % and not by 20
    shipped = BumpCover(1.0, 1.0, 1.0).stress([0, 0], [0, 0], [1, 0, 0])[0]
    assert sheared == pytest.approx(shipped, rel=0.15)
    assert shipped > 0.0


def test_a_scene_can_have_it() -> None:
    options = SimulatedOptions(cover="bumpy", noise=0.0, offset=0.0)
    with options.open() as array:
        assert np.isfinite(next(array.frames()).values).all()
        assert array.bumps == BumpCover(*COVER, pitch=1.5e-3)
    assert SimulatedOptions().open().bumps is None
    with pytest.raises(PhysicsError, match="bump radii"):
        SimulatedOptions(cover="bumpy", thickness=0.2e-3).open()
