"""A task of a sweep: a template with changed weights, run once."""

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cnnum.arrays import Floats, largest
from cnnum.design.experiment import CHIP, DRAW, OUTER, WEIGHT, Experiment, Value
from cnnum.engine import Engine
from cnnum.errors import ArrayError, MethodError, NotSupportedError, SizeError, TemplateError
from cnnum.runs.chip import MOST_BITS, Chip
from cnnum.runs.result import Result
from cnnum.safety.values import refuse_on_host
from cnnum.templating.batch import TemplateBatch
from cnnum.templating.checks.records import Case
from cnnum.templating.checks.registry import form_of
from cnnum.templating.numbers import on_grid, weights_of, with_numbers
from cnnum.templating.template import Template

Parts = dict[str, Floats]


def changed_weights(
    template: Template, place: Mapping[str, Value], rng: np.random.Generator
) -> Parts:
    """Return A, B and z of a run; the order of the axes changes nothing.

    Mismatch multiplies every number by 1 plus a normal number of that width. Of b bits, a number
    is a whole multiple of the largest of its matrix over 2^(b−1) − 1.
    """
    parts: Parts = {"A": template.A.copy(), "B": template.B.copy(), "z": template.z.copy()}
    for name, value in place.items():
        if WEIGHT.fullmatch(name):
            row, col = (int(n) for n in name[2:-1].split(","))
            parts[name[0]][..., row, col] = float(value)
    for name in ("A", "B"):
        if name in place:
            parts[name] *= float(place[name])
    if "z" in place:
        parts["z"][:] = float(place["z"])
    if "bits" in place:
        parts = {key: rounded(part, int(place["bits"])) for key, part in parts.items()}
    width = float(place.get("mismatch", 0.0))
    if width:
        parts = {
            key: part * (1.0 + width * rng.normal(size=part.shape)) for key, part in parts.items()
        }
    return parts


def rounded(part: Floats, bits: int) -> Floats:
    """Return numbers as whole multiples of the largest one over 2^(bits − 1) − 1."""
    return on_grid(part, largest(part), bits)


def biases_of(
    shape: tuple[int, int], place: Mapping[str, Value], rng: np.random.Generator
) -> Floats:
    """Return the bias map of a run: of each cell its own, and one that drifts across the array.

    Parameters
    ----------
    shape : (rows, cols)
    place : mapping
        "offset", a standard deviation, and "drift", that of the slope times the half diagonal.
    rng : Generator
    """
    values = np.zeros(shape)
    if offset := float(place.get("offset", 0.0)):
        values += offset * rng.normal(size=shape)
    if drift := float(place.get("drift", 0.0)):
        rows, cols = (np.arange(n) - (n - 1) / 2.0 for n in shape)
        half = max(float(np.hypot(rows[-1], cols[-1])), 1.0)
        down, east = drift * rng.normal(size=2) / half
        values += down * rows[:, np.newaxis] + east * cols
    return values


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
    result = list[Parts]()
    for chip, parts in zip(chips, drawn, strict=True):
        if chip is None or not template.plain:
            result.append(parts)
            continue
        own = chip.programmed(_with(template, parts))
        result.append({"A": own.A, "B": own.B, "z": own.z})
    return result


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
    result = list[Floats]()
    for number, (chip, parts) in enumerate(zip(chips, drawn, strict=True)):
        seen = None if inputs is None else inputs[number]
        lead = (1,) if seen is None else (len(seen),)
        if chip is None or not chip.mismatch:
            result.append(np.zeros((*lead, template.layers, *shape)))
        else:
            own = chip.offsets(_with(template, parts), seen, shape)
            result.append(np.broadcast_to(own, (*lead, template.layers, *shape)))
    return np.stack(result)


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


Figures = dict[str, NDArray[Any]]

NAMES = ("error", "wrong", "flipped", "settled", "time", "steps")
"""Figures of every run. They are the largest error, the share of wrong cells, and whether there is
one. Then come the share of pictures that rest, the longest time in the unit of τ, and most
steps."""

REASON = "reason"
"""Why a run failed, a sentence; empty where it came to its end. Its figures are NaN."""

LONGEST_REASON = 300
"""Signs of a reason that are kept."""

OWN_FAILURES = (MethodError, NotSupportedError, ArrayError, SizeError, TemplateError)
"""Errors of what a run is given, which count as its failure. Any other stops the sweep: it is the
machine's, and would fail every run alike."""

