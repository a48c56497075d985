"""Writing a report: the whole file or none."""

from collections.abc import Sequence
from pathlib import Path

from cnnum.errors import ReportError
from cnnum.report.encoding import ReportData
from cnnum.report.page import page
from cnnum.report.plan_cost import PlanCost
from cnnum.report.record import SceneRecord
from cnnum.report.work_precision import WorkPrecision
from cnnum.safety.files import write_whole
from cnnum.templating.checks import CheckResult


def write_demo_report(
    path: str | Path,
    record: SceneRecord,
    checks: Sequence[CheckResult] = (),
    work_precision: Sequence[WorkPrecision] = (),
    plans: Sequence[PlanCost] = (),
    *,
    force: bool = False,
) -> None:
    """Write the results of a scene as one self-contained HTML file.

    Parameters
    ----------
    path : str or Path
    record : SceneRecord
        From a `SceneRecorder` that was given every moment of the scene.
    checks : sequence of CheckResult
        Of the templates, on any number of engines.
    work_precision : sequence of WorkPrecision
        Of a few templates, from `measure_work_precision`.
    plans : sequence of PlanCost
        The scene's own first; the others are compared with it.
    force : bool
        Whether a file that is there, and is no report of cnnum, is replaced.

    Raises
    ------
    ReportError
        If there is no frame to show, another file is there, or it cannot be written.
    """
    if record.frames == 0:
        raise ReportError(f"The scene '{record.name}' had no frame; a report needs at least one.")
    data = ReportData(record, tuple(checks), tuple(work_precision), tuple(plans))
    content = page(data).encode("utf-8")
    write_whole(Path(path), content, force=force)
