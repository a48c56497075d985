"""Answers from the differences between a gray cell and its eight neighbours (nonlinear B)."""

from collections.abc import Callable

import numpy as np

from cnnum.arrays import Floats, Shape
from cnnum.templating.checks.analytic.linear import ANALOG_REASON, ANALOG_TOLERANCE
from cnnum.templating.checks.analytic.operators import neighbours
from cnnum.templating.checks.digital.form import digital_form
from cnnum.templating.checks.parameters import has, number, text
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
    gain = number(template, "gain", 1.0)
    return _approached(template, case, gain * np.abs(differences(template, case)).mean(axis=0))


def _approached(template: Template, case: Case, goal: Floats) -> Floats:
    left = np.exp(-case.time(template))
    return np.asarray(goal + (case.start(template) - goal) * left, dtype=np.float64)


def _flat_extremum(sign: float) -> Callable[[Template, Case], Floats]:
    def expected(template: Template, case: Case) -> Floats:
        above = sign * differences(template, case)
        return as_picture(above.min(axis=0) > -0.5 * number(template, "step"))

    return expected


def _flat(template: Template, case: Case) -> Floats:
    cost = np.minimum(np.abs(differences(template, case)), number(template, "most"))
    return as_picture(cost.sum(axis=0) < number(template, "threshold"))


def _raised(template: Template, case: Case) -> Floats:
    """Return how many neighbours lie below by more than the threshold, less those above."""
    beyond, each = number(template, "threshold"), differences(template, case)
    lead = (each > beyond).sum(axis=0) - (each < -beyond).sum(axis=0)
    return _approached(template, case, lead / 8.0)


def _alike(template: Template, case: Case) -> Floats:
    """Return the mean likeness of the 3×3 cells, 1 for equal ones and 0 from `width` on."""
    apart = np.abs(differences(template, case)) / number(template, "width")
    likeness = (1.0 + np.maximum(1.0 - apart, 0.0).sum(axis=0)) / 9.0
    return _approached(template, case, likeness)


def _line(template: Template, case: Case) -> Floats:
    """Count the neighbours that are as a line would have them.

    Of the pattern, '#' cells belong to the line: no darker than the cell by `similar`, or within
    it either way where there is `darker`. 'o' cells are paler by more than `darker`, or `similar`.
    """
    rows = text(template, "pattern").split("/")
    at, radius = neighbours(case.pictures, template.input_boundary, len(rows) // 2), len(rows) // 2
    similar, count = number(template, "similar"), np.zeros(case.pictures.shape)
    both, paler = has(template, "darker"), number(template, "darker", similar)
    for down, row in enumerate(rows):
        for east, sign in enumerate(row):
            apart = case.pictures - at(down - radius, east - radius)
            like = (np.abs(apart) if both else apart) < similar
            fits = {"#": like, "o": apart > paler, ".": np.zeros_like(like)}[sign]
            count += fits.astype(np.float64)
    return as_picture(count >= number(template, "least"))


def _analog(
    name: str,
    expected: Callable[[Template, Case], Floats],
    summary: str,
    needs: tuple[str, ...],
) -> ClosedForm:
    return ClosedForm(
        name,
        _graded_case,
        expected,
        ANALOG_TOLERANCE,
        ANALOG_REASON,
        summary,
        needs=needs,
        compares="state",
    )


FORMS = (
    digital_form(
        "flat-minimum",
        _graded_case,
        _flat_extremum(-1.0),
        "cells above none of their eight neighbours",
        ("step",),
    ),
    digital_form(
        "flat-maximum",
        _graded_case,
        _flat_extremum(1.0),
        "cells below none of their eight neighbours",
        ("step",),
    ),
    digital_form(
        "flat",
        _graded_case,
        _flat,
        "cells whose eight absolute differences, each cut at the most, sum to little",
        ("threshold", "most", "step"),
    ),
    digital_form(
        "gray-line",
        _graded_case,
        _line,
        "cells around which at least a number of neighbours are as a gray line has them",
        ("pattern", "similar", "least", "step"),
        ("darker",),
    ),
    _analog(
        "raised",
        _raised,
        "an eighth of the neighbours that lie below by the threshold, less those above",
        ("threshold", "step"),
    ),
    _analog(
        "alike",
        _alike,
        "the mean likeness of the nine cells, falling with their distance in gray",
        ("width", "step"),
    ),
    digital_form(
        "local-maximum",
        _graded_case,
        _local_maximum,
        "cells above all of their eight neighbours",
        ("step",),
    ),
    digital_form(
        "contour",
        _graded_case,
        _contour,
        "cells that differ from six neighbours by the threshold, or from five and are dark enough",
        ("threshold", "gray", "step"),
    ),
    digital_form(
        "steep",
        _graded_case,
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
        takes=("gain",),
        compares="state",
    ),
)
