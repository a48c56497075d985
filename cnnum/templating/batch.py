"""Many templates of one form: the same boundary, output and neighbourhood, other weights."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from cnnum.arrays import Floats, finite, frozen
from cnnum.errors import TemplateError
from cnnum.safety.values import expect
from cnnum.templating.template import Template


@dataclass(frozen=True, slots=True, eq=False, init=False)
class TemplateBatch:
    """Templates that differ in their numbers alone, so that a run of all is one launch.

    Leading axes of the numbers broadcast with each other, and in a run with those of its arrays:
    weights of (n, 1, k, k) and inputs of (m, rows, cols) are n × m runs.

    Parameters
    ----------
    template : Template
        Gives the numbers that are left out, and all that is no weight: boundaries, start, duration,
        output. Its couplings are linear, at once and constant in time.
    A : (..., k, k) or (..., layers, layers, k, k) float, optional
    B : (..., k, k) or (..., layers, inputs, k, k) float, optional
    z, tau : (...) or (..., layers) float, optional
        Of one layer (...).

    Raises
    ------
    TemplateError
        If shapes do not fit, a τ is not positive, or the template has other couplings.
    """

    template: Template
    A: Floats
    B: Floats
    z: Floats
    tau: Floats
    lead: tuple[int, ...]

    def __init__(
        self,
        template: Template,
        A: ArrayLike | None = None,
        B: ArrayLike | None = None,
        z: ArrayLike | None = None,
        tau: ArrayLike | None = None,
    ) -> None:
        expect("template", template, Template, TemplateError)
        if not template.plain:
            raise TemplateError(
                f"A batch of '{template.name}' needs linear couplings, at once and constant in "
                "time: run templates with others one by one."
            )
        layers, inputs = template.layers, template.inputs
        parts = {
            "A": _kernels(template, "A", A, (layers, layers)),
            "B": _kernels(template, "B", B, (layers, inputs)),
            "z": _numbers(template, "z", z),
            "tau": _numbers(template, "tau", tau),
        }
        inner = {"A": 4, "B": 4, "z": 1, "tau": 1}
        leads = {key: part.shape[: part.ndim - inner[key]] for key, part in parts.items()}
        try:
            lead = np.broadcast_shapes(*leads.values())
        except ValueError:
            raise TemplateError(
                f"A batch of '{template.name}' needs weights whose leading axes broadcast, got "
                f"{leads}."
            ) from None
        if (parts["tau"] <= 0.0).any() or 0 in lead:
            raise TemplateError(
                f"A batch of '{template.name}' needs at least one template, and a tau above 0."
            )
        object.__setattr__(self, "template", template)
        for key, part in parts.items():
            object.__setattr__(self, key, frozen(part))
        object.__setattr__(self, "lead", lead)

    @classmethod
    def of(cls, templates: Sequence[Template]) -> "TemplateBatch":
        """Return the batch of templates that differ in their numbers alone.

        Raises
        ------
        TemplateError
            If there is none, or they differ in more than A, B, z and tau.
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
                    "boundary, start, duration, output and sizes must be the same."
                )
        parts: dict[str, Any] = {
            key: np.stack([getattr(one, key) for one in templates]) for key in ("A", "B", "z")
        }
        tau = np.stack([one.tau for one in templates])
        return cls(first, **parts, tau=tau)

    @property
    def size(self) -> int:
        """Number of templates."""
        return math.prod(self.lead)

    def flat(self, lead: tuple[int, ...]) -> tuple[Floats, Floats, Floats, Floats]:
        """Return A, B, z and tau of every run of a batch that the weights broadcast to.

        Returns
        -------
        (n, layers, layers, k, k), (n, layers, inputs, k, k), (n, layers) and (n, layers) float
        """

        def all_of(part: Floats, inner: int) -> Floats:
            own = part.shape[part.ndim - inner :]
            return np.broadcast_to(part, (*lead, *own)).reshape(math.prod(lead), *own)

        return all_of(self.A, 4), all_of(self.B, 4), all_of(self.z, 1), all_of(self.tau, 1)

    def templates(self) -> Iterator[Template]:
        """Yield every template, the last leading axis first."""
        given = self.template.inputs > 0
        for a, b, z, tau in zip(*self.flat(self.lead), strict=True):
            parts: dict[str, Any] = {"A": a, "z": z.tolist(), "tau": tau.tolist()}
            yield replace(self.template, **parts, **({"B": b} if given else {}))

    def __repr__(self) -> str:
        return f"TemplateBatch('{self.template.name}', lead={self.lead})"


def _kernels(
    template: Template, part: str, value: ArrayLike | None, couples: tuple[int, int]
) -> Floats:
    if value is None:
        return np.asarray(getattr(template, part), dtype=np.float64)
    found = finite(f"{part} of a batch of '{template.name}'", value)
    plain = 2 <= found.ndim < 4 or (found.ndim >= 4 and found.shape[-4:-2] != (1, 1))
    if couples == (1, 1) and plain:
        found = found[..., np.newaxis, np.newaxis, :, :]
    sizes = found.shape[-4:]
    if len(sizes) < 4 or sizes[:2] != couples or sizes[-1] != sizes[-2] or sizes[-1] % 2 == 0:
        raise TemplateError(
            f"{part} of a batch of '{template.name}' must be (..., k, k) with k odd, for {couples} "
            f"couplings, got the shape {np.shape(value)}."
        )
    return found


def _numbers(template: Template, part: str, value: ArrayLike | None) -> Floats:
    if value is None:
        return np.asarray(getattr(template, part), dtype=np.float64)
    found = finite(f"{part} of a batch of '{template.name}'", value)
    if template.layers == 1 and (found.ndim == 0 or found.shape[-1] != 1):
        return found[..., np.newaxis]
    if found.ndim == 0 or found.shape[-1] != template.layers:
        raise TemplateError(
            f"{part} of a batch of '{template.name}' must be (..., {template.layers}), got the "
            f"shape {found.shape}."
        )
    return found


def _form(template: Template) -> tuple[object, ...]:
    return (
        template.A.shape,
        template.B.shape,
        template.boundary,
        template.input_boundary,
        template.initial,
        template.duration,
        template.output.name,
        template.plain,
    )
