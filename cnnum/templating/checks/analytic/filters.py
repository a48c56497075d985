"""Cells without feedback: each goes exponentially to the value set by its input."""

import numpy as np

from cnnum.arrays import Floats, Shape
from cnnum.templating.checks.analytic.linear import ANALOG_REASON, ANALOG_TOLERANCE
from cnnum.templating.checks.analytic.operators import SCALAR, VECTOR
from cnnum.templating.checks.parameters import choice, number, text
from cnnum.templating.checks.pictures import gray
from cnnum.templating.checks.records import Case, ClosedForm
from cnnum.templating.template import Template


def _case(template: Template, rng: np.random.Generator, shape: Shape) -> Case:
    if text(template, "operator") in VECTOR:
        return Case(input=np.stack([gray(rng, shape), gray(rng, shape)], axis=1))
    return Case(input=gray(rng, shape))


def _filter(template: Template, case: Case) -> Floats:
    """Return w + (x₀ − w)e^{−t}, with w the operator's answer and t in time constants."""
    operator = choice(template, "operator", {**SCALAR, **VECTOR})
    gain = number(template, "gain", 1.0)
    goal = gain * operator(case.pictures, template.input_boundary)
    left = np.exp(-case.time(template))
    return np.asarray(goal + (case.start(template) - goal) * left, dtype=np.float64)


FORMS = (
    ClosedForm(
        "filter",
        _case,
        _filter,
        ANALOG_TOLERANCE,
        ANALOG_REASON,
        "w + (x0 - w)exp(-t) with w a named operator of the input",
        needs=("operator",),
        takes=("gain",),
    ),
)
