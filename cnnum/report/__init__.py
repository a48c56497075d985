"""Reports: the results of a scene, as one HTML page that stands alone.

Data flow: `record` → `verdicts` → `encoding` and the pictures → `sections` → `page` → `write`.
`record` is collected while the scene runs. `verdicts` are against the ground truth. `encoding`
gives all of it as JSON.
"""

from cnnum.report.record import PlanCost, SceneRecord, SceneRecorder, Verdict, compare
from cnnum.report.sections import write_demo_report
from cnnum.report.work_precision import WorkPrecision, measure_work_precision

__all__ = [
    "PlanCost",
    "SceneRecord",
    "SceneRecorder",
    "Verdict",
    "WorkPrecision",
    "compare",
    "measure_work_precision",
    "write_demo_report",
]
