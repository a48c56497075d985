"""How cost grows with the array, the batch, the radius, the layers and the taxel grid."""

import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace

import numpy as np
from numpy.typing import NDArray

from cnnum.arrays import Floats, Shape
from cnnum.engine import Engine
from cnnum.lab.bench.errors import STEPS, ends_error
from cnnum.lab.bench.samples import full_template, maps
from cnnum.lab.bench.timing import difference
from cnnum.templating.template import Template

STEP = 0.02
WORK = 1.5e8
"""Updates by nine weights that a timed run takes at most; a larger case takes fewer steps."""

TIME_S = 110.0
"""s for all places. The rest is shared out evenly, so that builds and slow places use up time of
later ones. Each place takes three turns, however little is left. A run ends within three minutes on
a machine that is not busy with others' work."""

MOST_S = 3.0
"""s a place at most: more turns add nothing."""


@dataclass(frozen=True, slots=True)
class Scaling:
    """A row of `cnnum bench scaling`.

    Attributes
    ----------
    case : str
        The growing quantity.
    device : str
    shape : (rows, cols)
    batch, radius, layers : int
    cell_updates_per_s : float
        Of the steps alone.
    ns_per_update : float
        The same as time.
    growth : float or None
        The same over that of the `BASE` array in the same run. None if it is not the array that
        grows.
    seconds : float
        Median of the longer run, host to host, s.
    spread : float
    error : float
        Of the first and the last frame after a few of the steps, over their largest state. The
        reference engine's own steps are the truth.
    """

    case: str
    device: str
    shape: Shape
    batch: int
    radius: int
    layers: int
    cell_updates_per_s: float
    ns_per_update: float
    growth: float | None
    seconds: float
    spread: float
    error: float


@dataclass(frozen=True, slots=True)
class Point:
    """One place on a curve."""

    case: str
    shape: Shape = (8, 8)
    batch: int = 1
    radius: int = 1
    layers: int = 1


BASE = Point("array", (64, 64))
"""The reference of other arrays: from here to 2048² a cell shall take the same time within
1.5 times."""


def points(*, quick: bool = False) -> tuple[Point, ...]:
    """Return the places to measure."""
    sides: tuple[int, ...] = (8, 16, 32, 64, 128, 256, 512, 1024, 2048)
    batches: tuple[int, ...] = (1, 16, 256, 4096, 65_536)
    grids: tuple[tuple[int, int], ...] = ((2, 2), (4, 4), (4, 6), (8, 8), (9, 9), (16, 16))
    if quick:
        sides, batches, grids = (8, 64, 512, 2048), (1, 256, 65_536), ((2, 2), (8, 8))
    return (
        *(Point("array", (n, n)) for n in sides),
        *(Point("batch", batch=n) for n in batches),
        *(Point("radius", batch=1024, radius=n) for n in (1, 2, 3)),
        *(Point("layers", batch=1024, layers=n) for n in (1, 2, 3, 6)),
        *(Point("taxel grid", grid, 1024) for grid in grids),
    )


def measure_scaling(engine: Engine, *, quick: bool = False) -> Iterator[Scaling]:
    """Yield one row per place, in their order and as soon as it is measured.

    `BASE` is measured before all others, so that each row comes with its growth.
    """
    places = points(quick=quick)
    others = tuple(point for point in places if point != BASE)
    measured = _in_time(engine, (BASE, *others), (0.2 if quick else 1.0) * TIME_S)
    base = next(measured)
    for point in places:
        yield grown(base if point == BASE else next(measured), base)


def grown(row: Scaling, base: Scaling) -> Scaling:
    """Return a row with its growth over the base's."""
    if row.case != BASE.case:
        return row
    return replace(row, growth=row.ns_per_update / base.ns_per_update)


def _in_time(engine: Engine, places: tuple[Point, ...], seconds: float) -> Iterator[Scaling]:
    until = time.perf_counter() + seconds
    for number, point in enumerate(places):
        share = (until - time.perf_counter()) / (len(places) - number)
        # about half of a place's time goes into its builds
        yield _measure(engine, point, budget=min(MOST_S, max(0.0, 0.5 * share)))


def _measure(engine: Engine, point: Point, budget: float) -> Scaling:
    template = full_template(point.radius, point.layers)
    u = maps(point.batch, *point.shape)
    cells = u.size * point.layers
    few = int(min(max(WORK / (3 * cells * template.A[0].size / 9), 8), 4000))

    def run(steps: int, given: Template = template) -> None:
        engine.run(given, input=u, duration=steps * STEP, dt=STEP)

    def states(on: Engine, frames: NDArray[np.floating]) -> Floats:
        return on.run(template, input=frames, duration=STEPS * STEP, dt=STEP).state

    result = difference(lambda: run(few), lambda: run(3 * few), budget=budget, runs=9)
    rate = cells * 2 * few / result.more
    return Scaling(
        device=engine.device,
        **asdict(point),
        cell_updates_per_s=rate,
        ns_per_update=1e9 / rate,
        growth=None,
        seconds=result.long.median,
        spread=result.long.spread,
        error=ends_error(states, engine, u),
    )
