"""How well the followed error of fixed steps covers the true one, over random networks.

    python -m cnnum.lab.bench.followed_steps 60

A wide sample: one layer or two with their own time constants, and radius 1 or 2. Their feedback
contracts or is strong enough to decide; they have every output and boundary. Steps go from the
whole stability bound down to its hundredth.
"""

import sys
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from cnnum.arrays import Floats
from cnnum.engine import Engine
from cnnum.integrators.stability import stability_bound
from cnnum.runs.result import Result
from cnnum.templating.template import Template

METHODS = ("euler", "heun", "rk4", "bogacki-shampine", "dormand-prince")
EXPONENTIAL = ("exponential-euler", "etd-rk2")
OUTPUTS = ("standard", "linear", "tanh", "full-range")
BOUNDARIES = (0.0, 0.4, "zero-flux", "periodic")
SHAPE = (6, 7)
SEED = 21


@dataclass(frozen=True, slots=True, eq=False)
class Known:
    """A network, a batch of its frames, and where they truly end.

    Attributes
    ----------
    template : Template
    maps : dict of str to (batch, ...) float
    truth : Result
        By a pair at a tolerance of 1e-11, which takes a tenth of the reference engine's time.
    """

    template: Template
    maps: dict[str, Floats]
    truth: Result


def network(rng: np.random.Generator, output: str | None = None) -> Template:
    """Return a random template, of an output function or of any."""
    layers, k = int(rng.choice([1, 1, 2])), int(rng.choice([3, 5]))
    kernels = rng.normal(size=(layers, layers, k, k))
    kernels *= rng.random((k, k)) < rng.uniform(0.3, 1.0)
    kernels /= max(1e-9, float(np.abs(kernels).sum(axis=(1, 2, 3)).max()))
    kernels *= rng.uniform(0.1, float(rng.choice([1.0, 3.0, 8.0])))
    return Template(
        "sampled",
        kernels,
        rng.normal(size=(layers, 1, 1, 1)),
        rng.normal(size=layers).tolist(),
        tau=rng.choice([0.3, 1.0, 3.0], size=layers).tolist(),
        boundary=BOUNDARIES[int(rng.integers(len(BOUNDARIES)))],
        initial=0.0,
        duration=float(rng.choice([0.5, 2.0, 8.0])),
        output=output or str(rng.choice(OUTPUTS)),
    )


def frames(
    rng: np.random.Generator, template: Template, batch: int, shape: tuple[int, int]
) -> dict[str, Floats]:
    """Return random inputs, weak or strong, and states near 0 or not, of a batch."""
    layers = (template.layers,) * (template.layers > 1)
    size = rng.choice([0.01, 0.9])
    return {
        "input": rng.uniform(-1, 1, (batch, *shape)) * rng.uniform(0.0, 2.0),
        "state": rng.uniform(-1, 1, (batch, *layers, *shape)) * size,
    }


def sample(count: int, batch: int) -> Iterator[Known]:
    """Yield a number of networks, each with a batch of frames."""
    rng, engine = np.random.default_rng(SEED), Engine("numba", precision="float64")
    for _ in range(count):
        template = network(rng)
        maps = frames(rng, template, batch, SHAPE)
        input, state = maps["input"], maps["state"]
        truth = engine.run(
            template, input=input, state=state, method="dormand-prince", rtol=1e-11, atol=1e-11
        )
        yield Known(template, maps, truth)


def judged(
    engine: Engine, method: str, known: Known, rng: np.random.Generator
) -> tuple[Floats, Floats] | None:
    """Return the estimated and the true errors of a batch in steps of a random length.

    None if the method has no stable step, or its error is not followed.
    """
    template, maps, truth = known.template, known.maps, known.truth
    bound = stability_bound(template, SHAPE, method).step
    part = 10.0 ** rng.uniform(-2.0, 0.0)
    if not bound or (method == "etd-rk2" and template.output.limited):
        return None
    dt = min(bound, float(truth.time.max())) * part
    input, state = maps["input"], maps["state"]
    got = engine.run(template, input=input, state=state, method=method, dt=dt, estimate=True)
    off = np.abs(got.state - truth.state)
    error = off.max(axis=tuple(range(1, off.ndim)))
    return got.error, np.maximum(error - truth.error, 0.0)


def main(count: int) -> None:
    """Print how often each method's error is covered, and by how much."""
    engine, rng = Engine("numba", precision="float64"), np.random.default_rng(SEED + 1)
    results: dict[str, list[tuple[Floats, Floats]]] = {}
    for known in sample(count, 8):
        for method in (*METHODS, *EXPONENTIAL):
            pair = judged(engine, method, known, rng)
            results.setdefault(method, []).extend([] if pair is None else [pair])
    for method, runs in results.items():
        estimates, errors = (np.concatenate(part) for part in zip(*runs, strict=True))
        loose = (estimates / np.maximum(errors, 1e-12))[errors > 1e-8]
        print(
            f"{method}: {errors.size} runs, {np.mean(estimates >= errors):.2%} covered; of errors "
            f"above 1e-8 ({loose.size}) {np.median(loose):.1f} times in the median, "
            f"{np.quantile(loose, 0.9):.0f} times in one of ten"
        )


if __name__ == "__main__":
    main(int(sys.argv[1]))
