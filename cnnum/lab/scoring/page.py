"""The report as one HTML page: figures against targets, then the scenes that went wrong."""

import json
from collections.abc import Iterator, Sequence
from importlib import resources
from pathlib import Path

from cnnum.errors import ReportError
from cnnum.lab.scoring.generated.case import seed_set
from cnnum.lab.scoring.measures import Measure
from cnnum.lab.scoring.suites import Report, Request
from cnnum.lab.scoring.worst import Failing
from cnnum.report.environment import Environment
from cnnum.report.html import Cell, paragraph, section, table
from cnnum.report.pictures.svg import plain
from cnnum.safety.files import write_whole

HEAD = ("measure", "value", "unit", "target", "count", "verdict")
WORST_HEAD = ("scene", "what went wrong", "array", "rate", "cover", "faults")


def write_page(path: Path, report: Report, request: Request, environment: Environment) -> None:
    """Write the page of a report.

    Raises
    ------
    ReportError
        If the file cannot be written.
    """
    try:
        write_whole(path, page(report, request, environment).encode("utf-8"))
    except OSError as error:
        raise ReportError(
            f"Cannot write '{path}' ({error.strerror}): expected a file in a folder that may be "
            "written; give another with --out."
        ) from error


def page(report: Report, request: Request, environment: Environment) -> str:
    """Return the page as a text that needs nothing else."""
    style = (resources.files("cnnum.report") / "style.css").read_text(encoding="utf-8")
    data = {
        "measures": [_plain(measure.record()) for measure in report.measures],
        "failing": [item.record() for item in report.failing],
    }
    inside = json.dumps(data, ensure_ascii=False).replace("<", "\\u003c")
    title = "cnnum: how often the tactile programs are right"
    return (
        f'<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8"><title>{title}</title>'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<style>{style}</style></head><body><header><h1>{title}</h1>"
        f"{paragraph(_lead(report, request), 'lead')}</header>"
        f"<main>{''.join(_sections(report))}</main>"
        f"<footer>{paragraph(_foot(environment), 'note')}</footer>"
        f'<script type="application/json" id="data">{inside}</script></body></html>\n'
    )


def _lead(report: Report, request: Request) -> str:
    aimed = [measure for measure in report.measures if measure.target is not None]
    reached = sum(measure.reached is True for measure in aimed)
    first, last = request.seed, request.seed + request.count - 1
    drawn = (
        f" Generated scenes: seeds {first} to {last}, of the {seed_set(first)} set."
        if request.cases()
        else ""
    )
    return f"{reached} of {len(aimed)} targets reached.{drawn}"


def _foot(environment: Environment) -> str:
    versions = ", ".join(f"{name} {number}" for name, number in environment.versions)
    return (
        f"Written by “cnnum score --out” on {environment.date}; {environment.machine}, "
        f"{environment.system}; {environment.device}; {versions}. The figures are in this file "
        "once more as JSON."
    )


def _sections(report: Report) -> Iterator[str]:
    whole = [measure for measure in report.measures if not measure.group]
    number = 0
    for suite in dict.fromkeys(measure.suite for measure in whole):
        number += 1
        mine = [measure for measure in whole if measure.suite == suite]
        rows = ((m.reached is False, _cells(m)) for m in mine)
        yield section(number, f"s{number}", f"Suite “{suite}”", table(HEAD, rows, style="fold"))
    groups = [measure for measure in report.measures if measure.group]
    if groups:
        number += 1
        head = ("group", *HEAD)
        rows = ((False, (Cell(m.group, strong=True), *_cells(m))) for m in groups)
        yield section(number, "groups", "By kind of scene", table(head, rows, style="fold tall"))
    if report.failing:
        number += 1
        rows = ((False, _failing(item)) for item in report.failing)
        yield section(
            number, "worst", "Scenes that went wrong", table(WORST_HEAD, rows, style="fold tall")
        )


def _cells(measure: Measure) -> Sequence[Cell]:
    verdict = {
        True: Cell("✓ reached", style="yes"),
        False: Cell("✗ missed", style="no"),
        None: Cell("–"),
    }
    return (
        Cell(measure.measure, style="text", strong=measure.target is not None),
        Cell(plain(measure.value, 4)),
        Cell(measure.unit),
        Cell(target_text(measure)),
        Cell(str(measure.count)),
        verdict[measure.reached],
    )


def target_text(measure: Measure) -> str:
    """Return a target with its sign, or nothing."""
    if measure.target is None:
        return ""
    return f"{'≥' if measure.rule == 'at least' else '≤'} {measure.target:g}"


def _failing(item: Failing) -> Sequence[Cell]:
    about = (str(item.about.get(key, "–")) for key in ("array", "rate", "cover", "faults"))
    return (
        Cell(item.name, strong=True),
        Cell("; ".join(item.wrong), style="text"),
        *(Cell(text) for text in about),
    )


def _plain(record: dict[str, object]) -> dict[str, object]:
    return {
        key: None if isinstance(value, float) and value != value else value
        for key, value in record.items()
    }
