"""How far found edges lie from true outlines: `python -m cnnum.lab.bench.programs.edge_errors`.

It prints a table by families of bodies, with two baselines on the raw frame. A second table is by
faults of the array, and a third by covers, for `edge_enhancement`, too. The frames are those of
`edge_scenes`; the programs know nothing of them.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy import ndimage
from scipy.spatial import cKDTree

from cnnum.arrays import Floats
from cnnum.engine import Engine
from cnnum.lab.bench.programs.edge_scenes import CHOSEN_ON, SHARP, SMOOTH, Bodies
from cnnum.programs.library import get_program
from cnnum.tactile.flat_punches import Outline
from cnnum.tactile.indenters import Reads
from cnnum.templating.checks.program_run import RATE
from cnnum.templating.library import get_template

NOISE = 0.01
"""Of one reading, as a share of a frame's largest."""

DEPTHS = (0.3, 0.5, 0.75, 1.0)
BARE = 0.1
"""Pitches of cover of an array that has hardly any: the frame is the pressure at the taxels."""

READINGS: tuple[Reads, ...] = ("strain", "stress")
REST, HELD = 18, 3
STRONG = 0.5
"""Share of the largest Sobel gradient from which the baseline takes a cell for an edge."""

ALONG = 0.6
"""Least slope along a line, in slopes across it, of the other baseline."""

NEAR = 1.0
"""Pitches within which an outline counts as found."""

Finder = Callable[[Floats, "Skin"], list[Floats]]
"""Frames (bodies, rows, cols) to the places found in each, (places, 2): row and column."""


@dataclass(frozen=True, slots=True)
class Skin:
    """An array under a cover, and its faults.

    Attributes
    ----------
    cells : int
        Of a side.
    depth : float
        Pitches.
    reads : "strain" or "stress"
    noise : float
        Of one reading, as a share of a frame's largest.
    given : float
        Depth that the program works with, over the true one.
    gains : float
        Largest relative error of a taxel's gain, unknown to the program.
    dead : int
        Taxels that read nothing.
    """

    cells: int = 8
    depth: float = 0.5
    reads: Reads = "strain"
    noise: float = NOISE
    given: float = 1.0
    gains: float = 0.0
    dead: int = 0

    def stream(self, loads: Floats, seed: int = 1) -> Floats:
        """Return readings of rest and then of loads, (frames, bodies, rows, cols)."""
        rng, shape = np.random.default_rng(seed), loads.shape
        loads = loads / loads.max(axis=(1, 2), keepdims=True)
        loads = loads * (1.0 + self.gains * rng.uniform(-1.0, 1.0, shape))
        frames = self.noise * rng.normal(size=(REST + HELD, *shape))
        frames[REST:] += loads
        order = rng.permuted(np.tile(np.arange(self.cells**2), (len(loads), 1)), axis=1)
        return np.asarray(frames * (order >= self.dead).reshape(shape))


def found_places(right: Floats, below: Floats) -> Floats:
    """Return row and column of every place where an outline crosses a link, (places, 2)."""
    row, col = np.nonzero(right >= 0)
    across = np.stack([row, col + right[row, col]], axis=-1)
    row, col = np.nonzero(below >= 0)
    down = np.stack([row + below[row, col], col], axis=-1)
    return np.asarray(np.concatenate([across, down]), dtype=np.float64)


def run_edges(engine: Engine, loads: Floats, skin: Skin) -> dict[str, Floats]:
    """Return the outputs of `edges` after rest and three frames of each body, side by side."""
    given = {"rate": RATE, "depth": skin.depth * skin.given, "reads": skin.reads}
    program = get_program("edges").bind(**given)
    stream = engine.compile(program, loads.shape[1:]).stream((len(loads),))
    outputs = dict[str, Floats]()
    for frame in skin.stream(loads):
        outputs = stream.push(np.stack([0.0 * frame, 0.0 * frame, -frame], axis=-1))
    return outputs


def by_program(engine: Engine, loads: Floats, skin: Skin) -> list[Floats]:
    """Return the places that `edges` finds."""
    got = run_edges(engine, loads, skin)
    pairs = zip(got["edge_to_right"], got["edge_to_below"], strict=True)
    return [found_places(right, below) for right, below in pairs]


def by_sobel(loads: Floats, skin: Skin) -> list[Floats]:
    """Return the cells whose Sobel gradient of the raw frame is large."""
    result: list[Floats] = []
    for frame in skin.stream(loads)[-1]:
        steep = np.hypot(ndimage.sobel(frame, 0), ndimage.sobel(frame, 1))
        result.append(np.argwhere(steep >= STRONG * steep.max()).astype(np.float64))
    return result


