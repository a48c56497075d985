"""`cnnum score`: how often slip and twist are right, where the truth is known."""

import os
from pathlib import Path
from typing import TYPE_CHECKING

import click
from rich.table import Table
from rich.text import Text

from cnnum.cli.options import json_option
from cnnum.cli.output import Output, number, table
from cnnum.cli.progress import progress
from cnnum.cli.stopping import until_stopped

if TYPE_CHECKING:
    from cnnum.lab.scoring import Measure, Report, Request
    from cnnum.lab.scoring.worst import Failing

TARGETS_MISSED = 1
SHOWN = 10
"""Scenes that went wrong in the table; --json and --out have all."""

SUITES = ("slip", "false-alarms", "recordings", "all")


@click.command("score")
@click.argument("scenes", nargs=-1, metavar="[SCENE]...")
@click.option("--suite", type=click.Choice(SUITES), help="All unless a SCENE is given.")
@click.option(
    "--count",
    type=click.IntRange(min=1),
    help="Generated scenes that slip, and a third as many that do not; 24 unless given.",
)
@click.option(
    "--seed",
    type=click.IntRange(min=0),
    help="Of the first generated scene. Below 1000000, which is where scoring begins unless "
    "given, they are for tuning.",
)
@click.option("--program", default="tactile", help="Program for the generated scenes.")
@click.option("--engine", help="Engine to run on: opencl, numba or reference.")
@click.option("--device", help="Part of the device's name.")
@click.option("--precision", help="float32 or float64.")
@click.option("--strict", is_flag=True, help="Exit with 1 if a target is missed.")
@click.option(
    "--out",
    type=click.Path(path_type=Path, dir_okay=False),
    metavar="FILE.html",
    help="Write a page with all figures.",
)
@json_option
def command(
    scenes: tuple[str, ...],
    suite: str | None,
    count: int | None,
    seed: int | None,
    program: str,
    engine: str | None,
    device: str | None,
    precision: str | None,
    strict: bool,
    out: Path | None,
    as_json: bool,
) -> int:
    """Score the tactile programs against scenes of which the truth is known.

    Each SCENE is a scene file or name whose array knows the truth (driver "simulated"), or a
    folder of labelled uSkin trials. Without one, generated scenes are scored, and the trials in
    the folder that CNNUM_RECORDINGS names. For figures to publish: --count 300.
    """
    from cnnum.engine import Engine
    from cnnum.lab.scoring import score

    if out is not None and not out.parent.is_dir():
        raise click.UsageError(f"There is no folder '{out.parent}' to write '{out.name}' to.")
    request = _request(scenes, suite, count, seed, program)
    used = Engine(engine, device=device, precision=precision)
    total = len(request.cases()) + len(request.scenes) + len(request.trials())
    output = Output(as_json)
    done = 0
    with until_stopped() as stop, progress("scenes", total, as_json=as_json) as steps:

        def advance(name: str) -> None:
            nonlocal done
            done += 1
            steps.advance(name)

        report = score(request, used, advance)
    if stop.stopped:
        return stop.say(done, total, "scenes, too few for a score", as_json=as_json)
    for record in report.records():
        output.record(record)
    output.show(*_parts(report))
    if out is not None:
        _write(out, report, request, str(used.device))
        output.show(f"Written: {out}")
    return TARGETS_MISSED if strict and report.missed else 0


def _request(
    scenes: tuple[str, ...], suite: str | None, count: int | None, seed: int | None, program: str
) -> "Request":
    """Return what is to be scored: names of folders are recordings, all other names scenes."""
    from cnnum.lab.scoring.generated.case import SCORING
    from cnnum.lab.scoring.suites import QUICK, Request

    folders = tuple(Path(name) for name in scenes if Path(name).is_dir())
    named = tuple(name for name in scenes if not Path(name).is_dir())
    known = os.environ.get("CNNUM_RECORDINGS", "")
    wants_trials = suite in ("recordings", "all") or (suite is None and not scenes)
    if wants_trials and not folders and known and Path(known).is_dir():
        folders = (Path(known),)
    generated = ("slip", "false-alarms") if suite == "all" or (suite is None and not scenes) else ()
    chosen = (suite,) if suite not in (None, "all") else generated
    return Request(
        suites=tuple(name for name in chosen if name),
        scenes=named,
        recordings=folders,
        count=QUICK if count is None else count,
        seed=SCORING if seed is None else seed,
        program=program,
    )


def _write(out: Path, report: "Report", request: "Request", device: str) -> None:
    from cnnum.lab.scoring.page import write_page
    from cnnum.report.environment import Environment

    write_page(out, report, request, Environment.here(device))


def _parts(report: "Report") -> list[Table | str]:
    whole = [measure for measure in report.measures if not measure.group]
    parts: list[Table | str] = [_table([measure for measure in whole if not measure.detail])]
    if report.failing:
        parts.append(_worst(report.failing[:SHOWN], len(report.failing)))
    aimed = [measure for measure in whole if measure.target is not None]
    reached = sum(measure.reached is True for measure in aimed)
    parts.append(f"{reached} of {len(aimed)} targets reached.")
    return parts


def _table(measures: "list[Measure]") -> Table:
    """Return the main figures; --json and --out have all."""
    made = table("Suite", "measure", ">value", "unit", ">target", ">count", "")
    for measure in measures:
        sign = "≥" if measure.rule == "at least" else "≤"
        made.add_row(
            measure.suite,
            measure.measure,
            number(measure.value, 4) if measure.count else "–",
            measure.unit,
            "" if measure.target is None else f"{sign} {measure.target:g}",
            str(measure.count),
            _verdict(measure.reached),
        )
    return made


def _verdict(reached: bool | None) -> Text:
    if reached is None:
        return Text("")
    return Text("reached", style="green") if reached else Text("MISSED", style="bold red")


def _worst(failing: "tuple[Failing, ...]", total: int) -> Table:
    made = table("Scene", "what went wrong", "about", title=f"The worst of {total} scenes")
    for item in failing:
        about = ", ".join(f"{key} {value}" for key, value in item.about.items())
        made.add_row(item.name, "; ".join(item.wrong), about)
    return made
