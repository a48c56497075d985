"""A slip template learned from labelled scenes, one family left out at a time.

`python docs/figures/learn_slip.py`: the read-outs of `slip` are the inputs of a template of one
cell, whose weights gradients set. It takes half a minute.
"""

from functools import partial

import numpy as np

from cnnum.arrays import Floats
from cnnum.design.learning import Lesson, learn, untied
from cnnum.engine import Engine
from cnnum.lab.scoring.families.arrays import Arrays
from cnnum.lab.scoring.families.catalogue import FAMILIES
from cnnum.lab.scoring.judged_programs import in_batches, side_by_side
from cnnum.lab.scoring.trial import Trial
from docs.figures.learned_weights import PHYSICAL, READS, shows, strength

NAMES = ("constant speed", "force ramp", "tremor", "ring", "part pull", "grip")
SEEDS, FRAMES = (1, 2), 60
"""Scenes of a family, and frames of each that are learned from."""


def area(scores: Floats, slips: Floats) -> float:
    """Return the area under the curve: how often a frame with slip scores above one without."""
    ranks = np.argsort(np.argsort(scores)) + 1.0
    hits = slips > 0
    found, others = int(hits.sum()), int((~hits).sum())
    return float((ranks[hits].sum() - found * (found + 1) / 2) / (found * others))


def main() -> None:
    """Print the area of each family, by the learned template and by the formula of `slip`."""
    engine, arrays = Engine(), Arrays()
    make = {family.name: family.make for family in FAMILIES}
    trials = {n: [make[n](arrays, n, seed) for seed in SEEDS] for n in NAMES}
    flat: list[Trial] = [trial for some in trials.values() for trial in some]
    reads = in_batches(flat, partial(side_by_side, engine, shows, READS))
    counted = [t.scored & np.isfinite(t.slips) for t in flat]
    inputs = [
        np.log(np.maximum(np.stack([r[n] for n in READS], 1), 0.0) + 1e-3)[ok]
        for r, ok in zip(reads, counted, strict=True)
    ]
    labels = [t.slips[ok] for t, ok in zip(flat, counted, strict=True)]
    formula = [strength(r, PHYSICAL, axes=True)[ok] for r, ok in zip(reads, counted, strict=True)]
    rng = np.random.default_rng(0)
    for name in NAMES:
        own = [n for n, trial in enumerate(flat) if trial in trials[name]]
        rest = [n for n in range(len(flat)) if n not in own]
        some = {n: rng.choice(len(labels[n]), FRAMES) for n in rest}
        seen = np.concatenate([inputs[n][some[n]] for n in rest])
        slips = np.concatenate([labels[n][some[n]] for n in rest])
        middle, width = seen.mean(0), seen.std(0) + 1e-9

        def maps(values: Floats, middle: Floats = middle, width: Floats = width) -> Floats:
            return ((values - middle) / width)[:, :, np.newaxis, np.newaxis]

        form = untied("slip", inputs=len(READS), size=1, output="tanh", duration=2.0)
        counts = np.where(slips > 0, 0.5 / slips.mean(), 0.5 / (1.0 - slips.mean()))
        lesson = Lesson(
            form, 2.0 * slips[:, None, None] - 1.0, maps(seen), counts=counts[:, None, None],
            step=0.25, method="heun", shrink=1e-3,
        )  # fmt: skip
        made = learn(lesson, restarts=2, iterations=100)
        values = np.concatenate([inputs[n] for n in own])
        truth = np.concatenate([labels[n] for n in own])
        state = engine.run(made.template, input=maps(values)).state[:, 0, 0]
        if truth.any():
            both = (area(state, truth), area(np.concatenate([formula[n] for n in own]), truth))
            print(f"{name}: learned {both[0]:.3f}, formula {both[1]:.3f}", flush=True)
        else:
            print(f"{name}: {100 * (state > 0).mean():.1f} % of frames without slip reported")


if __name__ == "__main__":
    main()
