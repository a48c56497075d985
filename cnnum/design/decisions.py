"""Records of templates of one cell that decide, learned from labelled numbers.

A lesson has its inputs scaled to a mean of 0 and a deviation of 1. The record takes them as they
are: the scaling is part of its B and z.
"""

from dataclasses import replace

import numpy as np

from cnnum.arrays import Floats
from cnnum.errors import TemplateError
from cnnum.templating.batch import TemplateBatch
from cnnum.templating.checks.robustness import mismatched, wilson
from cnnum.templating.checks.running import Engine
from cnnum.templating.files.entry import About, Entry, FlipRate, Proof
from cnnum.templating.template import Template

MISMATCHES = (0.0, 0.01, 0.05, 0.1)
"""Standard deviations of a weight, as shares of itself, at which flips are counted."""

DRAWS = 1000
"""Templates of each: a rate of 3 % is known to ±1 %, with 95 % confidence."""


def unscaled(template: Template, middle: Floats, width: Floats) -> Template:
    """Return a template for unscaled inputs, given one for (inputs − middle) / width.

    Parameters
    ----------
    template : Template
        One layer with kernels of one cell.
    middle, width : (inputs,) float

    Raises
    ------
    TemplateError
        If a kernel of B reads neighbours, because the boundary cannot be scaled.
    """
    if template.B.shape[-2:] != (1, 1):
        raise TemplateError(
            f"The inputs of '{template.name}' read neighbouring cells: scale them beforehand."
        )
    B = template.B / width[:, np.newaxis, np.newaxis]
    return replace(template, B=B, z=template.z - (B[0, :, 0, 0] * middle).sum())


def decision_entry(
    template: Template,
    inputs: Floats,
    labels: Floats,
    engine: Engine,
    *,
    area: float,
    inputs_are: str,
    seed: int = 0,
) -> Entry:
    """Return the library entry of a template that decides by the sign of its state.

    A cell that starts from 0 keeps the sign of its drive z + Σ B u, so the margins are those of the
    drive. Each draw for the flip rates is a template with mismatch and one example.

    Parameters
    ----------
    template : Template
        One layer that starts from 0, with kernels of one cell.
    inputs : (examples, inputs, 1, 1) float
        Unscaled inputs of the training examples.
    labels : (examples,) float
        Above 0 for examples in which the event is on.
    engine : Engine
    area : float
        Area under the ROC curve, on examples outside the training set.
    inputs_are : str
        Meaning of the inputs.
    seed : int
        Seed of the mismatch.

    Raises
    ------
    TemplateError
        If a kernel of B has neighbours, or the template starts from another state.
    """
    if template.B.shape[-2:] != (1, 1) or template.initial != 0.0:
        raise TemplateError(
            f"'{template.name}' does not decide by its drive alone: it needs a 1×1 B and the "
            "initial state 0."
        )
    wanted = np.where(labels > 0, 1.0, -1.0)
    sums = inputs[:, :, 0, 0] * template.B[0, :, 0, 0]
    terms = np.column_stack([sums, np.full(len(wanted), template.z[0])])
    drives = wanted * terms.sum(axis=1)
    relative = float((drives / np.abs(terms).sum(axis=1)).min())
    rng = np.random.default_rng(seed)
    rates = list[FlipRate]()
    for mismatch in MISMATCHES:
        some = rng.integers(len(wanted), size=DRAWS)
        batch = TemplateBatch.of([mismatched(template, rng, mismatch) for _ in range(DRAWS)])
        drawn = np.asarray(engine.run(batch, input=inputs[some]).state)[:, 0, 0]
        wrong = int((wanted[some] * drawn <= 0.0).sum())
        rates.append(FlipRate(mismatch, wrong / DRAWS, *wilson(wrong, DRAWS), DRAWS))
    margin, flips = float(drives.min()), tuple(rates)
    proof = Proof(
        template.digest, "gradients", len(wanted), margin, relative, flips=flips, area=area
    )
    why = "no rule says when an event is on: the proof counts its answers"
    about = About(input=inputs_are, tags=("designed",), experimental=why)
    return Entry(template, about=about, proof=proof)
