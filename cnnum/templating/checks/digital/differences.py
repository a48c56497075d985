"""Answers from the differences between a gray cell and its eight neighbours (nonlinear B)."""

from collections.abc import Callable

import numpy as np

from cnnum.arrays import Floats, Shape
from cnnum.templating.checks.analytic.linear import ANALOG_REASON, ANALOG_TOLERANCE
from cnnum.templating.checks.analytic.operators import neighbours
from cnnum.templating.checks.digital.neighbourhood import DIGITAL_REASON, DIGITAL_TOLERANCE
from cnnum.templating.checks.parameters import number
from cnnum.templating.checks.pictures import as_picture, gray
from cnnum.templating.checks.records import Case, ClosedForm
from cnnum.templating.template import Template

_RING = [(down, east) for down in (-1, 0, 1) for east in (-1, 0, 1) if (down, east) != (0, 0)]


def _graded_case(template: Template, rng: np.random.Generator, shape: Shape) -> Case:
    """Draw gray levels a whole number of `step` apart: none is near where the answer turns."""
    step = number(template, "step")
    pictures = np.concatenate([gray(rng, shape), gray(rng, shape)])
    return Case(input=step * np.rint(pictures / step))


def _gray_case(template: Template, rng: np.random.Generator, shape: Shape) -> Case:
    return Case(input=gray(rng, shape))


def differences(template: Template, case: Case) -> Floats:
    """Return centre − neighbour, (8, pictures, rows, cols)."""
    at = neighbours(case.pictures, template.input_boundary)
    return np.stack([case.pictures - at(down, east) for down, east in _RING])


def _local_maximum(template: Template, case: Case) -> Floats:
    return as_picture(differences(template, case).min(axis=0) > 0.5 * number(template, "step"))


def _contour(template: Template, case: Case) -> Floats:
    differing = np.abs(differences(template, case)) > number(template, "threshold")
    count = differing.sum(axis=0)
    own = case.pictures > number(template, "gray")
    return as_picture((count >= 6) | ((count == 5) & own))


def _steep(template: Template, case: Case) -> Floats:
    total = np.abs(differences(template, case)).sum(axis=0)
    return as_picture(total > number(template, "threshold"))


def _mean_difference(template: Template, case: Case) -> Floats:
    """Return w + (x₀ − w)e^{−t}, with w the mean of the eight absolute differences."""
    mean = np.abs(differences(template, case)).mean(axis=0)
    left = np.exp(-case.time(template))
    return np.asarray(mean + (case.start(template) - mean) * left, dtype=np.float64)


def _digital(
    name: str,
    expected: Callable[[Template, Case], Floats],
    summary: str,
    needs: tuple[str, ...],
) -> ClosedForm:
    return ClosedForm(
        name, _graded_case, expected, DIGITAL_TOLERANCE, DIGITAL_REASON, summary, needs=needs
    )


FORMS = (
    _digital(
        "local-maximum", _local_maximum, "cells above all of their eight neighbours", ("step",)
    ),
    _digital(
        "contour",
        _contour,
        "cells that differ from six neighbours by the threshold, or from five and are dark enough",
        ("threshold", "gray", "step"),
    ),
    _digital(
        "steep",
        _steep,
        "cells whose eight absolute differences sum to more than the threshold",
        ("threshold", "step"),
    ),
    ClosedForm(
        "mean-difference",
        _gray_case,
        _mean_difference,
        ANALOG_TOLERANCE,
        ANALOG_REASON,
        "w + (x0 - w)exp(-t) with w the mean of the eight absolute differences",
        compares="state",
    ),
)
