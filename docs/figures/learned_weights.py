"""The free weights of `slip`: physical ones against those that an optimiser has set.

`python docs/figures/learned_weights.py families [--count 4] [--scenes 20] [--rolling]`
`CNNUM_RECORDINGS=FOLDER python docs/figures/learned_weights.py recordings [--objects all]`

Each family of scenes, or each object, is left out in turn: SciPy's Nelder–Mead sets the weights on
all others, and they are judged on those left out. Families learn on `--count` scenes of tuning
seeds and are judged on `--scenes` of scoring seeds. The read-outs come from the templates of
`slip`, once. Its decision is the formula at the head of its file, with seven numbers to set:

    moves^a · loosens^b · ratio^c / (still + trend · |trend| + swing · jolt + pull · grows)

The region that sticks, and the weights of where a motion and a shear lie, stay as they are.

For families the level is the one with four false reports in ten minutes on the others. That holds
for the physical weights, too. Rolling counts as a false report only with `--rolling`.
"""

import argparse
import os
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path

import numpy as np
from scipy.optimize import fmin

from cnnum.arrays import Floats
from cnnum.drivers.simulated.grips import Trial, first
from cnnum.engine import Engine
from cnnum.lab.scoring.families.catalogue import FAMILIES
from cnnum.lab.scoring.family_tables import FALSE, FOUND, drawn
from cnnum.lab.scoring.judge import NEAR, judge, median, per_ten_minutes, share
from cnnum.lab.scoring.recordings import folds, pooled, read
from cnnum.lab.scoring.subjects import Answers, in_batches, reports, side_by_side
from cnnum.programs import program
from cnnum.programs.fields import Field
from cnnum.programs.machine import FrameFields
from cnnum.templates.tactile.shared.loads import RecentLoads
from cnnum.templates.tactile.slip import ALONG, LIES, STICKS, read_outs
from cnnum.templates.tactile.twist import read_outs as turns_of

READS = ("moves", "loosens", "grows", "along", "lies", "sticks", "trend", "jolt", "ratio")
WEIGHTS = {
    "a": 2 / 3,
    "b": 1 / 3,
    "c": 1.0,
    "still": 0.2,
    "trend": 1.0,
    "swing": 0.3,
    "pull": 0.6,
}
"""As the program has them."""

PHYSICAL = np.log(list(WEIGHTS.values()))
TUNING, SCORING = 610_000, 5_000_000
"""First seeds of the scenes to learn on, and of those that are judged."""

EVALUATIONS, SOFT, FALSE_REPORTS = 160, 0.2, 4.0
"""Of an optimiser; width of a soft threshold, in logarithms of strength; in ten minutes."""


@program
def shows(
    frame: FrameFields,
    *,
    push: float = -1.0,
    shear_gain: float = 1.0,
    pads: int = 1,
    rate: float = 200.0,
) -> Mapping[str, Field]:
    """The fields that `slip` and `twist` decide by, either sense of a turn alike."""
    recent = frame.once(
        RecentLoads, push=push, shear_gain=shear_gain, pads=pads, rate=rate, rest=0.4, look=0.08,
        floor=240.0,
    )  # fmt: skip
    signs, turns = (
        read_outs(frame, recent=recent, load=0.35),
        turns_of(frame, recent=recent, still=0.25),
    )
    signs |= {"trend": abs(signs["trend"]), "jolt": recent.jolt, "ratio": recent.ratio}
    return recent.shown(**signs, turned=abs(turns["turned"]), apart=turns["apart"])


def strength(reads: Answers, logs: Floats, axes: bool) -> Floats:
    """Return the strength of slip with weights, given by their logarithms."""
    w = dict(zip(WEIGHTS, np.exp(logs), strict=True))
    tops = (np.maximum(reads[name], 1e-12) for name in ("moves", "loosens", "ratio"))
    top = np.prod([one ** w[p] for one, p in zip(tops, "abc", strict=True)], axis=0)
    explained = (
        w["trend"] * reads["trend"] + w["swing"] * reads["jolt"] + w["pull"] * reads["grows"]
    )
    values = top * (reads["sticks"] < STICKS) / (w["still"] + explained)
    if axes:
        values = values * (ALONG * np.maximum(1.0 + reads["along"], 0.0)) ** 2
        values = values * np.clip(reads["lies"] / LIES, 0.0, 1.0)
    return np.asarray(np.nan_to_num(values))


