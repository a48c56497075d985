"""Answers of a cell's own neighbourhood: rules, differences and ranks."""

from collections.abc import Callable, Mapping
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from cnnum.arrays import Floats, Shape
from cnnum.errors import TemplateError
from cnnum.templating.boundary import Boundary
from cnnum.templating.checks.analytic.linear import ANALOG_REASON, ANALOG_TOLERANCE, neighbours
from cnnum.templating.checks.pictures import (
    as_picture,
    every_neighbourhood,
    every_pair,
    gray,
    with_even,
)
from cnnum.templating.checks.records import (
    DIGITAL_TOLERANCE,
    Case,
    Cases,
    ClosedForm,
    choice,
    has,
    number,
    text,
)
from cnnum.templating.template import Template

DECIDED = (
    "a template that does not propagate runs for five time constants: a decided cell has then come "
    "within e^-5 = 0.7 % of black or white; a wrong cell is off by 2"
)
SETTLED = (
    "cells settle outside [-1, 1], where the output is exactly black or white; a wrong cell is off "
    "by 2"
)
DISCRETE = "discrete time with outputs of -1 and 1 is exact; a wrong cell is off by 2"


def digital_form(
    name: str,
    cases: Cases,
    expected: Callable[[Template, Case], Floats],
    summary: str,
    needs: tuple[str, ...] = (),
    takes: tuple[str, ...] = (),
    *,
    reason: str = DECIDED,
    compares: Literal["output", "state"] = "output",
) -> ClosedForm:
    """Return a closed form with the digital tolerance; `reason` says why it is not smaller."""
    return ClosedForm(
        name, cases, expected, DIGITAL_TOLERANCE, reason, summary, needs, takes, compares
    )


Bools = NDArray[np.bool_]

_SQUARE = np.ones((3, 3), dtype=bool)
_RING = np.array([[1, 1, 1], [1, 0, 1], [1, 1, 1]])
_SYMBOLS = {"#": "black", "o": "white", ".": "any"}


def pattern(template: Template, name: str) -> NDArray[np.str_]:
    """Return a 3×3 pattern of '#' (black), 'o' (white) and '.' (any), rows parted by '/'.

    Raises
    ------
    TemplateError
        If the parameter is something else.
    """
    rows = text(template, name).split("/")
    cells = [list(row) for row in rows]
    if [len(row) for row in cells] != [3, 3, 3] or {*"".join(rows)} - _SYMBOLS.keys():
        raise TemplateError(
            f"Template '{template.name}': the parameter '{name}' of its check must be three rows "
            f"of '#', 'o' and '.', separated by '/', got '{text(template, name)}'."
        )
    return np.array(cells)


def local(operation: Callable[[Bools], Bools], picture: Floats, boundary: Boundary) -> Bools:
    """Apply an operation of radius 1 to pictures whose rim of virtual cells is as the boundary's.

    Raises
    ------
    TemplateError
        If a fixed boundary is neither black nor white.
    """
    if boundary.constant not in (None, -1.0, 1.0):
        raise TemplateError(
            f"A black-and-white check needs a boundary of -1, 1, 'zero-flux' or 'periodic', "
            f"got {boundary}."
        )
    rim = [(0, 0), (1, 1), (1, 1)]
    if boundary.constant is None:
        padded = np.pad(picture, rim, mode=boundary.pad_mode)
    else:
        padded = np.pad(picture, rim, constant_values=boundary.constant)
    answers = [operation(cells)[1:-1, 1:-1] for cells in padded > 0]
    return np.stack(answers)


def _local_answer(template: Template, case: Case, operation: Callable[[Bools], Bools]) -> Floats:
    return as_picture(local(operation, case.pictures, template.input_boundary))


def _erosion(template: Template, case: Case) -> Floats:
    element = pattern(template, "element") == "#"
    return _local_answer(template, case, lambda p: ndimage.binary_erosion(p, element))


def _dilation(template: Template, case: Case) -> Floats:
    # A cell turns black if the element, laid on it, hits; scipy lays the reflected one.
    element = (pattern(template, "element") == "#")[::-1, ::-1]
    return _local_answer(template, case, lambda p: ndimage.binary_dilation(p, element))


def _edge(template: Template, case: Case) -> Floats:
    return _local_answer(template, case, lambda p: p & ~ndimage.binary_erosion(p, _SQUARE))


def _hit_or_miss(template: Template, case: Case) -> Floats:
    wanted = pattern(template, "pattern")
    return _local_answer(
        template, case, lambda p: ndimage.binary_hit_or_miss(p, wanted == "#", wanted == "o")
    )


def _thinning(template: Template, case: Case) -> Floats:
    patterns = [pattern(template, name) for name in ("pattern", "or") if has(template, name)]

    def operation(cells: Bools) -> Bools:
        hits = [ndimage.binary_hit_or_miss(cells, p == "#", p == "o") for p in patterns]
        return np.asarray(cells & ~np.any(hits, axis=0), dtype=np.bool_)

    return _local_answer(template, case, operation)


def _black_with_neighbours(template: Template, case: Case) -> Floats:
    least, most = number(template, "least", 0), number(template, "most", 8)

    def operation(cells: Bools) -> Bools:
        black = ndimage.correlate(cells.astype(np.int64), _RING, mode="constant")
        return cells & (black >= least) & (black <= most)

    return _local_answer(template, case, operation)


