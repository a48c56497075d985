"""Many templates of one form: the same boundary, output and neighbourhood, other weights."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike

from cnnum.arrays import Floats, finite, frozen
from cnnum.errors import TemplateError
from cnnum.safety.values import expect
from cnnum.templating.library import as_template
from cnnum.templating.numbers import numbers_of, with_numbers
from cnnum.templating.template import Template
from cnnum.values import ByContent

Parts = Mapping[str, Floats]
"""Numbers by their name: those of `numbers_of` but tables, and "tau" and "delay"."""

INNER = {"A": 4, "B": 4, "z": 1, "tau": 1, "delay": 0, "delayed": 4, "coupling": 2, "gain": 1}
"""Axes of a part that are not leading ones, by the first word of its name."""

OWN = ("A", "delayed", "coupling", "gain")
"""First words of parts whose numbers stand in the text of a kernel."""

LADDER = 2.0**0.5
"""Largest ratio of two delays that share a launch, and of rates that share a kernel."""

SEQUENCES = {"nonlinear": "coupling", "gains": "gain"}
"""Arguments of a batch that are sequences, and the first word of each part's name."""

Given = Mapping[str, ArrayLike | Sequence[ArrayLike | None] | None]


def inner(part: str) -> int:
    """Return the number of axes of a part that are not leading ones."""
    return INNER[part.split()[0]]


def parts_of(template: Template) -> Parts:
    """Return the numbers of a template by their name."""
    parts = {key: n for key, n in numbers_of(template).items() if not key.startswith("table")}
    parts["tau"] = template.tau
    if template.delayed is not None:
        parts["delay"] = np.asarray(template.delayed.delay, dtype=np.float64)
    return parts


def own_parts(parts: Parts) -> Parts:
    """Return the parts whose numbers stand in the text of a kernel, in their order."""
    return {key: part for key, part in parts.items() if key.split()[0] in OWN}


def stand_ins(template: Template) -> tuple[float, ...]:
    """Return the numbers of a template that stand for frames' own ones, in their order."""
    return tuple(
        number
        for part in own_parts(parts_of(template)).values()
        for number in part[part != 0.0].tolist()
    )


def with_parts(template: Template, parts: Parts) -> Template:
    """Return a template with other numbers."""
    changes: dict[str, Any] = {"tau": parts["tau"].tolist()}
    if template.delayed is not None:
        changes["delayed"] = replace(template.delayed, delay=float(parts["delay"]))
    return with_numbers(replace(template, **changes), parts)


def checked_parts(template: Template, given: Given) -> dict[str, Floats]:
    """Return the numbers of a batch: the given ones, and the template's where none are given.

    Parameters
    ----------
    template : Template
    given : mapping
        As `TemplateBatch` takes them.

    Raises
    ------
    TemplateError
        If the template has no such part, a shape does not fit, or a τ or delay is not positive.
    """
    named = _by_name(template, given)
    own = parts_of(template)
    for part in named.keys() - own.keys():
        raise TemplateError(
            f"A batch of '{template.name}' has no part '{part}': its template must have one."
        )
    result = {key: _checked(template, key, own[key], named.get(key)) for key in own}
    for part in result.keys() & {"tau", "delay"}:
        if (result[part] <= 0.0).any():
            raise TemplateError(f"A batch of '{template.name}' needs a {part} above 0.")
    return {key: frozen(value) for key, value in result.items()}


def _by_name(template: Template, given: Given) -> dict[str, ArrayLike]:
    """Return the given parts, each of a sequence by its own name."""
    result: dict[str, ArrayLike] = {}
    for part, value in given.items():
        if value is None or (part == "B" and not template.inputs and np.size(value) == 0):  # type: ignore[arg-type]
            continue
        if part not in SEQUENCES:
            result[part.replace("_", " ")] = cast(ArrayLike, value)
            continue
        count = len(getattr(template, part))
        if not isinstance(value, Sequence) or len(value) > count:
            raise TemplateError(
                f"'{part}' of a batch of '{template.name}' must be a sequence of arrays, at most "
                f"one for each of its {count}."
            )
        numbered = enumerate(cast("Sequence[ArrayLike | None]", value), 1)
        result |= {f"{SEQUENCES[part]} {n}": item for n, item in numbered if item is not None}
    return result


def _checked(template: Template, part: str, own: Floats, value: ArrayLike | None) -> Floats:
    if value is None:
        return np.asarray(own, dtype=np.float64)
    values = finite(f"{part} of a batch of '{template.name}'", value)
    if inner(part) == INNER["A"]:
        return _kernels(template, part, own, values)
    if part in ("z", "tau") and own.shape == (1,) and (values.ndim == 0 or values.shape[-1] != 1):
        return values[..., np.newaxis]
    if values.shape[values.ndim - own.ndim :] != own.shape:
        raise TemplateError(
            f"{part} of a batch of '{template.name}' must have the trailing axes {own.shape}, got "
            f"the shape {values.shape}."
        )
    return values


