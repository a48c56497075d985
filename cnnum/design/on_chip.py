"""Runs of a sweep as on an analogue array: a chip each, in lanes of one launch all the same."""

from collections.abc import Mapping, Sequence

import numpy as np

from cnnum.arrays import Floats
from cnnum.design.changed_weights import Parts
from cnnum.design.experiment import CHIP, Value
from cnnum.runs.chip import MOST_BITS, Chip
from cnnum.templating.numbers import weights_of, with_numbers
from cnnum.templating.template import Template

MOST_SEEDS = 2**31


def chip_of(place: Mapping[str, Value], rng: np.random.Generator) -> Chip | None:
    """Return the chip of a run, None where no axis is one of chips."""
    if not place.keys() & set(CHIP):
        return None
    return Chip(
        weight_bits=int(place.get("weight_bits", MOST_BITS)),
        state_bits=int(place.get("state_bits", MOST_BITS)),
        noise=float(place.get("chip_noise", 0.0)),
        mismatch=float(place.get("chip_mismatch", 0.0)),
        seed=int(place["chip_seed"]) if "chip_seed" in place else int(rng.integers(MOST_SEEDS)),
    )


def programmed(chips: Sequence[Chip | None], template: Template, drawn: list[Parts]) -> list[Parts]:
    """Return the weights that the cells of each run's chip share."""
    found = list[Parts]()
    for chip, parts in zip(chips, drawn, strict=True):
        if chip is None or not template.plain:
            found.append(parts)
            continue
        own = chip.programmed(_with(template, parts))
        found.append({"A": own.A, "B": own.B, "z": own.z})
    return found


def offsets(
    chips: Sequence[Chip | None], template: Template, drawn: list[Parts], inputs: Floats | None,
    shape: tuple[int, int],
) -> Floats | None:  # fmt: skip
    """Return the biases that mismatch of each cell adds, None where there is none.

    Parameters
    ----------
    chips : sequence of Chip or None
        Of each run.
    template : Template
    drawn : list of mapping
        Programmed weights of each run.
    inputs : (runs, pictures, rows, cols) or (runs, pictures, inputs, rows, cols) float or None
    shape : (rows, cols)

    Returns
    -------
    (runs, pictures or 1, layers, rows, cols) float or None
    """
    if not any(chip is not None and chip.mismatch for chip in chips):
        return None
    if inputs is not None and template.inputs == 1:
        inputs = inputs[:, :, np.newaxis]
    found = list[Floats]()
    for number, (chip, parts) in enumerate(zip(chips, drawn, strict=True)):
        seen = None if inputs is None else inputs[number]
        lead = (1,) if seen is None else (len(seen),)
        if chip is None or not chip.mismatch:
            found.append(np.zeros((*lead, template.layers, *shape)))
        else:
            own = chip.offsets(_with(template, parts), seen, shape)
            found.append(np.broadcast_to(own, (*lead, template.layers, *shape)))
    return np.stack(found)


def stored(chips: Sequence[Chip | None], maps: Sequence[Floats]) -> Floats:
    """Return the maps of each run as the memories of its chip hold them."""
    pairs = zip(chips, maps, strict=True)
    return np.stack([own if chip is None else chip.stored(own) for chip, own in pairs])


def read(chips: Sequence[Chip | None], outputs: Sequence[Floats]) -> Floats:
    """Return the outputs of each run as they are read from its chip: noisy, then rounded."""
    pairs = zip(chips, outputs, strict=True)
    return np.stack([own if chip is None else chip.read(own) for chip, own in pairs])


def _with(template: Template, parts: Parts) -> Template:
    return with_numbers(template, {key: parts[key] for key in weights_of(template)})
