"""Half-space by diffusion waves: the lattice's own transform, and the continuum."""

import numpy as np
import pytest
from scipy.fft import dctn, idctn

from cnnum.engine import Engine
from cnnum.errors import ProgramError
from cnnum.tactile.halfspace import SurfaceToDepth
from cnnum.templates.tactile.halfspace_strain import halfspace_strain
from cnnum.templates.tactile.halfspace_stress import error_of, halfspace_stress, read_out_times


def filtered(field, response):
    """Apply a filter of k to a map that goes on mirrored (DCT-II)."""
    squares = [2 - 2 * np.cos(np.pi * np.arange(n) / n) for n in field.shape]
    k = np.sqrt(squares[0][:, None] + squares[1][None])
    return idctn(dctn(field, norm="ortho") * response(k), norm="ortho")


def along_x(field):
    padded = np.pad(field, ((0, 0), (1, 1)), mode="edge")
    return (padded[:, 2:] - padded[:, :-2]) / 2


def along_y(field):
    return along_x(field.T).T


def bend_x(field):
    padded = np.pad(field, ((0, 0), (1, 1)), mode="edge")
    return padded[:, 2:] - 2 * padded[:, 1:-1] + padded[:, :-2]


def expected(load, z):
    q_x, q_y, p = np.moveaxis(load, -1, 0)

    def harmonic(u):
        return filtered(u, lambda k: np.exp(-k * z))

    def potential(u):
        return filtered(u, lambda k: np.where(k > 0, np.exp(-k * z) / np.maximum(k, 1e-300), 0.0))

    spread = along_x(potential(q_x)) + along_y(potential(q_y))
    pushed = along_x(harmonic(q_x)) + along_y(harmonic(q_y))
    bent_x = bend_x(potential(q_x)) + along_x(along_y(potential(q_y)))
    bent_y = bend_x(potential(q_y).T).T + along_y(along_x(potential(q_x)))
    shear_x = z * (along_x(harmonic(p)) - bent_x) - harmonic(q_x)
    shear_y = z * (along_y(harmonic(p)) - bent_y) - harmonic(q_y)
    low = filtered(p, lambda k: (1 + k * z) * np.exp(-k * z))
    band = filtered(p, lambda k: k * z * np.exp(-k * z))
    stress = [shear_x, shear_y, z * pushed - low]
    strain = [shear_x, shear_y, z * pushed - spread - band]
    return stress, strain


@pytest.mark.parametrize(("shape", "z"), [((4, 4), 0.5), ((8, 8), 2 / 3), ((16, 16), 2.0)])
def test_waves_are_the_transform(shape, z):
    load = np.random.default_rng(1).normal(size=(*shape, 3))
    engine = Engine()
    stress, strain = expected(load, z)
    got = engine.compile(halfspace_stress.bind(thickness=z, pitch=1.0), shape)(load)
    for name, wanted in zip(("stress_xz", "stress_yz", "stress_zz"), stress, strict=True):
        # 1e-6 of every wave, in float32: the requirement on it, with white noise for a load
        assert np.abs(got[name] - wanted).max() <= 1e-5 * np.abs(load).max()
    if shape == (8, 8):
        program = halfspace_strain.bind(thickness=z, pitch=1.0, youngs_modulus=1.5)
        got = engine.compile(program, shape)(load)
        for name, wanted in zip(("strain_xz", "strain_yz", "strain_zz"), strain, strict=True):
            assert np.abs(got[name] - wanted).max() <= 1e-5 * np.abs(load).max()


@pytest.mark.parametrize("tolerance", [1e-3, 1e-5, 1e-7])
@pytest.mark.parametrize("depth", [0.1, 1.0, 5.0])
def test_the_stated_error_holds_and_costs_few_waves(tolerance, depth):
    times = read_out_times(depth, (8, 8), tolerance)
    slowest = 2 - 2 * np.cos(np.pi / 8)
    assert error_of(times, depth, slowest) <= tolerance
    assert len(times.values) <= 4 * -np.log10(tolerance) + 14


def test_the_lattice_nears_the_continuum_as_the_square_of_the_cell(numba):
    """A smooth load without a net force, so that the mirrored ones beyond the rim fade quickly."""
    errors = []
    for cells in (10, 20):
        h = 10.0 / cells
        place = (np.arange(cells) + 0.5) * h - 5.0
        square = place[:, None] ** 2 + place[None, :] ** 2
        load = np.zeros((cells, cells, 3))
        load[..., 2] = (1.0 - square / 3.0) * np.exp(-square / 3.0)
        program = halfspace_stress.bind(thickness=1.0, pitch=h, tolerance=1e-3)
        got = numba.compile(program, (cells, cells), ["stress_zz"])(load)["stress_zz"]
        exact = SurfaceToDepth((cells, cells), h, 1.0)(load)[..., 2]
        errors.append(np.abs(got - exact).max() / np.abs(exact).max())
    # second order is 4 in the end; at h = z/2 the h⁴ term still takes a quarter of it away
    assert 2.7 <= errors[0] / errors[1] <= 4.3
    assert errors[1] <= 0.05


@pytest.mark.parametrize(
    "options", [{"thickness": 0.0}, {"thickness": -1.0}, {"tolerance": 0.5}, {"cells": 0.5}]
)
def test_what_cannot_be_is_refused(options):
    with pytest.raises(
        ProgramError, match=r"thickness.* (above|must be)|'cells'.* must be a whole"
    ):
        halfspace_stress.bind(**options).trace((8, 8))
