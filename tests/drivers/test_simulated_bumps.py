"""The cover "bumps-fem" of the simulated array."""

import numpy as np
import pytest

from cnnum.drivers.simulated.array import SimulatedOptions
from cnnum.drivers.simulated.bumps import bumps_fem_influence
from cnnum.drivers.simulated.cover import Layout, bumpy_influence
from cnnum.errors import PhysicsError
from cnnum.tactile.cover import BumpCover

LAYOUT = Layout((3, 4), 1.5e-3)
COVER = (1e-3, 0.87e6, 0.6e-3)


def test_every_cell_of_a_square_loads_its_bump() -> None:
    influence = bumps_fem_influence(LAYOUT, *COVER)
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


def test_pressure_reads_nearly_as_under_an_even_foot() -> None:
    """The two models share the force; the foot's spread of it counts at depth by tens of
    percent."""
    fem, even = bumps_fem_influence(LAYOUT, *COVER), bumpy_influence(LAYOUT, *COVER)
    below = [table[1, 1, 12, 12, 2, 2] for table in (fem, even)]
    beside = [table[1, 1, 12, 17, 2, 2] for table in (fem, even)]
    assert 0.6 < below[0] / below[1] < 1.1
    assert np.abs(beside).max() < 0.05 * np.abs(below).min()


def test_a_scene_can_have_it() -> None:
    frames = [
        next(SimulatedOptions(cover=cover, noise=0.0, offset=0.0).open().frames()).values
        for cover in ("bumps-fem", "bumpy")
    ]
    assert np.isfinite(frames[0]).all()
    assert frames[0].shape == frames[1].shape
    with pytest.raises(PhysicsError, match="bump radii"):
        SimulatedOptions(cover="bumps-fem", thickness=0.2e-3).open()
