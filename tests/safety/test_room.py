"""Arrays that never fit into memory are refused in one sentence, before any of them is made."""

import tracemalloc

import numpy as np
import pytest

import cnnum
from cnnum.errors import SizeError
from cnnum.graph.nodes import RunSpec, Transient
from cnnum.integrators.choice import choose

HUGE = (10_000_000, 10_000_000)
"""Cells of which one number each takes 800,000 GB, more than any machine has."""

LITTLE = 50_000_000
"""Bytes: less than one number for each cell of the smaller side."""


@cnnum.program
def averaged(frame):
    return {"a": cnnum.apply(cnnum.get_template("AVERAGE"), input=frame.normal)}


def refused(call):
    """Return the sentence of the error that a call ends with, which takes little memory."""
    tracemalloc.start()
    try:
        with pytest.raises(SizeError) as caught:
            call()
        assert tracemalloc.get_traced_memory()[1] < LITTLE
    finally:
        tracemalloc.stop()
    assert isinstance(caught.value, MemoryError)
    return str(caught.value)


@pytest.mark.parametrize("name", ["opencl", "numba", "reference"])
def test_array_larger_than_the_machine_is_refused(name):
    engine = cnnum.Engine(name)
    sentence = refused(lambda: engine.compile(averaged, HUGE))
    assert "10000000×10000000 cells" in sentence
    assert "1,600,000 GB" in sentence  # a channel and a map, eight bytes a cell


@pytest.mark.parametrize(
    ("name", "needed"), [("AVERAGE", "5,600,000 GB"), ("CCD_DIAG", "8,000,002 GB")]
)
def test_rates_that_do_not_fit_are_refused(name, needed):
    """56 bytes a mode of a boundary; 80 a mode of the torus that a fixed rim is a part of."""
    template = cnnum.get_template(name)
    transient = Transient(template, template.digest, RunSpec(), False, False, False, False)
    assert needed in refused(lambda: choose(transient, HUGE))


@cnnum.program
def doubled(frame):
    return {"a": 2.0 * frame.normal}


@pytest.mark.parametrize(
    ("program", "owner"), [(doubled, "a block of the device"), (averaged, "this machine")]
)
def test_batch_larger_than_its_room_is_refused(program, owner):
    """Frames that share their memory; where they are computed they would not."""
    engine = cnnum.Engine("opencl")
    plan = engine.compile(program, (300, 300), channels=("normal",))
    frames = np.broadcast_to(np.float32(0.5), (10_000_000, 300, 300, 1))
    memory = plan.executable.new_memory(1)
    sentence = refused(lambda: plan.executable.run(frames, memory, first=True))
    assert "batch of 10000000 frame(s)" in sentence
    assert owner in sentence
