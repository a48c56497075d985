"""All closed forms of programs: a new one is a record in a file of its own, listed here."""

from collections.abc import Mapping
from types import MappingProxyType

from cnnum.templating.checks.program_records import ProgramForm
from cnnum.templating.checks.tactile import codes as tactile_codes
from cnnum.templating.checks.tactile import contours as tactile_contours
from cnnum.templating.checks.tactile import halfspace as tactile_halfspace
from cnnum.templating.checks.tactile import moving_patterns as tactile_moving_patterns
from cnnum.templating.checks.tactile import outlines as tactile_outlines
from cnnum.templating.checks.tactile import receptor_channels as tactile_receptors
from cnnum.templating.checks.tactile import slip_and_twist as tactile_slip_and_twist

_KINDS = (
    tactile_outlines.FORMS,
    tactile_codes.FORMS,
    tactile_slip_and_twist.FORMS,
    tactile_halfspace.FORMS,
    tactile_receptors.FORMS,
    tactile_moving_patterns.FORMS,
    tactile_contours.FORMS,
)
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
