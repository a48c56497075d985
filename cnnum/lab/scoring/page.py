"""The tables as one HTML page."""

import json
from collections.abc import Iterator, Sequence
from pathlib import Path

from cnnum.lab.scoring.suites import SCORING, Request
from cnnum.lab.scoring.table import Row, Table
from cnnum.report.environment import Environment
from cnnum.report.html import Cell, document, paragraph, section, table
from cnnum.safety.files import write_whole

TITLE = "cnnum: slip and twist where the truth is known"
STYLES = {True: "yes", False: "no", None: ""}


def write_page(
    path: Path,
    tables: Sequence[Table],
    request: Request,
    environment: Environment,
    *,
    force: bool = False,
) -> None:
    """Write the page.

    Raises
    ------
    ReportError
        If a file is there that is no page of cnnum, and `force` does not say to replace it, or if
        it cannot be written.
    """
    write_whole(path, page(tables, request, environment), force=force)


def page(tables: Sequence[Table], request: Request, environment: Environment) -> str:
    """Return the page as a text that needs nothing else."""
    data = json.dumps(
        [record for table in tables for record in table.records()], ensure_ascii=False
    )
    lead, foot = paragraph(_lead(tables, request), "lead"), paragraph(_foot(environment), "note")
    return document(TITLE, lead, "".join(_sections(tables)), foot, data)


def _lead(tables: Sequence[Table], request: Request) -> str:
    aimed, missed = (sum(getattr(t, name) for t in tables) for name in ("aimed", "missed"))
    lead = f"{aimed - missed} of {aimed} aims reached."
    if "families" not in request.suites:
        return lead
    kind = "scoring" if request.seed >= SCORING else "tuning"
    last = request.seed + request.count - 1
    return f"{lead} {request.count} scenes a family, {kind} seeds {request.seed} to {last}."


def _foot(environment: Environment) -> str:
    versions = ", ".join(f"{name} {number}" for name, number in environment.versions)
    return (
        f"Written by “cnnum score --out” on {environment.date}; {environment.machine}, "
        f"{environment.system}; {environment.device}; {versions}. The figures are in this file "
        "once more as JSON."
    )


def _sections(tables: Sequence[Table]) -> Iterator[str]:
    for number, scores in enumerate(tables, 1):
        shown = [column for column in scores.columns if not column.explains]
        head = [f"{column.title} ({column.aim})".replace(" ()", "") for column in shown]
        rows = ((False, _cells(scores, row)) for row in scores.rows)
        inside = table(head, rows, style="fold")
        yield section(number, scores.name, scores.title, paragraph(scores.note, "note"), inside)


def _cells(table: Table, row: Row) -> list[Cell]:
    first, *others = (column for column in table.columns if not column.explains)
    more = ", ".join(c.text(row.get(c.key)) for c in table.columns if c.explains)
    cells = [Cell(first.text(row.get(first.key)), more, strong=True)]
    for column in others:
        value = row.get(column.key)
        cells.append(Cell(column.text(value), style=STYLES[table.reached(column, row)]))
    return cells