def _kernels(template: Template, part: str, own: Floats, values: Floats) -> Floats:
    couples = own.shape[:2]
    plain = 2 <= values.ndim < 4 or (values.ndim >= 4 and values.shape[-4:-2] != (1, 1))
    shape = values.shape
    if couples == (1, 1) and plain:
        values = values[..., np.newaxis, np.newaxis, :, :]
    sizes = values.shape[-4:]
    if len(sizes) < 4 or sizes[:2] != couples or sizes[-1] != sizes[-2] or sizes[-1] % 2 == 0:
        raise TemplateError(
            f"{part} of a batch of '{template.name}' must have the shape (..., k, k) with k odd, "
            f"for {couples} couplings, got the shape {shape}."
        )
    return values


@dataclass(frozen=True, slots=True, eq=False, init=False)
class TemplateBatch(ByContent):
    """Templates that differ only in their numbers, so that they run in one launch.

    The leading axes of the numbers broadcast with each other and, in a run, with those of its
    arrays: weights of shape (n, 1, k, k) and inputs of shape (m, rows, cols) make n × m runs.

    Parameters
    ----------
    template : Template or str
        A template, or the name of a template in the library. It supplies the numbers that are left
        out and everything else: boundaries, initial state, duration, output function, tables of
        nonlinear couplings, times of gains.
    A : (..., k, k) or (..., layers, layers, k, k) float, optional
    B : (..., k, k) or (..., layers, inputs, k, k) float, optional
    z, tau : (...) or (..., layers) float, optional
        Shape (...) for one layer.
    delay : (...) float, optional
        Delay of the delayed couplings, in the unit of tau.
    delayed_A, delayed_B : like `A` and `B`, optional
    nonlinear : sequence of ((..., k, k) float or None), optional
        Weights of the nonlinear couplings, in their order.
    gains : sequence of ((..., points) float or None), optional
        Values of the gains at the times of their tables, in their order.

    Attributes
    ----------
    template : Template
    parts : mapping of str to array
        All numbers by name, such as "A", "delayed A" and "gain 1", each with its own leading axes.
    lead : tuple of int
        Leading axes to which all numbers broadcast.

    Raises
    ------
    TemplateError
        If shapes do not fit, a τ or delay is not positive, or the template has no such part.
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
        """Return a batch of templates that differ only in their numbers.

        Raises
        ------
        TemplateError
            If there is no template, or the templates differ in more than their numbers.
        """
        expect("templates", templates, Sequence, TemplateError)
        if not templates:
            raise TemplateError("A batch needs at least one template, got none.")
        for template in templates:
            expect("templates", template, Template, TemplateError)
        first = templates[0]
        for other in templates[1:]:
            if _form(other) != _form(first):
                raise TemplateError(
                    f"A batch needs templates of one form, got '{first.name}' and '{other.name}': "
                    "boundary, initial state, duration, output, tables and sizes must be the "
                    "same."
                )
        all_parts = [parts_of(template) for template in templates]
        stacked = {key: np.stack([parts[key] for parts in all_parts]) for key in all_parts[0]}
        return _made(first, stacked, (len(templates),))

    def spread(self, axes: int = 1) -> TemplateBatch:
        """Return the same batch with more leading axes of length 1, for the arrays of a run."""
        flat = self.flat(self.lead)
        lead = (*self.lead, *(axes * (1,)))
        parts = {key: part.reshape(*lead, *part.shape[1:]) for key, part in flat.items()}
        return _made(self.template, parts, lead)

    @property
    def size(self) -> int:
        """Number of templates."""
        return math.prod(self.lead)

    def flat(self, lead: tuple[int, ...]) -> dict[str, Floats]:
        """Return the numbers of every run, for leading axes to which those of the batch broadcast.

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
        """Yield every template, the last leading axis varying fastest."""
        flat = self.flat(self.lead)
        for number in range(self.size):
            yield with_parts(self.template, {key: part[number] for key, part in flat.items()})

    def __repr__(self) -> str:
        return f"TemplateBatch('{self.template.name}', lead={self.lead})"


def _made(template: Template, parts: Parts, lead: tuple[int, ...]) -> TemplateBatch:
    """Return a batch of numbers that are known to fit."""
    template_batch = object.__new__(TemplateBatch)
    for key, value in (("template", template), ("parts", parts), ("lead", lead)):
        object.__setattr__(template_batch, key, value)
    return template_batch


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
