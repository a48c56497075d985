"""Linear arrays with a delay, exact by the method of steps, mode by mode.

x' = ax + bx(t − T) has a constant past. On the n-th stretch of length T it is a constant plus a
polynomial of degree n − 1 times e^{as}: each stretch integrates the polynomial before it (Bellman &
Cooke 1963, Differential-Difference Equations, ch. 3).
"""

import numpy as np

from cnnum.arrays import Floats, Shape
from cnnum.templating.checks.analytic.linear import ANALOG_REASON, ANALOG_TOLERANCE
from cnnum.templating.checks.analytic.modes import modes
from cnnum.templating.checks.parameters import number
from cnnum.templating.checks.pictures import gray
from cnnum.templating.checks.records import Case, ClosedForm, time_constant
from cnnum.templating.template import Template


def by_steps(rate: Floats, delayed: Floats, delay: float, time: float) -> Floats:
    """Return x(t) of x' = rate·x + delayed·x(t − delay) with x = 1 up to t = 0.

    Parameters
    ----------
    rate, delayed : (...) float
        The rate is not 0.
    delay, time : float
    """
    constant, polynomial = np.ones_like(rate), [np.zeros_like(rate)]
    value, begin = np.ones_like(rate), 0.0
    while begin < time:
        length = min(delay, time - begin)
        constant = -delayed * constant / rate
        powers = [delayed * p / (n + 1) for n, p in enumerate(polynomial)]
        polynomial = [value - constant, *powers]
        value = constant + np.exp(rate * length) * _at(polynomial, length)
        begin += delay
    return value


def _at(polynomial: list[Floats], s: float) -> Floats:
    return np.asarray(sum(p * s**n for n, p in enumerate(polynomial)), dtype=np.float64)


def _case(template: Template, rng: np.random.Generator, shape: Shape) -> Case:
    return Case(input=gray(rng, shape))


def _delayed(template: Template, case: Case) -> Floats:
    found = modes(template.boundary, (case.pictures.shape[-2], case.pictures.shape[-1]))
    edge, late_edge = number(template, "edge", 0.0), number(template, "delayed_edge", 0.0)
    rate = number(template, "centre", 0.0) - 1.0 + found.symbol(edge)
    late = number(template, "delayed_centre", 0.0) + found.symbol(late_edge)
    delay = number(template, "delay") / time_constant(template)
    return found.apply(case.pictures, by_steps(rate, late, delay, case.time(template)))


FORMS = (
    ClosedForm(
        "delayed-coupling",
        _case,
        _delayed,
        ANALOG_TOLERANCE,
        ANALOG_REASON,
        "a linear array that sees itself a delay ago, by the method of steps",
        needs=("delay",),
        takes=("centre", "edge", "delayed_centre", "delayed_edge"),
    ),
)
