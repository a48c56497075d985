"""The tolerance of `auto` over whole runs: random networks, against the truth to 1e-11."""

import numpy as np
import pytest

from cnnum.engine import Engine
from cnnum.lab.bench.followed_steps import sample
from cnnum.lab.stability.stated_error import judged


@pytest.fixture(scope="module")
def bent():
    return [known for known in sample(60, 8) if not known.template.output.smooth]


def test_few_runs_by_steps_miss_their_tolerance(bent):
    engine, parts = Engine("numba", precision="float64"), []
    for known in bent:
        kind, _, _, part = next(judged(engine, known))
        parts += part.tolist() if kind == "by steps" else []
    assert len(parts) >= 200
    # here 7 %; by the estimate of a pair alone, which may vanish at a bend, 24 %
    assert np.mean(np.array(parts) > 1.0) <= 0.10
    assert max(parts) <= 30.0


@pytest.mark.parametrize("name", ["opencl", "reference"])
def test_engines_judge_bends_alike(bent, name):
    """They take as many steps: roundings alone differ."""
    first, engine = Engine("numba", precision="float64"), Engine(name, precision="float64")
    for known in bent[:6]:
        given = {"method": "dormand-prince", **known.maps}
        steps = [one.run(known.template, **given).steps for one in (first, engine)]
        # a refused step that another engine takes is one in some fifty
        np.testing.assert_allclose(steps[1], steps[0], rtol=0.05, atol=1)


def test_a_large_array_judges_bends_as_a_small_one(bent):
    """Strips of rows find the worst of all cells: those of a torus, repeated."""
    tori = [known for known in bent if str(known.template.boundary) == "periodic"]
    engine = Engine("opencl", precision="float64")
    given = {"method": "dormand-prince", "duration": 1.0}
    # in the first, errors grow: another order of a sum moves its steps
    for known in tori[1:3]:
        maps = {name: values[0] for name, values in known.maps.items()}
        small = engine.run(known.template, **given, **maps)
        tiled = {name: np.tile(v, (1,) * (v.ndim - 2) + (40, 40)) for name, v in maps.items()}
        large = engine.run(known.template, **given, **tiled)
        assert large.steps == small.steps
        np.testing.assert_allclose(large.state[..., :6, :7], small.state, rtol=0.0, atol=1e-13)
