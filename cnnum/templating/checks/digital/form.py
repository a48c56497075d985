"""Closed forms whose answer is black or white in every cell."""

from collections.abc import Callable
from typing import Literal

from cnnum.arrays import Floats
from cnnum.templating.checks.records import DIGITAL_TOLERANCE, Case, Cases, ClosedForm
from cnnum.templating.template import Template

DECIDED = (
    "a template that does not propagate runs for five time constants: a decided cell has then come "
    "within e^-5 = 0.7 % of black or white; a wrong cell is off by 2"
)
SETTLED = (
    "cells settle outside [-1, 1], where the output is exactly black or white; a wrong cell is off "
    "by 2"
)
DISCRETE = "discrete time with outputs of -1 and 1 is exact; a wrong cell is off by 2"


def digital_form(
    name: str,
    cases: Cases,
    expected: Callable[[Template, Case], Floats],
    summary: str,
    needs: tuple[str, ...] = (),
    takes: tuple[str, ...] = (),
    *,
    reason: str = DECIDED,
    compares: Literal["output", "state"] = "output",
) -> ClosedForm:
    """Return a closed form with the digital tolerance; `reason` says why it is not smaller."""
    return ClosedForm(
        name, cases, expected, DIGITAL_TOLERANCE, reason, summary, needs, takes, compares
    )
