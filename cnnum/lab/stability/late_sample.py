"""How well runs with a delay keep their tolerance, and the error they state, over random networks.

    python -m cnnum.lab.stability.late_sample 64
    python -m cnnum.lab.stability.late_sample 16 opencl

One layer or two with their own time constants, radius 1 or 2, every output and boundary. The delay
is 0.1 to 3 time constants, and its couplings are up to three times as strong as the decay. The
truth is SciPy's Dormand–Prince 8(5,3) by the method of steps, as the `reference` engine has it.
"""

import sys
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from cnnum.arrays import Floats
from cnnum.engine import Engine
from cnnum.lab.bench.followed_steps import Known, frames, network
from cnnum.lab.stability.runner import ENGINES
from cnnum.runs.result import Result
from cnnum.templating.couplings import DelayedCoupling
from cnnum.templating.template import Template

SHAPE = (5, 6)
BATCH = 4
SEED = 29

Judged = tuple[Floats, Floats, Floats]
"""Stated errors of a batch, the true ones, and those as parts of the tolerance."""


def late_network(rng: np.random.Generator) -> Template:
    """Return a random template with a delay."""
    base = network(rng)
    layers, k = base.layers, int(rng.choice([3, 5]))
    seen = rng.normal(size=(layers, layers, k, k)) * (rng.random((k, k)) < 0.5)
    seen *= rng.uniform(0.1, 3.0) / max(1e-9, float(np.abs(seen).sum(axis=(1, 2, 3)).max()))
    inputs = 0.5 * rng.normal(size=(layers, 1, 1, 1))
    delay = float(rng.choice([0.1, 0.37, 1.0, 3.0]))
    return replace(base, delayed=DelayedCoupling(delay, seen, inputs))


def late_sample(count: int, batch: int = BATCH) -> Iterator[Known]:
    """Yield a number of networks, each with a batch of frames and its truth."""
    rng, reference = np.random.default_rng(SEED), Engine("reference")
    for _ in range(count):
        template = late_network(rng)
        maps = frames(rng, template, batch, SHAPE)
        maps["previous"] = maps["input"][::-1]
        yield Known(template, maps, _ran(reference, template, maps))


def _ran(engine: Engine, template: Template, maps: dict[str, Floats], **options: Any) -> Result:
    given: dict[str, Any] = {**maps, **options}
    return engine.run(template, **given)


def judged(engine: Engine, known: Known, rtol: float, atol: float) -> Judged:
    """Return the stated and true errors of a batch, and the worst part of the tolerance."""
    result = _ran(engine, known.template, known.maps, rtol=rtol, atol=atol)
    off = np.abs(result.state - known.truth.state)
    axes = tuple(range(1, off.ndim))
    part = off / (atol + rtol * np.abs(known.truth.state))
    return (
        result.error,
        np.maximum(off.max(axis=axes) - known.truth.error, 0.0),
        part.max(axis=axes),
    )


def report(name: str, runs: Sequence[Judged]) -> str:
    """Return a line on all runs of an engine."""
    stated, true, part = (np.concatenate(column) for column in zip(*runs, strict=True))
    some = np.isfinite(stated) & (true > 1e-9)
    return (
        f"{name}: {part.size} frames, {np.mean(part > 1.0):.1%} off by more than the tolerance, by "
        f"{part.max():.2g} times at most; {np.mean(stated >= true):.2%} covered, "
        f"{np.median(stated[some] / true[some]):.1f} times the true error in the median"
    )


def main(count: int, names: Sequence[str], rtol: float = 1e-4, atol: float = 1e-5) -> None:
    """Print how well each engine keeps the tolerance, and its errors the truth."""
    networks = list(late_sample(count))
    for name, precision in ENGINES:
        if name != "reference" and (not names or name in names):
            engine = Engine(name, precision=precision)
            runs = [judged(engine, known, rtol, atol) for known in networks]
            print(report(f"{name} {precision}", runs), flush=True)


if __name__ == "__main__":
    main(int(sys.argv[1]), sys.argv[2:])
