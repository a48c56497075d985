"""Scoring: slip and twist judged on scenes beyond the simulator's own, and on real recordings.

The way of the data: `families` (scenes by seed) or `recorded` (real trials) → a `trial` (frames
with their truth) → `judged_programs` → `judge` and `onsets` (reports
against the truth) → `family_tables`, `levels`, `left_out` and `recordings` (with `baselines`) →
a `table`. `suites` puts it together, `page` writes it down.
"""

from cnnum.lab.scoring.suites import SUITES, Gathered, Request, score
from cnnum.lab.scoring.table import Table

__all__ = ["SUITES", "Gathered", "Request", "Table", "score"]
