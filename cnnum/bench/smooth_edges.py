"""How often smooth contacts have an edge: small ones, two spheres, and one that is pulled.

`python -m cnnum.bench.smooth_edges` prints all tables. Spheres are Hertz's, pulls are Cattaneo's
and Mindlin's, readings are Hankel's, Love's and Cerruti's, with the noise of Table 3.II.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cnnum.arrays import Floats
from cnnum.bench.edge_errors import DEPTHS, READINGS, run_loads
from cnnum.engine import Engine
from cnnum.tactile.indenters import Disc, Indenter, Pressure, Reads, Rectangle, frame_under
from cnnum.tactile.touches import Touch, readings

SMALL = (0.6, 0.8, 1.0, 1.2, 1.4, 1.6, 1.8)
"""Cells: small contacts on 8×8, and half of what is as wide and has an edge."""

AMID = 1.5
"""Cells that these lie from the middle at most, along rows and columns."""

RADII = {8: ((1.5, 1.9), (1.7, 2.0)), 16: ((2.0, 3.5),)}
"""Cells: two contacts side by side, by the cells of a side."""

GAPS = {8: (0.5, 1.2), 16: (0.5, 3.0)}
"""Cells between them."""

PULLED = (2.0, 3.3)
"""Cells: contacts that are pulled, on 8×8."""

FRICTION = 0.7
SHARES = (0.0, 0.3, 0.6, 0.9, 0.999)
"""Of the pull at which the whole contact slips."""

SPARE = 0.3
"""Cells by which a contact may lie beyond the array."""


@dataclass(frozen=True, slots=True)
class Two:
    """Two round contacts that do not overlap, and the second's mean pressure over the first's."""

    first: Disc
    second: Disc
    share: float

    def frame(self, cells: int, depth: float, reads: Reads) -> Floats:
        """Return what a square array reads of both."""
        one, two = (
            frame_under(disc, (cells, cells), depth, reads) for disc in (self.first, self.second)
        )
        return np.asarray(one + self.share * two)


def drawn_pairs(
    rng: np.random.Generator,
    cells: int,
    radii: tuple[float, float],
    count: int,
    pressure: Pressure = "hertz",
) -> list[Two]:
    """Draw pairs in any direction, the second's pressure 0.5 to 1 of the first's."""
    found: list[Two] = []
    while len(found) < count:
        sizes = rng.uniform(*radii, 2)
        away, angle = sizes.sum() + rng.uniform(*GAPS[cells]), rng.uniform(0.0, 2 * np.pi)
        half = 0.5 * away * np.array([np.cos(angle), np.sin(angle)])
        middle, share = rng.uniform(-0.5, 0.5, 2), float(rng.uniform(0.5, 1.0))
        places = (middle + half, middle - half)
        reach = [np.abs(place).max() + size for place, size in zip(places, sizes, strict=True)]
        if max(reach) > cells / 2 + SPARE:
            continue
        one, two = (
            Disc(float(size), (float(place[0]), float(place[1])), pressure)
            for place, size in zip(places, sizes, strict=True)
        )
        found.append(Two(one, two, share))
    return found


def drawn_pulls(rng: np.random.Generator, share: float, count: int) -> list[Touch]:
    """Draw spheres near the middle of the array, pulled by a share of what makes them slip."""
    return [
        Touch(
            float(rng.uniform(*PULLED)),
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


def pairs(engine: Engine, count: int) -> None:
    """Print how many pairs of contacts have an edge, by depth."""
    for cells, ranges in RADII.items():
        for radii in ranges:
            for pressure in ("hertz", "uniform"):
                bodies = drawn_pairs(np.random.default_rng(31), cells, radii, count, pressure)
                for reads in READINGS:
                    found = {
                        depth: edged(
                            engine, [two.frame(cells, depth, reads) for two in bodies], depth, reads
                        )
                        for depth in DEPTHS
                    }
                    print(
                        f"{cells}×{cells}, two of {radii[0]} to {radii[1]} cells, {pressure}, "
                        f"{reads}: edges by depth, of {count}: {found}",
                        flush=True,
                    )


def pulls(engine: Engine, count: int) -> None:
    """Print how many pulled spheres have an edge, by depth."""
    for reads in READINGS:
        for share in SHARES:
            touches = drawn_pulls(np.random.default_rng(33), share, count)
            found = {
                depth: edged(
                    engine,
                    [-readings(touch, 8, depth, reads)[..., 2] for touch in touches],
                    depth,
                    reads,
                )
                for depth in DEPTHS
            }
            print(
                f"8×8, a sphere pulled by {share} of what makes it slip, {reads}: "
                f"edges by depth, of {count}: {found}",
                flush=True,
            )


def main(count: int = 60) -> None:
    """Print how often smooth contacts have an edge."""
    engine = Engine()
    small(engine, count)
    pairs(engine, count)
    pulls(engine, count)


if __name__ == "__main__":
    main()
