"""Scoring: how often the tactile programs are right, on many scenes of which the truth is known.

The way of the data: `draw` (seeded scenes: `case`) → `simulate` (frames, with `faults`) →
`batches` (many arrays side by side through one plan: `play`) → `episodes` and `judge` (against the
closed forms) → `measures`. `scenes` plays scene files, `recordings` labelled real trials; `worst`
lists what went wrong, `suites` puts it together, `page` writes it down.
"""

from cnnum.lab.scoring.measures import Measure
from cnnum.lab.scoring.suites import SUITES, Report, Request, score

__all__ = ["SUITES", "Measure", "Report", "Request", "score"]
