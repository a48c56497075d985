"""Wrong arguments of `Engine.run` and `stability_bound` are named in one sentence."""

import math

import numpy as np
import pytest

import cnnum
from cnnum.errors import ArrayError, MethodError

NAN, INF = math.nan, math.inf
ENGINES = ("numba", "opencl", "reference")
WRONG = [
    ("duration", -1.0), ("duration", NAN), ("duration", INF), ("duration", "soon"),
    ("duration", [1, 2]), ("duration", np.array(2.0)), ("duration", 1j),
    ("rtol", NAN), ("rtol", INF), ("rtol", "small"), ("rtol", None), ("rtol", -1e-3),
    ("atol", NAN), ("atol", INF), ("atol", 0.0),
    ("dt", NAN), ("dt", -1.0), ("dt", "short"), ("dt", [0.1]),
]  # fmt: skip


@pytest.mark.parametrize("name", ENGINES)
@pytest.mark.parametrize(("argument", "value"), WRONG, ids=str)
def test_numbers_that_are_none_are_refused(name, argument, value):
    with pytest.raises(MethodError, match=argument) as caught:
        cnnum.Engine(name).run(
            cnnum.get_template("HOLE"), input=np.zeros((3, 3)), **{argument: value}
        )
    assert "\n" not in str(caught.value)
    assert str(caught.value).endswith(".")


@pytest.mark.parametrize("value", [2, np.float32(2.0), np.int64(2)], ids=repr)
def test_any_kind_of_number_is_a_duration(value):
    engine, zeros = cnnum.Engine("numba"), np.zeros((3, 3))
    result = engine.run(cnnum.get_template("HOLE"), input=zeros, duration=value)
    assert result.time == pytest.approx(2.0)


@pytest.mark.parametrize("name", ENGINES)
@pytest.mark.parametrize("role", ["input", "state", "bias"])
def test_complex_maps_are_refused(name, role):
    maps = {"input": np.zeros((3, 3)), role: np.full((3, 3), 0.5 + 0.5j)}
    with pytest.raises(ArrayError, match=f"'{role}' must .* real"):
        cnnum.Engine(name).run(cnnum.get_template("HOLE"), **maps)


@pytest.mark.parametrize("name", ["numba", "opencl"])
def test_numbers_too_large_for_the_precision_are_refused(name):
    far = np.full((3, 3), -1e39)
    with pytest.raises(ArrayError, match=r"'input' .*float32.*float64"):
        cnnum.Engine(name, precision="float32").run(cnnum.get_template("EDGE"), input=far)
    near = np.full((3, 3), -1e30)
    result = cnnum.Engine(name, precision="float32").run(cnnum.get_template("THRES"), state=near)
    assert np.isfinite(result.state).all()


@pytest.mark.parametrize("shape", [(0, 8), (8,), (2, 2, 2), (-1, 4)], ids=str)
def test_a_bound_needs_an_array(shape):
    with pytest.raises(ArrayError, match="two positive whole numbers"):
        cnnum.stability_bound(cnnum.get_template("HOLE"), shape, "euler")


def test_complex_weights_and_frames_are_refused():
    with pytest.raises(ArrayError, match=r"A of template 'turns'.*must be real, got complex"):
        cnnum.Template("turns", np.array([[1j]]))
    total = cnnum.Program(lambda frame: {"sum": frame.normal.sum()}, "one")
    plan = cnnum.Engine("numba").compile(total, (4, 4))
    with pytest.raises(ArrayError, match=r"'frame'.*must be real, got complex"):
        plan(np.ones((4, 4, 3)) * 1j)
