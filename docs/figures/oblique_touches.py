"""Touches that come with their shear, and strokes, that no term of `slip` was picked on.

`python -m docs.figures.oblique_touches` draws them on the simulated array and on bristles, and
prints the false reports a minute and the strokes that are found: by `slip`, by `slip` without its
memory of how the load swings, and by the change of shear over load, each of the last two also at
the level at which it finds as many strokes as `slip`.
"""

import argparse
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from cnnum.arrays import Floats
from cnnum.drivers.simulated.grips import (
    REST,
    SHAKEN,
    Array,
    Arrays,
    Draw,
    Make,
    Skin,
    Trial,
    runs,
    trial_of,
)
from cnnum.drivers.simulated.settings import Command
from cnnum.engine import Engine
from cnnum.lab.scoring.families import bristles
from cnnum.lab.scoring.judge import due
from cnnum.lab.scoring.subjects import in_batches, reports, shipped_level, side_by_side
from cnnum.programs.library import get_program

Pair = tuple[float, float]
SMALL, LARGE = (8e-3, 15e-3), (40e-3, 80e-3)  # m, spheres beyond those of the families
NARROW, WIDE = (1.0e-3, 1.6e-3), (3.2e-3, 4.0e-3)  # m, contacts on bristles, likewise
USUAL, EDGE = (0.2, 0.7), (0.6, 0.7)  # pull over friction's limit
LASTS = {100.0: 6.0, 200.0: 6.0, 1000.0: 3.0}  # s of a scene, by its rate in Hz
RATES = "trend", "load_rate", "swings", "ratio_rate"
OUTPUTS = ("slip_strength", *(f"slip_{name}" for name in RATES))


def touch(frequency: float, scans: Callable[[float], int]) -> tuple[Floats, int, int]:
    """Return the depth of a touch over its largest, and the frames until it holds and leaves."""
    rise = np.arange(1, scans(0.3 / frequency) + 1) / scans(0.3 / frequency)
    still = scans(0.2 / frequency)
    return np.concatenate([rise, np.ones(still), rise[::-1], np.zeros(still)]), len(rise), still


def moved_on(way: Floats, begin: int, still: int, far: float) -> Floats:
    """Return a way that goes on while the touch holds."""
    way = way.copy()
    way[begin : begin + still] = way[begin - 1] + far * np.arange(1, still + 1) / still
    way[begin + still :] = way[begin + still - 1]
    return way


def sphere(
    frequency: float, rate: float, sizes: Pair, *, skin: Skin = Skin(), cover: str = "flat",  # noqa: B008
    shares: Pair = USUAL, strokes: bool = False,
) -> Make:  # fmt: skip
    """Return touches of a sphere on the simulated array."""

    def make(arrays: Arrays, family: str, seed: int) -> Trial:
        rng = np.random.default_rng([seed, 49])
        radius = float(sizes[0] * (sizes[1] / sizes[0]) ** rng.random())
        array = Array(rate=rate, radius=radius, contact=float(rng.uniform(1.6e-3, 2.8e-3)),
                      cover=cover)  # fmt: skip
        draw = Draw.of(family, seed, array)
        bounds, along = draw.bounds, (np.cos(draw.direction), np.sin(draw.direction))
        hand, count = [Command(load=0.0)] * draw.scans(REST), draw.scans(LASTS[rate])
        while len(hand) < count:
            high, share = draw.uniform(0.7, 1.2), draw.uniform(*shares)
            deep, begin, still = touch(frequency, draw.scans)
            way = share * bounds.travel() * high * deep
            if strokes:
                far = bounds.travel() * high + draw.uniform(0.4e-3, 1.0e-3)
                way = moved_on(way, begin, still, far)
            steps = np.diff(way, prepend=0.0)
            if strokes:
                steps[-still:] = -way[-1] / still
            hand += [
                Command(load=float(load), move=(float(step * along[0]), float(step * along[1])))
                for load, step in zip(bounds.load * (high * deep) ** 1.5, steps, strict=True)
            ]
        made = arrays.made(draw, array)
        return trial_of(made, draw, skin, family, list(made.follow(hand[:count])))

    return make


