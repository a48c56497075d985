"""Answers cell by cell: logic of two pictures, shifts by one cell, thresholds."""

from collections.abc import Callable, Mapping

import numpy as np
from scipy import ndimage

from cnnum.arrays import Floats, Shape
from cnnum.templating.checks.analytic.operators import neighbours
from cnnum.templating.checks.digital.form import digital_form
from cnnum.templating.checks.digital.neighbourhood import Bools, local
from cnnum.templating.checks.parameters import choice, number
from cnnum.templating.checks.pictures import (
    as_picture,
    every_neighbourhood,
    every_pair,
    gray,
    with_even,
)
from cnnum.templating.checks.records import Case
from cnnum.templating.template import Template

MARGIN = 0.05
"""Gray values keep this far from the threshold: a cell on it stays there for ever."""

_LOGIC: Mapping[str, Callable[[Bools, Bools], Bools]] = {
    "and": np.logical_and,
    "or": np.logical_or,
    "state and not input": lambda u, x: x & ~u,
    "state or not input": lambda u, x: x | ~u,
    "not input": lambda u, x: ~u,
}
_RING = [(down, east) for down in (-1, 0, 1) for east in (-1, 0, 1) if (down, east) != (0, 0)]
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
    ring = sum(at(down, east) for down, east in _RING)
    return as_picture(8.0 * case.pictures - ring > number(template, "threshold"))


FORMS = (
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
