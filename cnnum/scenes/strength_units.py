"""Units of what events report as their strength."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

from cnnum.programs import Program
from cnnum.scenes.events import EventRule

SHARE = "share"
"""Of slip and twist: 0 where all of the contact sticks, 1 where all of it slides."""

LOAD = "load_normal"
"""Output whose unit is that of the array's values, or of the program's parameter `unit`."""

SCORES: Mapping[str, str] = {"grasp_slip": "noise floors", "moving_contact": "score"}
"""Programs whose strengths are no share, and the unit of theirs."""


def with_units(
    rules: Sequence[EventRule], program: Program, measured: str
) -> tuple[EventRule, ...]:
    """Return rules that say the unit of their strength.

    Parameters
    ----------
    rules : sequence of EventRule
    program : Program
        With its parameters: where `unit` is given, its loads are newtons.
    measured : str
        Unit of the values that the program sees.
    """
    load = "N" if "unit" in dict(program.parameters) else measured
    score = SCORES.get(program.name, SHARE)
    return tuple(
        replace(rule, unit=load if rule.strength == LOAD else score if rule.strength else "")
        for rule in rules
    )
