"""Measured figures of a template: its end state, how soon it is there, and how far from flipping.

All are taken on the pictures of the template's own check, so that anyone can take them again.
"""

from dataclasses import replace

import numpy as np

from cnnum.arrays import Floats, Shape
from cnnum.errors import CnnumError
from cnnum.templating.checks.pictures import binary_case
from cnnum.templating.checks.records import Case, ClosedForm
from cnnum.templating.checks.registry import form_of, posed
from cnnum.templating.checks.running import Engine, Result, run_case, run_way
from cnnum.templating.files.entry import Measured
from cnnum.templating.reads import autonomous
from cnnum.templating.template import Template

SHAPE: Shape = (8, 8)
SIDES = (8, 12, 16)
"""Sides of the square arrays on which the settle time is taken."""

NEAR = 0.01
"""Outputs this close to their end have settled."""

_CHUNKS = 40
_AT_REST = 0.8
"""Of a run that is cut off, at rest for the fifth that is left."""
_BIASES = np.geomspace(0.01, 8.0, 30)
_FINER = 23
"""Steps of one per cent between two biases of the ladder."""

_STEP = 1.05
"""Beyond the finer steps, with room for an engine's own errors."""

_RTOL = 1e-4

_ALLOWED = 0.01
"""Of a mean over all states: engines end within 0.01 of each other, cell by cell."""

WRONG = 0.5
"""Outputs this far from black or white are wrong."""


def measure(template: Template, engine: Engine) -> Measured:
    """Return the figures of a template, taken on an engine.

    Raises
    ------
    TemplateError
        If the template has no check.
    """
    form = form_of(template)
    case, _ = posed(template, 0, SHAPE)
    mean, rms = summary(run_way(template, engine, case, form.rtol).state)
    return Measured(
        template.digest,
        mean,
        rms,
        settle_times(template, engine),
        _margin(template, engine, form, case) if form.digital else None,
    )


def settle_times(template: Template, engine: Engine) -> tuple[tuple[int, float], ...]:
    """Return cells along a side and the time (unit of τ) until the outputs rest, where they do.

    A template without a check runs on black-and-white pictures.
    """
    found = ((n, _settle(template, engine, (n, n))) for n in SIDES)
    return tuple((n, time) for n, time in found if time is not None)


def summary(states: object) -> tuple[float, float]:
    """Return the mean of all states and the root of the mean of their squares."""
    values = np.asarray(states, dtype=np.float64)
    return float(values.mean()), float(np.sqrt((values**2).mean()))


def _case(template: Template, shape: Shape) -> Case:
    cases = binary_case if template.check is None else form_of(template).cases
    return cases(template, np.random.default_rng(0), shape)


def wrong_at(
    template: Template, engine: Engine, form: ClosedForm, case: Case, biases: Floats
) -> list[bool]:
    """Return for each number whether, added to the bias, it makes a cell wrong; one run for all."""
    expected = form.expected(template, case)
    count, times = len(expected), len(biases)

    def repeated(maps: Floats | None) -> Floats | None:
        return None if maps is None else np.concatenate([maps] * times)

    layers = (template.layers,) if template.layers > 1 else ()
    each = np.repeat(biases, count).reshape(-1, *(1 for _ in layers), 1, 1)
    offset = np.broadcast_to(each, (times * count, *layers, *expected.shape[-2:])).copy()
    if case.bias is not None:
        offset += np.concatenate([case.bias] * times)
    many = replace(
        case,
        input=repeated(case.input),
        previous=repeated(case.previous),
        state=repeated(case.state),
        mask=repeated(case.mask),
        bias=offset,
    )
    found = np.asarray(run_case(template, engine, many, form.rtol).output, dtype=np.float64)
    apart = np.abs(found.reshape(times, *expected.shape) - expected)
    return [bool(not (one <= WRONG).all()) for one in apart]


def _margin(template: Template, engine: Engine, form: ClosedForm, case: Case) -> float:
    """Return the largest bias tried that flips no cell in either direction, 0 where none is right.

    Once the ladder says between which two numbers it lies, finer steps find it to one per cent.
    """
    low = _last_right(template, engine, form, case, _BIASES)
    if not 0.0 < low < _BIASES[-1]:
        return low
    between = low * np.geomspace(1.0, float(_BIASES[1] / _BIASES[0]), _FINER + 1)[:-1]
    return _last_right(template, engine, form, case, between)


def _last_right(
    template: Template, engine: Engine, form: ClosedForm, case: Case, biases: Floats
) -> float:
    """Return the last bias before the first that makes a cell wrong, 0 where none is right."""
    wrong = np.array(wrong_at(template, engine, form, case, np.concatenate([biases, -biases])))
    either = wrong[: len(biases)] | wrong[len(biases) :]
    first = int(np.argmax(either)) if either.any() else len(biases)
    return float(biases[first - 1]) if first else 0.0


