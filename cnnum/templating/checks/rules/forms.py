"""Answers by a rule: at once, or again and again until nothing changes."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from cnnum.arrays import Floats, Shape
from cnnum.templating.checks.digital.form import SETTLED, digital_form
from cnnum.templating.checks.parameters import choice, has, number, text
from cnnum.templating.checks.pictures import as_picture, binary
from cnnum.templating.checks.records import Case
from cnnum.templating.checks.rules.language import Neighbourhood, Rule, as_black
from cnnum.templating.template import Template

_TRIES = 400
_SQUARE = np.ones((1, 5, 5), dtype=bool)
_TAKES = ("state", "white", "avoid", "pictures")
_EIGHT = ndimage.generate_binary_structure(2, 2)


def rectangles(rng: np.random.Generator, shape: Shape) -> Floats:
    """Return pictures of black rectangles at least two cells apart, many of them at the frame."""
    pictures = np.zeros((12, *shape), dtype=np.bool_)
    for black in pictures[1:]:
        for _ in range(rng.integers(2, 9)):
            # Single cells up to squares that outlast a template which removes small things.
            height, width = (int(rng.integers(1, max(n - 1, 2))) for n in shape)
            top, left = (int(rng.integers(0, n)) for n in shape)
            block = np.zeros(shape, dtype=np.bool_)
            block[top : top + height, left : left + width] = True
            near = ndimage.binary_dilation(block, _EIGHT, iterations=2)
            if not (near & black).any():
                black |= block
    return as_picture(pictures)


_PICTURES = {"any": binary, "rectangles": rectangles}


def _draw(template: Template, rng: np.random.Generator, shape: Shape) -> Floats:
    drawn = choice(template, "pictures", _PICTURES) if has(template, "pictures") else binary
    return drawn(rng, shape)


def _states(template: Template, pictures: Floats, rng: np.random.Generator) -> Floats | None:
    """Return initial states: none where the template has its own, another picture, or a part.

    "other" is unrelated to the input, and "part" is a part of its black cells. "outside" is black
    cells that the input leaves white, "changed" the input with a few black cells turned white.
    """
    if not has(template, "state"):
        return None
    other, black = as_black(rng.permutation(pictures)), as_black(pictures)
    kinds: Mapping[str, NDArray[np.bool_]] = {
        "other": other,
        "part": black & (rng.random(black.shape) < 0.6),
        "outside": ~black & other,
        "changed": black & (rng.random(black.shape) < 0.95),
    }
    return as_picture(choice(template, "state", kinds))


def _steered(template: Template, rng: np.random.Generator, pictures: Floats, avoid: str) -> Floats:
    """Return pictures without the neighbourhoods in which a template stands on the fence."""
    rule = Rule(template.name, avoid)
    near = _near(rule, template, pictures)
    for _ in range(_TRIES):
        if not near.any():
            return pictures
        flip = near & (rng.random(pictures.shape) < 0.15)
        pictures = np.where(flip, -pictures, pictures)
        near = _near(rule, template, pictures)
    unclean = np.any(near, axis=(-2, -1), keepdims=True)
    return np.where(unclean, -1.0, pictures)


def _near(rule: Rule, template: Template, pictures: Floats) -> NDArray[np.bool_]:
    """Return the cells that a neighbourhood of the rule reaches."""
    black = as_black(pictures)
    seen = Neighbourhood(black, template.input_boundary)
    return np.asarray(ndimage.binary_dilation(rule(seen, black, seen), _SQUARE), dtype=np.bool_)


def _case(template: Template, rng: np.random.Generator, shape: Shape) -> Case:
    pictures = _draw(template, rng, shape)
    if has(template, "avoid"):
        pictures = _steered(template, rng, pictures, text(template, "avoid"))
    state = _states(template, pictures, rng)
    if has(template, "white"):
        pictures = np.where(pictures > 0, 1.0, number(template, "white"))
    return Case(input=pictures, state=state)


def _once(template: Template, case: Case) -> Floats:
    rule = Rule(template.name, text(template, "rule"))
    inputs = Neighbourhood(as_black(case.pictures), template.input_boundary)
    before = inputs.at(0, 0) if case.state is None else as_black(case.state)
    return as_picture(rule(inputs, before, inputs))


def until_still(
    rule: Rule, start: NDArray[np.bool_], inputs: Neighbourhood, template: Template
) -> NDArray[np.bool_]:
    """Return cells to which a rule was applied, to all at once, until none changed.

    Raises
    ------
    RuntimeError
        If they never come to rest.
    """
    cells = start
    for _ in range(start.size + 1):
        following = rule(Neighbourhood(cells, template.boundary), start, inputs)
        if (following == cells).all():
            return cells
        cells = following
    raise RuntimeError(f"The rule '{rule.text}' never comes to rest.")


def _still(template: Template, case: Case) -> Floats:
    rule = Rule(template.name, text(template, "rule"))
    inputs = Neighbourhood(as_black(case.pictures), template.input_boundary)
    start = np.asarray(case.start(template), dtype=np.float64)
    black = np.broadcast_to(as_black(start), case.pictures.shape)
    return as_picture(until_still(rule, black, inputs, template))


FORMS = (
    digital_form(
        "rule",
        _case,
        _once,
        "cells whose neighbourhood in the input obeys a rule",
        needs=("rule",),
        takes=_TAKES,
    ),
    digital_form(
        "rule-until-still",
        _case,
        _still,
        "a rule applied to the state again and again until nothing changes",
        needs=("rule",),
        takes=_TAKES,
        reason=SETTLED,
    ),
)
