"""Linear courses of any symmetric coupling, mode by mode, exact at any time.

A symmetric kernel is given by its south-east quadrant, the cell itself first: "1 0.2/0.2 0.1" is 1
for the cell, 0.2 for the four edge neighbours and 0.1 for the corners.
"""

import numpy as np

from cnnum.arrays import Floats, Shape
from cnnum.errors import TemplateError
from cnnum.templating.checks.analytic.delays import by_steps
from cnnum.templating.checks.analytic.linear import ANALOG_REASON, ANALOG_TOLERANCE
from cnnum.templating.checks.analytic.modes import Modes, modes
from cnnum.templating.checks.parameters import has, number, text
from cnnum.templating.checks.pictures import gray
from cnnum.templating.checks.records import Case, ClosedForm, time_constant
from cnnum.templating.template import Template


def symbol(template: Template, name: str, found: Modes) -> Floats:
    """Return the eigenvalues of the kernel that a parameter gives by its quadrant; 0 without it.

    Raises
    ------
    TemplateError
        If the parameter is not rows of numbers.
    """
    if not has(template, name):
        return np.zeros((found.cos_rows.size, found.cos_cols.size))
    try:
        rows = [[float(v) for v in row.split()] for row in text(template, name).split("/")]
    except ValueError:
        raise TemplateError(
            f"Template '{template.name}': the parameter '{name}' of its check must be rows of "
            f"numbers parted by '/', got '{text(template, name)}'."
        ) from None
    total = np.zeros((found.cos_rows.size, found.cos_cols.size))
    for down, row in enumerate(rows):
        for east, weight in enumerate(row):
            both = (1.0 if down == 0 else 2.0) * (1.0 if east == 0 else 2.0)
            total += both * weight * _cosine(found.cos_rows, down) * _cosine(found.cos_cols, east)
    return total


def _cosine(cosine: Floats, times: int) -> Floats:
    """Return cos nk of cos k."""
    return np.asarray(np.cos(times * np.arccos(np.clip(cosine, -1.0, 1.0))), dtype=np.float64)


def _modes(template: Template, pictures: Floats) -> Modes:
    return modes(template.boundary, (pictures.shape[-2], pictures.shape[-1]))


def _case(template: Template, rng: np.random.Generator, shape: Shape) -> Case:
    """Draw pictures of that amplitude, small enough that no cell leaves the linear range."""
    pictures = gray(rng, shape, number(template, "amplitude", 0.5))
    time = number(template, "time", 0.0)
    bias = rng.permutation(pictures) if has(template, "bias") else None
    duration = time * time_constant(template) if time > 0.0 else None
    return Case(input=pictures, bias=bias, duration=duration)


def _grown(rate: Floats, time: float) -> Floats:
    """Return (e^{λt} − 1)/λ, which is t where λ is 0."""
    safe = np.where(np.abs(rate) < 1e-12, 1.0, rate)
    return np.asarray(np.where(safe == rate, np.expm1(rate * time) / safe, time))


def _course(template: Template, case: Case) -> Floats:
    found, time = _modes(template, case.pictures), case.time(template)
    rate = symbol(template, "feedback", found) - 1.0
    start = np.broadcast_to(case.start(template), case.pictures.shape)
    answer = found.apply(np.asarray(start), np.exp(rate * time))
    answer = answer + found.apply(
        case.pictures, symbol(template, "control", found) * _grown(rate, time)
    )
    if case.bias is not None:
        answer = answer + found.apply(case.bias, _grown(rate, time))
    return answer


def _late(template: Template, case: Case) -> Floats:
    """Follow x' = −x + w + K∗y(t − T) from x = 0: what is left to its rest has a constant past."""
    found = _modes(template, case.pictures)
    late = symbol(template, "late", found)
    apart = np.where(np.abs(1.0 - late) < 1e-9, 1e-9, 1.0 - late)
    delay = number(template, "delay") / time_constant(template)
    left = by_steps(-np.ones_like(late), late, delay, case.time(template))
    return found.apply(case.pictures, symbol(template, "control", found) * (1.0 - left) / apart)


def _pair(template: Template, case: Case) -> Floats:
    """Follow x' = −x + C∗u + K∗y, y' = x from rest: y'' + y' − Ky = Cu."""
    found, time = _modes(template, case.pictures), case.time(template)
    drive = symbol(template, "control", found)
    back = symbol(template, "back", found).astype(complex)
    root = np.sqrt(0.25 + back + 0j)
    root = np.where(np.abs(root) < 1e-9, 1e-9, root)
    fast, slow = -0.5 - root, -0.5 + root
    # of y'' + y' − Ky = 1: x = y' is (e^{slow t} − e^{fast t})/(slow − fast)
    speed = (np.exp(slow * time) - np.exp(fast * time)) / (slow - fast)
    place = (_rise(slow, time) - _rise(fast, time)) / (slow - fast)
    both = [found.apply(case.pictures, drive * factor.real) for factor in (speed, place)]
    return np.stack(both, axis=1)


def _rise(rate: Floats, time: float) -> Floats:
    safe = np.where(np.abs(rate) < 1e-12, 1.0, rate)
    return np.asarray(np.where(safe == rate, np.expm1(rate * time) / safe, time))


_TAKES = ("feedback", "control", "amplitude", "time", "bias")

FORMS = (
    ClosedForm(
        "symmetric-course",
        _case,
        _course,
        ANALOG_TOLERANCE,
        ANALOG_REASON,
        "a symmetric coupling to neighbours and inputs in the linear range, mode by mode",
        takes=_TAKES,
        compares="state",
    ),
    ClosedForm(
        "late-inhibition",
        _case,
        _late,
        ANALOG_TOLERANCE,
        ANALOG_REASON,
        "a filter whose answer comes back a delay later, by the method of steps",
        needs=("control", "late", "delay"),
        takes=("amplitude", "time"),
        compares="state",
    ),
    ClosedForm(
        "layer-pair",
        _case,
        _pair,
        ANALOG_TOLERANCE,
        ANALOG_REASON,
        "a filter and the layer that sums its answer and inhibits it, mode by mode",
        needs=("control", "back"),
        takes=("amplitude", "time"),
        compares="state",
    ),
)
