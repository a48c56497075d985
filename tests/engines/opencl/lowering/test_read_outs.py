"""Read-outs of small arrays go in chains side by side: their values and their roundings."""

import numpy as np
import pytest

import cnnum
from cnnum.engines.opencl.lowering.dense_products import CHAINS

SHAPES = ((1, 1), (1, 3), (2, 3), (7, 5), (8, 8), (16, 16))

STACK = 5


def of_stacks(levels, stack):
    """Return read-outs of stacks, which are fields of a program or arrays of NumPy."""
    return {
        "constant": levels.sum(),
        "stack": stack.sum(),
        "most": stack.max(),
        "least": stack.min(),
        "some": (stack > 20.0).any(),
        "every": (stack > -20.0).all(),
    }


@cnnum.program
def read_out(frame):
    """Read-outs of inputs, of a memory, of a constant, of a stack, and within a loop."""
    rows, cols = frame.shape
    levels = frame.constant(np.arange(STACK * rows * cols).reshape(-1, rows, cols) % 7.0)
    memory = frame.memory("past")
    memory.store(frame.a)
    stack = levels * frame.a.max()

    def less(value):
        return value - (value.max() + value.min()) * 0.5

    return {
        "input": frame.a.sum(),
        "again": frame.a.max() + frame.a.sum(),
        "memory": memory.value.sum(),
        "kept": memory.value,
        **of_stacks(levels, stack),
        "loop": cnnum.loop(less, 2.0 * frame.a, limit=3).value.sum(),
    }


def expected(now, before):
    levels = np.arange(STACK * now.size).reshape(-1, *now.shape) % 7.0
    stack, value = levels * now.max(), 2.0 * now
    for _ in range(3):
        value = value - (value.max() + value.min()) * 0.5
    return {
        "input": now.sum(),
        "again": now.max() + now.sum(),
        "memory": before.sum(),
        "kept": before,
        **of_stacks(levels, stack),
        "loop": value.sum(),
    }


@pytest.mark.one_in(5)
@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("batch", [1, 33])
def test_read_outs_are_right(shape, batch, engines):
    """Streams of small integers, which float32 holds exactly, halves among them."""
    frames = np.random.default_rng(7).integers(-9, 10, (3, batch, *shape, 1)).astype(float)
    stream = engines["opencl-float32"].compile(read_out, shape, channels=("a",)).stream((batch,))
    before = np.zeros_like(frames[0])
    for frame in frames:
        got = stream.push(frame)
        for each in range(batch):
            for name, value in expected(frame[each, ..., 0], before[each, ..., 0]).items():
                np.testing.assert_array_equal(got[name][each], value, err_msg=name)
        before = frame


@cnnum.program
def sums(frame):
    levels = frame.constant(np.random.default_rng(9).uniform(-1.0, 1.0, (STACK, *frame.shape)))
    return {"map": frame.a.sum(), "stack": (levels * frame.a.max()).sum()}


@pytest.mark.parametrize("batch", [1, 33])
@pytest.mark.parametrize("shape", [(7, 5), (8, 8), (16, 16)])
def test_rounding_errors_do_not_add_up_over_all_cells(shape, batch, engines):
    """A cell of 1 and many of 2⁻²⁴, which one by one leave a sum of float32 at 1."""
    plan = engines["opencl-float32"].compile(sums, shape, channels=("a",))
    if plan.executable.wide_lanes == 1:
        pytest.skip("a device without vectors sums up cell by cell")
    least = 2.0**-24
    frame = np.full((batch, *shape, 1), least)
    frame[:, 0, 0] = 1.0
    got = plan(frame)["map"]
    # the chain with the 1 loses all its others; half a unit in the last place is lost whenever two
    # chains become one
    lost = least * (-(-np.prod(shape) // CHAINS) + np.log2(CHAINS))
    np.testing.assert_allclose(got, frame.sum(axis=(1, 2, 3)), rtol=0.0, atol=lost)


@pytest.mark.one_in(5)
@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_frames_have_the_same_bits_alone_and_side_by_side(shape, precision, engines):
    plan = engines[f"opencl-{precision}"].compile(sums, shape, channels=("a",))
    frames = np.random.default_rng(8).uniform(-1.0, 1.0, (33, *shape, 1))
    whole = plan(frames)
    for number, frame in enumerate(frames):
        for name, value in plan(frame).items():
            np.testing.assert_array_equal(value, whole[name][number], err_msg=name)
