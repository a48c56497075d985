"""`cnnum score`: how often slip and twist are right, where the truth is known."""

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, TypedDict, Unpack

import click
import rich.table
from rich.text import Text

from cnnum.cli.options import engine_options, force_option, json_option, page_option
from cnnum.cli.output import Output, progress, table
from cnnum.cli.signals import until_stopped

if TYPE_CHECKING:
    from cnnum.lab.scoring import Request, Table

AIMS_MISSED = 1

SUITES = ("families", "hands", "recordings")
STYLES = {True: "green", False: "bold red", None: ""}


class _Wanted(TypedDict):
    """The options that make a request."""

    suite: str | None
    count: int | None
    quick: bool
    seed: int | None
    leave_one_out: bool
    objects: str | None
    slip: str | None
    twist: str | None


@click.command("score")
@click.option(
    "--suite",
    type=click.Choice(SUITES),
    help="Suite; families by default, and recordings if CNNUM_RECORDINGS is set.",
)
@click.option("--count", type=click.IntRange(min=1), help="Scenes per family (20).")
@click.option("--quick", is_flag=True, help="Score one scene per family.")
@click.option(
    "--seed",
    type=click.IntRange(min=0),
    help="Seed of the first scene (1000000). Seeds below that are for tuning.",
)
@click.option(
    "--leave-one-out", is_flag=True, help="Also choose constants without each family in turn."
)
@click.option(
    "--objects",
    metavar="NAMES",
    help="Objects of the flat data set, such as 5,7 or all; by default all but 4, 9, 12 and 16.",
)
@click.option(
    "--slip",
    metavar="PROGRAM",
    help="Score your own program, FILE.py:FUNCTION, with the outputs of 'slip'.",
)
@click.option(
    "--twist", metavar="PROGRAM", help="Score your own program with the outputs of 'twist'."
)
@engine_options
@click.option("--strict", is_flag=True, help="Exit with 1 if a target is missed.")
@page_option
@force_option
@json_option
def command(
    engine: str | None,
    device: str | None,
    precision: str | None,
    strict: bool,
    out: Path | None,
    force: bool,
    as_json: bool,
    **wanted: Unpack[_Wanted],
) -> int:
    """Score slip and twist where the truth is known.

    The suite "families" simulates scenes with different pulls, objects, covers and taxels, and
    scenes without slip. The suite "hands" simulates situations that slip and twist meet in real
    hands, such as streams that begin with the object held, and arrays that measure fewer axes. The
    suite "recordings" replays the data sets in the folder that CNNUM_RECORDINGS names: uskin_grasp
    and a clone of tactile_prediction_flat_dataset.
    """
    from cnnum.engine import Engine
    from cnnum.lab.scoring import Gathered, score

    if wanted["quick"] and wanted["count"] is not None:
        raise click.UsageError("Give --quick or --count, not both.")
    request = _request(wanted)
    used = Engine(engine, device=device, precision=precision)
    output = Output(as_json)
    tables, done, gathered = list["Table"](), 0, Gathered()
    with (
        until_stopped() as stop,
        progress("families and trials", request.steps, as_json=as_json) as steps,
    ):

        def advance(name: str) -> None:
            nonlocal done
            done += 1
            steps.advance(name)

        tables = score(request, used, advance, gathered)
    if stop.stopped:
        _show_part(output, gathered.tables(used, request.programs))
        return stop.say(done, request.steps, "families and trials", as_json=as_json)
    _record(output, tables)
    aimed, missed = (sum(getattr(table, name) for table in tables) for name in ("aimed", "missed"))
    output.show(*_parts(tables), f"{aimed - missed} of {aimed} aims reached.")
    if out is not None:
        _write(out, tables, request, str(used.device), force)
        output.show(f"Written: {out}")
    return AIMS_MISSED if strict and missed else 0


def _record(output: Output, tables: "Sequence[Table]") -> None:
    for scores in tables:
        for record in scores.records():
            output.record(record)


def _show_part(output: Output, tables: "Sequence[Table]") -> None:
    """Show the figures of the work before a stop; a second Ctrl-C ends this, too."""
    _record(output, tables)
    output.show(*_parts(tables))


def _request(wanted: _Wanted) -> "Request":
    from cnnum.lab.scoring.suites import QUICK, SCORING, USUAL, Request
    from cnnum.scenes.arrangement import named as program_named

    known = os.environ.get("CNNUM_RECORDINGS", "")
    folder = Path(known) if known and Path(known).is_dir() else None
    usual = ("families", "recordings") if folder else ("families",)
    named = wanted["objects"]
    return Request(
        suites=(wanted["suite"],) if wanted["suite"] else usual,
        count=QUICK if wanted["quick"] else wanted["count"] or USUAL,
        seed=SCORING if wanted["seed"] is None else wanted["seed"],
        leave_one_out=wanted["leave_one_out"],
        recordings=folder,
        programs={
            name: program_named(place)
            for name, place in (("slip", wanted["slip"]), ("twist", wanted["twist"]))
            if place is not None
        },
        objects=tuple(name.strip() for name in named.split(",")) if named else None,
    )


def _write(
    out: Path, tables: "Sequence[Table]", request: "Request", device: str, force: bool
) -> None:
    from cnnum.lab.scoring.page import write_page
    from cnnum.report.environment import Environment

    write_page(out, tables, request, Environment.here(device), force=force)


def _parts(tables: "Sequence[Table]") -> list[rich.table.Table | str]:
    parts: list[rich.table.Table | str] = []
    for scores in tables:
        heads = [column.title for column in scores.columns]
        words = {
            c.title
            for c in scores.columns
            if any(isinstance(r.get(c.key), str) for r in scores.rows)
        }
        made = table(*(h if h in words else f">{h}" for h in heads), title=scores.title)
        for row in scores.rows:
            cells = ((column, row.get(column.key)) for column in scores.columns)
            made.add_row(*(Text(c.text(v), style=STYLES[scores.reached(c, row)]) for c, v in cells))
        parts += [made, scores.note]
    return parts
