"""Scoring: slip and twist judged on scenes beyond the simulator's own, and on real recordings.

The way of the data: `families` or `recorded` → a `trial` → `subjects` → `judge`
→ `family_tables`, `levels`, `left_out` and `recordings` → a `table`. `families` are scenes by seed,
`recorded` are real trials. A `trial` holds frames with their truth. `judge` and `suites` hold
reports against the truth. `recordings` go with simple baselines. `suites` puts it together, `page`
writes it down.
"""

from cnnum.lab.scoring.suites import SUITES, Gathered, Request, score
from cnnum.lab.scoring.table import Table

__all__ = ["SUITES", "Gathered", "Request", "Table", "score"]