def learned(merit: Callable[[Floats], float]) -> Floats:
    """Return the weights that an optimiser finds, from the physical ones on."""
    start = np.vstack([PHYSICAL, PHYSICAL + 0.5 * np.eye(len(PHYSICAL))])

    def cost(logs: Floats) -> float:
        return -merit(logs)

    found = fmin(cost, PHYSICAL, maxfun=EVALUATIONS, initial_simplex=start, disp=False)
    return np.asarray(found, dtype=np.float64)


class Scenes:
    """Scenes of some families with their read-outs; peaks of them in a strength."""

    def __init__(self, trials: Sequence[Trial], reads: Sequence[Answers], rolling: bool) -> None:
        self.trials, self.reads = trials, reads
        self.joined = {n: np.concatenate([one[n] for one in reads]) for n in READS}
        ends = np.cumsum([0, *(len(one.frames) for one in trials)])
        self.slides, self.quiet, self.minutes = list[slice](), list[slice](), 0.0
        for trial, begin in zip(trials, ends, strict=False):
            if trial.slides:
                near = int(np.searchsorted(trial.slid, NEAR))
                self.slides.append(slice(begin + trial.onset, begin + max(near, trial.onset + 1)))
            if trial.slides or rolling or "rolling" not in trial.family:
                # a report shortly before a slip, or while little sticks, is no false one
                loose = min(first(trial.early), trial.onset - round(0.1 * trial.rate))
                self._rests(begin, min(len(trial.frames), max(loose, 0)), trial.rate)

    def _rests(self, begin: int, until: int, rate: float) -> None:
        start, second = int(0.45 * rate) + 1, max(1, round(rate))
        for n in range(start, until, second):
            self.quiet.append(slice(begin + n, begin + min(n + second, until)))
        self.minutes += max(0, until - start) / rate / 60.0

    def level(self, values: Floats) -> float:
        """Return the level with that rate of peaks, one a second at the most."""
        peaks = np.sort([values[part].max() for part in self.quiet])
        return float(peaks[-1 - round(FALSE_REPORTS * self.minutes / 10.0)])

    def merit(self, logs: Floats) -> float:
        """Return the share of slides that are reported by 0.3 mm, softly."""
        values = strength(self.joined, logs, axes=True)
        peaks = np.array([values[part].max() for part in self.slides])
        ratio = np.log(np.maximum(peaks, 1e-9) / max(self.level(values), 1e-9))
        return float((1.0 / (1.0 + np.exp(-ratio / SOFT))).mean())


def family_row(
    trials: Sequence[Trial], reads: Sequence[Answers], logs: Floats, level: float
) -> tuple[float, float, float, float]:
    """Return found, sliding (mm), found by 0.3 mm, and false reports in ten minutes."""
    verdicts = []
    for trial, one in zip(trials, reads, strict=True):
        values = strength(one, logs, axes=True)
        flags = reports(values, level, trial.rate)
        zeros = dict.fromkeys(("slip_x", "slip_y"), np.zeros(len(values)))
        verdicts.append(judge(trial, zeros, flags))
    slides = [one for one in verdicts if one.slides]
    slid = [one.slid if one.found else np.inf for one in slides]
    false = per_ten_minutes(sum(v.false for v in verdicts), sum(v.seconds for v in verdicts))
    return (
        share(sum(one.found for one in slides), len(slides)),
        median(slid) * 1e3,
        share(sum(way <= NEAR for way in slid), len(slides)),
        false,
    )


