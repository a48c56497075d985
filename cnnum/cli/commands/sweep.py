"""`cnnum sweep`: an experiment over weights, sizes, noise and mismatch, here or on a cluster."""

from pathlib import Path
from typing import Any

import click

from cnnum.cli.options import force_option, json_option, to_write
from cnnum.cli.output import Output, facts, number, progress, quantity

RUNS_FAILED = 1
"""Exit code where all of them did."""


def _to_write(ctx: click.Context, _: click.Parameter, output: Path | None) -> Path | None:
    """Return the file or folder to write, refusing before the work one that cannot be written."""
    if output is not None:
        from cnnum.design.sweeping import refuse_results

        refuse_results(output, force=bool(ctx.params.get("force")))
    return output


@click.command("sweep")
@click.argument("experiment", type=click.Path(path_type=Path, dir_okay=False))
@click.option(
    "--output",
    type=click.Path(path_type=Path),
    callback=_to_write,
    help="File for the results, .nc or .zarr.",
)
@click.option("--scheduler", help="Address of a Dask scheduler, such as tcp://host:8786.")
@click.option("--engine", help="Engine to use instead of the experiment's.")
@click.option(
    "--page",
    type=click.Path(path_type=Path, dir_okay=False),
    callback=to_write,
    help="Also write an HTML page with pictures.",
)
@force_option
@json_option
def command(
    experiment: Path,
    output: Path | None,
    scheduler: str | None,
    engine: str | None,
    page: Path | None,
    force: bool,
    as_json: bool,
) -> int:
    """Run the sweep of the TOML file EXPERIMENT.

    Results go to the file of --output, or to the folder of the experiment. If a sweep is killed,
    run it again: it continues where it stopped and produces the same file. Failed runs are counted
    separately, with their reasons; if all runs fail, the exit code is 1.
    """
    from dataclasses import replace

    from cnnum.design.experiment import load_experiment
    from cnnum.design.sweeping import failures, sweep
    from cnnum.templating.checks.robustness import wilson

    wanted = load_experiment(experiment)
    if engine is not None:
        wanted = replace(wanted, engine=engine)
    shown = Output(as_json)
    with progress("tasks", None, as_json=as_json) as steps:
        outcome = sweep(
            wanted,
            output or experiment.with_suffix(".nc"),
            scheduler=scheduler,
            force=force,
            done=lambda n, total: steps.advance(f"{n} of {total} tasks"),
        )
    flips = outcome.results["flipped"]
    judged = int(flips.notnull().sum())
    rate = float(flips.mean())
    low, high = wilson(round(float(flips.sum())), judged) if judged else (rate, rate)
    record: dict[str, Any] = {
        "runs": wanted.runs,
        "judged": judged,
        "failed": int((outcome.results["failed"] > 0).sum()),
        "reasons": failures(outcome.results),
        "file": str(outcome.path),
        "tasks": outcome.tasks,
        "run_now": outcome.run_now,
        "seconds": outcome.seconds,
        "task_seconds": outcome.task_seconds,
        "flip_rate": rate,
        "flip_rate_low": low,
        "flip_rate_high": high,
        "wrong": float(outcome.results["wrong"].mean()),
    }
    if page is not None:
        from cnnum.report.sweep_page import write_page

        record["page"] = str(write_page(page, outcome.results, force=force))
    shown.record(record)
    shown.show(facts(_lines(record)))
    return RUNS_FAILED if record["failed"] == wanted.runs else 0


def _lines(record: dict[str, Any]) -> list[tuple[str, str]]:
    rate, low, high = (
        number(100 * record[key]) for key in ("flip_rate", "flip_rate_low", "flip_rate_high")
    )
    flip = f"{rate} % ({low}-{high} with 95 % confidence)"
    if not record["judged"]:
        flip = "not known: the template's check ends before cells saturate"
        if record["failed"]:
            flip = "not known: no run was judged"
    a_task = quantity(record["task_seconds"], "s")
    failed = [("failed", f"{count:,}: {why}") for why, count in record["reasons"].items()]
    return [
        ("runs", f"{record['runs']:,} in {record['tasks']} tasks, {record['run_now']} of them now"),
        *failed,
        ("took", f"{quantity(record['seconds'], 's')}, {a_task} a task"),
        ("templates that flip", flip),
        ("file", str(record["file"])),
    ]
