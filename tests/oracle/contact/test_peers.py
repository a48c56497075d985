"""Hertz and Cattaneo–Mindlin against a contact solver that knows neither: tamaas.

Its normal solver presses a paraboloid on a half-space with free boundaries. Partial slip is put
together of two of its solutions by Ciavarella's and Jäger's principle, q = μ (p(P) − p(P − Q/μ)).
"""

import numpy as np
import pytest

from cnnum.arrays import Floats
from cnnum.tactile import contact

tamaas = pytest.importorskip("tamaas")

CELLS, SIDE, SPHERE, MODULUS, LOAD, FRICTION = 96, 3e-3, 5e-3, 1.0e6, 0.05, 0.5


def places() -> Floats:
    """Distance of every cell from the middle of the map, (CELLS, CELLS), m."""
    at = (np.arange(CELLS) - CELLS / 2) * SIDE / CELLS
    return np.hypot(*np.meshgrid(at, at))


def solved(load: float) -> Floats:
    """Return the pressure that tamaas finds under a sphere, Pa."""
    model = tamaas.Model(tamaas.model_type.basic_2d, [SIDE, SIDE], [CELLS, CELLS])
    model.E, model.nu = MODULUS, 0.0  # so that E* = E
    tamaas.ModelFactory.registerNonPeriodic(model, "dcfft")
    solver = tamaas.PolonskyKeerRey(model, -(places() ** 2) / (2 * SPHERE), 1e-12)
    solver.setIntegralOperator("dcfft")
    solver.solve(load / SIDE**2)
    return np.array(model.traction)


def test_hertz_agrees_with_tamaas() -> None:
    sphere = contact.hertz(LOAD, SPHERE, MODULUS)
    found, rho = solved(LOAD), places()
    a, p0 = float(sphere.contact_radius), float(sphere.peak_pressure)
    # 20 cells a radius: the peak is found to their curvature, the rim to a cell
    assert found.max() == pytest.approx(p0, rel=2e-3)
    inside = rho < a - 2 * SIDE / CELLS
    error = np.abs(found - sphere.pressure(rho))[inside]
    assert np.sqrt(np.mean(error**2)) < 3e-3 * p0
    assert not found[rho > a + 2 * SIDE / CELLS].any()


@pytest.mark.parametrize("share", [0.3, 0.5, 0.8])
def test_partial_slip_agrees_with_two_solutions_of_tamaas(share: float) -> None:
    sphere = contact.hertz(LOAD, SPHERE, MODULUS)
    slip = contact.partial_slip(sphere, LOAD, share * FRICTION * LOAD, FRICTION)
    expected = FRICTION * (solved(LOAD) - solved(LOAD * (1 - share)))
    rho, cell = places(), SIDE / CELLS
    # cells are cut at the two rims; away from them the solver's own error at 64 cells a side is
    # 1.9e-3 of the largest traction. It halves with the cell
    near = np.abs(rho - sphere.contact_radius) < 2 * cell
    near |= np.abs(rho - slip.stick_radius) < 2 * cell
    error = (slip.traction(rho) - expected)[~near]
    largest = FRICTION * float(sphere.peak_pressure)
    assert np.sqrt(np.mean(error**2)) < 3e-3 * largest