def by_steepest(loads: Floats, skin: Skin) -> list[Floats]:
    """Return where the Sobel gradient of the raw frame is steepest along rows and columns.

    Between the taxels by the parabola through three, as far as half a pitch: what a careful user
    does by hand.
    """
    result: list[Floats] = []
    for frame in skin.stream(loads)[-1]:
        slopes = [ndimage.sobel(frame, axis) for axis in (0, 1)]
        steep, places = np.hypot(*slopes), [np.zeros((0, 2))]
        for axis in (0, 1):
            along, own, other = (
                np.moveaxis(slope, axis, 0) for slope in (steep, np.abs(slopes[axis]),
                                                        np.abs(slopes[1 - axis]))
            )  # fmt: skip
            before, here, behind = along[:-2], along[1:-1], along[2:]
            top = (here >= before) & (here >= behind) & (here >= STRONG * steep.max())
            top &= own[1:-1] >= ALONG * other[1:-1]
            i, j = np.nonzero(top)
            bend = np.minimum(before - 2.0 * here + behind, -1e-30)[top]
            off = np.clip(0.5 * (before - behind)[top] / bend, -0.5, 0.5)
            pair = [i + 1 + off, j.astype(np.float64)]
            places.append(np.stack(pair if axis == 0 else pair[::-1], axis=-1))
        result.append(np.concatenate(places))
    return result


def by_enhancement(engine: Engine, loads: Floats, skin: Skin) -> list[Floats]:
    """Return the places that `edge_enhancement` finds."""
    program = get_program("edge_enhancement").bind(rate=RATE)
    stream = engine.compile(program, loads.shape[1:]).stream((len(loads),))
    got = dict[str, Floats]()
    for frame in skin.stream(loads):
        got = stream.push(np.stack([0.0 * frame, 0.0 * frame, -frame], axis=-1))
    pairs = zip(got["edge_to_right"], got["edge_to_below"], strict=True)
    return [found_places(right, below) for right, below in pairs]


def by_template(engine: Engine, loads: Floats, skin: Skin) -> list[Floats]:
    """Return the cells that EDGE leaves of the raw frame above half of its peak."""
    frames = skin.stream(loads)[-1]
    black = frames > 0.5 * frames.max(axis=(1, 2), keepdims=True)
    edges = engine.run(get_template("EDGE"), input=np.where(black, 1.0, -1.0)).output > 0.0
    return [np.argwhere(edge).astype(np.float64) for edge in edges]


def off_outline(body: Outline, places: Floats, cells: int) -> Floats:
    """Return the distance of places from an outline, pitches."""
    middle = (cells - 1) / 2
    return np.abs(body.distance(places[:, 1] - middle, places[:, 0] - middle))


def met(body: Outline, places: Floats, cells: int) -> float:
    """Return the share of the outline on the array that has a place within a pitch."""
    if not len(places):
        return 0.0
    axis = np.linspace(-(cells - 1) / 2, (cells - 1) / 2, 10 * cells + 1)
    x, y = np.meshgrid(axis, axis)
    on = np.abs(body.distance(x, y)) < 0.06
    outline = np.stack([y[on], x[on]], axis=-1) + (cells - 1) / 2
    return float(np.mean(cKDTree(places).query(outline)[0] <= NEAR))


@dataclass(frozen=True, slots=True)
class Tally:
    """The results of a finder on bodies.

    Attributes
    ----------
    edged : int
        Bodies with an edge.
    of : int
    off : (places,) float
        Distances from the outlines, pitches; none of smooth bodies.
    met : float
        Mean share of the outlines that was found.
    """

    edged: int
    of: int
    off: Floats
    met: float

    @property
    def row(self) -> str:
        """Return bodies with an edge, the share of their outlines found, and errors of places."""
        if not self.off.size:
            return f"{100 * self.edged / self.of:.0f} % | {100 * self.met:.0f} % | |"
        low, high = np.quantile(self.off, [0.5, 0.95])
        share = f"{100 * self.edged / self.of:.0f} % | {100 * self.met:.0f} %"
        return f"{share} | {low:.2f} | {high:.2f}"


def tally(finder: Finder, bodies: Bodies, skins: Sequence[Skin]) -> Tally:
    """Return the results of a finder on bodies on all of these skins."""
    edged, of, off, shares = 0, 0, [np.zeros(0)], list[float]()
    for skin in skins:
        edges = finder(bodies.frames(skin.cells, skin.depth, skin.reads), skin)
        edged, of = edged + sum(len(places) > 0 for places in edges), of + len(edges)
        if bodies.outlines:
            pairs = list(zip(bodies.outlines, edges, strict=True))
            off += [off_outline(body, places, skin.cells) for body, places in pairs]
            shares += [met(body, places, skin.cells) for body, places in pairs]
    return Tally(edged, of, np.concatenate(off), float(np.mean(shares or [0.0])))


def finders(engine: Engine) -> dict[str, Finder]:
    """Return the program and the baselines."""
    return {
        "edges": partial(by_program, engine),
        "Sobel": by_sobel,
        "EDGE": partial(by_template, engine),
    }


