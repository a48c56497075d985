"""The rough faces that scoring drags are those of tamaas."""

from importlib import resources
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("tamaas", reason="tamaas is not installed (extra 'oracles')")


@pytest.fixture(scope="module")
def solver():
    spec = spec_from_file_location("rough_faces", Path(__file__).parent / "rough_faces.py")
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_shipped_faces_are_those_of_tamaas(solver):
    with (
        resources.files("cnnum.lab.scoring.families").joinpath("rough_faces.npz").open("rb") as file
    ):
        shipped = dict(np.load(file))
    made = solver.table(faces=1)
    for name in ("approach", "stiffness"):
        np.testing.assert_allclose(shipped[name][:1], made[name], rtol=1e-5)
    # half floats of shares of the largest pressure: 2⁻¹¹
    np.testing.assert_allclose(shipped["pressed"][:1], made["pressed"], atol=1e-3)
    np.testing.assert_array_equal(shipped["loads"], made["loads"])


def test_a_smooth_face_has_the_stiffness_of_a_flat_punch(solver):
    """Of a square punch it is 1.012 times that of the circle of its area (King 1987)."""
    at = np.abs(((np.arange(solver.POINTS) + 0.5) / solver.POINTS - 0.5) * solver.SIDE)
    smooth = np.where(np.maximum(at[:, None], at) < solver.HALF, 0.0, -1e-3)
    _, approach = solver.solved(smooth, solver.LOAD)
    radius = 2.0 * solver.HALF / np.pi**0.5
    # 88 points a side, and a pressure without bound at the rim: half a point each is 1 %
    stiffness = solver.LOAD / (2.0 * solver.MODULUS * radius * approach)
    assert stiffness == pytest.approx(1.012, rel=0.02)
