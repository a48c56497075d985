"""Linear arrays whose coupling fades while they run: each mode by the integral of its rate."""

import numpy as np

from cnnum.arrays import Floats, Shape
from cnnum.templating.checks.analytic.linear import ANALOG_REASON, ANALOG_TOLERANCE
from cnnum.templating.checks.analytic.modes import modes
from cnnum.templating.checks.parameters import number
from cnnum.templating.checks.pictures import gray
from cnnum.templating.checks.records import Case, ClosedForm, time_constant
from cnnum.templating.template import Template


def _case(template: Template, rng: np.random.Generator, shape: Shape) -> Case:
    return Case(input=gray(rng, shape))


def _faded(template: Template, case: Case) -> Floats:
    """Solve x' = −x + g(t)Kx with g falling from 1 to 0 in a straight line: ln x is −t + K∫g."""
    found = modes(template.boundary, (case.pictures.shape[-2], case.pictures.shape[-1]))
    time, fade = case.time(template), number(template, "fade") / time_constant(template)
    seen = min(time, fade)
    coupled = found.symbol(number(template, "edge")) * (seen - 0.5 * seen**2 / fade)
    return found.apply(case.pictures, np.exp(coupled - time))


FORMS = (
    ClosedForm(
        "fading",
        _case,
        _faded,
        ANALOG_TOLERANCE,
        ANALOG_REASON,
        "a coupling to the neighbours that fades in a straight line, mode by mode",
        needs=("edge", "fade"),
    ),
)
