"""Rank filters: median, minimum and maximum of neighbourhoods, and of the whole array."""

from collections.abc import Callable
from typing import Literal

import numpy as np
from scipy import ndimage

from cnnum.arrays import Floats, Shape
from cnnum.templating.boundary import Boundary
from cnnum.templating.checks.parameters import choice
from cnnum.templating.checks.pictures import gray
from cnnum.templating.checks.records import Case, ClosedForm
from cnnum.templating.template import Template

CHATTER = 0.1
CHATTER_REASON = (
    "a cell slides along a jump of its rate: its Euler steps of 0.01 leave it within 0.08. That is "
    "the change by eight neighbours in a step, and the table's jump lies up to 0.01 from 0"
)
_SPREAD = 0.02
_SPREAD_REASON = (
    "a maximum never falls again, so that the errors of up to 150 steps, 1e-4 each, may all lift "
    "it; a rise still on its way after 100 time constants is less"
)
_SIZE = (1, 3, 3)
_Mode = Literal["reflect", "wrap", "constant"]
_MODES: dict[str, _Mode] = {"symmetric": "reflect", "wrap": "wrap", "constant": "constant"}
_Filter = Callable[[Floats, Boundary], Floats]


def _median(picture: Floats, boundary: Boundary) -> Floats:
    mode = _MODES[boundary.pad_mode]
    found = ndimage.median_filter(picture, _SIZE, mode=mode, cval=boundary.constant or 0.0)
    return np.asarray(found, dtype=np.float64)


def _minimum(picture: Floats, boundary: Boundary) -> Floats:
    mode = _MODES[boundary.pad_mode]
    return ndimage.minimum_filter(picture, _SIZE, mode=mode, cval=boundary.constant or 0.0)


def _maximum(picture: Floats, boundary: Boundary) -> Floats:
    return -_minimum(-picture, boundary)


_RANKS: dict[str, _Filter] = {"median": _median, "minimum": _minimum, "maximum": _maximum}


def _case(template: Template, rng: np.random.Generator, shape: Shape) -> Case:
    return Case(input=gray(rng, shape))


def _rank(template: Template, case: Case) -> Floats:
    return choice(template, "rank", _RANKS)(case.pictures, template.input_boundary)


def _global_maximum(template: Template, case: Case) -> Floats:
    largest = case.pictures.max(axis=(-2, -1), keepdims=True)
    return np.broadcast_to(largest, case.pictures.shape)


def _global_minimum(template: Template, case: Case) -> Floats:
    smallest = case.pictures.min(axis=(-2, -1), keepdims=True)
    return np.broadcast_to(smallest, case.pictures.shape)


FORMS = (
    ClosedForm(
        "rank",
        _case,
        _rank,
        CHATTER,
        CHATTER_REASON,
        "median, minimum or maximum of the 3×3 neighbourhood",
        needs=("rank",),
    ),
    ClosedForm(
        "global-maximum",
        _case,
        _global_maximum,
        _SPREAD,
        _SPREAD_REASON,
        "the largest value of the picture, in every cell",
    ),
    ClosedForm(
        "global-minimum",
        _case,
        _global_minimum,
        _SPREAD,
        _SPREAD_REASON.replace("maximum never falls", "minimum never rises").replace(
            "lift", "lower"
        ),
        "the smallest value of the picture, in every cell",
    ),
)