def _settle(template: Template, engine: Engine, shape: Shape) -> float | None:
    """Return when all outputs are within 0.01 of their end, a fortieth of the duration too late.

    A run goes on for twice the template's duration, or until it settles, also where its check
    stops it before: so it shows whether the end of the duration is a rest.
    """
    if template.output.discrete:
        return None
    # a run that knows its past or its clock cannot be cut into parts
    from_start = not autonomous(template)
    longest = _longest(template)
    case = replace(_case(template, shape), duration=longest)
    chunks = _CHUNKS if longest is None else 2 * _CHUNKS
    try:
        whole = _run(template, engine, case)
    except CnnumError:
        return None  # it diverges, or settles within no time that an engine runs for
    end = float(np.max(whole.time))
    if not 0.0 < end < np.inf or not np.isfinite(whole.output).all():
        return None
    goal, step = np.asarray(whole.output), end / chunks
    last, now = 0, case if template.inputs else replace(case, input=None, state=_start(case))
    for n in range(1, chunks):
        part = replace(case, duration=n * step) if from_start else replace(now, duration=step)
        passed = _run(template, engine, part)
        now = replace(now, state=np.asarray(passed.state, dtype=np.float64))
        if not (np.abs(np.asarray(passed.output) - goal) <= NEAR).all():
            last = n
    # a course that is cut off comes near its end in any case
    latest = chunks - 1 if longest is None else _AT_REST * chunks
    return (last + 1) * step if last < latest else None


def _longest(template: Template) -> float | None:
    return None if template.duration == "settle" else 2.0 * template.duration


def unsettled(template: Template, measured: Measured) -> str:
    """Return why a template has no settle time on some arrays, in a sentence; empty if it has."""
    known = dict(measured.settle)
    without = [f"{side}×{side}" for side in SIDES if side not in known]
    if not without:
        return ""
    where = f" ({', '.join(without)})" if known else ""
    return _why(template).removesuffix(".") + where + "."


def _why(template: Template) -> str:
    if template.output.discrete:
        return f"It runs in steps, for {template.timed(float(template.duration))}."
    if template.duration == "settle":
        return "A cell is still on its way when the longest run ends."
    return f"It is still on its way after {template.timed(2.0 * template.duration)}."


def _start(case: Case) -> Floats:
    return case.pictures if case.state is None else case.state


def _run(template: Template, engine: Engine, case: Case) -> Result:
    rtol = _RTOL if template.check is None else form_of(template).rtol
    return run_way(template, engine, case, rtol)


def drift(template: Template, result: Result, measured: Measured) -> str:
    """Return how a template differs from its measured figures, in a sentence; empty if not.

    Parameters
    ----------
    template : Template
    result : Result
        Result of the check's case on 8×8 cells, seed 0.
    measured : Measured
    """
    if template.digest != measured.digest:
        return "its numbers are not those that were measured"
    mean, rms = summary(result.state)
    # cells that chatter end anywhere within the tolerance of their check
    allowed = max(_ALLOWED * max(1.0, measured.rms), form_of(template).tolerance)
    if not (abs(mean - measured.mean) <= allowed and abs(rms - measured.rms) <= allowed):
        return f"its states end at a mean of {mean:.4g} and {rms:.4g} rms"
    return ""


def shifted(template: Template, engine: Engine, measured: Measured) -> str:
    """Return how margin or settle time differ from the measured ones, in a sentence; empty if not.

    A margin is right if 0.95 times it flips no cell, and 1.05 times it flips one.
    """
    form, case = form_of(template), _case(template, SHAPE)
    margin = measured.margin
    if margin is not None and form.digital and margin > 0.0:
        tries = np.array([margin / _STEP, -margin / _STEP, _STEP * margin, -_STEP * margin])
        wrong = wrong_at(template, engine, form, case, tries)
        if any(wrong[:2]):
            return f"a bias of {margin / _STEP:.3g} more or less flips a cell"
        if margin < _BIASES[-1] and not any(wrong[2:]):
            return f"a bias of {_STEP * margin:.3g} more or less flips no cell"
    known = dict(measured.settle).get(SHAPE[0])
    # beyond where a check stops, the rounding of a processor may decide how long a cell takes
    if known is not None and case.duration is None:
        found = _settle(template, engine, SHAPE)
        if found is None or abs(found - known) > 0.3 * known + 0.2:
            return f"it settles after {template.timed(found or np.inf, 3)}"
    return ""
