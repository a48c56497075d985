"""Streams abreast: what shares a launch gives what it gives alone, on every engine."""

import numpy as np
import pytest

import cnnum
from cnnum.errors import FrameError
from cnnum.stream import Abreast


@cnnum.program
def wandering(frame):
    """A mean over frames, which overflows where its input is huge."""
    memory = frame.memory()
    mean = memory.value * 0.75 + frame.normal * 0.25
    memory.store(cnnum.where(frame.first, frame.normal, mean))
    return {"mean": mean, "fourth": mean * mean * mean * mean}


@pytest.mark.parametrize("label", ["opencl-float32", "numba-float32", "reference"])
def test_streams_abreast_give_what_they_give_alone(engines, label):
    """Some miss frames, some are tared, loads grow, and some frames overflow."""
    plan = engines[label].compile(wandering, shape=(3, 4), channels=("normal",))
    count, rng = 18, np.random.default_rng(5)
    together, alone = Abreast(plan, count), [plan.stream() for _ in range(count)]
    shared = refused = 0
    for step in range(160):
        lanes = [lane for lane in range(count) if rng.random() < 0.9]
        for lane in np.flatnonzero(rng.random(count) < 0.01):
            together.streams[lane].tare()
            alone[lane].tare()
        values = rng.normal(0.0, 1.0 + step // 60, (len(lanes), 3, 4, 1))
        values[rng.random(len(lanes)) < 0.02] = 1e80 if label == "reference" else 1e12
        sizes = [float(np.abs(frame).max()) for frame in values]
        columns, results = together.push(lanes, values, sizes)
        shared += len(lanes) - len(results)
        for lane in set(lanes) - set(results):
            results[lane] = {name: numbers[lane] for name, numbers in columns.items()}
        for lane, frame, size in zip(lanes, values, sizes, strict=True):
            result = results[lane]
            try:
                expected = alone[lane].push_read(frame, size)
            except FrameError as error:
                told, expected = str(error), {}
            if not expected:
                assert str(result) == told
                refused += 1
                continue
            assert result.keys() == expected.keys()
            assert all(np.array_equal(result[name], expected[name]) for name in expected)
        assert [s.frames for s in together.streams] == [s.frames for s in alone]
    assert shared > 100
    assert refused > 20
