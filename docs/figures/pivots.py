"""Slips that pivot, twists after a slide or a press, starts in motion: `docs.figures.pivots`.

`python -m docs.figures.pivots` draws scenes of bristles (`cnnum/lab/scoring/families/bristles.py`)
whose truth is known, and prints what `slip`, `twist` and the watch of held starts say of them.
"""

import argparse
from dataclasses import replace

import numpy as np

from cnnum.drivers.simulated.grips import Arrays, Trial, first
from cnnum.engine import Engine
from cnnum.frame import FORCE_AXES
from cnnum.lab.scoring.families import bristles
from cnnum.lab.scoring.families.bristles import PITCH, TAXELS, Brush
from cnnum.lab.scoring.subjects import Answers, in_batches, side_by_side
from cnnum.programs.library import get_program
from cnnum.scenes.push_watch import HeldWatch

ARMS = ((0.1, 0.5), (0.5, 1.0), (1.0, 2.0), (2.0, 4.0), (8.0, 16.0))
"""Of a turn, in radii of the contact: from its middle to the place about which it turns."""

SLIP = (
    "gross_slip", "slip_pivots", "slip_centred", "slip_sense", "slip_row", "slip_column"
)  # fmt: skip
TWIST = ("twist", "twist_sense")
WAITS = (-0.1, -0.03, 0.0, 0.05, 0.1, 0.2, 0.4)
"""s from the end of a press to the begin of a turn; below 0 they overlap."""


def played(
    engine: Engine, name: str, outputs: tuple[str, ...], trials: list[Trial]
) -> list[Answers]:
    """Return the outputs of a program on trials."""
    return in_batches(trials, lambda some: side_by_side(engine, get_program(name), outputs, some))


def turned(engine: Engine, arms: tuple[float, float], seeds: range) -> str:
    """Return what is reported of turns about places so far away."""
    trials, truths = list[Trial](), list[tuple[float, float, float]]()
    for seed in seeds:
        rng = np.random.default_rng([seed, 3])
        arm = float(rng.choice([-1.0, 1.0]) * rng.uniform(*arms))
        trials.append(bristles.scene(bristles.swung(arm))(Arrays(), "swung", seed))
        place = Brush.drawn("swung", seed).place_of(arm) / PITCH + (TAXELS - 1) / 2
        truths.append((float(np.sign(arm)), float(place[1]), float(place[0])))
    slips, twists = (played(engine, *which, trials) for which in (("slip", SLIP), ("twist", TWIST)))
    said = pivots = right = either = 0
    away = list[float]()
    for trial, slip, twist, (sense, row, column) in zip(trials, slips, twists, truths, strict=True):
        reported = (slip["gross_slip"] > 0) & trial.scored
        turn = ((twist["twist"] > 0) & trial.scored).any()
        either += bool(reported.any() or turn)
        if not reported.any():
            continue
        at, said = first(reported), said + 1
        pivots += bool(slip["slip_pivots"][at])
        right += bool(slip["slip_sense"][at] == sense)
        if slip["slip_centred"][at]:
            away.append(
                float(np.hypot(slip["slip_row"][at] - row, slip["slip_column"][at] - column))
            )
    places = f"median {np.median(away):.2f}, largest {max(away):.2f}" if away else "none"
    return (
        f"{len(trials)} scenes: reported {either}, as a slip {said}, as a pivot {pivots}, sense "
        f"right {right}, places {len(away)}: off by {places} cells"
    )


def after_a_slide(engine: Engine, seeds: range) -> str:
    """Return what is reported of twists after a slide."""
    make = bristles.scene(bristles.slid_then_turned)
    trials = [make(Arrays(), "slid, then turned", seed) for seed in seeds]
    slips, twists = (played(engine, *which, trials) for which in (("slip", SLIP), ("twist", TWIST)))
    found = right = slip_too = scenes = 0
    for trial, slip, twist in zip(trials, slips, twists, strict=True):
        turns = trial.sense != 0
        if not turns.any():
            continue
        scenes += 1
        flags = (twist["twist"] > 0) & (np.arange(len(turns)) >= first(turns) - 0.5 * trial.rate)
        found += bool(flags.any())
        right += bool(flags.any() and (twist["twist_sense"][flags] == trial.sense[turns][0]).all())
        slip_too += bool((slip["gross_slip"][turns] > 0).any())
    return (
        f"{scenes} scenes: twists found {found}, sense right {right}, slip in the turn {slip_too}"
    )


def after_a_press(engine: Engine, wait: float, seeds: range) -> str:
    """Return how many turns are reported that begin so soon after a press."""

    def moves(brush: Brush) -> bristles.Way:
        way, early = bristles.pivot(brush), round((0.4 - wait) * brush.rate)
        return replace(way, angle=np.pad(way.angle[early:], (0, early), mode="edge"))

    name = "turned early"
    trials = [bristles.scene(moves)(Arrays(), name, seed) for seed in seeds]
    ends = [bristles.pivot(Brush.drawn(name, seed)).angle[-1] for seed in seeds]
    found = right = 0
    for trial, end, twist in zip(trials, ends, played(engine, "twist", TWIST, trials), strict=True):
        flags = (twist["twist"] > 0) & trial.scored
        found += bool(flags.any())
        right += bool(flags.any() and (twist["twist_sense"][flags] == np.sign(end)).all())
    return f"{len(trials)} scenes: twists found {found}, sense right {right}"


def begun_in_motion(seeds: range) -> str:
    """Return of how many streams that begin in a slide, and without contact, it is said.

    Slides that are over before the rest is known have no events to mark.
    """
    said = [0, 0]
    scenes = 0
    for seed in seeds:
        trial = bristles.scene(bristles.slide)(Arrays(), "begins sliding", seed)
        if len(trial.frames) - trial.onset < 0.45 * trial.rate:
            continue
        scenes += 1
        for place, start in enumerate((trial.onset, 0)):
            watch = HeldWatch(get_program("slip"), FORCE_AXES)
            for n, frame in enumerate(trial.frames[start : start + round(0.45 * trial.rate)]):
                watch.look(frame, n / trial.rate)
            said[place] += watch.held
    return f"{scenes} scenes: said of {said[0]} that begin in the slide, {said[1]} without contact"


def main() -> None:
    """Print a line a kind of scene."""
    arguments = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    arguments.add_argument("--count", type=int, default=16)
    arguments.add_argument("--seed", type=int, default=5_000_000)
    given = arguments.parse_args()
    engine, seeds = Engine(), range(given.seed, given.seed + given.count)
    print(f"a slide, then a twist: {after_a_slide(engine, seeds)}", flush=True)
    for wait in WAITS:
        print(f"{wait:g} s after a press: {after_a_press(engine, wait, seeds)}", flush=True)
    print(f"starts: {begun_in_motion(seeds)}", flush=True)
    for arms in ARMS:
        print(f"{arms[0]:g} to {arms[1]:g} radii: {turned(engine, arms, seeds)}", flush=True)


if __name__ == "__main__":
    main()
