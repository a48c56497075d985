"""Templates of slip and of twist learned from labelled scenes, a family left out at a time.

`python docs/figures/learn_events.py slip` or `twist`: the read-outs of the programs are the inputs
of a template of one cell, whose weights gradients set. With `maps` the inputs are the maps of the
array, and their change over 80 ms; the mean over the cells is the strength. Each takes a minute.
"""

import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from cnnum.arrays import Floats
from cnnum.design.learning import Lesson, learn, untied
from cnnum.engine import Engine
from cnnum.lab.scoring.families.arrays import Arrays
from cnnum.lab.scoring.families.catalogue import FAMILIES
from cnnum.lab.scoring.judged_programs import Answers, in_batches, side_by_side
from cnnum.lab.scoring.trial import Trial
from cnnum.programs import program
from cnnum.programs.fields import Field
from cnnum.programs.machine import FrameFields
from cnnum.templates.tactile.shared.recent_loads import RecentLoads
from cnnum.templates.tactile.twist import APART, read_outs
from cnnum.templating.template import Template
from docs.figures.learned_weights import PHYSICAL, READS, strength
from docs.figures.learned_weights import shows as slip_shows

SEEDS, FRAMES = (1, 2), 60
"""Scenes of a family, and frames of each that are learned from."""

TURNS, LOOK = ("turned", "apart"), 0.08
"""Signs of the program `twist`; how long ago maps are compared with, s."""

MAPS = (1, 60)
"""Restarts and iterations of maps, whose runs take a hundred times as long."""


@dataclass(frozen=True, slots=True)
class Job:
    """An event to learn.

    Attributes
    ----------
    families : tuple of str
    reads : tuple of str
        Read-outs that are the inputs; maps of the array where there are none.
    truth : callable
        Returns of a trial whether the event is on, frame by frame.
    formula : callable
        Returns of read-outs the strength by which the program decides.
    """

    families: tuple[str, ...]
    reads: tuple[str, ...]
    truth: Callable[[Trial], Floats]
    formula: Callable[[Answers], Floats]


SLIP = Job(
    ("constant speed", "force ramp", "tremor", "ring", "part pull", "grip"),
    READS,
    lambda trial: trial.slips,
    lambda reads: strength(reads, PHYSICAL, axes=True),
)

JOBS = {
    "slip": SLIP,
    "maps": replace(SLIP, reads=()),
    "twist": Job(
        ("twist", "twist, layer", "twist, bumps", "twist, real taxels", "constant speed", "grip"),
        (*READS, *TURNS),
        lambda trial: np.abs(trial.sense).astype(np.float64),
        lambda reads: turn_strength(reads),
    ),
}


@program
def twist_shows(
    frame: FrameFields,
    *,
    push: float = -1.0,
    shear_gain: float = 1.0,
    pads: int = 1,
    rate: float = 200.0,
) -> Mapping[str, Field]:
    """The fields that `twist` decides by, either sense alike."""
    recent = frame.once(
        RecentLoads, push=push, shear_gain=shear_gain, pads=pads, rate=rate, rest=0.4, look=0.08,
        floor=240.0,
    )  # fmt: skip
    signs = read_outs(frame, recent=recent, still=0.25)
    return recent.shown(turned=abs(signs["turned"]), apart=signs["apart"])


def turn_strength(reads: Answers) -> Floats:
    """Return the strength that `twist` holds against its level."""
    counts = reads["turned"] > reads["ratio"] + APART * reads["apart"]
    return np.asarray(np.where(counts, reads["turned"], 0.0))


def area(scores: Floats, hits: Floats) -> float:
    """Return the area under the curve: how often a frame with the event scores above another."""
    order = np.argsort(np.argsort(scores)) + 1.0
    found, others = int((hits > 0).sum()), int((hits <= 0).sum())
    return float((order[hits > 0].sum() - found * (found + 1) / 2) / (found * others))


