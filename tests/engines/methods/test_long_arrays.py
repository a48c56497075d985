"""Long thin arrays: no method looks at a matrix whose side is the array's."""

import tracemalloc

import numpy as np
import pytest

import cnnum
from cnnum.graph.nodes import RunSpec, Transient
from cnnum.integrators.choice import choose

CELLS = 66_000
"""A matrix of this side takes 32 GiB; more cells than are looked at before they are taken."""

FEW_MAPS = 250 * 8 * CELLS
"""250 maps of float64, more than the stages of any method and of a second run that it is compared
with; one matrix of the side is 66,000."""

SHORT = 0.05
"""Time constants: the reference engine takes seconds for a longer run of these cells."""

NAMES = ("EDGE", "AVERAGE", "DIFFUS", "HOLE")


def peak_bytes(call):
    """Return the most memory that Python and NumPy held for a call."""
    tracemalloc.start()
    try:
        call()
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize("shape", [(CELLS, 1), (1, CELLS)])
@pytest.mark.parametrize("name", [*NAMES, "CCD_DIAG", "DELAYED_DIFFUSION", "AUTOWAVE"])
def test_method_is_chosen_in_the_room_of_a_few_maps(name, shape):
    """Even and uneven couplings, of fixed and zero-flux rims, with a delay and with two layers."""
    template = cnnum.get_template(name)
    transient = Transient(template, template.digest, RunSpec(), False, False, False, False)
    assert peak_bytes(lambda: choose(transient, shape)) < FEW_MAPS


@pytest.mark.one_in(3)
@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("engine", ["opencl", "numba", "reference"])
def test_long_arrays_run_as_parts_of_them_do(engine, name):
    """A picture that repeats: far from the ends a period is as in a short array."""
    period = np.where(np.random.default_rng(5).random((200, 1)) < 0.5, 1.0, -1.0)
    used, template = cnnum.Engine(engine), cnnum.get_template(name)
    short = used.run(template, input=np.tile(period, (5, 1)), duration=SHORT)
    picture = np.tile(period, (330, 1))
    if engine == "opencl":  # imports, builds and what is measured of the device are not the run's
        used.run(template, input=picture, duration=SHORT)
    found = []
    peak = peak_bytes(lambda: found.append(used.run(template, input=picture, duration=SHORT)))
    assert peak < FEW_MAPS
    np.testing.assert_allclose(found[0].state[600:800], short.state[400:600], atol=2e-3)


@pytest.mark.one_in(5)
@pytest.mark.parametrize("shape", [(CELLS, 1), (1, CELLS)])
@pytest.mark.parametrize("engine", ["opencl", "numba", "reference"])
def test_long_wave_decays_at_its_own_rate(engine, shape):
    """A cosine of n/8 half waves is a mode of a zero-flux rim: it goes by e^(g (2 cos w - 2) t)."""
    coupling, w = 0.7, np.pi / 8.0
    template = cnnum.Template(
        "diffusion",
        [[0, coupling, 0], [coupling, 1 - 4 * coupling, coupling], [0, coupling, 0]],
        boundary="zero-flux",
        output="linear",
    )
    start = np.cos(w * (np.arange(CELLS) + 0.5)).reshape(shape)
    got = cnnum.Engine(engine).run(template, state=start, duration=2.0)
    rate = coupling * (2.0 * np.cos(w) - 2.0)
    assert float(got.error) < 1e-2
    np.testing.assert_allclose(got.state, start * np.exp(2.0 * rate), atol=1e-4)


def test_reference_keeps_one_state_of_all_its_steps():
    """It works in 35 maps: the states of some 400 steps would be 400 more."""
    picture = np.where(np.random.default_rng(6).random((40, 40)) < 0.5, 1.0, -1.0)
    used, template = cnnum.Engine("reference"), cnnum.get_template("AVERAGE")
    used.run(template, input=picture, duration=0.01)  # imports are not the run's
    assert used.run(template, input=picture, duration=1.0).steps > 300
    peak = peak_bytes(lambda: used.run(template, input=picture, duration=1.0))
    assert peak / picture.nbytes < 100
