"""Units of the strength of events."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

from cnnum.programs import Program
from cnnum.scenes.events import EventRule

SCORE = "score"
"""Of slip and twist: a pure number, see `docs/events.md`."""

LOAD = "load_normal"
"""Output whose unit is that of the array's values, or of the program's parameter `unit`."""

SHARES: Mapping[str, str] = {"mindlin_slip": "share"}
"""Programs whose strength is the share of the contact that slides: 0 to 1."""


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
    score = SHARES.get(program.name, SCORE)
    return tuple(
        replace(rule, unit=load if rule.strength == LOAD else score if rule.strength else "")
        for rule in rules
    )