def read(engine: Engine, trials: Sequence[Trial]) -> list[Answers]:
    """Return the read-outs of slip and of twist of each trial."""
    both = (
        in_batches(trials, partial(side_by_side, engine, slip_shows, READS)),
        in_batches(trials, partial(side_by_side, engine, twist_shows, TURNS)),
    )
    return [{**slips, **turns} for slips, turns in zip(*both, strict=True)]


def seen(job: Job, trial: Trial, reads: Answers) -> Floats:
    """Return the inputs of every frame, (frames, inputs, rows, cols)."""
    if job.reads:
        values = np.stack([reads[name] for name in job.reads], axis=1)
        logs: Floats = np.log(np.maximum(values, 0.0) + 1e-3)
        return logs[:, :, np.newaxis, np.newaxis]
    maps = np.moveaxis(trial.frames.astype(np.float64), -1, 1)
    late = max(1, round(LOOK * trial.rate))
    past = np.concatenate([np.repeat(maps[:1], late, axis=0), maps[:-late]])
    load = np.abs(maps[:, 2]).mean(axis=(1, 2))[:, np.newaxis, np.newaxis, np.newaxis] + 1e-9
    both: Floats = np.concatenate([maps, maps - past], axis=1)
    return np.asarray(both / load)


def taught(inputs: Floats, hits: Floats) -> tuple[Template, Callable[[Floats], Floats]]:
    """Return the template that frames teach, and a function that scales its inputs."""
    axes = (0, 2, 3)
    middle = inputs.mean(axes, keepdims=True)
    width = inputs.std(axes, keepdims=True) + 1e-9

    def scaled(values: Floats) -> Floats:
        return np.asarray((values - middle) / width)

    shape, size = (len(inputs), *inputs.shape[2:]), min(3, inputs.shape[-1])
    form = untied("event", inputs=inputs.shape[1], size=size, output="tanh", duration=2.0)
    share = float(hits.mean())
    each: Floats = np.where(hits > 0, 0.5 / share, 0.5 / (1.0 - share))
    wanted, counts = (
        np.broadcast_to(one[:, np.newaxis, np.newaxis], shape) for one in (2.0 * hits - 1.0, each)
    )
    lesson = Lesson(
        form, wanted, scaled(inputs), counts=counts, step=0.25, method="heun", shrink=1e-3
    )
    restarts, iterations = (2, 100) if shape[1] == 1 else MAPS
    return learn(lesson, restarts=restarts, iterations=iterations).template, scaled


def main() -> None:
    """Print the area of each family, by the learned template and by the program's formula."""
    job, engine, arrays = JOBS[sys.argv[1]], Engine(), Arrays()
    make = {family.name: family.make for family in FAMILIES}
    flat = [make[name](arrays, name, seed) for name in job.families for seed in SEEDS]
    reads = read(engine, flat)
    counted = [trial.scored & np.isfinite(trial.slips) for trial in flat]
    each = zip(flat, reads, counted, strict=True)
    inputs = [seen(job, trial, answers)[ok] for trial, answers, ok in each]
    labels = [job.truth(trial)[ok] for trial, ok in zip(flat, counted, strict=True)]
    formula = [job.formula(r)[ok] for r, ok in zip(reads, counted, strict=True)]
    rng = np.random.default_rng(0)
    for name in job.families:
        own = [n for n, trial in enumerate(flat) if trial.family == name]
        rest = [n for n in range(len(flat)) if n not in own]
        some = {n: rng.choice(len(labels[n]), FRAMES) for n in rest}
        template, scaled = taught(
            np.concatenate([inputs[n][some[n]] for n in rest]),
            np.concatenate([labels[n][some[n]] for n in rest]),
        )
        truth = np.concatenate([labels[n] for n in own])
        values = scaled(np.concatenate([inputs[n] for n in own]))
        state = engine.run(template, input=values).state.mean(axis=(1, 2))
        if truth.any():
            both = (area(state, truth), area(np.concatenate([formula[n] for n in own]), truth))
            print(f"{name}: learned {both[0]:.3f}, formula {both[1]:.3f}", flush=True)
        else:
            print(f"{name}: {100 * (state > 0).mean():.1f} % of frames without one reported")


if __name__ == "__main__":
    main()
