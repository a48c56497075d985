"""Many templates of one form: the same boundary, output and neighbourhood, other weights."""

from __future__ import annotations  # signatures that `help` shows as they are written

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from cnnum.arrays import Floats
from cnnum.errors import TemplateError
from cnnum.safety.values import expect
from cnnum.templating.batch_parts import Parts, checked_parts, inner, parts_of, with_parts
from cnnum.templating.library import as_template
from cnnum.templating.template import Template
from cnnum.values import ByContent


@dataclass(frozen=True, slots=True, eq=False, init=False)
class TemplateBatch(ByContent):
    """Templates that differ only in their numbers, so that they run in one launch.

    Leading axes of the numbers broadcast with each other, and in a run with those of its arrays:
    weights of (n, 1, k, k) and inputs of (m, rows, cols) are n × m runs.

    Parameters
    ----------
    template : Template or str
        A template, or the name of one of the library. It supplies the numbers that are left out
        and everything else: boundaries, initial state, duration, output, tables of nonlinear
        couplings, times of gains.
    A : (..., k, k) or (..., layers, layers, k, k) float, optional
    B : (..., k, k) or (..., layers, inputs, k, k) float, optional
    z, tau : (...) or (..., layers) float, optional
        Shape (...) for one layer.
    delay : (...) float, optional
        Delay of the delayed couplings, in the unit of tau.
    delayed_A, delayed_B : like `A` and `B`, optional
    nonlinear : sequence of ((..., k, k) float or None), optional
        Weights of each nonlinear coupling, in their order.
    gains : sequence of ((..., points) float or None), optional
        Values of each gain at the times of its table, in their order.

    Attributes
    ----------
    template : Template
    parts : mapping of str to array
        All numbers by their name, such as "A", "delayed A" and "gain 1", each with its own leading
        axes.
    lead : tuple of int
        The leading axes that all numbers broadcast to.

    Raises
    ------
    TemplateError
        If shapes do not fit, a τ or delay is not positive, or the template lacks such a part.
    """

    template: Template
    parts: Parts
    lead: tuple[int, ...]

    def __init__(
        self,
        template: Template | str,
        A: ArrayLike | None = None,
        B: ArrayLike | None = None,
        z: ArrayLike | None = None,
        tau: ArrayLike | None = None,
        *,
        delay: ArrayLike | None = None,
        delayed_A: ArrayLike | None = None,
        delayed_B: ArrayLike | None = None,
        nonlinear: Sequence[ArrayLike | None] | None = None,
        gains: Sequence[ArrayLike | None] | None = None,
    ) -> None:
        template = as_template(template)
        given = {"A": A, "B": B, "z": z, "tau": tau, "delay": delay, "delayed_A": delayed_A,
                 "delayed_B": delayed_B, "nonlinear": nonlinear, "gains": gains}  # fmt: skip
        parts = checked_parts(template, given)
        leads = {key: part.shape[: part.ndim - inner(key)] for key, part in parts.items()}
        try:
            lead = np.broadcast_shapes(*leads.values())
        except ValueError:
            raise TemplateError(
                f"A batch of '{template.name}' needs weights whose leading axes broadcast, got "
                f"{leads}."
            ) from None
        if 0 in lead:
            raise TemplateError(f"A batch of '{template.name}' needs at least one template.")
        object.__setattr__(self, "template", template)
        object.__setattr__(self, "parts", parts)
        object.__setattr__(self, "lead", lead)

    @classmethod
    def of(cls, templates: Sequence[Template]) -> TemplateBatch:
        """Return the batch of templates that differ in their numbers alone.

        Raises
        ------
        TemplateError
            If there is none, or they differ in more than their numbers.
        """
        expect("templates", templates, Sequence, TemplateError)
        if not templates:
            raise TemplateError("A batch needs at least one template, got none.")
        for one in templates:
            expect("templates", one, Template, TemplateError)
        first = templates[0]
        for other in templates[1:]:
            if _form(other) != _form(first):
                raise TemplateError(
                    f"A batch needs templates of one form, got '{first.name}' and '{other.name}': "
                    "boundary, start, duration, output, tables and sizes must be the same."
                )
        each = [parts_of(one) for one in templates]
        stacked = {key: np.stack([parts[key] for parts in each]) for key in each[0]}
        return _made(first, stacked, (len(templates),))

    def spread(self, axes: int = 1) -> TemplateBatch:
        """Return the same with more leading axes of length 1: a run has its arrays there."""
        flat = self.flat(self.lead)
        lead = (*self.lead, *(axes * (1,)))
        parts = {key: part.reshape(*lead, *part.shape[1:]) for key, part in flat.items()}
        return _made(self.template, parts, lead)

    @property
    def size(self) -> int:
        """Number of templates."""
        return math.prod(self.lead)

    def flat(self, lead: tuple[int, ...]) -> dict[str, Floats]:
        """Return the numbers of every run of a batch that the weights broadcast to.

        Returns
        -------
        dict of str to (n, ...) float
            "A" is (n, layers, layers, k, k), "z" is (n, layers), and so on.
        """

        def all_of(name: str, part: Floats) -> Floats:
            own = part.shape[part.ndim - inner(name) :]
            return np.broadcast_to(part, (*lead, *own)).reshape(math.prod(lead), *own)

        return {name: all_of(name, part) for name, part in self.parts.items()}

    def templates(self) -> Iterator[Template]:
        """Yield every template, the last leading axis first."""
        flat = self.flat(self.lead)
        for number in range(self.size):
            yield with_parts(self.template, {key: part[number] for key, part in flat.items()})

    def __repr__(self) -> str:
        return f"TemplateBatch('{self.template.name}', lead={self.lead})"


def _made(template: Template, parts: Parts, lead: tuple[int, ...]) -> TemplateBatch:
    """Return a batch of numbers that are known to fit."""
    found = object.__new__(TemplateBatch)
    for key, value in (("template", template), ("parts", parts), ("lead", lead)):
        object.__setattr__(found, key, value)
    return found


def _form(template: Template) -> tuple[object, ...]:
    """Return all of a template that is not a number of a batch."""
    delayed, one = template.delayed, np.ones((1, 1))
    return (
        template.A.shape,
        template.B.shape,
        template.boundary,
        template.input_boundary,
        template.initial,
        template.duration,
        template.output.name,
        None if delayed is None else (delayed.A.shape, delayed.B.shape),
        *((c.weights.shape, replace(c, weights=one).physics[1:]) for c in template.nonlinear),
        *((g.to, g.source, g.table.interpolation, _places(g.table.points)) for g in template.gains),
    )


def _places(points: Sequence[tuple[float, float]]) -> tuple[float, ...]:
    return tuple(place for place, _ in points)
