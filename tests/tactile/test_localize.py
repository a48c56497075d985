"""Bumps: loads by the finite-element coefficients, and every contact set apart."""

import numpy as np
import pytest
from scipy import ndimage

from cnnum.engine import Engine
from cnnum.errors import PhysicsError, UnknownNameError
from cnnum.tactile.bump_loads import bump_readings
from cnnum.tactile.cover import BumpCover
from cnnum.tactile.pad import Pad
from cnnum.templates.tactile.localize import localize, unmix

COVERS = {"strain": (7.5, 1.0), "stress": (6.0, 1.0), "pad": (3.0, 0.5)}
"""Bump pitch and depth of the taxels, in bump radii."""

ENGINES = (("reference", 4), ("opencl", 8), ("numba", 10))
"""And the side of the array that all kinds of taxels are tested on."""

EIGHT = np.ones((3, 3))


def streamed(readings, noise, seed=0):
    """Rest, then readings; noise as a share of the largest reading of each stream."""
    rng = np.random.default_rng(seed)
    top = np.abs(readings).max(axis=(-3, -2, -1), keepdims=True)
    drawn_noise = rng.standard_normal((21, *readings.shape), dtype=np.float32)
    frames = drawn_noise * (noise * np.where(top > 0, top, 1.0)).astype(np.float32)
    frames[18:] += readings
    return frames


def program_for(taxels):
    pitch, depth = COVERS[taxels]
    return localize.bind(taxels=taxels, bump_pitch=pitch, bump_depth=depth, push=1.0)


def drawn(touched, seed=1):
    """Loads of 0.4 to 1 on touched bumps, dragged within a friction of 0.6."""
    rng = np.random.default_rng(seed)
    normal = np.where(touched, rng.uniform(0.4, 1.0, touched.shape), 0.0)
    ratio, way = rng.uniform(0, 0.6, touched.shape), rng.uniform(0, 2 * np.pi, touched.shape)
    parts = (ratio * np.cos(way), ratio * np.sin(way), np.ones(touched.shape))
    return np.stack([normal * part for part in parts], axis=-1)


@pytest.mark.parametrize(
    ("name", "cells", "taxels"),
    [
        *((name, cells, taxels) for name, cells in ENGINES for taxels in COVERS),
        ("opencl", 4, "stress"),
        ("opencl", 16, "pad"),
    ],
)
def test_own_loads_come_back(run, name, cells, taxels):
    """Every kind of taxels on every engine, and every size on OpenCL.

    Taxels change nothing of a program but its weights: other sizes need no more than one kind.
    """
    engine, shape = Engine(name), (cells, cells)
    touched = np.random.default_rng(5).random(shape) < 0.3
    own = drawn(touched)
    frames = streamed(bump_readings(own, taxels, *COVERS[taxels]), 2e-3)
    got = run(engine, program_for(taxels), frames)
    np.testing.assert_array_equal(got["bump_contact"][-1] > 0, touched)
    assert got["bump_count"][-1] == touched.sum()
    for k, name in enumerate(("bump_load_x", "bump_load_y", "bump_load_normal")):
        # the inverse is cut at 3 bumps (2 %); shear is read with 3 times less gain than normal
        # load. So 0.2 % of noise in the largest reading is 4 standard deviations of 1 %
        assert np.abs(got[name][-1] - own[..., k]).max() < (0.03 if k == 2 else 0.08)
    label, count = ndimage.label(touched, EIGHT)
    assert got["bump_patches"][-1] == count
    for patch in range(1, count + 1):
        mine = label == patch
        assert len(np.unique(got["bump_patch"][-1][mine])) == 1
        centre = ndimage.center_of_mass(own[..., 2], label, patch)
        where = got["bump_patch_row"][-1][mine], got["bump_patch_column"][-1][mine]
        np.testing.assert_allclose([w.mean() for w in where], centre, atol=0.05)
        assert max(np.ptp(w) for w in where) == 0
    assert not got["bump_contact"][:18].any()


@pytest.mark.one_in(2)
@pytest.mark.parametrize("taxels", COVERS)
def test_every_pattern_of_contacts_is_reported(fast, run, taxels):
    """All 65,535 patterns of 4×4 bumps: each touched bump found, each free one left free.

    So contacts with one free bump between them are always two.
    """
    bits = np.arange(1, 1 << 16)[:, None] >> np.arange(16) & 1
    touched = bits.reshape(-1, 4, 4) > 0
    readings = bump_readings(drawn(touched), taxels, *COVERS[taxels])
    frames = streamed(readings, 2e-3)
    got = run(fast, program_for(taxels), frames, ["bump_contact", "bump_patches"])
    np.testing.assert_array_equal(got["bump_contact"][-1] > 0, touched)
    stacked = np.zeros((3, 3, 3))
    stacked[1] = 1.0  # patterns are apart along the first axis
    label, total = ndimage.label(touched, stacked)
    pattern = np.zeros(total + 1, dtype=np.intp)
    pattern[label] = np.arange(len(touched))[:, None, None]
    count = np.bincount(pattern[1:], minlength=len(touched))
    np.testing.assert_array_equal(got["bump_patches"][-1], count)


@pytest.mark.parametrize(("cells", "bumps"), [(9, 4), (21, 10)])
def test_a_pad_of_pressure_taxels(fast, run, cells, bumps):
    """From every pressure taxel's own stress to the bumps: (6.2) in between."""
    own = drawn(np.random.default_rng(2).random((bumps, bumps)) < 0.3)
    at = np.stack(np.meshgrid(1.5 * np.arange(cells), 1.5 * np.arange(cells)), axis=-1)
    pressure = np.zeros((cells, cells))
    for row, col in np.argwhere(own[..., 2] > 0):
        bump = [0.75 + 3.0 * col, 0.75 + 3.0 * row]
        pressure -= BumpCover(0.5, 1.0, 1.0, origin=tuple(bump)).stress(bump, at, own[row, col])[
            ..., 2
        ]
    read = Pad.regular((cells, cells)).to_three_axial(pressure)
    got = run(fast, program_for("pad"), streamed(read, 2e-3))
    np.testing.assert_array_equal(got["bump_contact"][-1] > 0, own[..., 2] > 0)
    for k, name in enumerate(("bump_load_x", "bump_load_y", "bump_load_normal")):
        # as above
        assert np.abs(got[name][-1] - own[..., k]).max() < 0.05


def test_without_unmixing_a_neighbour_would_pull(fast, run):
    """One pressed bump leaves its neighbours a shear reading of 23 % of a drag's own."""
    own = np.zeros((8, 8, 3))
    own[4, 4, 2] = 1.0
    read = bump_readings(own, "strain", 3.0, 1.0)
    assert np.abs(read[4, 5, 0]) > 0.2 * 0.044
    bound = localize.bind(bump_pitch=6.0, push=1.0)
    got = run(fast, bound, streamed(bump_readings(own, "strain", 6.0, 1.0), 1e-3))
    assert got["bump_count"][-1] == 1
    assert abs(got["bump_load_x"][-1]).max() < 0.05


def test_bumps_that_cannot_be_distinguished_are_refused():
    with pytest.raises(PhysicsError, match="separated"):
        unmix("strain", 2.0, 4.0)
    with pytest.raises(UnknownNameError, match="taxels"):
        unmix("volts")  # type: ignore[arg-type]
