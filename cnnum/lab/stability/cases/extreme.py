"""Extreme numbers and shapes: huge, tiny, empty, long, or all alike."""

from collections.abc import Callable, Iterator

import numpy as np

from cnnum.arrays import Floats
from cnnum.engine import Engine
from cnnum.lab.stability.cases.solving import coupled
from cnnum.lab.stability.record import Case, Solved, outputs, states
from cnnum.templating.library import get_template
from cnnum.templating.template import Template

NOT_FINITE = r"infinit|too large|not finite|overflow"
SHAPES = ((1, 1), (1, 2), (1, 97), (97, 1), (2, 3), (7, 13), (31, 37), (4096, 8), (8, 4096))


def cases() -> Iterator[Case]:
    """Return the extreme cases."""
    for size in (1e-45, 1e-40, 1e-30, 1e10, 1e30):
        yield _input_of_size(size)
    yield _too_large()
    for shape in SHAPES:
        yield _edges(shape)
        yield _mean(shape)
    yield _empty_batch()
    yield _alike("all-white", -1.0)
    yield _alike("all-black", 1.0)
    yield _checkerboard()
    yield _corner()
    yield _rim_alone()
    yield _huge_mask()
    yield _large_and_small()
    for duration in (0.0, 1e-40, 1e6):
        yield _decay_for(duration)


def _input_of_size(size: float) -> Case:
    """X' = −x + u, of one huge or tiny number among zeros."""
    template = Template("follow", [[0.0]], [[1.0]], duration=1.0, output="linear")
    picture = np.zeros((8, 8))
    picture[2, 3], picture[5, 5] = size, -size
    tiny = 1e-37
    return Case(
        f"input-{size:g}",
        "extreme",
        f"inputs of ±{size:g}",
        lambda engine: states(engine.run(template, input=picture)),
        lambda: picture * -np.expm1(-1.0),
        max(1e-6 * size, tiny),
        max(1e-6 * size, tiny),
        "roundings; values below 1e-37 may be 0, as devices flush it",
    )


def _too_large() -> Case:
    """A sum beyond the largest number of single precision is refused, in double it is right."""
    B = np.ones((3, 3))
    template = Template("sum", [[0.0]], B, duration=1.0, output="linear")
    picture = np.full((8, 8), 2e38)
    return Case(
        "sum-beyond-float32",
        "extreme",
        "a sum of 1.8e39, which single precision does not hold",
        lambda engine: states(engine.run(template, input=picture)),
        lambda: _driven(B, picture, 1.0),
        0.0,
        1e33,
        "roundings in double precision; none is right in single",
        NOT_FINITE,
    )


def _driven(B: Floats, picture: Floats, duration: float) -> Floats:
    """Return the states of x' = −x + B u after a time, from 0."""
    total = coupled(B, picture, "constant")
    return np.asarray(total * -np.expm1(-duration), dtype=np.float64)


def _picture(shape: tuple[int, int]) -> Floats:
    return np.where(np.random.default_rng(sum(shape)).random(shape) < 0.5, 1.0, -1.0)


def _edges(shape: tuple[int, int]) -> Case:
    """EDGE: a black cell with a white one among its eight neighbours stays black."""
    picture = _picture(shape)

    def truth() -> Floats:
        black = picture > 0
        around = np.pad(black, 1, mode="symmetric")
        whole = np.ones(shape, dtype=bool)
        for r in range(3):
            for c in range(3):
                whole &= around[r : r + shape[0], c : c + shape[1]]
        return np.where(black & ~whole, 1.0, -1.0)

    return Case(
        f"edge-{shape[0]}x{shape[1]}",
        "extreme",
        f"EDGE on {shape[0]}×{shape[1]} cells",
        lambda engine: Solved(np.sign(engine.run(get_template("EDGE"), input=picture).output)),
        truth,
        0.0,
        0.0,
        "every cell decides",
    )


def _mean(shape: tuple[int, int]) -> Case:
    """Diffusion keeps the mean, in arrays of any shape."""
    d = 0.2
    A = [[0.0, d, 0.0], [d, 1.0 - 4.0 * d, d], [0.0, d, 0.0]]
    template = Template("heat", A, boundary="zero-flux", duration=5.0)
    start = 0.9 * _picture(shape)
    return Case(
        f"mean-{shape[0]}x{shape[1]}",
        "extreme",
        f"diffusion on {shape[0]}×{shape[1]} cells keeps their mean",
        lambda engine: Solved(np.mean(engine.run(template, state=start).state, keepdims=True)),
        lambda: np.mean(start, keepdims=True),
        1e-4,
        1e-4,
        "the tolerance",
    )


