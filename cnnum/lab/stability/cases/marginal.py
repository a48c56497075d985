"""Arrays on the edge: of growth, of rest, of order."""

from collections.abc import Iterator

import numpy as np

from cnnum.arrays import Floats
from cnnum.engine import Engine
from cnnum.lab.stability.cases.solving import integrated
from cnnum.lab.stability.record import Case, Solved, outputs, says_settled, states
from cnnum.templating.couplings import NonlinearCoupling
from cnnum.templating.functions import Table
from cnnum.templating.template import Template

SHAPE = (8, 8)
TOO_LONG = r"did not reach its end"

ALPHA, BETA, INNER, OUTER = 9.0, 14.286, -1.0 / 7.0, 2.0 / 7.0
"""Chua's circuit with the double scroll (Chua, Komuro & Matsumoto, IEEE Trans. CAS 33 (1986))."""


def cases() -> Iterator[Case]:
    """Return the marginal cases."""
    for excess in (1e-2, 1e-4, 1e-6, 0.0, -1e-6, -1e-2):
        yield _weakly(excess)
    yield _balanced()
    yield from _not_at_rest()
    yield from _at_rest()
    for width in (8, 64):
        yield _pinned_front(width)
    for periods in (10, 100, 10_000):
        for output in ("linear", "standard"):
            yield _oscillator(periods, output)
    for strength in (1.1, 2.0):
        yield _never_settles(strength)
    yield _chua()
    yield _chua_bounded()
    yield _pattern()


def _weakly(excess: float) -> Case:
    """X' = ε x + z within the linear range, coupled to nothing and to a mirror of itself."""
    alone = Template("edge", [[1.0 + excess]], z=0.01, duration=20.0)
    cross = [[0.0, 0.25, 0.0], [0.25, excess, 0.25], [0.0, 0.25, 0.0]]
    # four neighbours, all alike, weigh as much as a₀₀ = 1
    together = Template("edge", cross, z=0.01, duration=20.0, boundary="zero-flux")

    def solve(engine: Engine) -> Solved:
        start = np.full(SHAPE, 0.3)
        runs = [engine.run(template, state=start) for template in (alone, together)]
        return Solved(np.stack([run.state for run in runs]))

    def truth() -> Floats:
        grown = np.expm1(20.0 * excess) / excess if excess else 20.0
        return np.full((2, *SHAPE), 0.3 * np.exp(20.0 * excess) + 0.01 * grown)

    return Case(
        f"growth-{excess:g}",
        "marginal",
        f"cells that grow by {excess:g} a time constant",
        solve,
        truth,
        1e-3,
        1e-3,
        "the tolerance a time constant, over twenty",
    )


def _balanced() -> Case:
    """A state that begins in exact balance stays there for any given time."""
    A = [[0.0, 0.1, 0.0], [0.1, 2.0, 0.1], [0.0, 0.1, 0.0]]
    template = Template("balance", A, duration=10.0)
    return Case(
        "balanced",
        "marginal",
        "cells in exact balance on a saddle, for ten time constants",
        lambda engine: states(engine.run(template, state=np.zeros(SHAPE))),
        lambda: np.zeros(SHAPE),
        0.0,
        0.0,
        "every term of the rates is 0",
    )


def _rest(name: str, title: str, template: Template, start: Floats, end: Floats) -> Case:
    """A run to rest ends where the network rests, or says that it does not rest."""

    def solve(engine: Engine) -> Solved:
        result = engine.run(template, state=start, duration="settle")
        if not np.all(result.settled):
            return Solved(end)  # it says that it is not at rest: so be it
        return states(result)

    return Case(
        name,
        "marginal",
        title,
        solve,
        lambda: end,
        1e-3,
        1e-3,
        "at rest, the tolerance over the slowest decay; or it says that it does not rest",
    )