BLOCK = 512
"""Runs of a launch."""

PICTURE_BYTES = 64
"""Of a cell of the check's pictures, which are at least some of float64 at once."""

HALF = 0.5
FAR = 1e30
"""A state at which every bounded output has its largest magnitude."""


@cache
def _engine(name: str, precision: str) -> Engine:
    """Return the engine of this process: opening one takes longer than a task."""
    return Engine(name, precision=precision or None)


def run_task(experiment: Experiment, first: int, last: int) -> Figures:
    """Return the figures of the runs from the first up to, not with, the last.

    Runs share launches in blocks that do not depend on the task: steps follow the fastest template
    of a launch, so that the same run in other company may differ by roundings.

    Parameters
    ----------
    experiment : Experiment
    first, last : int
        Of one launch: only axes of lanes may differ.

    Returns
    -------
    dict of str to (runs,) float
        Those of `NAMES`, and under "reason" (runs,) str.

    Raises
    ------
    CnnumError
        If the check's case cannot be made, or the engine cannot run at all.
    """
    begin = first - first % experiment.launched
    ends = [*range(first + BLOCK - (first - begin) % BLOCK, last, BLOCK), last]
    starts = [first, *ends[:-1]]
    parts = [_block(experiment, *block) for block in zip(starts, ends, strict=True)]
    return {name: np.concatenate([part[name] for part in parts]) for name in (*NAMES, REASON)}


def refuse_launches(experiment: Experiment) -> None:
    """Make the case of every launch once, so that one that cannot be made is said at the start.

    Raises
    ------
    CnnumError
        If the template has no case at a boundary, size or time constant of the axes.
    """
    outer = [name for name in ("boundary", "size", "tau") if name in experiment.axes]
    for values in itertools.product(*(experiment.axes[name] for name in outer)):
        shared = dict(zip(outer, values, strict=True))
        _case(replace(experiment, pictures=1), _form(experiment.base, shared), shared)


def _block(experiment: Experiment, first: int, last: int) -> Figures:
    places = [experiment.place(run) for run in range(first, last)]
    shared = {name: places[0][name] for name in OUTER if name in places[0]}
    template = _form(experiment.base, shared)
    case = _case(experiment, template, shared)
    rngs = [np.random.default_rng([experiment.seed, run]) for run in range(first, last)]
    drawn = [changed_weights(template, p, rng) for p, rng in zip(places, rngs, strict=True)]
    noise = [float(place.get("noise", 0.0)) for place in places]
    inputs = case.pictures if template.inputs or case.state is None else case.states
    noisy = [inputs + s * r.normal(size=inputs.shape) for s, r in zip(noise, rngs, strict=True)]
    with np.errstate(over="ignore", invalid="ignore"):  # of a field that grows until it settles
        expected = form_of(template).expected(template, case)
    shape = (inputs.shape[-2], inputs.shape[-1])
    if any("offset" in place or "drift" in place for place in places):
        maps = [biases_of(shape, p, rng) for p, rng in zip(places, rngs, strict=True)]
        case = replace(case, bias=_biased(template, case, np.stack(maps)[:, np.newaxis]))
    chips = [chip_of(place, rng) for place, rng in zip(places, rngs, strict=True)]
    held, drawn = stored(chips, noisy), programmed(chips, template, drawn)
    seen = held if template.inputs else None
    if (off := offsets(chips, template, drawn, seen, shape)) is not None:
        case = replace(case, bias=_biased(template, case, off))
    engine = _engine(experiment.engine, str(shared.get("precision", "")))
    try:
        method = str(shared.get("method", _method(experiment, template)))
        result = _run(engine, template, case, drawn, held, chips, method)
        shown = replace(result, output=read(chips, list(result.output)))
        return _judged(template, shown, expected)
    except OWN_FAILURES as error:
        if last - first == 1:
            return _failed(str(error))  # it diverges, or does not reach its end
        parts = [_block(experiment, run, run + 1) for run in range(first, last)]
        return {name: np.concatenate([part[name] for part in parts]) for name in (*NAMES, REASON)}


def _biased(template: Template, case: Case, maps: Floats) -> Floats:
    """Return the bias maps of runs, those of the case with biases of their own.

    Parameters
    ----------
    template : Template
    case : Case
    maps : (runs, pictures or 1, rows, cols) or (runs, pictures or 1, layers, rows, cols) float
    """
    if template.layers > 1 and maps.ndim == 4:
        maps = maps[:, :, np.newaxis]
    if template.layers == 1 and maps.ndim == 5:
        maps = maps[:, :, 0]
    return maps if case.bias is None else maps + case.bias


