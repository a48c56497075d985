"""How often smooth contacts have an edge: small ones, several spheres, and one that is pulled.

`python -m cnnum.lab.bench.programs.smooth_edges` prints all tables. Spheres are Hertz's, pulls are
Cattaneo's and Mindlin's, readings are Hankel's, Love's and Cerruti's, with the noise of Table 3.II.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from cnnum.arrays import Floats
from cnnum.engine import Engine
from cnnum.lab.bench.programs.edge_errors import DEPTHS, READINGS, run_loads
from cnnum.tactile.indenters import Disc, Indenter, Pressure, Reads, Rectangle, frame_under
from cnnum.tactile.touches import Touch, readings

PRESSURES: tuple[Pressure, ...] = ("hertz", "uniform")
SMALL = (0.6, 0.8, 1.0, 1.2, 1.4, 1.6, 1.8)
"""Cells: small contacts on 8×8, and half of what is as wide and has an edge."""

AMID = 1.5
"""Cells that these lie from the middle at most, along rows and columns."""

RADII = {8: ((1.5, 1.9), (1.7, 2.0)), 16: ((2.0, 3.5),)}
"""Cells: two contacts side by side, by the cells of a side."""

THREE_RADII = {8: ((1.5, 1.7),), 16: ((1.6, 2.4), (2.0, 3.0))}
"""The same of three."""

GAPS = {8: (0.5, 1.2), 16: (0.5, 3.0)}
"""Cells between them."""

PULLED = ((0.8, 1.2), (1.2, 1.6), (1.6, 2.0), (2.0, 3.3))
"""Cells: contacts that are pulled, on 8×8."""

FINER = 15
"""Cells of the surface to a pitch under them: readings of the narrowest are off by 0.3 %."""

FRICTION = 0.7
SHARES = (0.0, 0.3, 0.6, 0.9, 0.999)
"""Of the pull at which the whole contact slips."""

SPARE = 0.3
"""Cells by which a contact may lie beyond the array."""


@dataclass(frozen=True, slots=True)
class Several:
    """Round contacts that do not overlap, and their mean pressures over the first's."""

    discs: tuple[Disc, ...]
    shares: tuple[float, ...]

    def frame(self, cells: int, depth: float, reads: Reads) -> Floats:
        """Return what a square array reads of all."""
        frames = [
            share * frame_under(disc, (cells, cells), depth, reads)
            for disc, share in zip(self.discs, self.shares, strict=True)
        ]
        return np.asarray(sum(frames))


def drawn_pairs(
    rng: np.random.Generator,
    cells: int,
    radii: tuple[float, float],
    count: int,
    pressure: Pressure = "hertz",
) -> list[Several]:
    """Draw pairs in any direction, the second's pressure 0.5 to 1 of the first's."""
    found: list[Several] = []
    while len(found) < count:
        sizes = rng.uniform(*radii, 2)
        away, angle = sizes.sum() + rng.uniform(*GAPS[cells]), rng.uniform(0.0, 2 * np.pi)
        half = 0.5 * away * np.array([np.cos(angle), np.sin(angle)])
        middle, share = rng.uniform(-0.5, 0.5, 2), float(rng.uniform(0.5, 1.0))
        places = (middle + half, middle - half)
        reach = [np.abs(place).max() + size for place, size in zip(places, sizes, strict=True)]
        if max(reach) <= cells / 2 + SPARE:
            found.append(Several(_discs(sizes, places, pressure), (1.0, share)))
    return found


def drawn_threes(
    rng: np.random.Generator,
    cells: int,
    radii: tuple[float, float],
    count: int,
    pressure: Pressure = "hertz",
) -> list[Several]:
    """Draw three anywhere, each as near to another as pairs are, with pressures like theirs."""
    found: list[Several] = []
    near, far = GAPS[cells]
    while len(found) < count:
        sizes = rng.uniform(*radii, 3)
        reach = cells / 2 + SPARE - sizes[:, None]
        places = rng.uniform(-reach, reach, (3, 2))
        away = np.linalg.norm(places[:, None] - places, axis=-1) - (sizes[:, None] + sizes)
        gaps = np.sort(away[np.triu_indices(3, 1)])
        if gaps[0] >= near and gaps[1] <= far:
            first, second = rng.uniform(0.5, 1.0, 2)
            shares = (1.0, float(first), float(second))
            found.append(Several(_discs(sizes, places, pressure), shares))
    return found