NEIGHBOURHOOD_FORMS = (
    digital_form(
        "edge", every_neighbourhood, _edge, "black cells that the erosion by a 3×3 square removes"
    ),
    digital_form(
        "erosion", every_neighbourhood, _erosion, "binary erosion by the element", ("element",)
    ),
    digital_form(
        "dilation",
        every_neighbourhood,
        _dilation,
        "binary dilation by the reflected element",
        ("element",),
    ),
    digital_form(
        "thinning",
        every_neighbourhood,
        _thinning,
        "black cells but for those whose neighbourhood is the one pattern or the other",
        ("pattern",),
        ("or",),
    ),
    digital_form(
        "hit-or-miss",
        every_neighbourhood,
        _hit_or_miss,
        "cells whose neighbourhood is the pattern",
        ("pattern",),
    ),
    digital_form(
        "neighbour-count",
        every_neighbourhood,
        _black_with_neighbours,
        "black cells with a number of black ones among their eight neighbours",
        takes=("least", "most"),
    ),
)


MARGIN = 0.05
"""Gray values keep this far from the threshold: a cell on it stays there for ever."""

_LOGIC: Mapping[str, Callable[[Bools, Bools], Bools]] = {
    "and": np.logical_and,
    "or": np.logical_or,
    "state and not input": lambda u, x: x & ~u,
    "state or not input": lambda u, x: x | ~u,
    "not input": lambda u, x: ~u,
}
_POINTWISE_RING = [
    (down, east) for down in (-1, 0, 1) for east in (-1, 0, 1) if (down, east) != (0, 0)
]
_OFFSETS = {"east": (0, 1), "west": (0, -1), "south": (1, 0), "north": (-1, 0)} | {
    "north-east": (-1, 1),
    "north-west": (-1, -1),
    "south-east": (1, 1),
    "south-west": (1, -1),
}


def _logic(template: Template, case: Case) -> Floats:
    operation = choice(template, "operation", _LOGIC)
    return as_picture(operation(case.pictures > 0, case.states > 0))


def _shift(template: Template, case: Case) -> Floats:
    offset = choice(template, "direction", _OFFSETS)
    return as_picture(
        local(lambda cells: np.roll(cells, offset, (0, 1)), case.pictures, template.input_boundary)
    )


def _away_from_threshold(template: Template, rng: np.random.Generator, shape: Shape) -> Case:
    threshold = number(template, "threshold")
    picture = gray(rng, shape)
    near = np.abs(picture - threshold) < MARGIN
    side = np.where(picture > threshold, MARGIN, -MARGIN)
    return Case(input=np.where(near, threshold + side, picture))


def _threshold(template: Template, case: Case) -> Floats:
    return as_picture(case.pictures > number(template, "threshold"))


def _beside_levels(template: Template, rng: np.random.Generator, shape: Shape) -> Case:
    """Draw gray inputs away from both levels of a latch, and its state before."""
    level = number(template, "level")
    picture = gray(rng, shape)
    near = np.abs(np.abs(picture) - level) < MARGIN
    moved = np.copysign(level + np.copysign(MARGIN, np.abs(picture) - level), picture)
    before = as_picture(rng.random(picture.shape) < 0.5)
    return Case(input=np.where(near, moved, picture), state=before)


def _latch(template: Template, case: Case) -> Floats:
    level = number(template, "level")
    turned = np.abs(case.pictures) > level
    return np.where(turned, as_picture(case.pictures > 0.0), case.states)


def _five_levels(template: Template, rng: np.random.Generator, shape: Shape) -> Case:
    """Draw gray levels in steps of 0.4, so that no sum of them comes nearer to ±0.5 than 0.1."""
    noise = rng.integers(-2, 3, (4, *shape))
    smooth = ndimage.gaussian_filter(noise.astype(np.float64), (0, 1, 1), mode="reflect")
    steps = np.concatenate([noise, np.clip(np.rint(2.0 * smooth), -2, 2)])
    return Case(input=with_even(np.asarray(0.4 * steps, dtype=np.float64), -0.8))


def _gray_edge(template: Template, case: Case) -> Floats:
    at = neighbours(case.pictures, template.input_boundary)
    ring = sum(at(down, east) for down, east in _POINTWISE_RING)
    return as_picture(8.0 * case.pictures - ring > number(template, "threshold"))


POINTWISE_FORMS = (
    digital_form(
        "logic", every_pair, _logic, "a Boolean function of input and state", ("operation",)
    ),
    digital_form(
        "shift", every_neighbourhood, _shift, "the picture, one cell further", ("direction",)
    ),
    digital_form(
        "threshold",
        _away_from_threshold,
        _threshold,
        "cells above the threshold, for gray values at least 0.05 from it",
        ("threshold",),
    ),
    digital_form(
        "latch",
        _beside_levels,
        _latch,
        "black above the level, white below its negative, else its value before",
        ("level",),
    ),
    digital_form(
        "gray-edge",
        _five_levels,
        _gray_edge,
        "cells whose eight differences to their neighbours sum to more than the threshold",
        ("threshold",),
    ),
)


_DIFFERENCES_RING = [
    (down, east) for down in (-1, 0, 1) for east in (-1, 0, 1) if (down, east) != (0, 0)
]


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
    return np.stack([case.pictures - at(down, east) for down, east in _DIFFERENCES_RING])


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
    beyond, gaps = number(template, "threshold"), differences(template, case)
    lead = (gaps > beyond).sum(axis=0) - (gaps < -beyond).sum(axis=0)
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


DIFFERENCES_FORMS = (
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
    result = ndimage.median_filter(picture, _SIZE, mode=mode, cval=boundary.constant or 0.0)
    return np.asarray(result, dtype=np.float64)


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


RANKS_FORMS = (
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

FORMS = (*NEIGHBOURHOOD_FORMS, *POINTWISE_FORMS, *DIFFERENCES_FORMS, *RANKS_FORMS)
