"""Answers that compare a picture with that of a delay ago."""

import numpy as np
from scipy import ndimage

from cnnum.arrays import Floats, Shape
from cnnum.templating.checks.digital.form import digital_form
from cnnum.templating.checks.parameters import number
from cnnum.templating.checks.pictures import as_picture, binary
from cnnum.templating.checks.records import Case
from cnnum.templating.template import Template

_NINE = np.ones((1, 3, 3), dtype=np.int64)
_RING = np.array([[[1, 1, 1], [1, 0, 1], [1, 1, 1]]])
_CROSS = ndimage.generate_binary_structure(2, 1)[np.newaxis]


def _shifted_east(pictures: Floats) -> Floats:
    moved = np.full_like(pictures, -1.0)
    moved[..., 1:] = pictures[..., :-1]
    return moved


def _moving(template: Template, rng: np.random.Generator, shape: Shape) -> Case:
    """Draw objects on every second row; most move one cell east.

    Lines on their own have few black neighbours; in wide objects the outputs would be gray.
    """
    lines = np.arange(shape[0])[:, np.newaxis] % 2 == 0
    before = np.where(lines, binary(rng, shape), -1.0)
    other = np.where(lines, rng.permutation(before), -1.0)
    kept = rng.random(before.shape) < 0.7
    return Case(input=np.where(kept, _shifted_east(before), other), previous=before)


def _moved(template: Template, case: Case) -> Floats:
    """Return the states: present plus past, less the inhibition by the answer's neighbours."""
    both = case.pictures + _shifted_east(case.before)
    answer = as_picture(both > 0)
    around = ndimage.correlate(answer, _RING.astype(np.float64), mode="constant", cval=-1.0)
    weight, taken = number(template, "weight"), number(template, "inhibition")
    return np.asarray(weight * both + number(template, "bias") - taken * around, dtype=np.float64)


def _overlapping(template: Template, rng: np.random.Generator, shape: Shape) -> Case:
    """Draw the picture of a delay ago as the state, and a picture that partly keeps it."""
    before = binary(rng, shape)
    kept = rng.random(before.shape) < 0.6
    return Case(input=np.where(kept, before, rng.permutation(before)), state=before)


def _kept(template: Template, case: Case) -> Floats:
    around = ndimage.correlate((case.states > 0).astype(np.int64), _NINE, mode="constant")
    return as_picture((case.pictures > 0) & (around >= number(template, "least")))


def _appearing(template: Template, rng: np.random.Generator, shape: Shape) -> Case:
    before = binary(rng, shape)
    kept = rng.random(before.shape) < 0.4
    after = rng.permutation(binary(rng, shape))
    return Case(input=np.where(kept, before, after), previous=before)


def _appeared(template: Template, case: Case) -> Floats:
    now, before = case.pictures > 0, case.before > 0
    gained = now.astype(np.int64) - before.astype(np.int64)
    around = ndimage.correlate(gained, _RING, mode="constant")
    return as_picture((gained > 0) & (around >= number(template, "least")))


def _seeds(template: Template, rng: np.random.Generator, shape: Shape) -> Case:
    """Draw a few black cells each, and none in the last picture."""
    chances = np.array([0.03, 0.06, 0.12, 0.0])[:, np.newaxis, np.newaxis]
    return Case(input=as_picture(rng.random((4, *shape)) < chances))


def _grown(template: Template, case: Case) -> Floats:
    times = int(number(template, "steps"))
    return as_picture(ndimage.binary_dilation(case.pictures > 0, _CROSS, iterations=times))


def _travelling(template: Template, rng: np.random.Generator, shape: Shape) -> Case:
    """Draw the present picture as the input and in the first layer, and a path in the second."""
    now = binary(rng, shape)
    return Case(input=now, state=np.stack([now, rng.permutation(now)], axis=1))


def _path(template: Template, case: Case) -> Floats:
    now = case.pictures > 0
    return np.stack([as_picture(now), as_picture(now | (case.states[:, 1] > 0))], axis=1)


FORMS = (
    digital_form(
        "moved-east",
        _moving,
        _moved,
        "above 0 where a cell is black and its western neighbour was",
        ("weight", "inhibition", "bias"),
        compares="state",
    ),
    digital_form(
        "kept",
        _overlapping,
        _kept,
        "black cells with a number of black ones in their 3×3 neighbourhood a delay ago",
        ("least",),
    ),
    digital_form(
        "appeared",
        _appearing,
        _appeared,
        "cells that turned black while around them a number more appeared than vanished",
        ("least",),
    ),
    digital_form(
        "path", _travelling, _path, "the picture, and all that it or the path up to now covers"
    ),
    digital_form(
        "delayed-wave",
        _seeds,
        _grown,
        "black regions grown by one cell for each delay that began",
        ("steps",),
    ),
)
