"""Surface load from a frame: the network against dense least squares, and several contacts."""

import numpy as np
import pytest

from cnnum.bench.halfspace_figures import contacts
from cnnum.bench.halfspace_runs import inverse
from cnnum.errors import ProgramError
from cnnum.tactile.halfspace import SurfaceToDepth
from cnnum.tactile.inverse import LoadMap
from cnnum.templates.tactile.surface_load import surface_load

PITCH, THICKNESS, E, NOISE, LIKELY = 1.5e-3, 1.0e-3, 0.87e6, 1e-4, 3e3
NAMES = ("load_x", "load_y", "load_normal")


def taxels(shape):
    rows, cols = ((np.arange(n) - (n - 1) / 2) * PITCH for n in shape)
    y, x = np.meshgrid(rows, cols, indexing="ij")
    return np.stack([x.ravel(), y.ravel()], axis=-1)


def least_squares(shape):
    return LoadMap(taxels(shape), shape, PITCH, THICKNESS, E, NOISE)


def answer(engine, strain, **options):
    shape = strain.shape[-3:-1]
    program = surface_load.bind(noise=NOISE, likely=LIKELY, **options)
    got = engine.compile(program, shape)(strain)
    return np.stack([got[name] for name in NAMES], axis=-1), got["residual"]


@pytest.mark.parametrize("shape", [(4, 4), (8, 8)])
def test_the_network_is_least_squares(opencl, shape):
    strain = np.random.default_rng(2).normal(0.0, 3e-3, (2, *shape, 3))
    got, _ = answer(opencl, strain)
    wanted = least_squares(shape)(strain.reshape(2, -1, 3), LIKELY).traction
    # float32: roundings of 6e-8 times the sum of 384 products of the gain
    assert np.abs(got - wanted).max() <= 2e-4 * np.abs(wanted).max()


def two_contacts():
    """Two patches pressed and dragged apart, their strain from Love and Cerruti."""
    load = np.zeros((8, 8, 3))
    load[1:3, 1:3] = [1e3, 0.0, 8e3]
    load[5:7, 4:7] = [0.0, -2e3, 6e3]
    cover = SurfaceToDepth((8, 8), PITCH, THICKNESS, youngs_modulus=E)
    return load, cover(load)


def test_several_contacts_come_back_at_once(opencl):
    load, strain = two_contacts()
    noisy = strain + np.random.default_rng(3).normal(0.0, NOISE, strain.shape)
    got, residual = answer(opencl, noisy)
    inside = load[..., 2] > 0
    pressure = got[..., 2]
    # a uniform pressure is not seen: what is between contacts is the ground that they stand on
    ground = np.median(pressure[~inside])
    touched = pressure - ground > 3e3
    assert (touched == inside).all()
    for patch, wanted in ((np.s_[1:3, 1:3], 8e3), (np.s_[5:7, 4:7], 6e3)):
        # a resolution of about a taxel smears an eighth of a patch of two over its edge
        assert abs(pressure[patch].mean() - ground - wanted) <= 0.2 * wanted
    # as many loads as strains: the fit takes up much of the noise, and none of it beyond
    assert 0.1 <= residual <= 1.2


def test_noise_and_resolution_are_those_stated(opencl):
    rng = np.random.default_rng(4)
    got, _ = answer(opencl, rng.normal(0.0, NOISE, (400, 8, 8, 3)))
    stated = least_squares((8, 8)).noise_error(LIKELY) / 1.959964
    # 400 frames know a standard deviation to 1/√800 = 3.5 %; the worst of 192 is within four
    assert np.abs(got.std(axis=0) / stated - 1).max() <= 0.16


def test_heights_are_read_from_the_ground(opencl):
    """The contacts of docs/programs/halfspace.md, and the figures given there."""
    (_, true, _), _, (_, found, _) = contacts(opencl)
    ground = found[true == 0].mean()
    # as printed there, to its last digit
    assert ground == pytest.approx(-0.7e3, abs=50.0)
    assert found[true == 0].min() == pytest.approx(-2.1e3, abs=50.0)
    for pressure, height in ((6e3, 5.5e3), (8e3, 8.1e3), (12e3, 12.1e3)):
        assert found[true == pressure].mean() - ground == pytest.approx(height, abs=50.0)


@pytest.mark.parametrize("thickness", [0.5e-3, 1.0e-3, 1.5e-3])
def test_noise_dips_where_the_singular_values_say(opencl, thickness):
    kept = inverse(opencl, PITCH, thickness)
    cover = LoadMap(taxels((8, 8)), (8, 8), PITCH, thickness, E, NOISE)
    stated = np.reshape(cover.noise_error(LIKELY), (8, 8, 3))[4, 4, 2] / 1.959964
    # 200 frames know a standard deviation to 5 %: within two of these
    assert kept["noise"] == pytest.approx(stated, rel=0.1)


def test_a_larger_array_steps_to_the_same(opencl):
    shape = (16, 16)
    strain = np.random.default_rng(5).normal(0.0, 3e-3, (*shape, 3))
    coarse = {"noise": 1e-3, "likely": LIKELY}
    program = surface_load.bind(reach=4, tolerance=1e-5, **coarse)
    got = opencl.compile(program, shape, list(NAMES))(strain)
    cover = LoadMap(taxels(shape), shape, PITCH, THICKNESS, E, coarse["noise"])
    wanted = cover(strain.reshape(-1, 3), LIKELY).traction
    for n, name in enumerate(NAMES):
        # what lies beyond four taxels is left out, (z/r)³ = 0.4 % a cell, and the inverse of that
        assert np.abs(got[name] - wanted[..., n]).max() <= 0.12 * np.abs(wanted).max()


def test_wrong_covers_are_refused():
    with pytest.raises(ProgramError, match="above 0"):
        surface_load.bind(noise=0.0).trace((8, 8))
