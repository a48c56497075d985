"""`cnnum process`: a scene over many recordings, into one table of events."""

from pathlib import Path

import click

from cnnum.cli.options import Changes, force_option, json_option, scene_options, trust_option
from cnnum.cli.output import Output, facts, progress, quantity

ALL_FAILED = 1
"""Exit code where no recording could be processed."""


@click.command("process")
@click.argument("sources", nargs=-1, required=True)
@click.option("--scene", required=True, help="Scene file or name; its array is replaced.")
@click.option(
    "--out",
    "--output",
    required=True,
    type=click.Path(path_type=Path, dir_okay=False),
    help="Table of the events, .parquet or .csv; that of the recordings is written next to it.",
)
@click.option(
    "--fields",
    type=click.Path(path_type=Path),
    metavar="FOLDER.zarr",
    help="Also write the fields that the scene needs, in one group per recording.",
)
@click.option(
    "--workers",
    type=click.IntRange(min=1),
    default=1,
    show_default=True,
    help="Number of processes on this machine.",
)
@click.option("--scheduler", help="Address of a Dask scheduler, such as tcp://host:8786.")
@scene_options
@trust_option
@force_option
@json_option
def command(
    sources: tuple[str, ...],
    scene: str,
    out: Path,
    fields: Path | None,
    workers: int,
    scheduler: str | None,
    changes: Changes,
    trust: bool,
    force: bool,
    as_json: bool,
) -> int:
    """Run a scene over all recordings that SOURCES name.

    SOURCES are files, folders, patterns in quotes such as "day*/*.mcap", and addresses such as
    "s3://bucket/day1/". If the command is killed, run it again: it continues where it stopped and
    produces the same tables. A recording that cannot be read becomes a row with the reason; if none
    can be read, the exit code is 1.
    """
    from cnnum.scenes.processing import process

    with progress("recordings", None, as_json=as_json) as steps:
        made = process(
            sources,
            scene,
            out,
            changes=changes,
            fields=fields,
            workers=workers,
            scheduler=scheduler,
            trust=trust,
            force=force,
            done=lambda n, total: steps.advance(f"{n} of {total} recordings"),
        )
    shown = Output(as_json)
    shown.record(
        {
            "recordings": made.count,
            "failed": made.failed,
            "frames": made.frames,
            "events": made.events_count,
            "run_now": made.run_now,
            "seconds": made.seconds,
            "file": str(made.events),
            "recordings_file": str(made.recordings),
            **({} if made.fields is None else {"fields": str(made.fields)}),
        }
    )
    failed = f", {made.failed:,} could not be processed" if made.failed else ""
    lines = [
        ("recordings", f"{made.count:,}, {made.run_now:,} of them now{failed}"),
        ("frames", f"{made.frames:,}"),
        ("events", f"{made.events_count:,} in {made.events}"),
        ("rows of recordings", str(made.recordings)),
        *([] if made.fields is None else [("fields", str(made.fields))]),
        ("took", quantity(made.seconds, "s")),
    ]
    shown.show(facts(lines))
    return ALL_FAILED if made.failed == made.count else 0
