"""Answers by a rule: at once, or again and again until nothing changes."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from cnnum.arrays import Floats, Shape
from cnnum.templating.checks.digital.form import SETTLED, digital_form
from cnnum.templating.checks.neighbourhoods import Bools, Held, covering, steered
from cnnum.templating.checks.parameters import choice, has, number, text
from cnnum.templating.checks.pictures import as_picture, binary
from cnnum.templating.checks.records import Case
from cnnum.templating.checks.rules.language import Neighbourhood, Rule, as_black, is_wide
from cnnum.templating.checks.rules.linear import SIDE, narrow_neighbourhoods
from cnnum.templating.template import Template

_TAKES = ("state", "white", "avoid", "pictures")
_EIGHT = ndimage.generate_binary_structure(2, 2)


def rectangles(rng: np.random.Generator, shape: Shape) -> Floats:
    """Return pictures of black rectangles at least two cells apart, many of them at the frame.

    The first picture is empty, and the second one a single rectangle, as large as the array has
    room for without its rim: what takes small things away leaves some of it.
    """
    pictures = np.zeros((12, *shape), dtype=np.bool_)
    pictures[(1, *(slice(1, -1) if n > 2 else slice(None) for n in shape))] = True
    for black in pictures[2:]:
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


def _states(
    template: Template, black: Bools, other: Bools, rng: np.random.Generator
) -> Floats | None:
    """Return initial states: none where the template has its own, another picture, or a part.

    "other" is unrelated to the input, and "part" is a part of its black cells. "outside" is black
    cells that the input leaves white, "changed" the input with a few black cells turned white.
    """
    if not has(template, "state"):
        return None
    kinds: Mapping[str, Bools] = {
        "other": other,
        "part": black & (rng.random(black.shape) < 0.6),
        "outside": ~black & other,
        "changed": black & (rng.random(black.shape) < 0.95),
    }
    return as_picture(choice(template, "state", kinds))


def _avoided(template: Template) -> Held | None:
    """Return what says where a template stands on the fence, None where it never does."""
    if not has(template, "avoid"):
        return None
    rule = Rule(template.name, text(template, "avoid"))

    def held(black: Bools) -> Bools:
        seen = Neighbourhood(black, template.input_boundary)
        return rule(seen, black, seen)

    return held


def _wave_case(template: Template, rng: np.random.Generator, shape: Shape) -> Case:
    """Draw pictures of several kinds for a rule that hands something on from cell to cell."""
    black = steered(rng, as_black(_draw(template, rng, shape)), _avoided(template))
    state = _states(template, black, rng.permutation(black), rng)
    white = number(template, "white") if has(template, "white") else -1.0
    return Case(input=np.where(black, 1.0, white), state=state)


def _local_case(template: Template, rng: np.random.Generator, shape: Shape) -> Case:
    """Draw every neighbourhood of 3×3 cells, under both states; of 5×5 the narrowest ones."""
    if is_wide(template):
        black = steered(rng, as_black(_draw(template, rng, shape)), _avoided(template))
        black = np.concatenate([black, _planted(template, rng, shape)])
    else:
        avoided = _avoided(template)
        black = as_black(covering(rng, shape, template.input_boundary, avoided))
    if not has(template, "state"):
        return Case(input=as_picture(black))
    other = rng.random(black.shape) < 0.5
    twice, others = np.concatenate([black, black]), np.concatenate([other, ~other])
    return Case(input=as_picture(twice), state=_states(template, twice, others, rng))


def _planted(template: Template, rng: np.random.Generator, shape: Shape) -> Bools:
    """Return pictures with a narrow decision each, of either colour, in the middle.

    Of each colour there are those that the template itself decides most narrowly, and those that
    random weights do. An array that holds no 5×5 cells, or a rule that is too tangled, has none.
    """
    if min(shape) < SIDE or template.inputs != 1:
        return np.zeros((0, *shape), dtype=np.bool_)
    found = narrow_neighbourhoods(template, rng)
    top, left = (shape[0] - SIDE) // 2, (shape[1] - SIDE) // 2
    at = np.s_[:, top : top + SIDE, left : left + SIDE]
    black, fixed = np.zeros((2, len(found), *shape), dtype=np.bool_)
    black[at], fixed[at] = found, True
    crowded = black | ((rng.random(black.shape) < 0.4) & ~fixed)
    avoided = _avoided(template)
    pictures = np.concatenate([steered(rng, each, avoided, fixed) for each in (black, crowded)])
    return pictures[np.any(pictures, axis=(-2, -1))]


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
        _local_case,
        _once,
        "cells whose neighbourhood in the input obeys a rule",
        needs=("rule",),
        takes=_TAKES,
    ),
    digital_form(
        "rule-until-still",
        _wave_case,
        _still,
        "a rule applied to the state again and again until nothing changes",
        needs=("rule",),
        takes=_TAKES,
        reason=SETTLED,
    ),
)
