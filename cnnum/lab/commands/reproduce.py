"""`cnnum reproduce`: the dissertation's numbers and figures, and ours."""

from pathlib import Path
from typing import TYPE_CHECKING

import click
from rich.table import Table
from rich.text import Text

from cnnum.cli.options import force_option, json_option
from cnnum.cli.output import Output, number, progress, table, verdict
from cnnum.cli.signals import until_stopped

if TYPE_CHECKING:
    from cnnum.lab.reproduce import Item, Row
    from cnnum.lab.reproduce.faults import Mutant

CHECKS_FAILED = 1


@click.command("reproduce")
@click.argument("items", nargs=-1, metavar="[ITEMS]...")
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    metavar="DIR|FILE.html",
    help="Write a page with the table and all figures.",
)
@click.option(
    "--mutants",
    is_flag=True,
    help="Break the function that each check is about, and report whether the check fails.",
)
@force_option
@json_option
def command(
    items: tuple[str, ...], out: Path | None, mutants: bool, force: bool, as_json: bool
) -> int:
    """Compute the dissertation's results and compare them with the published numbers.

    ITEMS are names of rows or their beginnings, such as "W", "fig-4.5" or "eq-5"; by default all.
    The exit code is 1 if a check fails. Comparisons with values that no model here is meant to
    match never fail.

    With --mutants, every check is repeated with the function behind it changed: by a factor (1.01
    if the check is that sharp), by a sign, or by a thicker cover. The exit code is 1 if a check
    still passes. This takes a minute.
    """
    from cnnum.lab.reproduce import run, select

    chosen, output = select(items), Output(as_json)
    if mutants:
        if out is not None:
            raise click.UsageError("'--out' cannot be combined with '--mutants'.")
        return _mutants(chosen, as_json)
    rows: list[Row] = []
    if out is not None:
        from cnnum.errors import RecordingError
        from cnnum.lab.reproduce.page import target_of
        from cnnum.safety.files import refuse_folder, refuse_target

        page = target_of(out)
        if page == out or out.exists():
            refuse_target(page, error=RecordingError, force=force)
        else:
            refuse_folder(out, error=RecordingError)
    with until_stopped() as stop, progress("items", len(chosen), as_json=as_json) as steps:
        for row in run(chosen):
            rows.append(row)
            output.record(row.record())
            steps.advance(row.item.name)
    output.show(_table(rows), _summary(rows))
    if stop.stopped:
        return stop.say(len(rows), len(chosen), "items", as_json=as_json)
    if out is not None:
        _write(out, rows, force, as_json)
    return CHECKS_FAILED if any(row.passed is False for row in rows) else 0


def _mutants(chosen: "tuple[Item, ...]", as_json: bool) -> int:
    from cnnum.lab.reproduce.faults import mutants as broken

    total, output = sum(len(item.faults) for item in chosen), Output(as_json)
    made: list[Mutant] = []
    with until_stopped() as stop, progress("mutants", total, as_json=as_json) as steps:
        for mutant in broken(chosen):
            made.append(mutant)
            output.record(mutant.record())
            steps.advance(mutant.item.name)
    stay = sum(mutant.passed for mutant in made)
    shown = table("Item", "broken", "fault", ">expected", ">got", ">tolerance", "")
    for mutant in made:
        shown.add_row(
            mutant.item.name,
            mutant.fault.target,
            mutant.fault.what,
            _expected(mutant.item),
            number(mutant.got, 4),
            number(mutant.item.tolerance, 2),
            _fate(mutant),
        )
    ran = [mutant for mutant in made if not mutant.missing]
    text = (
        f"{len(ran) - stay} of {len(ran)} faults made their check fail, of "
        f"{len({mutant.item.name for mutant in ran})} checks; "
        f"comparisons cannot fail ({sum(not item.faults for item in chosen)})."
    )
    output.show(
        shown, " ".join([text, *sorted({mutant.missing for mutant in made if mutant.missing})])
    )
    if stop.stopped:
        return stop.say(len(made), total, "mutants", as_json=as_json)
    return CHECKS_FAILED if stay else 0


def _fate(mutant: "Mutant") -> Text:
    if mutant.missing:
        return Text("not run", style="yellow")
    return Text("fell", style="green") if mutant.fell else Text("PASSED", style="bold red")


def _write(out: Path, rows: "list[Row]", force: bool, as_json: bool) -> None:
    from cnnum.lab.reproduce.page import figures_of, write_page

    made = figures_of(rows)
    with progress("figures", len(made), as_json=as_json) as steps:
        place = write_page(out, rows, made, steps.advance, force=force)
    Output(as_json).show(f"Written: {place}")


def _summary(rows: "list[Row]") -> str:
    checks = [row for row in rows if row.passed is not None]
    others = sum(row.item.kind == "comparison" for row in rows)
    missing = {row.missing for row in rows if row.missing}
    text = (
        f"{sum(bool(row.passed) for row in checks)} of {len(checks)} checks passed; "
        f"{others} comparisons."
    )
    return " ".join([text, *sorted(missing)])


def _table(rows: "list[Row]") -> Table:
    made = table("Item", ">published", ">ours", ">error", ">tolerance", "", "what")
    for row in rows:
        item = row.item
        made.add_row(
            item.name,
            _expected(item),
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


def _expected(item: "Item") -> str:
    if isinstance(item.expected, tuple):
        return f"{number(item.expected[0])}–{number(item.expected[1])}"
    sign = {"at least": "≥ ", "at most": "≤ "}.get(item.rule, "")
    return f"{sign}{number(item.expected, 4)}"


def _verdict(row: "Row") -> Text:
    if row.missing:
        return Text("not run", style="yellow")
    return Text("compared") if row.passed is None else verdict(row.passed)
