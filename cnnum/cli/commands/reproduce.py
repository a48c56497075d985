"""`cnnum reproduce`: the dissertation's numbers and figures, and ours."""

from pathlib import Path
from typing import TYPE_CHECKING

import click
from rich.table import Table
from rich.text import Text

from cnnum.cli.options import json_option
from cnnum.cli.output import Output, number, table, verdict
from cnnum.cli.progress import progress
from cnnum.cli.stopping import until_stopped

if TYPE_CHECKING:
    from cnnum.lab.reproduce import Row

CHECKS_FAILED = 1


@click.command("reproduce")
@click.argument("items", nargs=-1, metavar="[ITEMS]...")
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    metavar="DIR|FILE.html",
    help="Write a page with the table and all figures.",
)
@json_option
def command(items: tuple[str, ...], out: Path | None, as_json: bool) -> int:
    """Compute the dissertation's results and compare them with the published numbers.

    ITEMS are names of rows, or beginnings of them: "W", "fig-4.5", "eq-5"; all unless given.
    Exits with 1 if a check fails; comparisons with real sensors, which no model here is meant
    to match, never fail.
    """
    from cnnum.lab.reproduce import run, select

    chosen, output = select(items), Output(as_json)
    rows: list[Row] = []
    if out is not None and not out.parent.is_dir():
        raise click.UsageError(f"There is no folder '{out.parent}' to write '{out.name}' to.")
    with until_stopped() as stop, progress("items", len(chosen), as_json=as_json) as steps:
        for row in run(chosen):
            rows.append(row)
            output.record(row.record())
            steps.advance(row.item.name)
    output.show(_table(rows), _summary(rows))
    if stop.stopped:
        return stop.say(len(rows), len(chosen), "items", as_json=as_json)
    if out is not None:
        _write(out, rows, as_json)
    return CHECKS_FAILED if any(row.passed is False for row in rows) else 0


def _write(out: Path, rows: "list[Row]", as_json: bool) -> None:
    from cnnum.lab.reproduce.page import figures_of, write_page

    made = figures_of(rows)
    with progress("figures", len(made), as_json=as_json) as steps:
        place = write_page(out, rows, made, steps.advance)
    Output(as_json).show(f"Written: {place}")


def _summary(rows: "list[Row]") -> str:
    checks = [row for row in rows if row.passed is not None]
    others = sum(row.item.kind == "comparison" for row in rows)
    missing = {row.missing for row in rows if row.missing}
    text = (
        f"{sum(bool(row.passed) for row in checks)} of {len(checks)} checks passed; "
        f"{others} comparisons with real sensors."
    )
    return " ".join([text, *sorted(missing)])


def _table(rows: "list[Row]") -> Table:
    made = table("Item", ">published", ">ours", ">error", ">tolerance", "", "what")
    for row in rows:
        item = row.item
        made.add_row(
            item.name,
            _expected(row),
            number(row.got, 4),
            number(row.error, 2),
            number(item.tolerance, 2) if item.kind == "check" else "",
            _verdict(row),
            f"{item.title}{_unit(row)} · {item.source}{_printed(row)}",
        )
    return made


def _unit(row: "Row") -> str:
    return f" ({row.item.unit})" if row.item.unit else ""


def _printed(row: "Row") -> str:
    return "" if row.printed is None else f" · as printed: {number(row.printed, 4)}"


def _expected(row: "Row") -> str:
    item = row.item
    if isinstance(item.expected, tuple):
        return f"{number(item.expected[0])}–{number(item.expected[1])}"
    sign = {"at least": "≥ ", "at most": "≤ "}.get(item.rule, "")
    return f"{sign}{number(item.expected, 4)}"


def _verdict(row: "Row") -> Text:
    if row.missing:
        return Text("not run", style="yellow")
    return Text("compared") if row.passed is None else verdict(row.passed)
