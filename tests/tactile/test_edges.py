"""Edges: the waves by their transform, and outlines of indenters under a cover."""

import numpy as np
import pytest
from scipy.fft import dctn, idctn

from cnnum.tactile.halfspace import SurfaceToDepth
from cnnum.templates.tactile.edges import edges


def diffused(field, time):
    squares = [2 - 2 * np.cos(np.pi * np.arange(n) / n) for n in field.shape]
    fading = np.exp(-time * (squares[0][:, None] + squares[1][None]))
    return idctn(dctn(field, norm="ortho") * fading, norm="ortho")


def pressed(load, noise=1e-4, seed=0):
    """Frames of rest and then of a load, with the sign of stress."""
    frames = noise * np.random.default_rng(seed).normal(size=(20, *load.shape, 3))
    frames[18:, ..., 2] -= load
    return frames


@pytest.mark.parametrize("shape", [(4, 4), (8, 8), (16, 16)])
def test_edges_are_where_the_waves_differ(engine, run, shape):
    if engine.name == "reference" and shape != (8, 8):
        pytest.skip("the reference solves every threshold anew; one shape of it is enough")
    load = np.zeros(shape)
    load[1:3, 1:] = 1.0
    frames = pressed(load)
    got = run(engine, edges, frames)
    seen = -(frames[-1] - frames[:18].mean(axis=0))[..., 2]
    difference = diffused(seen, 0.125) - diffused(seen, 0.5)
    level = 0.1 * seen.max()
    # cells within 3 % of the level may fall on either side
    sure = np.abs(difference - level) > 0.03 * level
    found = got["edges"][-1] > 0
    np.testing.assert_array_equal(found[sure], (difference > level)[sure])
    assert found.any()
    assert got["edge_count"][-1] == found.sum()
    row, column = np.nonzero(found)
    assert got["edge_row"][-1] == pytest.approx(row.mean(), abs=1e-4)
    assert got["edge_column"][-1] == pytest.approx(column.mean(), abs=1e-4)
    assert not got["edges"][:18].any()


def stress_under(pressure, depth):
    traction = np.zeros((*pressure.shape, 3))
    traction[..., 2] = pressure
    return -SurfaceToDepth(pressure.shape, 1.0, depth)(traction)[..., 2]


def place(cells):
    axis = np.arange(cells) - (cells - 1) / 2
    return axis[:, None], axis[None, :]


def test_a_rectangle_has_its_rim_and_no_inside(opencl, run):
    """Under a cover half a cell thick, edges lie on the outermost ring of the load.

    Only next to its four corners, where the load bends both ways, one taxel more may be an edge.
    """
    load = np.zeros((24, 24))
    load[6:18, 5:19] = 1.0
    found = run(opencl, edges, pressed(stress_under(load, 0.5)), ["edges"])["edges"][-1] > 0
    inner = np.zeros_like(found)
    inner[7:17, 6:18] = True
    rim = (load > 0) & ~inner
    corners = np.zeros_like(found)
    corners[np.ix_([7, 16], [6, 17])] = True
    assert found[rim].all()
    assert not found[~(rim | corners)].any()


def test_a_sphere_has_no_edge(opencl, run):
    """Hertz's pressure, 8 cells in radius, bends little anywhere under half a cell of cover."""
    y, x = place(24)
    sphere = np.sqrt(np.maximum(0.0, 1.0 - (x**2 + y**2) / 64.0))
    punch = (x**2 + y**2 < 64.0).astype(float)
    smooth = run(opencl, edges, pressed(stress_under(sphere, 0.5)), ["edge_count"])
    sharp = run(opencl, edges, pressed(stress_under(punch, 0.5)), ["edge_count"])
    assert smooth["edge_count"][-1] == 0
    assert sharp["edge_count"][-1] >= 24
