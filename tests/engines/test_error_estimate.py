"""`error` covers the true error: a wide random sample of networks, frames and tolerances."""

import numpy as np
import pytest

from cnnum.engine import Engine
from cnnum.template import Template

TEMPLATES, FRAMES = 14, 16


def network(rng):
    """A template whose feedback may contract, or be strong enough to saturate and decide."""
    radius = int(rng.integers(1, 3))
    k = 2 * radius + 1
    feedback = rng.normal(size=(k, k)) * (rng.random((k, k)) < rng.uniform(0.2, 1.0))
    feedback *= rng.uniform(0.1, rng.choice([1.0, 3.0, 8.0])) / max(1e-9, np.abs(feedback).sum())
    boundary = rng.choice(np.array([0.0, -1.0, "zero-flux", "periodic"], dtype=object))
    return Template(
        "sampled",
        feedback,
        [[1.0]],
        float(rng.normal()),
        boundary=boundary,
        initial=0.0,
        duration=float(rng.choice([0.5, 2.0, 8.0])),
        output=str(rng.choice(["standard", "standard", "linear", "tanh"])),
    )


@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_error_covers_the_truth(precision):
    """At least 99 % of all runs."""
    engine, reference = Engine(precision=precision), Engine("reference")
    rng = np.random.default_rng(11 if precision == "float32" else 12)
    covered: list[np.ndarray] = []
    loose: list[np.ndarray] = []
    for _ in range(TEMPLATES):
        template = network(rng)
        maps = {
            "input": rng.uniform(-1, 1, (FRAMES, 6, 7)) * rng.uniform(0.0, 2.0),
            "state": rng.uniform(-1, 1, (FRAMES, 6, 7)) * rng.choice([0.01, 1.0]),
        }
        known = reference.run(template, **maps)
        rtol = float(10.0 ** -rng.integers(2, 5))
        result = engine.run(template, rtol=rtol, atol=rtol, **maps)
        error = np.abs(result.state - known.state).max(axis=(-2, -1))
        # the reference has an error of its own, which exact answers in float64 are below
        covered.append(result.error + 20.0 * known.error >= error)
        loose.append(result.error / np.maximum(error, 1e-12))
    assert np.concatenate(covered).mean() >= 0.99
    # an estimate that always says infinity would cover, and tell nothing
    assert np.median(np.concatenate(loose)) < 1000.0
