"""Whole numbers as a precision of engines: the same bits on a device and in NumPy."""

import numpy as np
import pytest

import cnnum
from cnnum.errors import ArrayError, NoOpenCLError, ProgramError, UnknownNameError
from tests.embedded.conftest import SHORT, made, streams

ENGINES = ("reference", "opencl")
FRAMES = streams((8, 8), 20)
STEP = {"q15": 2.0**-14, "q7": 2.0**-6, "q3.12": 2.0**-12}
"""Of values up to 1, with room above them; or as it is named."""


def engine(name, precision):
    try:
        return cnnum.Engine(name, precision=precision)
    except NoOpenCLError:
        pytest.skip("needs an OpenCL device")


@pytest.mark.one_in(2)
@pytest.mark.parametrize("precision", STEP)
@pytest.mark.parametrize("template", ["EDGE", "HOLE", "tactile_diffusion"])
def test_a_run_gives_the_same_bits_on_both_engines(template, precision):
    u = np.random.default_rng(1).uniform(-1.0, 1.0, (3, 8, 8))
    first, second = (engine(name, precision).run(template, input=u) for name in ENGINES)
    for what in ("output", "state", "steps", "settled", "time"):
        np.testing.assert_array_equal(getattr(first, what), getattr(second, what), what)
    if template == "tactile_diffusion":
        exact = cnnum.Engine("reference").run(template, input=u).output
        # measured: below one step; weights and sums on the way are rounded, too
        assert np.abs(first.output - exact).max() <= 2 * STEP[precision]
    assert np.isinf(first.error).all()


@pytest.mark.parametrize("precision", ["q15", "q7"])
def test_a_stream_gives_the_same_bits_on_both_engines(precision):
    program = cnnum.get_program("twist").bind(**SHORT)
    found = []
    for name in ENGINES:
        plan = engine(name, precision).compile(program, (8, 8), like=FRAMES)
        stream = plan.stream((FRAMES.shape[1],))
        found.append([stream.push(frame) for frame in FRAMES])
    for first, second in zip(*found, strict=True):
        assert first.keys() == second.keys()
        for name, values in first.items():
            np.testing.assert_array_equal(values, second[name], name)


def test_an_engine_runs_the_program_that_is_exported():
    program = cnnum.get_program("twist").bind(**SHORT)
    plan = engine("opencl", "q15").compile(program, (8, 8), like=streams((8, 8)))
    stream, exported = plan.stream((3,)), made("twist", "q15").run(FRAMES)
    for number, frame in enumerate(FRAMES):
        for name, values in stream.push(frame).items():
            np.testing.assert_array_equal(values, exported[name][number], name)


@cnnum.program
def twice(frame):
    return {"twice": 2.0 * frame.channel("normal")}


def test_a_number_beyond_the_range_saturates():
    plan = engine("reference", "q15").compile(twice, (8, 8), like=FRAMES)
    near, far, farther = (plan(scale * FRAMES[-1, 0])["twice"] for scale in (1.0, 1e3, 1e6))
    at = np.abs(near) > 0.1 * np.abs(near).max()
    np.testing.assert_array_equal(far[at], farther[at])
    # a quarter of room above the largest value seen, to the next power of two
    assert 1.25 * np.abs(near).max() <= np.abs(far).max() <= 4.0 * np.abs(near).max()


def test_a_stream_without_ranges_is_refused():
    plan = engine("reference", "q15").compile(cnnum.get_program("twist").bind(rate=200.0), (8, 8))
    stream = plan.stream((3,))
    stream.push(FRAMES[0])
    with pytest.raises(ProgramError, match="like=frames"):
        stream.push(FRAMES[1])


def test_ranges_are_for_whole_numbers_and_of_the_shape_of_frames():
    program = cnnum.get_program("twist")
    with pytest.raises(ProgramError, match="uses float64"):
        cnnum.Engine("reference").compile(program, (8, 8), like=FRAMES)
    with pytest.raises(ArrayError, match=r"\(frames, ..., 8, 8, 3\)"):
        engine("reference", "q15").compile(program, (8, 8), like=FRAMES[..., :2])


def test_an_engine_without_whole_numbers_says_so():
    with pytest.raises(UnknownNameError, match="'opencl' or 'reference'"):
        cnnum.Engine("numba", precision="q15")
    with pytest.raises(UnknownNameError, match="'q99'"):
        cnnum.Engine("reference", precision="q99")
