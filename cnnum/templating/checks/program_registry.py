"""All closed forms of programs: a new one is a record in a file of its own, listed here."""

from collections.abc import Mapping
from types import MappingProxyType

from cnnum.templating.checks.program_run import ProgramForm
from cnnum.templating.checks.tactile import halfspace, patterns, slip_and_twist

_KINDS = (patterns.FORMS, slip_and_twist.FORMS, halfspace.FORMS)
_FORMS: Mapping[str, tuple[ProgramForm, ...]] = MappingProxyType(
    {
        program: tuple(f for kind in _KINDS for f in kind if f.program == program)
        for program in dict.fromkeys(form.program for kind in _KINDS for form in kind)
    }
)


def checked_programs() -> tuple[str, ...]:
    """Return the names of the programs that have a check."""
    return tuple(_FORMS)


def program_forms(program: str) -> tuple[ProgramForm, ...]:
    """Return the closed forms of a program, none if it has no check."""
    return _FORMS.get(program, ())
