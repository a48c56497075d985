"""Fast and slow parts in one array: layers, diffusion, loops, large weights."""

from collections.abc import Callable, Iterator
from functools import partial

import numpy as np
import scipy.sparse as sparse
from scipy.sparse.linalg import spsolve

from cnnum.arrays import Floats
from cnnum.engine import Engine
from cnnum.lab.stability.cases.solving import integrated, linear
from cnnum.lab.stability.record import Case, Solved, states
from cnnum.templating.library import get_template
from cnnum.templating.template import Template

SHAPE = (8, 8)
METHODS = (
    "euler",
    "heun",
    "rk4",
    "bogacki-shampine",
    "dormand-prince",
    "runge-kutta-chebyshev",
    "exponential-euler",
    "etd-rk2",
    "rodas3",
)
FEW_STEPS = r"did not reach its end"
"""Error message if explicit steps would be too many."""

UNFIT = r"needs rates that are known to be real|has no propagator|No step of"
"""Error message if the method does not suit such an array."""


def cases() -> Iterator[Case]:
    """Return the stiff cases."""
    for ratio in (1.0, 1e2, 1e4, 1e6, 1e8):
        yield _chain(ratio)
        yield _chain(1.0 / ratio) if ratio > 1.0 else _loop()
    for method in METHODS:
        yield _chain(100.0, method)
    for number in (1.0, 1e2, 1e4, 1e6):
        for output in ("linear", "standard"):
            yield _diffusion(number, output)
    for method in METHODS:
        yield _diffusion(100.0, "standard", method)
    for weight in (1e3, 1e5, 1e6):
        yield _symmetric(weight)
    for weight in (10.0, 1e3, 1e6):
        yield _feedback(weight)
        yield _together(weight)
    yield _interpolation()
    yield _wide()


def _chain(ratio: float, method: str = "auto") -> Case:
    """A layer that saturates drives another, `ratio` times as fast."""
    A = np.zeros((2, 2, 1, 1))
    A[1, 0] = 1.0
    template = Template("chain", A, [[[[1.0]]], [[[0.0]]]], tau=(1.0, 1.0 / ratio), duration=2.0)

    def solve(engine: Engine) -> Solved:
        return states(engine.run(template, input=np.full(SHAPE, 2.0), method=method))

    def truth() -> Floats:
        # x₀ = 2 (1 − e^−t) passes 1 at ln 2; x₁ follows y₀ = min(x₀, 1)
        turn, slow, fast = np.log(2.0), -1.0, -ratio
        if ratio == 1.0:
            at_turn = 2.0 * (1.0 - (1.0 + turn) * np.exp(-turn))
        else:
            both = (slow * np.exp(fast * turn) - fast * np.exp(slow * turn)) / (slow - fast)
            at_turn = 2.0 * (1.0 - both)
        second = 1.0 + (at_turn - 1.0) * np.exp(fast * (2.0 - turn))
        return np.stack([np.full(SHAPE, 2.0 * (1.0 - np.exp(-2.0))), np.full(SHAPE, second)])

    fixed = method in ("euler", "heun", "rk4", "exponential-euler", "etd-rk2")
    return Case(
        _name(f"layers-{ratio:g}", method),
        "stiff",
        f"one layer saturates and drives another that is {ratio:g} times as fast",
        solve,
        truth,
        # steps of a given length are half of the stable length, at any error
        *((0.3, 0.3) if fixed else (3e-4, 3e-4)),
        "steps of half the stable length bound nothing but growth"
        if fixed
        else "the tolerance, 1e-4 of the state and 1e-5, for each of the two layers",
        f"{FEW_STEPS}|{UNFIT}",
    )


def _name(name: str, method: str) -> str:
    return name if method == "auto" else f"{name} {method}"


