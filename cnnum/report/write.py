"""Writing a report: the whole file or none."""

from collections.abc import Sequence
from html import escape
from importlib import resources
from pathlib import Path

from cnnum.errors import ReportError
from cnnum.report import sections
from cnnum.report.encoding import ReportData, to_json
from cnnum.report.plan_cost import PlanCost
from cnnum.report.record import SceneRecord
from cnnum.report.work_precision import WorkPrecision
from cnnum.safety.files import write_whole
from cnnum.sharing.colours import style_rules
from cnnum.templating.checks import CheckResult


def page(data: ReportData) -> str:
    """Return a whole HTML document that needs nothing from outside itself."""
    title = f"cnnum: the scene “{data.record.name}”"
    parts = (
        "<!DOCTYPE html>\n",
        '<html lang="en"><head><meta charset="utf-8"><meta name="generator" content="cnnum">',
        f"<title>{escape(title)}</title>",
        '<meta name="viewport" content="width=device-width, initial-scale=1">',
        f"<style>{_resource('style.css')}{style_rules()}</style></head><body>",
        sections.head(data),
        f"<main>{_body(data)}</main>",
        sections.foot(data),
        f'<script type="application/json" id="data">{to_json(data)}</script>',
        f"<script>{_resource('player.js')}</script></body></html>\n",
    )
    return "".join(parts)


def _body(data: ReportData) -> str:
    chosen = (
        sections.story,
        sections.frames,
        sections.events,
        sections.errors,
        sections.plans,
        sections.latency,
        sections.further,
    )
    return "".join(part(number, data) for number, part in enumerate(chosen, start=1))


def _resource(name: str) -> str:
    return (resources.files("cnnum.report") / name).read_text(encoding="utf-8")


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
        Checks of the templates, on any number of engines.
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