def _discs(sizes: Floats, places: Iterable[Floats], pressure: Pressure) -> tuple[Disc, ...]:
    return tuple(
        Disc(float(size), (float(place[0]), float(place[1])), pressure)
        for size, place in zip(sizes, places, strict=True)
    )


def drawn_pulls(
    rng: np.random.Generator, radii: tuple[float, float], share: float, count: int
) -> list[Touch]:
    """Draw spheres near the middle of the array, pulled by a share of what makes them slip."""
    return [
        Touch(
            float(rng.uniform(*radii)),
            (float(rng.uniform(-0.5, 0.5)), float(rng.uniform(-0.5, 0.5))),
            share * FRICTION,
            float(rng.uniform(0.0, 2 * np.pi)),
            FRICTION,
        )
        for _ in range(count)
    ]


def drawn_small(rng: np.random.Generator, kind: str, size: float, count: int) -> list[Indenter]:
    """Draw small spheres, uniform discs or squares, squares at any angle."""
    found: list[Indenter] = []
    for _ in range(count):
        at = (float(rng.uniform(-AMID, AMID)), float(rng.uniform(-AMID, AMID)))
        if kind == "square":
            angle = float(rng.uniform(0.0, np.pi))
            found.append(Rectangle(2.0 * size, 2.0 * size, angle, at))
        else:
            found.append(Disc(size, at, "hertz" if kind == "sphere" else "uniform"))
    return found


def edged(engine: Engine, frames: Sequence[Floats], depth: float, reads: Reads) -> int:
    """Return how many frames have an edge."""
    got = run_loads(engine, np.stack(frames), depth, reads)
    return int((got["edge_count"] > 0).sum())


def small(engine: Engine, count: int) -> None:
    """Print how many small contacts have an edge, by depth."""
    rng = np.random.default_rng(35)
    for kind in ("sphere", "disc", "square"):
        for size in SMALL:
            bodies = drawn_small(rng, kind, size, count)
            for reads in READINGS:
                found = {
                    depth: edged(
                        engine,
                        [frame_under(body, (8, 8), depth, reads) for body in bodies],
                        depth,
                        reads,
                    )
                    for depth in DEPTHS
                }
                print(
                    f"8×8, a {kind} of {size} cells, {reads}: edges by depth, of {count}: {found}",
                    flush=True,
                )


def side_by_side(engine: Engine, count: int) -> None:
    """Print how many frames of two and three contacts have an edge, by depth."""
    for name, drawn, all_ranges in (
        ("two", drawn_pairs, RADII),
        ("three", drawn_threes, THREE_RADII),
    ):
        for cells, ranges in all_ranges.items():
            for radii, pressure in product(ranges, PRESSURES):
                bodies = drawn(np.random.default_rng(31), cells, radii, count, pressure)
                for reads in READINGS:
                    found = {
                        depth: edged(
                            engine,
                            [body.frame(cells, depth, reads) for body in bodies],
                            depth,
                            reads,
                        )
                        for depth in DEPTHS
                    }
                    print(
                        f"{cells}×{cells}, {name} of {radii[0]} to {radii[1]} cells, {pressure}, "
                        f"{reads}: edges by depth, of {count}: {found}",
                        flush=True,
                    )


def pulls(engine: Engine, count: int) -> None:
    """Print how many pulled spheres have an edge, by depth."""
    for radii, reads, share in product(PULLED, READINGS, SHARES):
        touches = drawn_pulls(np.random.default_rng(33), radii, share, count)
        found = {
            depth: edged(
                engine,
                [-readings(touch, 8, depth, reads, FINER)[..., 2] for touch in touches],
                depth,
                reads,
            )
            for depth in DEPTHS
        }
        print(
            f"8×8, a sphere of {radii[0]} to {radii[1]} cells pulled by {share} of what makes it "
            f"slip, {reads}: edges by depth, of {count}: {found}",
            flush=True,
        )


def main(count: int = 60) -> None:
    """Print how often smooth contacts have an edge."""
    engine = Engine()
    small(engine, count)
    side_by_side(engine, count)
    pulls(engine, count)


if __name__ == "__main__":
    main()
