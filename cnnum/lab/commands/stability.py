"""`cnnum stability`: networks and programs that are stiff, marginal or extreme."""

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import click
from rich.table import Table
from rich.text import Text

from cnnum.cli.options import engine_options, force_option, json_option, page_option
from cnnum.cli.output import Output, number, progress, table, verdict

if TYPE_CHECKING:
    from cnnum.lab.stability import Case, Row

CHECKS_FAILED = 1


@click.command("stability")
@click.argument("cases", nargs=-1, metavar="[CASES]...")
@engine_options
@page_option
@force_option
@json_option
def command(
    cases: tuple[str, ...],
    engine: str | None,
    device: str | None,
    precision: str | None,
    out: Path | None,
    force: bool,
    as_json: bool,
) -> int:
    """Run stiff, marginal and extreme cases on every engine.

    A case passes if its error is within the tolerance, or if it is refused for the right reason. It
    fails if an answer is wrong or not a number, or takes longer than a minute.

    CASES are families (stiff, marginal, extreme, precision) or beginnings of names; by default
    all. The exit code is 1 if a case fails.
    """
    from cnnum.errors import name_error
    from cnnum.lab.stability import ENGINES, select

    chosen = select(cases)
    pairs = [p for p in ENGINES if engine in (None, p[0]) and precision in (None, p[1])]
    if not pairs:
        known = [" in ".join(pair) for pair in ENGINES]
        raise name_error("engine and precision", f"{engine} in {precision}", known)
    output, rows = Output(as_json), list["Row"]()
    total = sum(not _left_out(case, name) for name, _ in pairs for case in chosen)
    try:
        with progress("cases", total, as_json=as_json) as steps:
            for row in _rows(chosen, pairs, device):
                rows.append(row)
                output.record(row.record())
                steps.advance(row.case)
    finally:
        _show(output, rows)
    if out is not None:
        from cnnum.lab.stability.page import write_page

        output.show(f"Written: {write_page(out, rows, force=force)}")
    return CHECKS_FAILED if any(not row.passed for row in rows) else 0


def _left_out(case: "Case", engine: str) -> bool:
    return engine == "reference" and bool(case.slow)


def _rows(
    cases: "tuple[Case, ...]", pairs: list[tuple[str, str]], device: str | None
) -> "Iterator[Row]":
    from cnnum.engines.registry import device_for
    from cnnum.lab.stability import run

    for engine, precision in pairs:
        some = [case for case in cases if not _left_out(case, engine)]
        yield from run(some, engine, precision, device_for(engine, device))


def _show(output: Output, rows: "list[Row]") -> None:
    """Show the sums of families, and every case that failed; --json and --out have all rows."""
    failed = [row for row in rows if not row.passed]
    if rows:
        output.show(_sums(rows))
    if failed:
        output.show(_table(failed))
    refused = sum(row.passed and row.outcome == "refused" for row in rows)
    cases = len({row.case for row in rows})
    output.show(
        f"{len(rows) - len(failed)} of {len(rows)} runs of {cases} cases passed; {refused} of them "
        f"are refused for the right reason. They took {sum(row.seconds for row in rows):.0f} s."
    )


def _sums(rows: "list[Row]") -> Table:
    made = table(
        "Engine", "precision", "family", ">solved", ">refused", ">failed", ">worst", "case"
    )
    for kind in dict.fromkeys((row.engine, row.precision, row.family) for row in rows):
        mine = [row for row in rows if (row.engine, row.precision, row.family) == kind]
        solved = [row for row in mine if row.passed and row.outcome == "solved"]
        worst = max(solved, key=lambda row: row.share, default=None)
        made.add_row(
            *kind,
            str(len(solved)),
            str(sum(row.passed and row.outcome == "refused" for row in mine)),
            str(sum(not row.passed for row in mine)),
            "" if worst is None else f"{100.0 * worst.share:.0f} %",
            "" if worst is None else worst.case,
        )
    return made


def _table(rows: "list[Row]") -> Table:
    made = table("Case", "engine", "precision", "outcome", ">error", ">tolerance", "", "why")
    for row in rows:
        made.add_row(
            row.case,
            row.engine,
            row.precision,
            row.outcome,
            number(row.error) if row.outcome == "solved" else "",
            number(row.tolerance),
            verdict(row.passed),
            Text(row.why),
        )
    return made
