"""How far results of devices may differ: rounding, order of sums, numbers that are flushed to 0."""

from collections.abc import Iterator

import numpy as np

from cnnum.arrays import Floats
from cnnum.engine import Engine
from cnnum.lab.stability.cases.solving import integrated
from cnnum.lab.stability.record import Case, Solved, states
from cnnum.templating.checks.analytic.courses import by_steps
from cnnum.templating.couplings import DelayedCoupling
from cnnum.templating.library import get_template
from cnnum.templating.template import Template

SINGLE, DOUBLE = 2.0**-24, 2.0**-53
"""Relative error of one rounding."""


def cases() -> Iterator[Case]:
    """Return the cases of precision."""
    for duration in (10.0, 1e3):
        yield _contraction(duration)
    yield _cancelling()
    yield _products()
    yield _subnormal()
    for batch in (1, 5, 40):
        yield _batch(batch)
    for delay, strength in ((0.5, 3.0), (2.0, 1.5)):
        yield _late(delay, strength)
    for seed in range(4):
        yield _network(seed)


def _contraction(duration: float) -> Case:
    """Roundings of a contraction do not add up: a long run is no worse than a short one."""
    A = [[0.1, 0.1, 0.1], [0.1, 0.1, 0.1], [0.1, 0.1, 0.1]]
    template = Template("contract", A, [[0.05]], z=0.01, boundary="periodic", duration=duration)
    picture = np.random.default_rng(4).uniform(-1.0, 1.0, (8, 8))

    def truth() -> Floats:
        weights = np.zeros((8, 8))
        weights[[0, 0, 0, 1, 1, 1, 7, 7, 7], [0, 1, 7, 0, 1, 7, 0, 1, 7]] = 0.1
        rates = np.fft.fft2(weights) - 1.0
        drive = np.fft.fft2(0.05 * picture + 0.01)
        return np.asarray(np.fft.ifft2(drive * np.expm1(rates * duration) / rates).real)

    return Case(
        f"long-contraction-{duration:g}",
        "precision",
        f"a contracting array for {duration:g} time constants",
        lambda engine: states(engine.run(template, input=picture, state=np.zeros((8, 8)))),
        truth,
        20.0 * SINGLE / 0.1,
        1e-9,
        "some 20 roundings, over 1 − Σ|a| = 0.1, however long; the reference solves to 1e-10",
    )


def _cancelling() -> Case:
    """Weights of 1e4 that nearly cancel: the error is that of the terms, not of the sum."""
    B = np.array([[1e4, -1e4, 1.0], [1e4, -1e4, 0.5], [-1e4, 1e4, 0.25]])
    template = Template("cancel", [[0.0]], B, duration=30.0, output="linear")
    picture = np.random.default_rng(5).uniform(-1.0, 1.0, (8, 8))

    def truth() -> Floats:
        around = np.pad(picture, 1)
        terms = [
            B[r, c] * around[r : r + 8, c : c + 8].astype(np.longdouble)
            for r in range(3)
            for c in range(3)
        ]
        total = sum(terms[1:], terms[0])
        return np.asarray(total * -np.expm1(-30.0), dtype=np.float64)

    # the input rounds once, then nine terms of at most 1e4 in any order
    return Case(
        "cancelling-weights",
        "precision",
        "six weights of 1e4 that cancel",
        lambda engine: states(engine.run(template, input=picture)),
        truth,
        11.0 * SINGLE * 6e4,
        11.0 * DOUBLE * 6e4,
        "(n + 2) u Σ|b u|, for any order of the sum, with products fused or not",
    )


def _products() -> Case:
    """a·b + c with c ≈ −a·b: fused and unfused differ by the rounding of the product."""
    near = 1.0 + 2.0**-12
    template = Template("product", [[0.0]], [[near]], duration=30.0, output="linear", z=-(near**2))
    picture = np.full((4, 4), near)
    return Case(
        "product-less-itself",
        "precision",
        "a product and its negative: the rounding that a fused step leaves",
        lambda engine: states(engine.run(template, input=picture)),
        lambda: np.zeros((4, 4)),
        4.0 * SINGLE,
        4.0 * DOUBLE,
        "roundings of the product, of z and of the sum, all about 1",
    )


def _subnormal() -> Case:
    """A decay into numbers that devices flush to 0."""
    template = Template("fade", [[0.0]], duration=95.0)
    return Case(
        "subnormal-decay",
        "precision",
        "a decay to 5e-42, below the smallest normal number of single precision",
        lambda engine: states(engine.run(template, state=np.ones((8, 8)))),
        lambda: np.full((8, 8), np.exp(-95.0)),
        1.2e-38,
        1e-45,
        "the smallest normal number of single precision",
    )


def _batch(count: int) -> Case:
    """Frames are the same alone and among others, to roundings."""
    pictures = np.random.default_rng(6).uniform(-1.0, 1.0, (count, 8, 8))
    smooth = get_template("AVERAGE")

    def solve(engine: Engine) -> Solved:
        together = engine.run(smooth, state=pictures, duration=1.0).state
        alone = [engine.run(smooth, state=picture, duration=1.0).state for picture in pictures[:5]]
        return Solved(together[:5] - np.array(alone))

    return Case(
        f"batch-of-{count}",
        "precision",
        f"a frame among {count} is the frame alone",
        solve,
        lambda: np.zeros((min(count, 5), 8, 8)),
        2e-4,
        2e-4,
        "twice the tolerance: a batch may take other steps",
    )


def _late(delay: float, strength: float) -> Case:
    """Cells that see the opposite of their past, exact by the method of steps."""
    coupling = DelayedCoupling(delay, np.full((1, 1, 1, 1), -strength), np.zeros((1, 0, 1, 1)))
    template = Template("echo", [[0.0]], output="linear", delayed=coupling, duration=6.0)
    start = np.random.default_rng(8).uniform(-1.0, 1.0, (6, 7))

    def truth() -> Floats:
        return start * float(by_steps(np.array(-1.0), np.array(-strength), delay, 6.0))

    return Case(
        f"late-{delay:g}",
        "precision",
        f"cells that each see {-strength:g} times their state of {delay:g} time constants ago",
        lambda engine: states(engine.run(template, state=start, rtol=1e-5, atol=1e-6)),
        truth,
        1.1e-5 * max(1.0, float(np.abs(truth()).max())),
        1.1e-5 * max(1.0, float(np.abs(truth()).max())),
        "the tolerance, of steps that are halved until they keep it",
    )


def _network(seed: int) -> Case:
    """A random network with two layers, against implicit steps at 1e-12."""
    rng = np.random.default_rng(100 + seed)
    A = rng.uniform(-0.25, 0.25, (2, 2, 3, 3))
    for layer in range(2):
        A[layer, layer, 1, 1] += 1.2
    start, drive = rng.uniform(-0.5, 0.5, (2, 6, 7)), rng.uniform(-0.3, 0.3, (2, 6, 7))
    taus = (1.0, 0.3)
    template = Template("random", A, tau=taus, boundary="zero-flux", duration=2.0)
    return Case(
        f"random-network-{seed}",
        "precision",
        "a random network of two layers whose cells saturate",
        lambda engine: states(engine.run(template, state=start, bias=drive, rtol=1e-5, atol=1e-6)),
        lambda: integrated(A, drive, start, 2.0, outside="edge", taus=taus, rtol=1e-12),
        2e-3,
        2e-3,
        "the tolerance, times the growth of an error over the time",
    )
