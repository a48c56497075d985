"""Streams on which ranges are measured, and the programs of the library as they are exported."""

from collections.abc import Sequence
from functools import cache, lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cnnum.arrays import Floats, Shape
from cnnum.drivers.simulated import hands
from cnnum.drivers.simulated.grips import SHAKEN, Array, Arrays, Trial, power, pulled, twisted
from cnnum.embedded.formats import precision_named
from cnnum.embedded.lowering.solvers import solvers_for
from cnnum.embedded.making import Made, make_with
from cnnum.embedded.measuring import Seen, measured
from cnnum.frame import FORCE_AXES
from cnnum.graph.schedule import Schedule, schedule
from cnnum.programs import Program
from cnnum.scenes.arrangement import named

RATE = 200.0
"""Hz of the streams, and the parameter of programs."""

RADIUS = {4: 15e-3}
"""m, of the sphere on small arrays, whose taxels lie as close as others'."""

APART = 20
"""Step between the frames of a program without memories."""

MEASURED = 3
"""Seeds of each kind of stream on which ranges are measured."""


@cache
def trials(shape: Shape, seed: int, count: int, rate: float = RATE) -> tuple[Trial, ...]:
    """Return scenes that slip, twist and rest: `count` of each, from a seed on."""
    arrays = Arrays()
    array = Array(shape, rate=rate, radius=RADIUS.get(min(shape)))
    makers = (
        ("slip", pulled(power(1.0), array)),
        ("slip, gains", pulled(power(2.0), array, SHAKEN)),
        ("twist", twisted(array)),
    )
    found = [maker(arrays, name, n) for name, maker in makers for n in range(seed, seed + count)]
    if shape == (8, 8):
        grip = hands.held(hands.grips)
        found += [grip(arrays, "grip", n) for n in range(seed, seed + count)]
    return tuple(found)


def side_by_side(some: Sequence[Trial], most: int | None = None) -> Floats:
    """Return streams side by side, (frames, streams, rows, cols, 3); the last frame repeats."""
    longest = max(len(one.frames) for one in some)
    longest = longest if most is None else min(longest, most)
    padded = [
        np.concatenate([t.frames[:longest], np.repeat(t.frames[-1:], longest - len(t.frames), 0)])
        if len(t.frames) < longest
        else t.frames[:longest]
        for t in some
    ]
    return np.stack(padded, axis=1).astype(np.float64)


@cache
def measuring_frames(shape: Shape, rate: float = RATE) -> Floats:
    """Return the streams on which ranges are measured: 3 s each."""
    return side_by_side(trials(shape, 0, MEASURED, rate), max(60, round(3.0 * rate)))


def bound(name: str) -> Program:
    """Return a program, of the library or by its place, at the rate of the streams."""
    return named(name).bind(rate=RATE)


def schedule_of(name: str, shape: Shape, needs: Sequence[str] | None = None) -> Schedule:
    """Return the schedule of a program of the library on three-axial frames.

    Raises
    ------
    UnknownNameError
        If there is no such program or output.
    """
    return schedule(bound(name).trace(shape, FORCE_AXES), FORCE_AXES, needs)


def made(
    name: str,
    shape: Shape,
    precision: str,
    method: str = "auto",
    needs: Sequence[str] | None = None,
) -> Made:
    """Return a program of the library in a precision, its ranges measured on simulated scenes.

    Raises
    ------
    NotSupportedError
        If something in it has no form in this precision.
    UnknownNameError
        If there is no such program, output or precision.
    """
    kind, found = precision_named(precision), schedule_of(name, shape, needs)
    wanted = None if needs is None else tuple(needs)
    seen = _seen(name, shape, method, wanted) if kind.integer else Seen()
    return make_with(named(name).name, found, solvers_for(found, method), kind, seen, method)


@lru_cache(maxsize=4)
def _seen(name: str, shape: Shape, method: str, needs: tuple[str, ...] | None) -> Seen:
    """Return the ranges of a program's values: whole numbers of any length share them."""
    found = schedule_of(name, shape, needs)
    step = 1 if found.memories else APART
    return measured(found, solvers_for(found, method), measuring_frames(shape)[::step])


def vector_streams(shape: Shape, count: int, rate: float = RATE) -> Floats:
    """Return simulated streams among which a test vector is chosen, as `vector_parts` does."""
    scenes = trials(shape, 0, MEASURED, rate)[::MEASURED]
    return vector_parts([one.frames for one in scenes], count)


def vector_parts(scenes: Sequence[NDArray[Any]], count: int) -> Floats:
    """Return streams among which a test vector is chosen, (count, streams, rows, cols, channels).

    They are parts of the scenes, as fast as they were taken or with frames left out up to the
    whole scene, and numbers at random, each held for some frames.

    Parameters
    ----------
    scenes : sequence of (frames, rows, cols, channels) float
    count : int
        Frames of a stream.
    """
    found, like = list[Floats](), scenes[0]
    for one in scenes:
        whole = len(one) // count or 1
        for step in sorted({1, whole}):
            last = max(0, len(one) - step * count)
            for start in sorted({0, last // 2, last}):
                part = one[start::step][:count].astype(np.float64)
                rest = np.repeat(part[-1:], count - len(part), axis=0)
                found.append(np.concatenate([part, rest]))
    largest = np.max([np.abs(one).max(axis=(0, 1, 2)) for one in scenes], axis=0)
    random = np.random.default_rng(0)
    for held in (1, 1, 3, 8):
        numbers = random.uniform(-1.0, 1.0, (-(-count // held), *like.shape[1:])) * largest
        found.append(np.repeat(numbers, held, axis=0)[:count])
    return np.stack(found, axis=1).astype(np.float64)


def vector_frames(shape: Shape, count: int) -> Floats:
    """Return frames of one stream: of a slip, after the rest."""
    frames = trials(shape, 0, MEASURED)[0].frames
    start = max(0, min(len(frames) - count, len(frames) // 2))
    return frames[start : start + count].astype(np.float64)
