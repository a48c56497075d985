"""Parameters of a template's check, read with an error that names the template."""

from collections.abc import Mapping
from typing import TypeVar

from cnnum.errors import TemplateError
from cnnum.templating.template import Template

T = TypeVar("T")


def has(template: Template, name: str) -> bool:
    """Return whether the template's check has that parameter."""
    return name in _parameters(template)


def number(template: Template, name: str, default: float | None = None) -> float:
    """Return a numeric parameter of the template's check.

    Raises
    ------
    TemplateError
        If it is missing and has no default, or is a text.
    """
    value = _parameters(template).get(name, default)
    if value is None or isinstance(value, str):
        raise _wrong(template, name, "a number", value)
    return value


def text(template: Template, name: str) -> str:
    """Return a textual parameter of the template's check.

    Raises
    ------
    TemplateError
        If it is missing or a number.
    """
    value = _parameters(template).get(name)
    if not isinstance(value, str):
        raise _wrong(template, name, "a text", value)
    return value


def choice(template: Template, name: str, choices: Mapping[str, T]) -> T:
    """Return the value of a textual parameter.

    Raises
    ------
    TemplateError
        If it is none of the choices.
    """
    value = text(template, name)
    if value not in choices:
        raise _wrong(template, name, f"one of {', '.join(map(repr, choices))}", value)
    return choices[value]


def _parameters(template: Template) -> dict[str, float | str]:
    return {} if template.check is None else dict(template.check.parameters)


def _wrong(template: Template, name: str, expected: str, value: object) -> TemplateError:
    return TemplateError(
        f"Template '{template.name}': the parameter '{name}' of its check must be {expected}, "
        f"got {value!r}."
    )
