"""Templates of slip and of twist learned from labelled scenes, a family left out at a time.

`python -m docs.figures.learn_events slip [--out FOLDER]` or `twist`: the read-outs of the programs
are the inputs of a template of one cell, whose weights gradients set. `--out` keeps the template of
all families, with its proof; its area is the mean over the families left out.

With `maps` the inputs are the maps of the array, and their change over 80 ms. The mean over the
cells is the strength. Each takes a minute.
"""

import argparse
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from cnnum.arrays import Floats
from cnnum.design.decisions import decision_entry, unscaled
from cnnum.design.learning import Lesson, learn, untied
from cnnum.drivers.simulated.grips import Arrays, Trial
from cnnum.engine import Engine
from cnnum.lab.scoring.families.catalogue import FAMILIES
from cnnum.lab.scoring.judge import auc
from cnnum.lab.scoring.subjects import Answers, in_batches, side_by_side
from cnnum.templates.tactile.twist import APART
from cnnum.templating.files import save_entry
from cnnum.templating.template import Template
from docs.figures.learned_weights import PHYSICAL, READS, shows, strength

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


def turn_strength(reads: Answers) -> Floats:
    """Return the strength that `twist` holds against its level."""
    counts = reads["turned"] > reads["ratio"] + APART * reads["apart"]
    return np.asarray(np.where(counts, reads["turned"], 0.0))


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


@dataclass(frozen=True, slots=True)
class Taught:
    """A template that frames taught, with the scaling of its inputs: (inputs − middle) / width."""

    template: Template
    middle: Floats
    width: Floats

    def states(self, engine: Engine, inputs: Floats) -> Floats:
        """Return the mean state of each frame, of inputs as they are."""
        scaled = (inputs - self.middle) / self.width
        return np.asarray(engine.run(self.template, input=scaled).state.mean(axis=(1, 2)))


def taught(name: str, inputs: Floats, hits: Floats) -> Taught:
    """Return the template that frames teach."""
    axes = (0, 2, 3)
    middle = inputs.mean(axes, keepdims=True)
    width = inputs.std(axes, keepdims=True) + 1e-9
    shape, size = (len(inputs), *inputs.shape[2:]), min(3, inputs.shape[-1])
    form = untied(name, inputs=inputs.shape[1], size=size, output="tanh", duration=2.0)
    share = float(hits.mean())
    each: Floats = np.where(hits > 0, 0.5 / share, 0.5 / (1.0 - share))
    wanted, counts = (
        np.broadcast_to(one[:, np.newaxis, np.newaxis], shape) for one in (2.0 * hits - 1.0, each)
    )
    lesson = Lesson(
        form,
        wanted,
        (inputs - middle) / width,
        counts=counts,
        step=0.25,
        method="heun",
        shrink=1e-3,
    )
    restarts, iterations = (2, 100) if shape[1] == 1 else MAPS
    learned = learn(lesson, restarts=restarts, iterations=iterations)
    return Taught(learned.template, middle, width)


def keep(job: Job, made: Taught, frames: tuple[Floats, Floats], area: float, out: Path) -> Path:
    """Write the record of a template with its proof, and return its path."""
    flat = unscaled(made.template, made.middle.ravel(), made.width.ravel())
    flat = replace(
        flat,
        description="Decides by the sign of its state after two time constants.",
        source="learned from labelled scenes by gradients",
    )
    reads = f"ln(x + 0.001) of the read-outs {', '.join(job.reads)}"
    entry = decision_entry(flat, *frames, Engine(), area=area, inputs_are=reads)
    path = out / f"{flat.name.lower()}.toml"
    save_entry(entry, path, force=True)
    return path


def main() -> None:
    """Print the area of each family, by the learned template and by the program's formula."""
    words = argparse.ArgumentParser(description="Learn a template of slip or of twist.")
    words.add_argument("event", choices=JOBS)
    words.add_argument("--out", type=Path, help="folder of the template's record; not of maps")
    given = words.parse_args()
    job, engine, arrays = JOBS[given.event], Engine(), Arrays()
    if given.out and not (job.reads and given.out.is_dir()):
        words.error("--out needs a folder that exists, and the event 'slip' or 'twist'.")
    make = {family.name: family.make for family in FAMILIES}
    flat = [make[name](arrays, name, seed) for name in job.families for seed in SEEDS]
    reads = in_batches(flat, partial(side_by_side, engine, shows, (*READS, *TURNS)))
    counted = [trial.scored & np.isfinite(trial.slips) for trial in flat]
    each = zip(flat, reads, counted, strict=True)
    inputs = [seen(job, trial, answers)[ok] for trial, answers, ok in each]
    labels = [job.truth(trial)[ok] for trial, ok in zip(flat, counted, strict=True)]
    formula = [job.formula(r)[ok] for r, ok in zip(reads, counted, strict=True)]
    rng, name = np.random.default_rng(0), f"{given.event.upper()}_EVENT"

    def frames_of(trials: Sequence[int]) -> tuple[Floats, Floats]:
        some = {n: rng.choice(len(labels[n]), FRAMES) for n in trials}
        return (
            np.concatenate([inputs[n][some[n]] for n in trials]),
            np.concatenate([labels[n][some[n]] for n in trials]),
        )

    areas = list[float]()
    for family in job.families:
        own = [n for n, trial in enumerate(flat) if trial.family == family]
        made = taught(name, *frames_of([n for n in range(len(flat)) if n not in own]))
        state = made.states(engine, np.concatenate([inputs[n] for n in own]))
        on = np.concatenate([labels[n] for n in own]) > 0
        if on.any():
            physical = np.concatenate([formula[n] for n in own])
            areas.append(auc(state[on], state[~on]))
            by_formula = auc(physical[on], physical[~on])
            print(f"{family}: learned {areas[-1]:.3f}, formula {by_formula:.3f}", flush=True)
        else:
            print(f"{family}: {100 * (state > 0).mean():.1f} % of frames without one reported")
    if given.out:
        frames = frames_of(range(len(flat)))
        path = keep(job, taught(name, *frames), frames, float(np.mean(areas)), given.out)
        print(f"wrote {path}")


if __name__ == "__main__":
    main()
