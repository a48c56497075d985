"""Stacks of maps: as NumPy does with arrays of one axis more, on every engine."""

import numpy as np
import pytest

import cnnum
from cnnum.engines.opencl import executable
from cnnum.engines.opencl.lowering import kernel_source
from cnnum.errors import ProgramError

COUNT = 3


@cnnum.program
def stacked(frame):
    """A stack that is the same always, a memory, a loop, read-outs, and single maps."""
    rows, cols = frame.shape
    levels = frame.constant(1.0 + np.arange(COUNT * rows * cols).reshape(-1, rows, cols))
    one = frame.memory()
    one.store(one.value + frame.a)
    largest = frame.a.max()
    memory = frame.memory("sums", maps=COUNT)
    sums = 0.5 * memory.value + levels * largest
    memory.store(sums)

    def halved(stack, single):
        return cnnum.where(stack > 8.0 * levels, 0.5 * stack, stack), single + 1.0

    def small(stack, _):
        return (stack <= 8.0 * levels).all()

    run = cnnum.loop(halved, sums + 1.0, frame.a, limit=20, until=small)
    before = frame.previous(sums)
    return {
        "total": sums.sum(),
        "mean": sums.mean(),
        "least": (sums - 7.0 * levels).min(),
        "most": run.values[0].max(),
        "rounds": run.iterations,
        "single": run.values[1] + one.value,
        "changed": (abs(sums - before) > 0.0).count(),
        "some": (levels.equals(largest)).any(),
    }


class Expected:
    """The same of one stream in NumPy."""

    def __init__(self, shape):
        self.levels = 1.0 + np.arange(COUNT * np.prod(shape)).reshape(COUNT, *shape)
        self.sums = self.one = np.zeros(1)
        self.first = True

    def push(self, frame):
        levels, before, one = self.levels, self.sums, self.one
        self.one = one + frame
        self.sums = 0.5 * self.sums + levels * frame.max()
        stack, rounds = self.sums + 1.0, 0
        while rounds < 20:
            stack = np.where(stack > 8.0 * levels, 0.5 * stack, stack)
            rounds += 1
            if (stack <= 8.0 * levels).all():
                break
        changed = 0 if self.first else (self.sums != before).sum()
        self.first = False
        return {
            "total": self.sums.sum(),
            "mean": self.sums.mean(),
            "least": (self.sums - 7.0 * levels).min(),
            "most": stack.max(),
            "rounds": rounds,
            "single": frame + rounds + one,
            "changed": changed,
            "some": (levels == frame.max()).any(),
        }


def agrees(engine, shape, batch):
    """Streams of small integers, whose halves and sums float32 holds exactly; a mean it rounds."""
    frames = np.random.default_rng(5).integers(1, 9, (3, batch, *shape, 1)).astype(float)

    stream = engine.compile(stacked, shape, channels=("a",)).stream((batch,))
    wanted = [Expected(shape) for _ in range(batch)]
    for frame in frames:
        got = stream.push(frame)
        for number, each in enumerate(wanted):
            for name, value in each.push(frame[number, ..., 0]).items():
                rounds = np.finfo(np.float32).eps if name == "mean" else 0.0
                np.testing.assert_allclose(got[name][number], value, rtol=rounds, err_msg=name)


@pytest.mark.parametrize("batch", [1, 33])
def test_stacks_are_right_in_streams(engines, reference, batch):
    for engine in (reference, engines["opencl-float32"], engines["numba-float32"]):
        agrees(engine, (2, 3), batch)


@pytest.mark.parametrize("most", [0, 32 * 32])
def test_stacks_of_large_arrays_are_right(most, monkeypatch):
    """In parts, and as one kernel whose arrays are too large to be private."""
    monkeypatch.setattr(kernel_source, "PRIVATE_CELLS", 0)
    monkeypatch.setattr(kernel_source, "WHOLE_CELLS", most)
    monkeypatch.setattr(executable, "WIDE_CELLS", 0)
    agrees(cnnum.Engine("opencl"), (7, 5), 2)


def test_stack_can_be_looked_at(reference):
    """A trace shows a stack as an array with one axis more."""
    steps = reference.compile(stacked, (2, 3), ["total"], channels=("a",)).trace(np.ones((2, 3, 1)))
    shapes = {step.value.shape for step in steps}
    assert shapes == {(2, 3), (COUNT, 2, 3), ()}


@pytest.mark.parametrize(
    ("made", "words"),
    [
        (lambda frame, stack: stack + frame.a, "got 1 and 3"),
        (lambda frame, stack: cnnum.shift(stack, 1), "single maps"),
        (lambda frame, stack: stack, "stack of 3 maps"),
        (lambda frame, stack: stack.argmax()[0], "a single map"),
        (lambda frame, stack: frame.memory().store(stack), "maps="),
        (lambda frame, stack: cnnum.loop(lambda _: stack, frame.a, limit=2).value, "as many"),
    ],
)
def test_stacks_stay_what_they_are(reference, made, words):
    def program(frame):
        return {"made": made(frame, frame.constant(np.zeros((3, *frame.shape))))}

    with pytest.raises(ProgramError, match=words):
        reference.compile(cnnum.program(program), (2, 3), channels=("a",))