def _form(base: Template, shared: dict[str, Value]) -> Template:
    changes: dict[str, Any] = {}
    if "boundary" in shared:
        changes |= {"boundary": shared["boundary"], "input_boundary": shared["boundary"]}
    if "tau" in shared:
        changes["tau"] = float(shared["tau"])
    return replace(base, **changes)


def _case(experiment: Experiment, template: Template, shared: dict[str, Value]) -> Case:
    """Return the check's case, with the experiment's number of pictures, evenly taken."""
    side = int(float(shared.get("size", 8)))
    refuse_on_host("A picture of the check", (side, side), PICTURE_BYTES)
    rng = np.random.default_rng(experiment.seed)
    case = form_of(template).cases(template, rng, (side, side))
    maps = {key: getattr(case, key) for key in ("input", "previous", "state", "bias", "mask")}
    count = max(len(array) for array in maps.values() if array is not None)
    chosen = np.unique(
        np.linspace(0, count - 1, min(count, experiment.pictures)).round().astype(int)
    )
    kept = {key: None if array is None else array[chosen] for key, array in maps.items()}
    duration = case.duration if experiment.duration is None else experiment.duration
    return replace(case, **kept, duration=duration)


def _method(experiment: Experiment, template: Template) -> str:
    """Return the method of runs unless an axis has it: an exact run knows no settle time."""
    stepped = experiment.duration == "settle" and template.plain and not template.output.discrete
    return "dormand-prince" if stepped else "auto"


def _run(
    engine: Engine,
    template: Template,
    case: Case,
    drawn: list[dict[str, Floats]],
    held: Floats,
    chips: list[Chip | None],
    method: str,
) -> Result:
    """Run all templates on all pictures: (runs, pictures)."""
    options: dict[str, Any] = {"duration": case.duration, "method": method}
    given: dict[str, Any] = {"bias": case.bias, "mask": case.mask}
    given |= {"input": held} if case.input is not None else {"state": held}
    for role in ("previous", "state") if case.input is not None else ("previous",):
        maps = getattr(case, role)
        given[role] = None if maps is None else stored(chips, [maps] * len(chips))
    parts = {key: np.stack([draw[key] for draw in drawn]) for key in ("A", "B", "z")}
    # an axis for the pictures of the case
    batch = TemplateBatch(template, parts["A"], parts["B"], parts["z"]).spread()
    return engine.run(batch, **given, **options)


def _judged(template: Template, result: Result, expected: Floats) -> Figures:
    form = form_of(template)
    answer = np.asarray(getattr(result, form.compares), dtype=np.float64)
    runs = len(answer)
    with np.errstate(invalid="ignore"):  # of infinite numbers, which are no answer
        apart = np.abs(answer - expected).reshape(runs, -1)
    wrong = (apart > (HALF if form.digital else form.tolerance)).mean(axis=1)
    far = form.compares == "output" and np.abs(expected).max() > _reach(template) + form.tolerance
    if far or not np.isfinite(expected).all():
        # the closed form is that of a shorter run, before any cell saturates: it judges none of it
        apart, wrong = np.full_like(apart, np.nan), np.full(runs, np.nan)

    def of(values: Any) -> Floats:
        return np.asarray(values, dtype=np.float64).reshape(runs, -1)

    figures: Figures = {
        "error": apart.max(axis=1),
        "wrong": wrong,
        "flipped": np.where(np.isnan(wrong), np.nan, wrong > 0.0),
        "settled": of(result.settled).mean(axis=1),
        "time": of(result.time).max(axis=1),
        "steps": of(result.steps).max(axis=1),
    }
    lost = ~np.isfinite(answer.reshape(runs, -1)).all(axis=1)
    for values in figures.values():
        values[lost] = np.nan
    return figures | {REASON: np.where(lost, "The result is not finite.", "")}


def _reach(template: Template) -> float:
    """Return the largest magnitude of an output."""
    return float(np.abs(template.output.numpy(np.array([-FAR, FAR]))).max())


def _failed(reason: str) -> Figures:
    figures: Figures = {name: np.array([np.nan]) for name in NAMES}
    return figures | {REASON: np.array([reason[:LONGEST_REASON]])}


__all__ = ["DRAW", "NAMES", "REASON", "refuse_launches", "run_task"]
