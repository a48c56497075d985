"""The numbers of a batch of templates: arrays with leading axes, checked against one template."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike

from cnnum.arrays import Floats, finite, frozen
from cnnum.errors import TemplateError
from cnnum.templating.numbers import numbers_of, with_numbers
from cnnum.templating.template import Template

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
    found = {key: n for key, n in numbers_of(template).items() if not key.startswith("table")}
    found["tau"] = template.tau
    if template.delayed is not None:
        found["delay"] = np.asarray(template.delayed.delay, dtype=np.float64)
    return found


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
    asked = _by_name(template, given)
    own = parts_of(template)
    for part in asked.keys() - own.keys():
        raise TemplateError(
            f"A batch of '{template.name}' has no part '{part}': its template must have it, too."
        )
    found = {key: _checked(template, key, own[key], asked.get(key)) for key in own}
    for part in found.keys() & {"tau", "delay"}:
        if (found[part] <= 0.0).any():
            raise TemplateError(f"A batch of '{template.name}' needs a {part} above 0.")
    return {key: frozen(value) for key, value in found.items()}


def _by_name(template: Template, given: Given) -> dict[str, ArrayLike]:
    """Return the given parts, each of a sequence by its own name."""
    found: dict[str, ArrayLike] = {}
    for part, value in given.items():
        if value is None or (part == "B" and not template.inputs and np.size(value) == 0):  # type: ignore[arg-type]
            continue
        if part not in SEQUENCES:
            found[part.replace("_", " ")] = cast(ArrayLike, value)
            continue
        count = len(getattr(template, part))
        if not isinstance(value, Sequence) or len(value) > count:
            raise TemplateError(
                f"'{part}' of a batch of '{template.name}' is a sequence of arrays, one for each "
                f"of its {count}."
            )
        each = enumerate(cast("Sequence[ArrayLike | None]", value), 1)
        found |= {f"{SEQUENCES[part]} {n}": one for n, one in each if one is not None}
    return found


def _checked(template: Template, part: str, own: Floats, value: ArrayLike | None) -> Floats:
    if value is None:
        return np.asarray(own, dtype=np.float64)
    found = finite(f"{part} of a batch of '{template.name}'", value)
    if inner(part) == INNER["A"]:
        return _kernels(template, part, own, found)
    if part in ("z", "tau") and own.shape == (1,) and (found.ndim == 0 or found.shape[-1] != 1):
        return found[..., np.newaxis]
    if found.shape[found.ndim - own.ndim :] != own.shape:
        raise TemplateError(
            f"{part} of a batch of '{template.name}' must have the last axes {own.shape}, got the "
            f"shape {found.shape}."
        )
    return found


def _kernels(template: Template, part: str, own: Floats, found: Floats) -> Floats:
    couples = own.shape[:2]
    plain = 2 <= found.ndim < 4 or (found.ndim >= 4 and found.shape[-4:-2] != (1, 1))
    shape = found.shape
    if couples == (1, 1) and plain:
        found = found[..., np.newaxis, np.newaxis, :, :]
    sizes = found.shape[-4:]
    if len(sizes) < 4 or sizes[:2] != couples or sizes[-1] != sizes[-2] or sizes[-1] % 2 == 0:
        raise TemplateError(
            f"{part} of a batch of '{template.name}' must be (..., k, k) with k odd, for {couples} "
            f"couplings, got the shape {shape}."
        )
    return found
