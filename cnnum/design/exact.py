"""Templates from the weights of a linear program."""

import math
from dataclasses import dataclass

import numpy as np

from cnnum.design.linear_program import Conflict, Weights, separate
from cnnum.design.local_rules import NINE, Table
from cnnum.errors import TemplateError
from cnnum.templating.template import Check, Initial, Template

HELD = 1.0
"""Of the own feedback above 1 where a cell need not keep its colour: it ends black or white."""

SPARE = 2.0
"""Run time over the longest that a cell of exact weights takes."""

SOURCE = "designed from its local rule by a linear program of the largest relative margin"


@dataclass(frozen=True, slots=True)
class Shape:
    """All of a template that a rule does not say.

    Attributes
    ----------
    name, description : str
    boundary : float or str
    initial : float or "input"
    margin : float
        Least drive of a cell that decides; all weights scale with it.
    check : Check or None
    """

    name: str
    description: str = ""
    boundary: float | str = -1.0
    initial: Initial = 0.0
    margin: float = 1.0
    check: Check | None = None


def design(table: Table, shape: Shape) -> tuple[Template, Weights]:
    """Return the template of the largest relative margin for a local rule, and its weights.

    Raises
    ------
    TemplateError
        If no single template obeys the rule; the sentence says why.
    """
    found = separate(table)
    if isinstance(found, Conflict):
        raise TemplateError(
            f"No single template does '{shape.name}': {found.why}. Split it into a sequence with "
            "split = true, or look at more of the array."
        )
    return as_template(found, shape), found


def as_template(weights: Weights, shape: Shape) -> Template:
    """Return the template of weights; it rests after a run of its duration."""
    scale = shape.margin
    coupled = any(seen.source == "y" for seen in weights.seen)
    feedback, control = (
        scale * np.array([weights.of(source, *place) for place in NINE]).reshape(3, 3)
        for source in ("y", "u")
    )
    before = scale * weights.of("before")
    feedback[1, 1] += 1.0 + (0.0 if coupled else before or HELD)
    return Template(
        shape.name,
        feedback,
        control if control.any() or not coupled else None,
        scale * weights.bias,
        boundary=shape.boundary,
        initial=shape.initial,
        duration="settle" if coupled else _duration(scale, before),
        description=shape.description,
        source=SOURCE,
        check=shape.check,
    )


def settle_bound(margin: float, before: float) -> float:
    """Return the longest time until a cell is black or white, in time constants.

    Within the linear range dx/dt = k x + w, with k = a − 1: from x = 0 the drive w ≥ margin takes
    ln(1 + k/w)/k to 1. From the rail of the other colour, where the rate is the margin, it takes
    ln(1 + 2k/margin)/k.
    """
    k = before or HELD
    return math.log1p((2.0 if before else 1.0) * k / margin) / k


def duration_from_rails(margin: float) -> float:
    """Return a duration after which cells that start black or white do not matter any more.

    From the rail of the other colour, dx/dt = k x + w with w ≥ margin takes ln((w + k)/(w − k))/k
    to the rail of its own.
    """
    passed = math.log((margin + HELD) / (margin - HELD)) / HELD
    return max(1.0, math.ceil(10.0 * SPARE * passed) / 10.0)


def _duration(margin: float, before: float) -> float:
    # a state beyond ±1 after it does not matter: the output is black or white
    return max(1.0, math.ceil(10.0 * SPARE * settle_bound(margin, before)) / 10.0)