def _not_at_rest() -> Iterator[Case]:
    slow = Template("bottleneck", [[0.0, 0.0, 0.0], [1e-3, 2.0, 1e-3], [0.0, 0.0, 0.0]], z=-1.00101)
    # all at 2: y = 1, and x' = −x + 2.002 − 1.00101 would be at rest at 1.00099. From there the
    # rim, which lacks a neighbour, goes down first and takes the others with it
    yield _rest(
        "bottleneck",
        "rates fall to 1e-5 on the way to another rest",
        slow,
        np.full(SHAPE, 2.0),
        np.where(np.isin(np.arange(8), (0, 7)), -3.00201, -3.00301) + np.zeros(SHAPE),
    )
    saddle = Template(
        "saddle",
        [[0.0, 0.1, 0.0], [0.1, 2.0, 0.1], [0.0, 0.1, 0.0]],
        z=1e-7,
        boundary="zero-flux",
    )
    yield _rest(
        "saddle",
        "rates of 1e-7 grow until the cells saturate",
        saddle,
        np.zeros(SHAPE),
        np.full(SHAPE, 2.4),
    )


def _at_rest() -> Iterator[Case]:
    for weight in (0.9, 0.999):
        yield _slow_decay(weight)


def _slow_decay(weight: float) -> Case:
    """A linear cell that comes to rest at 0.5, slowly."""
    rate = 1.0 - weight
    template = Template("slow", [[weight]], z=0.5 * rate, duration="settle")
    return Case(
        f"slow-decay-{weight:g}",
        "marginal",
        f"cells that come to rest at a rate of {rate:.1g}",
        lambda engine: states(engine.run(template, state=np.zeros(SHAPE))),
        lambda: np.full(SHAPE, 0.5),
        5e-5,
        5e-5,
        "the rest of a cell alone is exact",
    )


