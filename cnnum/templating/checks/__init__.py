"""Closed forms that templates are checked against; none of them knows an engine."""

from cnnum.templating.checks.records import Case, CheckResult, ClosedForm
from cnnum.templating.checks.registry import closed_form, closed_form_names, form_of
from cnnum.templating.checks.running import run_check

__all__ = [
    "Case",
    "CheckResult",
    "ClosedForm",
    "closed_form",
    "closed_form_names",
    "form_of",
    "run_check",
]