def brush(
    frequency: float, rate: float, sizes: Pair, *, noise: float = 0.003, shares: Pair = USUAL,
    strokes: bool = False,
) -> Make:  # fmt: skip
    """Return touches of a body on bristles."""

    def moves(body: bristles.Brush) -> bristles.Way:
        depth, ways = ([value * np.ones(body.scans(REST))] for value in (-1e-6, 0.0))
        while sum(map(len, depth)) < LASTS[rate] * rate:
            share, high = body.rng.uniform(*shares), body.depth * body.rng.uniform(0.7, 1.2)
            deep, begin, still = touch(frequency, body.scans)
            limit = body.friction * bristles.STIFFNESS * high
            way = share * limit * deep
            if strokes:
                way = moved_on(way, begin, still, limit + body.rng.uniform(0.4e-3, 1.0e-3))
                way[-still:] = way[-1] * (1.0 - np.arange(1, still + 1) / still)
            depth.append(np.where(deep > 0.0, high * deep, -1e-6))
            ways.append(way)
        x, y = (np.concatenate(ways) * turn(body.direction) for turn in (np.cos, np.sin))
        return bristles.Way.of(np.concatenate(depth), x=x, y=y)

    def make(arrays: Arrays, family: str, seed: int) -> Trial:
        size = float(np.random.default_rng([seed, 50]).uniform(*sizes))

        def other(body: bristles.Brush) -> bristles.Brush:
            radius = size if body.flat else size**2 / (2.0 * body.depth)
            return replace(body, rate=rate, radius=radius, noise=noise)

        return bristles.scene(moves, other=other)(arrays, family, seed)

    return make


MIX = ((100.0, 0), (200.0, 1), (1000.0, 0), (100.0, 1), (200.0, 0), (1000.0, 1))
MORE = ((100.0, 0), (200.0, 1), (100.0, 1), (200.0, 0)) * 2
TWO, SIX = MIX[:2], ((100.0, 0), (100.0, 1)) * 3
Group = dict[str, list[tuple[int, Make]]]


def groups() -> dict[str, Group]:
    """Return the scenes of each row by family, with their seeds."""
    balls, widths, seeds = (SMALL, LARGE), (NARROW, WIDE), (77_000_000, 77_100_000)
    rows: dict[str, Group] = {}

    def add(row: str, family: str, makes: list[Make], seed: int) -> None:
        rows.setdefault(row, {}).setdefault(family, []).extend(enumerate(makes, seed))

    for f in (0.5, 1.0, 2.0, 3.0, 4.0, 6.0):
        row = "spheres, 3 Hz" if f == 3.0 else "spheres, other frequencies"
        for seed, mix in zip(seeds, (() if f == 3.0 else MIX, MORE), strict=True):
            add(row, f"sphere {f:g}", [sphere(f, r, balls[k]) for r, k in mix], seed)
        on = [brush(f, r, widths[k], noise=(0.003, 0.006)[k]) for r, k in MIX]
        add("bristles", f"bristle {f:g}", on, seeds[0])
        few, many = SIX[:2] * (f in (1.0, 2.0, 4.0)), SIX * (f in (1.0, 3.0, 6.0))
        for seed, sizes in zip(seeds, (few, many), strict=True):
            edge = [sphere(f, r, balls[k], shares=EDGE) for r, k in sizes]
            add("spheres, 0.6 to 0.7 of the limit", f"sphere-edge {f:g}", edge, seed)
    for f in (1.0, 3.0, 6.0):
        edge = [brush(f, r, widths[k], shares=EDGE) for r, k in TWO]
        add("bristles", f"bristle-edge {f:g}", edge, seeds[0])
    for f in (1.0, 2.0, 4.0):
        for kind in ("layer", "bumpy"):
            row = "layer" if kind == "layer" else "bumps, real taxels"
            on = [sphere(f, 100.0, size, cover=kind) for size in balls]
            add(row, f"sphere-{kind} {f:g}", on, seeds[0])
        on = [sphere(f, 100.0, size, skin=SHAKEN) for size in balls]
        add("bumps, real taxels", f"sphere-shaken {f:g}", on, seeds[0])
    for f in (0.5, 1.0, 2.0):
        on = [sphere(f, r, balls[k], strokes=True) for r, k in TWO * 2]
        add("strokes", f"stroke-sphere {f:g}", on, seeds[0])
        on = [brush(f, r, widths[k], strokes=True) for r, k in TWO * 2]
        add("strokes", f"stroke-bristle {f:g}", on, seeds[0])
    return rows


