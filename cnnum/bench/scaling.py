"""How cost grows with the array, the batch, the radius, the layers and the taxel grid."""

from collections.abc import Iterator
from dataclasses import dataclass

from cnnum.arrays import Shape
from cnnum.bench.samples import full_template, maps
from cnnum.bench.timing import difference
from cnnum.engine import Engine
from cnnum.template import Template

STEP = 0.02
WORK = 6e8
"""Cell updates a timed run takes at most; a larger case takes fewer steps."""


@dataclass(frozen=True, slots=True)
class Scaling:
    """A row of `cnnum bench scaling`.

    Attributes
    ----------
    case : str
        What grows.
    device : str
    shape : (rows, cols)
    batch, radius, layers : int
    cell_updates_per_s : float
        Of the steps alone.
    ns_per_update : float
        The same as time.
    seconds : float
        Median of the longer run, host to host, s.
    spread : float
    """

    case: str
    device: str
    shape: Shape
    batch: int
    radius: int
    layers: int
    cell_updates_per_s: float
    ns_per_update: float
    seconds: float
    spread: float


@dataclass(frozen=True, slots=True)
class Point:
    """One place on a curve."""

    case: str
    shape: Shape = (8, 8)
    batch: int = 1
    radius: int = 1
    layers: int = 1


def points(*, quick: bool = False) -> tuple[Point, ...]:
    """Return the places to measure."""
    sides: tuple[int, ...] = (8, 16, 32, 64, 128, 256, 512, 1024, 2048)
    batches: tuple[int, ...] = (1, 16, 256, 4096, 65_536)
    grids: tuple[tuple[int, int], ...] = ((2, 2), (4, 4), (8, 8), (16, 16), (4, 6), (9, 9))
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
    """Yield a row a place."""
    for point in points(quick=quick):
        yield _measure(engine, point, budget=0.5 if quick else 2.0)


def _measure(engine: Engine, point: Point, budget: float) -> Scaling:
    template = full_template(point.radius, point.layers)
    u = maps(point.batch, *point.shape)
    cells = u.size * point.layers
    few = int(min(max(WORK / (4 * cells * template.A[0].size / 9), 8), 4000))

    def run(steps: int, given: Template = template) -> None:
        engine.run(given, input=u, duration=steps * STEP, dt=STEP)

    more, long = difference(lambda: run(few), lambda: run(3 * few), budget=budget, runs=9)
    rate = cells * 2 * few / more
    return Scaling(
        case=point.case,
        device=engine.device,
        shape=point.shape,
        batch=point.batch,
        radius=point.radius,
        layers=point.layers,
        cell_updates_per_s=rate,
        ns_per_update=1e9 / rate,
        seconds=long.median,
        spread=long.spread,
    )