def _empty_batch() -> Case:
    return Case(
        "empty-batch",
        "extreme",
        "a batch of no frame",
        lambda engine: states(engine.run(get_template("EDGE"), input=np.zeros((0, 8, 8)))),
        lambda: np.zeros((0, 8, 8)),
        0.0,
        0.0,
        "no frame, no number",
        r"empty|no frame|at least one",
    )


def _alike(name: str, value: float) -> Case:
    """On a picture of one colour no template of edges finds any, with zero flux at the rim."""
    picture = np.full((8, 8), value)
    return Case(
        name,
        "extreme",
        f"EDGE where every cell is {value:g}",
        lambda engine: outputs(engine.run(get_template("EDGE"), input=picture)),
        lambda: np.full((8, 8), -1.0),
        1e-6,
        1e-6,
        "the output is saturated",
    )


def _checkerboard() -> Case:
    picture = np.where(np.indices((8, 8)).sum(axis=0) % 2, 1.0, -1.0)
    return Case(
        "checkerboard",
        "extreme",
        "EDGE on a checkerboard: every black cell is an edge",
        lambda engine: outputs(engine.run(get_template("EDGE"), input=picture)),
        lambda: picture,
        1e-6,
        1e-6,
        "the output is saturated",
    )


def _corner() -> Case:
    """All cells exactly where they saturate, where the rate is 0 on one side only."""
    template = Template("corner", [[2.0]], z=-1.0, duration=10.0)
    return Case(
        "saturation-corner",
        "extreme",
        "every cell at x = 1, where a₀₀ = 2 and z = −1 hold it in balance",
        lambda engine: states(engine.run(template, state=np.ones((8, 8)))),
        lambda: np.ones((8, 8)),
        1e-6,
        1e-6,
        "the rate is 0 there",
    )


def _rim_alone() -> Case:
    """One cell that only hears the virtual cells around it."""
    A = np.ones((3, 3))
    A[1, 1] = 0.0
    template = Template("rim", A, boundary=0.1, duration=3.0)
    return Case(
        "rim-alone",
        "extreme",
        "one cell with nothing around it but virtual cells",
        lambda engine: states(engine.run(template, state=np.zeros((1, 1)))),
        lambda: np.full((1, 1), -0.8 * np.expm1(-3.0)),
        1e-4,
        1e-4,
        "the tolerance",
    )


def _huge_mask() -> Case:
    """Where a mask holds all cells nothing moves, under any drive."""
    start = np.linspace(-0.9, 0.9, 64).reshape(8, 8)
    hole = get_template("HOLE")
    held = np.ones((8, 8), dtype=bool)
    return Case(
        "all-held",
        "extreme",
        "a mask that holds every cell",
        lambda engine: states(
            engine.run(hole, input=np.ones((8, 8)), state=start, mask=held, duration=5.0)
        ),
        lambda: start,
        1e-7,
        0.0,
        "the state is kept; single precision rounds it once",
    )


def _large_and_small() -> Case:
    """A mean of numbers, one 1e6 times the others."""
    B = np.full((3, 3), 1.0 / 9.0)
    template = Template("box", [[0.0]], B, duration=20.0, output="linear")
    picture = np.random.default_rng(2).uniform(0.5, 1.0, (8, 8))
    picture[4, 4] = 1e6
    return Case(
        "large-beside-small",
        "extreme",
        "sums over a cell that is a million times as large as its neighbours",
        lambda engine: states(engine.run(template, input=picture)),
        lambda: _driven(B, picture, 20.0),
        1e6 / 9.0 * 9.0 * 6e-8,
        1e-3,
        "nine roundings of the largest number",
    )


def _decay_for(duration: float) -> Case:
    template = Template("decay", [[0.0]], duration=duration, z=0.25)
    solve: Callable[[Engine], Solved] = lambda engine: states(  # noqa: E731
        engine.run(template, state=np.full((8, 8), 0.75))
    )
    return Case(
        f"decay-for-{duration:g}",
        "extreme",
        f"a cell that decays for {duration:g} time constants",
        solve,
        lambda: np.full((8, 8), 0.25 + 0.5 * np.exp(-duration)),
        1e-6,
        1e-6,
        "exact, but for roundings",
    )
