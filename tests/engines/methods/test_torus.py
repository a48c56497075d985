"""The equilibrium of linear arrays on a torus, in shifts: against a dense solve of all cells."""

import math

import numpy as np
import pytest
from scipy.ndimage import correlate

from cnnum.engine import Engine
from cnnum.engines.numba import transients
from cnnum.integrators import choice
from cnnum.integrators.closed_forms import MOST_CELLS, SHIFTS, propagator
from cnnum.templates.tactile.cover_model.elastic_lattice import ElasticLattice
from cnnum.templating.network import Network
from cnnum.templating.template import Template

RNG = np.random.default_rng(11)
SWIRL = RNG.normal(size=(3, 3, 3, 3))
SWIRL *= 0.5 / np.abs(SWIRL).sum(axis=(1, 2, 3)).max()
TEMPLATES = {
    "elastic block": (ElasticLattice(8, 0.75, 0.45).template(), (8, 8)),
    "any": (
        Template("any", SWIRL, RNG.normal(size=(3, 2, 3, 3)), [0.3, 0.0, -0.4],
                 tau=[0.5, 1.0, 3.0], boundary="periodic", initial=0.2, output="linear",
                 duration="settle"),
        (19, 20),
    ),
}  # fmt: skip


@pytest.fixture(params=["numba", "opencl"])
def name(request):
    if request.param == "opencl":
        request.getfixturevalue("opencl")
    return request.param


def dense(template, inputs, biases):
    """Solve for all cells at once, in double precision."""
    drive = np.broadcast_to(template.z[:, None, None], biases.shape) + biases
    for layer, source in np.argwhere(template.B.any(axis=(2, 3))):
        kernel = template.B[layer, source]
        drive[..., layer, :, :] += correlate(
            inputs[..., source, :, :], kernel[None], mode="grid-wrap"
        )
    found = propagator(Network(template, drive.shape[-2:]), math.inf)
    assert found is not None
    return found.reach(np.zeros_like(drive), drive)


@pytest.mark.parametrize("precision", ["float32", "float64"])
@pytest.mark.parametrize("case", TEMPLATES)
def test_it_is_the_dense_solution(name, precision, case):
    template, shape = TEMPLATES[case]
    rng = np.random.default_rng(1)
    maps = {"input": rng.normal(size=(3, template.inputs, *shape))}
    biases = np.zeros((3, template.layers, *shape))
    if case == "any":
        maps |= {role: rng.normal(size=biases.shape) for role in ("bias", "state")}
        biases = maps["bias"]
    wanted = dense(template, maps["input"], biases)
    found = Engine(name, precision=precision).run(template, duration="settle", **maps)
    assert (found.method, found.reason) == ("propagator", SHIFTS)
    assert found.settled.all()
    off, largest = np.abs(found.state - wanted).max(axis=(1, 2, 3)), np.abs(wanted).max()
    # the dense solution has roundings of its own: rates of the block span three decades
    assert (off <= found.error + 1e-13 * largest).all()
    # measured: 10 roundings at most, as those of the products add up at random
    assert (off <= (30 * np.finfo(precision).eps + 1e-13) * largest).all()


@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_frames_have_the_bits_that_they_have_alone(precision, monkeypatch):
    template, shape = TEMPLATES["any"]
    maps = np.random.default_rng(2).normal(size=(9, 2, *shape))
    engine = Engine("numba", precision=precision)
    together = engine.run(template, input=maps)
    monkeypatch.setattr(transients, "CELLS_A_THREAD", 8 * 19 * 20)
    np.testing.assert_array_equal(engine.run(template, input=maps).state, together.state)
    for frame in (0, 4, 8):
        alone = engine.run(template, input=maps[frame])
        np.testing.assert_array_equal(alone.state, together.state[frame])
        assert alone.error == together.error[frame]


def test_arrays_of_more_cells_than_a_sum_takes_step(monkeypatch):
    side = math.isqrt(MOST_CELLS)
    turning = Template(
        "turning", SWIRL[0, 0], [[1.0]], boundary="periodic", output="linear", duration="settle"
    )
    larger = Engine("numba").run(turning, input=np.ones((side + 1, side)))
    assert (larger.method != "propagator", larger.settled) == (True, True)
    monkeypatch.setattr(choice, "DENSE_LIMIT", 0)
    assert Engine("numba").run(turning, input=np.ones((side, side))).reason == SHIFTS