def by_family(engine: Engine, count: int, seed: int = 7) -> Iterator[str]:
    """Yield the rows of the first table: 8×8, all covers, in strain and in stress."""
    skins = [Skin(depth=depth, reads=reads) for reads in READINGS for depth in DEPTHS]
    for name, family in SHARP.items():
        bodies = family(np.random.default_rng(seed), 8, count)
        rows = [tally(finder, bodies, skins).row for finder in finders(engine).values()]
        yield f"| {name}{' *' if name in CHOSEN_ON else ''} | {' | '.join(rows)} |"
    for name, family in SMOOTH.items():
        bodies = family(np.random.default_rng(seed), 8, count)
        tallies = [tally(finder, bodies, skins) for finder in finders(engine).values()]
        rows = [f"{counts.edged} of {counts.of}" for counts in tallies]
        yield f"| {name}{' *' if name in CHOSEN_ON else ''} | {' | '.join(rows)} |"


def skins_by_name() -> dict[str, list[Skin]]:
    """Return the skins of the second table."""
    both = [Skin(reads=reads) for reads in READINGS]
    cases = {f"{side}×{side}": [replace(s, cells=side) for s in both] for side in (4, 8, 16)}
    for reads in READINGS:
        for depth in DEPTHS:
            cases[f"{depth} pitches, {reads}"] = [Skin(depth=depth, reads=reads)]
    for given in (0.5, 0.7, 1.3, 1.5):
        wrong = [replace(s, given=given, depth=d) for s in both for d in (0.5, 0.75)]
        cases[f"0.5 and 0.75 pitches, given as {given} of it"] = wrong
    cases["noise of 0.25 %"] = [replace(s, noise=0.0025) for s in both]
    cases["noise of 3 %"] = [replace(s, noise=0.03) for s in both]
    cases["gains ±20 %"] = [replace(s, gains=0.2) for s in both]
    cases["2 of 64 taxels dead"] = [replace(s, dead=2) for s in both]
    return cases


def by_skin(engine: Engine, count: int, seed: int = 8) -> Iterator[str]:
    """Yield the rows of the second table: punches and spheres that no constant was chosen on."""
    finder: Finder = partial(by_program, engine)
    punches = [name for name in SHARP if name not in CHOSEN_ON and "uniform" not in name]
    spheres = [name for name in SMOOTH if name not in CHOSEN_ON and "0.6" not in name]
    for title, skins in skins_by_name().items():
        cells, rng = skins[0].cells, np.random.default_rng(seed)
        kinds = [name for name in punches if cells > 4 or name != "ring"]
        tallies = [tally(finder, SHARP[name](rng, cells, count), skins) for name in kinds]
        whole = Tally(
            sum(counts.edged for counts in tallies),
            sum(counts.of for counts in tallies),
            np.concatenate([counts.off for counts in tallies]),
            float(np.mean([counts.met for counts in tallies])),
        )
        smooth = [tally(finder, SMOOTH[name](rng, cells, count), skins) for name in spheres]
        false = f"{sum(counts.edged for counts in smooth)} of {sum(counts.of for counts in smooth)}"
        yield f"| {title} | {whole.row} | {false} |"


def by_cover(engine: Engine, count: int, seed: int = 9) -> Iterator[str]:
    """Yield the rows of the third table: bodies without a star, by cover and reading."""
    finders: dict[str, Finder] = {
        "edge_enhancement": partial(by_enhancement, engine),
        "edges": partial(by_program, engine),
        "Sobel": by_sobel,
        "Sobel, steepest": by_steepest,
    }
    yield f"| cover | {' | '.join(finders)} |"
    rng = np.random.default_rng(seed)
    bodies = [SHARP[name](rng, 8, count) for name in SHARP if name not in CHOSEN_ON]
    covers: list[tuple[float, Reads]] = [(BARE, "stress")]
    covers.extend((depth, reads) for reads in READINGS for depth in DEPTHS)
    for depth, reads in covers:
        cells = list[str]()
        for finder in finders.values():
            tallies = [tally(finder, body, [Skin(depth=depth, reads=reads)]) for body in bodies]
            off = np.concatenate([counts.off for counts in tallies])
            median, most = np.quantile(off, [0.5, 0.95])
            share = float(np.mean([counts.met for counts in tallies]))
            cells.append(f"{median:.2f}, {most:.2f} ({100 * share:.0f} %)")
        yield f"| {depth} pitches, {reads} | {' | '.join(cells)} |"


def main(count: int = 40) -> None:
    """Print the tables."""
    engine = Engine()
    for table in (by_family(engine, count), by_skin(engine, count), by_cover(engine, count)):
        for row in table:
            print(row, flush=True)
        print()


if __name__ == "__main__":
    main()
