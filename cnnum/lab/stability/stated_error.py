"""How well the error that a run states covers the true one, over random networks, on every engine.

    python -m cnnum.lab.stability.stated_error 40
    python -m cnnum.lab.stability.stated_error 40 numba reference
    python -m cnnum.lab.stability.stated_error 60 scipy

It also says how many runs by steps are off by more than their tolerance. That is the tolerance of a
step: errors of many steps add up, and an array that decides lets them grow.

The sample is that of `followed_steps`: one layer or two with their own time constants, radius 1 or
2, every output and boundary. Their feedback contracts or decides. Each network is run for its time
with `method="auto"`, by steps or exactly. Where its output is bounded it is also run up to a rest,
even if it never rests.

With "scipy" it says instead how often SciPy's methods miss the tolerance of those runs that take
steps, a yardstick for `auto`. The truth is a pair's run at 1e-11.
"""

import sys
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from cnnum.arrays import Floats
from cnnum.engine import Engine
from cnnum.engines.reference.equation import Given, StateEquation
from cnnum.errors import MethodError
from cnnum.lab.bench.followed_steps import Known, sample
from cnnum.lab.stability import ENGINES

BATCH = 8
"""Frames of a network."""

RTOL, ATOL = 1e-4, 1e-5
"""Those of `Engine.run` unless others are given."""

SCIPY_METHODS = ("LSODA", "DOP853", "RK45", "RK23")

SMALL = 1e-8
"""True errors below it are no measure of how loose an estimate is."""

Judged = tuple[str, Floats, Floats, Floats]
"""Name of a run, the stated errors of a batch, the true ones, and as parts of the tolerance."""


def judged(engine: Engine, known: Known) -> Iterator[Judged]:
    """Yield the stated and the true errors of a batch, for its time and up to a rest."""
    input, state = known.maps["input"], known.maps["state"]
    result = engine.run(known.template, input=input, state=state)
    off = np.abs(result.state - known.truth.state)
    kind = "without steps" if result.method == "propagator" else "by steps"
    wanted = ATOL + RTOL * np.abs(known.truth.state)
    yield kind, result.error, _true(off, known.truth.error), _true(off / wanted, 0.0)
    if known.template.output.linear:
        return
    try:
        rest = engine.run(known.template, input=input, state=state, duration="settle")
    except MethodError:  # one frame of the batch did not reach its end, as it says
        return
    far = _from_rest(rest.state, rest.settled, known)
    yield "settle", rest.error, far, np.zeros_like(far)


def _true(off: Floats, unknown: Floats | float) -> Floats:
    largest = off.max(axis=tuple(range(1, off.ndim)))
    return np.asarray(np.maximum(largest - unknown, 0.0), dtype=np.float64)


def _from_rest(state: Floats, settled: NDArray[np.bool_], known: Known) -> Floats:
    """Return how far states that say they rest still go in 40 time constants; 0 for others."""
    engine, slowest = Engine("numba", precision="float64"), float(known.template.tau.max())
    later = engine.run(
        known.template,
        input=known.maps["input"],
        state=state,
        method="dormand-prince",
        rtol=1e-10,
        atol=1e-10,
        duration=40.0 * slowest,
    )
    return np.where(settled, _true(np.abs(later.state - state), later.error), 0.0)


def report(name: str, runs: Sequence[Judged]) -> Iterator[str]:
    """Yield a line for each kind of run."""
    for kind in dict.fromkeys(run[0] for run in runs):
        stated = np.concatenate([run[1] for run in runs if run[0] == kind])
        true = np.concatenate([run[2] for run in runs if run[0] == kind])
        part = np.concatenate([run[3] for run in runs if run[0] == kind])
        known = np.isfinite(stated)
        some = known & (true > SMALL)
        loose = stated[some] / true[some]
        median = f"{np.median(loose):.1f} times the true one" if len(loose) else "not to be said"
        yield (
            f"{name} {kind}: {len(true)} runs, {np.mean(stated >= true):.2%} covered, "
            f"{np.mean(~known):.0%} with no error known; in the median of {len(loose)} {median}"
            f"; {np.mean(part > 1.0):.1%} beyond the tolerance, by {part.max():.1f} times at most"
        )


def missed(method: str, known: Known, frame: int) -> float:
    """Return the error of a frame by a SciPy method, over the tolerance."""
    template, truth = known.template, known.truth.state[frame]
    shape = truth.shape[-2:]
    input = known.maps["input"][frame].reshape(-1, *shape)
    state = known.maps["state"][frame].reshape(-1, *shape)
    equation = StateEquation(template, shape, Given(input, None, state, None, None))
    drive, start = equation.drive(), equation.start()

    def rates(time: float, flat: Floats) -> Floats:
        return equation.rate(drive, flat.reshape(start.shape), None, time).ravel()

    span = (0.0, float(known.truth.time[frame]))
    run: Any = solve_ivp  # SciPy's types know no name of a method
    end = run(rates, span, start.ravel(), method=method, rtol=RTOL, atol=ATOL).y[:, -1]
    off = np.abs(end - truth.ravel()) / (ATOL + RTOL * np.abs(truth.ravel()))
    return float(off.max())


def judge_scipy(count: int) -> None:
    """Print the share of frames that miss their tolerance, method by method."""
    engine = Engine("numba", precision="float64")
    networks = list[Known]()
    for known in sample(count, BATCH):
        ours = engine.run(known.template, input=known.maps["input"], state=known.maps["state"])
        if ours.method != "propagator":
            networks.append(known)
    for method in SCIPY_METHODS:
        parts = np.array([missed(method, network, b) for network in networks for b in range(BATCH)])
        share = np.mean(parts > 1.0)
        print(f"{method}: {parts.size} frames, {share:.0%} missed, by {parts.max():.0f} at most")


def main(count: int, names: Sequence[str]) -> None:
    """Print how often each engine's stated error covers the true one, and how loose it is."""
    if "scipy" in names:
        judge_scipy(count)
        return
    networks = list(sample(count, BATCH))
    for name, precision in ENGINES:
        if names and name not in names:
            continue
        engine = Engine(name, precision=precision)
        runs = [run for known in networks for run in judged(engine, known)]
        for line in report(f"{name} {precision}", runs):
            print(line, flush=True)


if __name__ == "__main__":
    main(int(sys.argv[1]), sys.argv[2:])
