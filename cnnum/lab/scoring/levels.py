"""A threshold is a rate of false alarms: the found slips of each level, and its false reports."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cnnum.lab.scoring.families.catalogue import FAMILIES
from cnnum.lab.scoring.family_tables import FOUND, Scenes
from cnnum.lab.scoring.judge import NEAR, judge, median, per_ten_minutes, share
from cnnum.lab.scoring.subjects import reports, shipped_level
from cnnum.lab.scoring.table import Column, Row, Table

LEVELS = (0.15, 0.20, 0.25, 0.28, 0.32, 0.36, 0.40, 0.45, 0.50, 0.60)

COLUMNS = (
    Column("level", "level"),
    Column("found", "found", 3),
    Column("families", f"families ≥ {FOUND:g}"),
    Column("near", "by 0.3 mm", 3),
    Column("slid_mm", "slid, mm"),
    Column("false", "false / 10 min", 1),
    Column("still_false", "without rolling", 1),
)
NOTE = (
    "Found, and by 0.3 mm: means over the families that slip. False: over all families without "
    "slip; rolling under a weight looks like slow sliding to any patch of taxels."
)


@dataclass(frozen=True, slots=True)
class Outcome:
    """The results of a family at one level.

    Attributes
    ----------
    found, near : float
        Shares of its scenes; NaN in a family without slip.
    slid : tuple of float, m
        Sliding before each report; infinite without one.
    false : int
    seconds : float, s
    """

    found: float
    near: float
    slid: tuple[float, ...]
    false: int
    seconds: float


def outcome(scenes: Scenes, family: str, level: float) -> Outcome:
    """Return the results of a family at a level of `slip_strength`."""
    pairs = zip(scenes.trials[family], scenes.answers[family], strict=True)
    verdicts = [judge(t, a, reports(a["slip_strength"], level, t.rate)) for t, a in pairs]
    slides = [verdict for verdict in verdicts if verdict.slides]
    slid = tuple(slide.slid if slide.found else float("inf") for slide in slides)
    return Outcome(
        found=share(sum(slide.found for slide in slides), len(slides)),
        near=share(sum(way <= NEAR for way in slid), len(slides)),
        slid=slid,
        false=sum(verdict.false for verdict in verdicts),
        seconds=sum(verdict.seconds for verdict in verdicts),
    )


def level_table(scenes: Scenes) -> Table:
    """Return one row per level."""
    levels = sorted({*LEVELS, shipped_level()})
    rows = [_row(scenes, level) for level in levels]
    return Table("levels", "Level against false reports", NOTE, COLUMNS, rows)


def _row(scenes: Scenes, level: float) -> Row:
    slips = [outcome(scenes, f.name, level) for f in FAMILIES if f.kind == "slip"]
    held = {f.name: outcome(scenes, f.name, level) for f in FAMILIES if f.kind == "held"}
    still = [tried for name, tried in held.items() if "rolling" not in name]
    ways = [way for slip in slips for way in slip.slid]
    return {
        "level": level,
        "found": float(np.mean([slip.found for slip in slips])),
        "families": sum(slip.found >= FOUND for slip in slips),
        "near": float(np.mean([slip.near for slip in slips])),
        "slid_mm": median(ways) * 1e3,
        "false": rate_of(list(held.values())),
        "still_false": rate_of(still),
    }


def rate_of(outcomes: Sequence[Outcome]) -> float:
    """Return the false reports in ten minutes of some families."""
    false, seconds = (
        sum(getattr(outcome, name) for outcome in outcomes) for name in ("false", "seconds")
    )
    return per_ten_minutes(false, seconds)
