"""How far found edges lie from the true outlines: `python -m cnnum.lab.bench.programs.edge_errors`.

Frames are closed forms with the noise of Table 3.II; the program knows nothing of them.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from cnnum.arrays import Floats
from cnnum.engine import Engine
from cnnum.programs.library import get_program
from cnnum.tactile.indenters import (
    Disc,
    Indenter,
    Reads,
    Rectangle,
    Ring,
    frame_under,
    two_bars,
)

NOISE = 5e-3
"""2.5 mV of 500 mV."""

DEPTHS = (0.3, 0.5, 0.75, 1.0)
LARGER = {8: 1.0, 16: 1.6, 32: 2.6}
HALF = 0.5
"""Cells. A place must be nearer to the true outline."""

READINGS: tuple[Reads, ...] = ("strain", "stress")
KINDS = ("disc", "ring", "rectangle", "two bars", "punch")


def indenter(kind: str, size: float, rng: np.random.Generator) -> Indenter:
    """Draw an indenter of that kind, its angle and place."""
    angle = float(rng.uniform(0, np.pi))
    at = (float(rng.uniform(-0.5, 0.5)) * size, float(rng.uniform(-0.5, 0.5)) * size)
    a, b, c = (float(value) for value in rng.uniform(0.0, 1.0, 3))
    match kind:
        case "disc":
            return Disc(size * (1.8 + a), at)
        case "ring":
            return Ring(size * (0.9 + 0.2 * a), size * (2.5 + 0.4 * b), at)
        case "rectangle":
            return Rectangle(size * (2.3 + 0.7 * a), size * (3.0 + b), angle, at)
        case "two bars":
            gap = size * (1.4 + 0.2 * c)
            return two_bars(size * (1.5 + 0.5 * a), size * (3.5 + 0.5 * b), gap, angle, at)
        case "punch":
            return Disc(size * (1.8 + a), at, "punch")
        case _:
            return Disc(size * float(kind), at, "hertz")


def found_places(right: Floats, below: Floats) -> Floats:
    """Return row and column of every place where an outline crosses a link, (places, 2)."""
    row, col = np.nonzero(right >= 0)
    across = np.stack([row, col + right[row, col]], axis=-1)
    row, col = np.nonzero(below >= 0)
    down = np.stack([row + below[row, col], col], axis=-1)
    return np.asarray(np.concatenate([across, down]), dtype=np.float64)


def run_edges(
    engine: Engine,
    bodies: Sequence[Indenter],
    cells: int,
    depth: float,
    reads: Reads,
    noise: float = NOISE,
) -> dict[str, Floats]:
    """Return the outputs of `edges` after rest and three frames of each body, side by side."""
    loads = np.stack([frame_under(body, (cells, cells), depth, reads) for body in bodies])
    return run_loads(engine, loads, depth, reads, noise)


def run_loads(
    engine: Engine, loads: Floats, depth: float, reads: Reads, noise: float = NOISE
) -> dict[str, Floats]:
    """Return the outputs of `edges` after rest and three of each frame, side by side.

    Parameters
    ----------
    engine : Engine
    loads : (frames, rows, cols) float
        Normal readings in any unit, positive under a push.
    depth : float
    reads : "strain" or "stress"
    noise : float
        Of one reading, as a share of a frame's largest.
    """
    loads = loads / loads.max(axis=(1, 2), keepdims=True)
    rng = np.random.default_rng(1)
    program = get_program("edges").bind(depth=depth, reads=reads)
    plan = engine.compile(program, (loads.shape[1], loads.shape[2]))
    stream, outputs = plan.stream((len(loads),)), dict[str, Floats]()
    for number in range(21):
        frame = noise * rng.normal(size=(*loads.shape, 3))
        frame[..., 2] -= loads if number >= 18 else 0.0
        outputs = stream.push(frame)
    return outputs


def off_outline(body: Indenter, places: Floats, cells: int) -> Floats:
    """Return the distance of places from an outline, cells."""
    middle = (cells - 1) / 2
    return np.abs(body.distance(places[:, 1] - middle, places[:, 0] - middle))


def bare(body: Indenter, places: Floats, cells: int) -> float:
    """Return the share of an outline that has no place within a cell."""
    axis = np.linspace(-cells / 2, cells / 2, 10 * cells + 1)
    x, y = np.meshgrid(axis, axis)
    on = np.abs(body.distance(x, y)) < 0.06
    outline = np.stack([y[on], x[on]], axis=-1) + (cells - 1) / 2
    return float(np.mean(cKDTree(places).query(outline)[0] > 1.0))


def errors_of(
    engine: Engine,
    kind: str,
    cells: int,
    depth: float,
    reads: Reads,
    count: int,
    noise: float = NOISE,
) -> tuple[Floats, int, float]:
    """Return the errors of all places of many indenters, and how much has no edge.

    That is the number of indenters without any place, and of all others the mean share of the
    outline that has none within a cell.
    """
    rng = np.random.default_rng(7)
    bodies = [indenter(kind, LARGER[cells], rng) for _ in range(count)]
    got = run_edges(engine, bodies, cells, depth, reads, noise)
    found = [
        found_places(right, below)
        for right, below in zip(got["edge_to_right"], got["edge_to_below"], strict=True)
    ]
    off = [off_outline(body, where, cells) for body, where in zip(bodies, found, strict=True)]
    pairs = [(body, where) for body, where in zip(bodies, found, strict=True) if len(where)]
    gaps = [bare(body, where, cells) for body, where in pairs]
    return np.concatenate(off), len(bodies) - len(pairs), float(np.mean(gaps)) if gaps else 1.0


def told_apart(radius: float, depth: float, reads: Reads, cells: int = 8) -> tuple[float, float]:
    """Return how far a sphere's frame is from that of the disc most like it.

    Parameters
    ----------
    radius : float
        Of the sphere's contact, cells.
    depth : float
        Of the cover, cells.
    reads : "strain" or "stress"
    cells : int
        Of the array, along each axis.

    Returns
    -------
    apart : float
        Norm of the difference in standard deviations of the noise: with it, the best test that
        knows both frames is wrong once in a thousand at 6.2, and once in a million at 9.5.
    likeness : float
        Radius of that disc over the sphere's.
    """
    centre = (0.2, 0.1)
    sphere = frame_under(Disc(radius, centre, "hertz"), (cells, cells), depth, reads)
    found: list[tuple[float, float]] = []
    for share in np.arange(0.6, 1.01, 0.02):
        disc = frame_under(Disc(float(share) * radius, centre), (cells, cells), depth, reads)
        off = sphere - disc * float((disc * sphere).sum() / (disc * disc).sum())
        found.append((float(np.linalg.norm(off)) / (NOISE * float(sphere.max())), float(share)))
    return min(found)


@dataclass(frozen=True, slots=True)
class Tally:
    """The places found under indenters of one kind.

    Attributes
    ----------
    depth : float
        Of the cover, cells.
    errors : (places,) float
        Distance to the true outline, cells.
    missed : int
        Indenters without an edge.
    bare : float
        Share of the outline of all others that has no place within a cell.
    """

    depth: float
    errors: Floats
    missed: int
    bare: float

    @property
    def row(self) -> str:
        """Return median and 95 % of the errors, how many are too large, and what has no edge."""
        low, high = np.quantile(self.errors, [0.5, 0.95])
        far = int(np.sum(self.errors >= HALF))
        places = f"{low:.2f} | {high:.2f} | {far} of {len(self.errors)}"
        return f"{places} | {self.missed} | {self.bare:.1%}"


def of_kind(engine: Engine, kind: str, cells: int, count: int) -> Iterator[Tally]:
    """Print and yield the errors under every cover, in strain and in stress."""
    for reads in READINGS:
        for depth in DEPTHS:
            tally = Tally(depth, *errors_of(engine, kind, cells, depth, reads, count))
            print(f"| {cells} | {reads} | {depth} | {kind} | {tally.row} |", flush=True)
            yield tally


def together(cells: int, kind: str, tallies: Sequence[Tally]) -> str:
    """Return the worst of all covers and readings, and the sums over them."""
    low, high = np.array([np.quantile(t.errors, [0.5, 0.95]) for t in tallies]).max(axis=0)
    least = min(float(np.mean(t.errors < HALF)) for t in tallies)
    places = np.concatenate([t.errors for t in tallies])
    missed = {depth: sum(t.missed for t in tallies if t.depth == depth) for depth in DEPTHS}
    return (
        f"{cells}×{cells}, {kind}, the worst: median {low:.2f}, 95 % {high:.2f}, {least:.1%} below "
        f"half a cell; all: {np.sum(places >= HALF)} of {len(places)} places half a cell off or "
        f"more, at most {places.max():.2f}; no edge, by depth: {missed}; "
        f"bare of places: {max(t.bare for t in tallies):.1%} of the outline"
    )


def outlines(engine: Engine, count: int) -> None:
    """Print the errors of indenters with an edge."""
    print(
        "| cells | reads | z/pitch | kind | median | 95 % | half a cell or more | no edge | bare |"
    )
    lines = [
        together(cells, kind, list(of_kind(engine, kind, cells, count)))
        for cells in LARGER
        for kind in KINDS
    ]
    print("\n".join(lines))
    for noise in (NOISE, NOISE / 100):
        off, *_ = errors_of(engine, "punch", 8, DEPTHS[0], "strain", count, noise)
        print(
            f"punch, 8×8, strain, {DEPTHS[0]}, noise {noise:.3%}: 95 % within "
            f"{np.quantile(off, 0.95):.2f}, {np.mean(off < HALF):.1%} below half a cell"
        )


def spheres(engine: Engine, count: int) -> None:
    """Print how many smooth contacts have an edge, and how well they can be told from discs."""
    for radius in ("2.0", "2.5", "3.0", "3.3", "3.6"):
        shares = {
            depth: sum(
                count - errors_of(engine, radius, 8, depth, reads, count)[1] for reads in READINGS
            )
            for depth in DEPTHS
        }
        print(f"Hertz, radius {radius} cells on 8×8: edges by depth, of {2 * count}: {shares}")
    for size in (1.5, 2.0, 2.5):
        for reads in READINGS:
            apart = {depth: round(told_apart(size, depth, reads)[0], 1) for depth in DEPTHS}
            print(f"a sphere of {size} cells and the disc most like it, {reads}: {apart}")


def main(count: int = 60) -> None:
    """Print the errors of every kind, and the number of smooth contacts with an edge."""
    engine = Engine()
    outlines(engine, count)
    spheres(engine, count)


if __name__ == "__main__":
    main()