def _pinned_front(width: int) -> Case:
    """A front between two saturated halves that neither wins, too weakly coupled to move."""
    A = [[0.0, 0.0, 0.0], [0.2, 2.0, 0.2], [0.0, 0.0, 0.0]]
    template = Template("front", A, boundary="zero-flux", duration=50.0)
    start = np.broadcast_to(np.where(np.arange(width) < width // 2, 1.0, -1.0), (4, width)).copy()

    def truth() -> Floats:
        end = np.full(width, 2.4)
        end[[width // 2 - 1]] = 2.0
        end[width // 2 :] = -end[: width - width // 2][::-1]
        rest = np.broadcast_to(end, (4, width))
        return np.asarray(rest + (start - rest) * np.exp(-50.0), dtype=np.float64)

    return Case(
        f"pinned-front-{width}",
        "marginal",
        f"a front of speed 0 in rows of {width} cells",
        lambda engine: states(engine.run(template, state=start)),
        truth,
        1e-3,
        1e-3,
        "saturated cells decay to their rest at rate 1",
    )


def _oscillator(periods: int, output: str) -> Case:
    """Two layers that turn without loss: x' = −y, y' = x."""
    A = np.zeros((2, 2, 1, 1))
    A[0, 0] = A[1, 1] = 1.0
    A[0, 1], A[1, 0] = -1.0, 1.0
    duration = 2.0 * np.pi * periods
    template = Template("turn", A, duration=duration, output=output)
    start = np.stack([np.full((2, 2), 0.5), np.zeros((2, 2))])
    drift = 1e-3 * periods
    return Case(
        f"oscillator-{periods}-{output}",
        "marginal",
        f"{periods} turns without loss, {output} output",
        lambda engine: states(engine.run(template, state=start)),
        lambda: start,
        min(drift, 0.1) if output == "standard" else 2e-7 * periods + 1e-5,
        min(drift, 0.1) if output == "standard" else 1e-9 * periods,
        "the tolerance, some ten times a turn" if output == "standard" else "roundings of a turn",
        TOO_LONG,
        slow="it would take a million steps there" if periods > 1000 else "",
    )


def _never_settles(strength: float) -> Case:
    """Three cells in a ring that chase each other; the limit cycle is stable for s > 1."""
    s = strength
    A = np.zeros((3, 3, 1, 1))
    for n in range(3):
        A[n, n], A[n, (n + 1) % 3] = s + 0.5, -s
    template = Template("ring", A, duration="settle")
    start = np.stack([np.full((2, 2), v) for v in (0.4, -0.1, 0.2)])
    return Case(
        f"never-settles-{strength:g}",
        "marginal",
        "three layers in a ring that chase each other without end",
        lambda engine: says_settled(engine.run(template, state=start)),
        lambda: np.zeros(()),
        0.0,
        0.0,
        "no equilibrium of the ring is stable",
        slow="it would follow the ring to 1e-10 for a thousand time constants",
    )


def _chua_template(duration: float) -> Template:
    A = np.zeros((3, 3, 1, 1))
    A[0, 0], A[0, 1] = 1.0 - ALPHA * OUTER, ALPHA
    A[1, 0], A[1, 2] = 1.0, 1.0
    A[2, 2], A[2, 1] = 1.0, -BETA
    bend = ALPHA * (OUTER - INNER)
    table = Table("linear", ((-1.0, -bend), (1.0, bend)))
    diode = NonlinearCoupling(np.ones((1, 1)), table, "x")
    return Template("chua", A, nonlinear=[diode], output="linear", duration=duration)


def _chua_starts() -> Floats:
    x = np.linspace(-0.5, 0.5, 16).reshape(4, 4)
    return np.stack([x, 0.2 * x[::-1], 0.1 - x])


def _chua() -> Case:
    """Chaos is followed over a short time only: errors grow e-fold in two or so."""

    def truth() -> Floats:
        from scipy.integrate import solve_ivp

        def slope(_: float, flat: Floats) -> Floats:
            x, y, z = flat.reshape(3, -1)
            diode = OUTER * x + 0.5 * (INNER - OUTER) * (np.abs(x + 1.0) - np.abs(x - 1.0))
            return np.concatenate([ALPHA * (y - x - diode) + ALPHA * x, x - y + z, -BETA * y])

        start = _chua_starts()
        end = solve_ivp(slope, (0.0, 4.0), start.ravel(), "Radau", rtol=1e-10, atol=1e-12).y[:, -1]
        return np.asarray(end).reshape(start.shape)

    return Case(
        "chaos-short",
        "marginal",
        "Chua's circuit as a cell of three layers, for four time constants",
        lambda engine: states(engine.run(_chua_template(4.0), state=_chua_starts())),
        truth,
        2e-2,
        2e-2,
        "the tolerance, times the growth of an error in chaos over the time",
    )


def _chua_bounded() -> Case:
    """Over a long time the circuit stays on its attractor: 0 where every cell does."""

    def solve(engine: Engine) -> Solved:
        state = engine.run(_chua_template(100.0), state=_chua_starts()).state
        return Solved(np.maximum(np.abs(state).max(axis=(1, 2)) - np.array([4.0, 1.0, 6.0]), 0.0))

    return Case(
        "chaos-long",
        "marginal",
        "the same for a hundred: every cell stays on the attractor",
        solve,
        lambda: np.zeros(3),
        0.0,
        0.0,
        "the double scroll lies within |x| < 4, |y| < 1, |z| < 6",
        patience=180.0,  # the reference engine looks in vain for two solutions that agree
    )


def _pattern() -> Case:
    """Activator and inhibitor from small noise: the waves that grow are those of the formula."""
    n, time = 16, 6.0
    A = np.zeros((2, 2, 3, 3))
    cross = np.array([[0.0, 1.0, 0.0], [1.0, -4.0, 1.0], [0.0, 1.0, 0.0]])
    A[0, 0], A[1, 1] = 0.05 * cross, 1.0 * cross
    A[0, 0, 1, 1] += 2.5
    A[0, 1, 1, 1], A[1, 0, 1, 1], A[1, 1, 1, 1] = -2.0, 2.0, A[1, 1, 1, 1] - 0.5
    template = Template("turing", A, boundary="periodic", duration=time)
    start = 1e-3 * np.random.default_rng(3).standard_normal((2, n, n))
    return Case(
        "pattern",
        "marginal",
        "an activator and an inhibitor that diffuse form a pattern from small noise",
        lambda engine: outputs(engine.run(template, state=start)),
        lambda: np.clip(integrated(A, 0.0, start, time, outside="wrap"), -1.0, 1.0),
        2e-2,
        2e-2,
        "the tolerance, times the growth of the fastest wave",
    )