def change_over_load(trial: Trial) -> Floats:
    """Return the change of shear off its mean in 50 ms, over the load, 1/s."""
    rest = round(0.4 * trial.rate)
    values = trial.frames.astype(float) - trial.frames[:rest].astype(float).mean(axis=0)
    back, change = max(1, round(0.05 * trial.rate)), np.zeros_like(values[..., :2])
    change[back:] = (values[back:] - values[:-back])[..., :2] / 0.05
    change -= change.mean(axis=(1, 2), keepdims=True)
    load = np.abs(values[..., 2]).mean(axis=(1, 2))
    size = np.sqrt((change**2).sum(axis=-1).mean(axis=(1, 2)))
    return np.asarray(size / (load + 2.0 * np.abs(values[:rest, ..., 2]).mean()))


def strengths(engine: Engine, trials: list[Trial]) -> list[tuple[Floats, Floats, Floats]]:
    """Return the strength of each trial by `slip`, without its memory, and by the baseline."""
    made = in_batches(trials, lambda some: side_by_side(engine, get_program("slip"), OUTPUTS, some))
    result = list[tuple[Floats, Floats, Floats]]()
    for trial, answer in zip(trials, made, strict=True):
        trend, load_rate, swings, ratio_rate = (answer[f"slip_{name}"] for name in RATES)
        without = 0.2 + trend + 0.6 * load_rate + 0.6 * ratio_rate
        strength = answer["slip_strength"]
        longer = strength * (1.0 + 0.08 * swings**2 / without)
        result.append((strength, longer, change_over_load(trial)))
    return result


def counted(trials: list[Trial], scores: list[Floats], level: float) -> tuple[int, int]:
    """Return the false reports and the strokes that are found."""
    false = found = 0
    for trial, score in zip(trials, scores, strict=True):
        flags = reports(score, level, trial.rate) & trial.scored
        false += sum(not due(trial, begin) for begin, _ in runs(flags))
        late = round(0.1 * trial.rate)
        found += sum(bool(flags[a : b + late].any()) for a, b in strokes_of(trial))
    return false, found


def strokes_of(trial: Trial) -> list[tuple[int, int]]:
    """Return begin and end of each slide of two frames or more."""
    return [(a, b) for a, b in runs(trial.scored & (trial.slips == 1)) if b - a >= 2]


def main() -> None:
    """Print one row per kind of scene."""
    argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0]).parse_args()
    engine, arrays = Engine(), Arrays()
    drawn = {
        row: [make(arrays, name, seed) for name, made in group.items() for seed, make in made]
        for row, group in groups().items()
    }
    scored = {row: strengths(engine, trials) for row, trials in drawn.items()}
    level, strokes = shipped_level(), drawn["strokes"]
    own, without, baseline = ([s[n] for s in scored["strokes"]] for n in range(3))
    found = counted(strokes, own, level)[1]
    raised, high = (
        max(at for at in levels if counted(strokes, scores, at)[1] >= found)
        for scores, levels in (
            (without, np.linspace(0.2, 1.0, 41)), (baseline, np.geomspace(0.1, 3000.0, 160))
        )
    )  # fmt: skip
    ways = ((0, level), (1, level), (1, raised), (2, high))
    print(f"strokes: {sum(len(strokes_of(trial)) for trial in strokes)}; levels: "
          f"{', '.join(f'{at:.3g}' for _, at in ways)}")  # fmt: skip
    for row, trials in drawn.items():
        seconds = sum((t.scored & (t.slips == 0)).sum() / t.rate for t in trials)
        results = [counted(trials, [s[n] for s in scored[row]], at) for n, at in ways]
        cells = (f"{60.0 * false / seconds:.1f} ({false}), {hit}" for false, hit in results)
        print(f"| {row}: {len(trials)} scenes, {seconds / 60:.1f} min | {' | '.join(cells)} |")


if __name__ == "__main__":
    main()
