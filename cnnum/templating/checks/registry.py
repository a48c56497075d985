"""All closed forms by name: a new one is a record in the file of its kind."""

from collections.abc import Mapping
from types import MappingProxyType

import numpy as np

from cnnum.arrays import Floats, Shape
from cnnum.errors import OneColourError, TemplateError, name_error
from cnnum.templating.checks import rules
from cnnum.templating.checks.analytic import courses, linear, waves
from cnnum.templating.checks.digital import neighbourhood, propagation
from cnnum.templating.checks.records import Case, ClosedForm
from cnnum.templating.template import Template

_KINDS = (
    *(neighbourhood.FORMS, propagation.FORMS, rules.FORMS),
    *(linear.FORMS, courses.FORMS, waves.FORMS),
)
_FORMS: Mapping[str, ClosedForm] = MappingProxyType(
    {form.name: form for kind in _KINDS for form in kind}
)


def closed_form_names() -> tuple[str, ...]:
    """Return the names that a template's check may have."""
    return tuple(_FORMS)


def closed_form(name: str) -> ClosedForm:
    """Return the closed form of that name.

    Raises
    ------
    UnknownNameError
        If there is no such name.
    """
    if name not in _FORMS:
        raise name_error("closed form", name, _FORMS)
    return _FORMS[name]


def form_of(template: Template) -> ClosedForm:
    """Return the closed form that a template names, its parameters being those the form takes.

    Raises
    ------
    TemplateError
        If the template has no check, or a parameter is missing or unknown.
    UnknownNameError
        If there is no such closed form.
    """
    if template.check is None:
        raise TemplateError(
            f"Template '{template.name}' has no check; name a closed form in its [check], "
            f"one of {', '.join(map(repr, _FORMS))}."
        )
    form = closed_form(template.check.name)
    given = {name for name, _ in template.check.parameters}
    missing, extra = set(form.needs) - given, given - {*form.needs, *form.takes}
    if missing or extra:
        raise TemplateError(
            f"Template '{template.name}': the check '{form.name}' needs the parameters "
            f"{_listed(form.needs)} and takes {_listed(form.takes)}, got {_listed(given)}."
        )
    return form


def posed(template: Template, seed: int, shape: Shape) -> tuple[Case, Floats]:
    """Return the case of a template's check and its right answers.

    Raises
    ------
    TemplateError
        If the template has no check.
    OneColourError
        If all right answers have one colour: a template that gives it to every cell would pass.
    """
    form = form_of(template)
    case = form.cases(template, np.random.default_rng(seed), shape)
    with np.errstate(over="ignore", invalid="ignore"):  # of a field that grows until it settles
        expected = form.expected(template, case)
    if form.digital and (expected > 0.0).all() | (expected < 0.0).all():
        colour = "black" if (expected > 0.0).all() else "white"
        raise OneColourError(
            f"The check '{form.name}' of '{template.name}' shows nothing on {shape[0]}×{shape[1]} "
            f"cells with seed {seed}: every correct output is {colour}, expected both colours; "
            "use a larger array or another seed, or correct the parameters of the check."
        )
    return case, expected


def _listed(names: tuple[str, ...] | set[str]) -> str:
    return ", ".join(f"'{name}'" for name in sorted(names)) or "none"
