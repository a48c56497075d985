"""Units of the strength of events."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

from cnnum.programs import Program
from cnnum.scenes.events import EventRule

SCORE = "score"
"""Of slip and twist: a pure number, see `docs/events.md`."""

LOADS: Mapping[str, Mapping[str, str]] = {
    "load_normal": {"": "unit"},
    "bump_normal": {"": "unit", "tactile": "bump_unit"},
}
"""Outputs that are loads: by program, or of any, the parameter that makes them newtons. Without it
they are in the unit of the array's values."""

SHARES: Mapping[str, str] = {"mindlin_slip": "share"}
"""Programs whose strength is the share of the contact that slides: 0 to 1."""


OTHERS: Mapping[str, str] = {"flow_speed": "cells/s", "motion_strength": "share"}
"""Outputs with a unit of their own."""


def with_units(
    rules: Sequence[EventRule], program: Program, measured: str
) -> tuple[EventRule, ...]:
    """Return rules that say the unit of their strength.

    Parameters
    ----------
    rules : sequence of EventRule
    program : Program
        With its parameters: where the one of `LOADS` is given, that load is in newtons.
    measured : str
        Unit of the values that the program sees.
    """
    return tuple(
        rule if rule.own else replace(rule, unit=_unit(rule.strength, program, measured))
        for rule in rules
    )


def _unit(strength: str, program: Program, measured: str) -> str:
    if not strength:
        return ""
    if strength not in LOADS:
        return OTHERS.get(strength, SHARES.get(program.name, SCORE))
    of = LOADS[strength]
    return "N" if of.get(program.name, of[""]) in dict(program.parameters) else measured
