"""The parts of a row of the table: a published number, ours, and how far apart they may be."""

from collections.abc import Callable
from dataclasses import dataclass
from math import inf, isfinite, nan
from typing import Literal, get_args

from cnnum.errors import PhysicsError
from cnnum.lab.reproduce.faults import Fault
from cnnum.lab.reproduce.figure import Figure

Kind = Literal["check", "comparison"]
Rule = Literal["absolute", "relative", "within", "at least", "at most"]

SMALL = 0.02
"""Largest error of its subject that a check must notice."""
Expected = float | tuple[float, float]


@dataclass(frozen=True, slots=True, eq=False)
class Item:
    """One result of the dissertation and the function that gives ours.

    Attributes
    ----------
    name : str
        Short, unique: "W", "table-3.I-Fz".
    title : str
        Its name, in a few words.
    source : str
        Table, figure, equation or section of the dissertation.
    expected : float or (float, float)
        The published number, or the value of the published equation; a range for "within".
    compute : callable
        Returns ours, in the same unit.
    tolerance : float
        Largest error that passes.
    reason : str
        Why that tolerance; of a comparison, why the two need not agree.
    unit : str
        Unit of the numbers; "" where they have none.
    rule : str
        Kind of error: "absolute" |got − expected|, "relative" that over |expected|, "within"
        the distance from the range. "at least" is the part missing, "at most" the part too much.
    kind : str
        "check", or "comparison" where the model is not meant to give the number.
    figure : str or None
        Name of the figure that shows it.
    printed : callable or None
        Of an erratum: the value of the formula as it is printed.
    faults : tuple of Fault
        Of a check: faults of the library that make it fail; one of them is of 2 % at most.
    """

    name: str
    title: str
    source: str
    expected: Expected
    compute: Callable[[], float]
    tolerance: float
    reason: str
    unit: str = ""
    rule: Rule = "absolute"
    kind: Kind = "check"
    figure: str | None = None
    printed: Callable[[], float] | None = None
    faults: tuple[Fault, ...] = ()

    def __post_init__(self) -> None:
        if self.rule not in get_args(Rule) or self.kind not in get_args(Kind):
            raise PhysicsError(
                f"'{self.name}': expected a rule of {get_args(Rule)} and a kind of "
                f"{get_args(Kind)}, got '{self.rule}' and '{self.kind}'."
            )
        if (self.rule == "within") != isinstance(self.expected, tuple):
            raise PhysicsError(
                f"'{self.name}': a range goes with the rule 'within' and a number with any other, "
                f"got {self.expected} with '{self.rule}'."
            )
        if not (self.tolerance >= 0.0 and self.reason):
            raise PhysicsError(
                f"'{self.name}': expected a tolerance of 0 or more and a reason for it, got "
                f"{self.tolerance} and '{self.reason}'."
            )
        if (self.kind == "check") != bool(self.faults):
            raise PhysicsError(
                f"'{self.name}': a check names the faults that make it fail, and a comparison, "
                f"which cannot fail, has none; got a {self.kind} with {len(self.faults)}."
            )
        if self.faults and min(fault.share for fault in self.faults) > SMALL:
            raise PhysicsError(
                f"'{self.name}': expected a fault of {SMALL:.0%} or less that makes the check "
                f"fail, got {', '.join(fault.what for fault in self.faults)}."
            )

    def error(self, got: float) -> float:
        """Return how far a number is from the expected one, by the rule."""
        if not isfinite(got):
            return inf
        if isinstance(self.expected, tuple):
            low, high = self.expected
            return max(low - got, got - high, 0.0)
        gap = got - self.expected
        if self.rule == "relative":
            return abs(gap / self.expected)
        return {"at least": max(-gap, 0.0), "at most": max(gap, 0.0)}.get(self.rule, abs(gap))


@dataclass(frozen=True, slots=True)
class Row:
    """An item with its result.

    Attributes
    ----------
    item : Item
    got : float
        NaN where it was not run.
    error : float
    passed : bool or None
        None for a comparison, and where it was not run.
    printed : float or None
        Of an erratum: the value of the printed formula.
    missing : str
        Why it was not run; "" where it was.
    """

    item: Item
    got: float
    error: float
    passed: bool | None
    printed: float | None = None
    missing: str = ""

    def record(self) -> dict[str, object]:
        """Return the row as `cnnum reproduce --json` writes it."""
        item = self.item
        return {
            "item": item.name,
            "source": item.source,
            "expected": item.expected,
            "got": self.got,
            "error": self.error,
            "tolerance": item.tolerance,
            "passed": self.passed,
            "kind": item.kind,
            "rule": item.rule,
            "unit": item.unit,
            "title": item.title,
            "reason": item.reason,
            "printed": self.printed,
            "figure": item.figure,
            "missing": self.missing,
        }


@dataclass(frozen=True, slots=True)
class Chapter:
    """The items and figures of one part of the dissertation.

    Attributes
    ----------
    title : str
    items : tuple of Item
    figures : mapping of str to callable
        Makes the figure of that name.
    """

    title: str
    items: tuple[Item, ...]
    figures: "dict[str, Callable[[], Figure]]"


def not_run(item: Item, why: str) -> Row:
    """Return the row of an item that could not be run."""
    return Row(item, nan, nan, None, None, why)
