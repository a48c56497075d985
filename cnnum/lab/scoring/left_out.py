"""Leave one family out: free constants are chosen on the others, and judged on that family."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from cnnum.drivers.simulated.grips import Trial
from cnnum.engine import Engine
from cnnum.lab.scoring.families.catalogue import FAMILIES
from cnnum.lab.scoring.family_tables import FALSE, FOUND, played
from cnnum.lab.scoring.judge import NEAR, median
from cnnum.lab.scoring.levels import LEVELS, Outcome, outcome, rate_of
from cnnum.lab.scoring.subjects import Subject
from cnnum.lab.scoring.table import Column, Row, Table

STILL, PULL = (0.15, 0.2, 0.3), (0.3, 0.6, 1.0, 1.5)
GRID = tuple({"still": still, "pull": pull} for still, pull in product(STILL, PULL))
"""Values of two free constants; the third is the level."""

COLUMNS = (
    Column("family", "family left out"),
    Column("still", "still"),
    Column("pull", "pull"),
    Column("level", "level"),
    Column("found", "found", 2, least=FOUND),
    Column("slid_mm", "slid, mm", 2, most=NEAR * 1e3),
    Column("near", "by 0.3 mm"),
    Column("false", "false / 10 min", 1, most=FALSE),
)
NOTE = (
    "The constants of each row reach most aims on the other families; of several, those that "
    "find most by 0.3 mm."
)


@dataclass(frozen=True, slots=True)
class Choice:
    """Constants, and the results of every family with them.

    Attributes
    ----------
    constants : mapping of str to float
    outcomes : mapping of str to Outcome
        By family.
    """

    constants: Mapping[str, float]
    outcomes: Mapping[str, Outcome]


def choices(
    engine: Engine, trials: Mapping[str, Sequence[Trial]], advance: Callable[[str], object]
) -> list[Choice]:
    """Return all constants of the grid, with the results of families of scenes."""
    result = list[Choice]()
    names = [family.name for family in FAMILIES if family.kind != "twist"]
    some = {name: trials[name] for name in names}
    for constants in GRID:
        scenes = played(Subject(engine, constants, twists=False), some)
        for level in LEVELS:
            outcomes = {name: outcome(scenes, name, level) for name in names}
            result.append(Choice({**constants, "level": level}, outcomes))
        advance(", ".join(f"{name} {value:g}" for name, value in constants.items()))
    return result


def chosen(choices: Sequence[Choice], left_out: str) -> Choice:
    """Return the constants that reach most aims on all families but one.

    A family without slip has one aim, one that slips three. Of several, those that find most by
    0.3 mm.
    """

    def merit(choice: Choice) -> tuple[int, float]:
        others = [outcome for name, outcome in choice.outcomes.items() if name != left_out]
        near = float(np.mean([other.near for other in others if other.slid]))
        return sum(reached(other) for other in others), near

    return max(choices, key=merit)


def reached(outcome: Outcome) -> int:
    """Return the number of aims that a family reaches."""
    slips = (outcome.found >= FOUND, median(outcome.slid) <= NEAR) if outcome.slid else ()
    return sum((rate_of([outcome]) <= FALSE, *slips))


def left_out_table(choices: Sequence[Choice]) -> Table:
    """Return one row per family, with the constants that the other families choose."""
    rows = [_row(choices, family.name) for family in FAMILIES if family.kind != "twist"]
    return Table("left-out", "Leave one family out", NOTE, COLUMNS, rows)


def _row(choices: Sequence[Choice], family: str) -> Row:
    choice = chosen(choices, family)
    mine = choice.outcomes[family]
    return {
        "family": family,
        **choice.constants,
        "found": mine.found,
        "slid_mm": median(list(mine.slid)) * 1e3,
        "near": mine.near,
        "false": rate_of([mine]),
    }