def _diffusion(number: float, output: str, method: str = "auto") -> Case:
    """Diffusion for a time in which the fastest mode would decay by e^(−8 number)."""
    d = number
    A = [[0.0, d, 0.0], [d, 1.0 - 4.0 * d, d], [0.0, d, 0.0]]
    template = Template("heat", A, boundary="zero-flux", duration=1.0, output=output)
    wave = [np.cos(np.pi * m * (np.arange(8) + 0.5) / 8.0) for m in (1, 7)]
    slow, fast = np.outer(wave[0], np.ones(8)), np.outer(wave[1], wave[1])

    def solve(engine: Engine) -> Solved:
        start = 0.3 + 0.2 * slow + 0.2 * fast
        return states(engine.run(template, state=start, method=method))

    def truth() -> Floats:
        rates = [2.0 * d * (1.0 - np.cos(np.pi * m / 8.0)) for m in (1, 7)]
        kept = np.exp(-rates[0]), np.exp(-2.0 * rates[1])
        return np.asarray(0.3 + 0.2 * kept[0] * slow + 0.2 * kept[1] * fast, dtype=np.float64)

    fixed = method in ("euler", "heun", "rk4", "exponential-euler", "etd-rk2")
    # sums of weights of 4 d, in single precision
    rounding = 2e-7 * 8.0 if output == "linear" else 4e-6
    return Case(
        _name(f"diffusion-{number:g}-{output}", method),
        "stiff",
        f"diffusion number {number:g}, {output} output",
        solve,
        truth,
        *((0.05, 0.05) if fixed else (1e-4 + rounding * min(d, 1e3), 1e-4)),
        "steps of half the stable length" if fixed else "the tolerance, and roundings of weights",
        f"{FEW_STEPS}|{UNFIT}",
    )


def _loop() -> Case:
    """A damped loop of two fast layers that a slow one drives and hears."""
    A = np.zeros((3, 3, 1, 1))
    A[0, 0], A[0, 2] = 0.5, 0.1
    A[1, 2], A[2, 1] = -5.0, 5.0
    A[1, 0] = 1.0
    taus = (1.0, 1e-3, 1e-3)
    template = Template("loop", A, z=(0.1, 0.0, 0.0), tau=taus, output="linear", duration=3.0)
    plain = Template("loop", A, z=(0.1, 0.0, 0.0), tau=taus, duration=3.0, boundary="periodic")

    def solve(engine: Engine) -> Solved:
        start = np.stack([np.full((2, 2), v) for v in (0.2, 0.1, -0.1)])
        first = engine.run(template, state=start)
        second = engine.run(plain, state=start)
        return Solved(np.stack([first.state, second.state]))

    def truth() -> Floats:
        rates = 1.0 / np.array(taus)
        matrix = (A[:, :, 0, 0] - np.eye(3)) * rates[:, np.newaxis]
        end = linear(matrix, np.array([0.1, 0.0, 0.0]), np.array([0.2, 0.1, -0.1]), 3.0)
        return np.broadcast_to(end[:, np.newaxis, np.newaxis], (2, 3, 2, 2)).copy()

    return Case(
        "fast-loop-in-slow",
        "stiff",
        "a loop of two layers turns a thousand times as fast as the layer around it",
        solve,
        truth,
        1e-3,
        1e-3,
        "the tolerance, ten times over: the loop turns 2,400 times",
        FEW_STEPS,
    )


def _grown(weight: float, start: float, drive: float, time: float) -> float:
    """Return x of x' = −x + weight f(x) + drive from 0 < start < 1, which grows past 1."""
    rest = -drive / (weight - 1.0)
    turn = np.log((1.0 - rest) / (start - rest)) / (weight - 1.0)
    end = weight + drive
    return float(end + (1.0 - end) * np.exp(-(time - turn)))


def _feedback(weight: float) -> Case:
    template = Template("own", [[weight]], z=0.2, duration=1.5)
    return Case(
        f"self-feedback-{weight:g}",
        "stiff",
        f"cells alone with a₀₀ = {weight:g} leave the linear range and saturate",
        lambda engine: states(engine.run(template, state=np.full(SHAPE, 0.1))),
        lambda: np.full(SHAPE, _grown(weight, 0.1, 0.2, 1.5)),
        3e-4 * weight,
        3e-4 * weight,
        "the tolerance, of a state as large as a₀₀",
    )


def _together(weight: float) -> Case:
    """All cells alike on a torus: the array is one cell with the sum of the weights."""
    side = weight / 4.0
    A = [[0.0, side, 0.0], [side, weight, side], [0.0, side, 0.0]]
    template = Template("alike", A, z=0.2, boundary="periodic", duration=1.5)
    return Case(
        f"coupled-feedback-{weight:g}",
        "stiff",
        f"coupled cells, all alike, with weights that sum to {2.0 * weight:g}",
        lambda engine: states(engine.run(template, state=np.full(SHAPE, 0.1))),
        lambda: np.full(SHAPE, _grown(2.0 * weight, 0.1, 0.2, 1.5)),
        6e-4 * weight,
        6e-4 * weight,
        "the tolerance, of a state as large as the sum",
        f"{FEW_STEPS}|{UNFIT}",
    )