def families(engine: Engine, count: int, scenes: int, rolling: bool) -> None:
    """Print a row a family, and how many reach each aim."""
    names = [one.name for one in FAMILIES if one.kind != "twist"]
    known, fresh = (
        _with_reads(engine, names, *draw) for draw in ((count, TUNING), (scenes, SCORING))
    )
    heads = ("found", "slid, mm", "by 0.3 mm", "false")
    print(f"| {' | '.join(['family', *heads, *(f'{head} *' for head in heads)])} |")
    print("|---|---|---|---|---|---|---|---|---|")
    aims, all_logs = np.zeros((2, 3), dtype=int), list[Floats]()
    for name in names:
        rest = [pair for other in names if other != name for pair in known[other]]
        others = Scenes([trial for trial, _ in rest], [each for _, each in rest], rolling)
        trials, reads = zip(*fresh[name], strict=True)
        all_logs.append(learned(others.merit))
        rows = []
        for logs in (PHYSICAL, all_logs[-1]):
            level = others.level(strength(others.joined, logs, axes=True))
            rows.append(family_row(trials, reads, logs, level))
        for place, (found, slid, _, false) in enumerate(rows):
            aims[place] += found >= FOUND, slid <= NEAR * 1e3, false <= FALSE
        cells = [f"{value:.2f}" if value == value else "–" for row in rows for value in row]
        print(f"| {name} | {' | '.join(cells)} |", flush=True)
    print(f"Aims reached, found, slid, false: physical {aims[0]}, learned {aims[1]}")
    print(_named(np.median(all_logs, axis=0)))


def _with_reads(
    engine: Engine, names: Sequence[str], count: int, seed: int
) -> dict[str, list[tuple[Trial, Answers]]]:
    made = drawn(count, seed, str)
    trials = [trial for name in names for trial in made[name]]
    reads = in_batches(trials, partial(side_by_side, engine, shows, READS))
    pairs = iter(zip(trials, reads, strict=True))
    return {name: [next(pairs) for _ in made[name]] for name in names}


def recordings(engine: Engine, root: Path, objects: str | None) -> None:
    """Print the areas under the curve: pooled, of each object, and of the uSkin trials."""
    flat, uskin = read(root, tuple(objects.split(",")) if objects else None, str)
    run = partial(side_by_side, engine, shows, READS)
    reads, other = in_batches(flat, run), in_batches(uskin, run)

    def scores(logs: Floats, numbers: Sequence[int]) -> list[Floats]:
        return [strength(reads[n], logs, axes=False) for n in numbers]

    def area(trials: Sequence[Trial], numbers: Sequence[int], logs: Floats) -> float:
        return pooled(trials, scores(logs, numbers))

    physical, chosen = scores(PHYSICAL, range(len(flat))), dict[int, Floats]()
    for name, mine, rest in folds(flat):
        known = [flat[n] for n in rest]
        logs = learned(partial(area, known, rest))
        # weights scale a score: in units of the others' median
        unit = float(np.median(np.concatenate(scores(logs, rest))))
        chosen |= {n: one / unit for n, one in zip(mine, scores(logs, mine), strict=True)}
        own = [flat[n] for n in mine]
        areas = [pooled(own, [each[n] for n in mine]) for each in (physical, chosen)]
        print(f"| {name} | {areas[0]:.3f} | {areas[1]:.3f} |", flush=True)
    both = (physical, [chosen[n] for n in range(len(flat))])
    print(f"| pooled | {' | '.join(f'{pooled(flat, each):.3f}' for each in both)} |")
    logs = learned(partial(area, flat, range(len(flat))))
    areas = [
        pooled(uskin, [strength(one, w, axes=False) for one in other]) for w in (PHYSICAL, logs)
    ]
    print(f"| uSkin trials | {areas[0]:.3f} | {areas[1]:.3f} |")
    print(_named(logs))


def _named(logs: Floats) -> str:
    return ", ".join(f"{n} {w:.2g}" for n, w in zip(WEIGHTS, np.exp(logs), strict=True))


def main() -> None:
    """Print the tables of one suite."""
    arguments = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    arguments.add_argument("suite", choices=("families", "recordings"))
    arguments.add_argument("--count", type=int, default=4)
    arguments.add_argument("--scenes", type=int, default=20)
    arguments.add_argument("--rolling", action="store_true")
    arguments.add_argument("--objects")
    given = arguments.parse_args()
    engine = Engine()
    if given.suite == "families":
        families(engine, given.count, given.scenes, given.rolling)
    else:
        recordings(engine, Path(os.environ["CNNUM_RECORDINGS"]), given.objects)


if __name__ == "__main__":
    main()