def _symmetric(weight: float) -> Case:
    """A random symmetric kernel on a small array, whose cells saturate one after the other."""
    rng = np.random.default_rng(1)
    kernel = rng.normal(size=(3, 3))
    kernel = weight * (kernel + kernel[::-1, ::-1])
    start = rng.uniform(-0.5, 0.5, (1, 3, 3))
    template = Template("symmetric", kernel, duration=2.0)
    return Case(
        f"symmetric-{weight:g}",
        "stiff",
        f"a symmetric kernel of weights of {weight:g}",
        lambda engine: states(engine.run(template, state=start[0])),
        lambda: integrated(kernel[np.newaxis, np.newaxis], 0.0, start, 2.0)[0],
        3e-4 * weight,
        3e-4 * weight,
        "the tolerance, of states of up to four times the weights",
    )


def _interpolation() -> Case:
    """INTERP solves a biharmonic equation between known cells; 64×64 has slow modes."""
    shape, template = (64, 64), get_template("INTERP")
    rng = np.random.default_rng(0)
    known = rng.random(shape) < 0.1
    values = np.where(known, rng.uniform(-0.8, 0.8, shape), 0.0)

    def solve(engine: Engine) -> Solved:
        result = engine.run(template, state=values, mask=known, duration="settle")
        settled = bool(np.all(result.settled))
        return Solved(np.append(result.state, 0.0 if settled else 1.0))

    def truth() -> Floats:
        weights = template.A[0, 0] - np.pad([[1.0]], 2)
        size = values.size
        matrix = sparse.lil_matrix((size, size))
        rest = ~known.ravel()
        for cell in range(size):
            row, col = divmod(cell, shape[1])
            for (r, c), weight in np.ndenumerate(weights):
                i, j = row + r - 2, col + c - 2
                if weight and 0 <= i < shape[0] and 0 <= j < shape[1]:
                    matrix[cell, i * shape[1] + j] = weight
        whole = matrix.tocsr()
        flat = values.ravel().copy()
        flat[rest] = spsolve(whole[rest][:, rest].tocsc(), -(whole[rest] @ flat))
        return np.append(flat, 0.0)

    return Case(
        "biharmonic-64",
        "stiff",
        "a biharmonic surface through a tenth of the cells of 64×64",
        lambda engine: _flat(solve(engine)),
        truth,
        5e-2,
        5e-2,
        "it rests where rates are below 1e-5; the slowest mode decays at about 1e-3",
        FEW_STEPS,
        slow="it is solved to 1e-10, which takes minutes",
    )


def _flat(solved: Solved) -> Solved:
    return Solved(solved.values.ravel())


def _wide() -> Case:
    """A 7×7 neighbourhood, linear: every mode of the torus by its own factor."""
    place = np.arange(-3, 4)
    bell = np.exp(-0.25 * (place[:, np.newaxis] ** 2 + place**2))
    weights = 20.0 * (bell / bell.sum()) - 20.0 * np.pad([[1.0]], 3)
    shape = (16, 16)
    template = Template(
        "wide", weights + np.pad([[1.0]], 3), boundary="periodic", duration=2.0, output="linear"
    )
    start = np.random.default_rng(1).uniform(-0.9, 0.9, shape)

    def truth() -> Floats:
        centred = np.zeros(shape)
        for (r, c), weight in np.ndenumerate(weights):
            centred[(3 - r) % 16, (3 - c) % 16] += weight
        rates = np.fft.fft2(centred)
        return np.asarray(np.fft.ifft2(np.fft.fft2(start) * np.exp(2.0 * rates)).real)

    run: Callable[[Engine], Solved] = partial(_from_state, template, start)
    return Case(
        "radius-3",
        "stiff",
        "smoothing over 7×7 cells at rates up to 20",
        run,
        truth,
        1e-4,
        1e-4,
        "the tolerance",
    )


def _from_state(template: Template, start: Floats, engine: Engine) -> Solved:
    return states(engine.run(template, state=start))
