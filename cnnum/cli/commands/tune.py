"""`cnnum tune`: the level of an event, and a few constants, from recordings of one's own."""

from pathlib import Path

import click

from cnnum.cli.options import (
    Changes,
    file_option,
    force_option,
    json_option,
    picture_option,
    scene_options,
    trust_option,
)
from cnnum.cli.output import Output, busy


@click.command("tune")
@click.argument("files", type=click.Path(path_type=Path), nargs=-1, required=True)
@click.option("--scene", default="slip", show_default=True, help="Scene file or name.")
@click.option("--event", default="", help="Event of the scene; by default the first with a level.")
@click.option(
    "--labels",
    type=click.Path(path_type=Path, dir_okay=False),
    help="CSV file with the columns recording, begin, end (s) and, if given, kind.",
)
@click.option(
    "--false-reports",
    type=click.FloatRange(1e-3, 1e3),
    default=2.0,
    show_default=True,
    help="Accepted false reports in ten minutes.",
)
@click.option(
    "--try",
    "tried",
    multiple=True,
    metavar="NAME=V,V…",
    help="Values of a parameter to try instead of the usual ones; may be repeated.",
)
@file_option("scene.toml", "Scene to write, for 'cnnum run' and 'cnnum replay'.")
@picture_option("--chart", "Draw false reports against level and delay.")
@scene_options
@trust_option
@force_option
@json_option
def command(
    files: tuple[Path, ...],
    scene: str,
    event: str,
    labels: Path | None,
    false_reports: float,
    tried: tuple[str, ...],
    out: Path,
    chart: Path | None,
    changes: Changes,
    trust: bool,
    force: bool,
    as_json: bool,
) -> None:
    """Choose the level of an event from the recordings FILES, and write a scene with it.

    Stretches without a label must be free of the event, but may contain holds, grips and pulls.
    With labels, some constants of the program are varied as well. Each recording is judged with the
    values chosen from the others.
    """
    output = Output(as_json)
    with busy("tuning", as_json=as_json):
        from cnnum.scenes.tuning import tune

        tuned = tune(
            files, scene, event=event, labels=labels or (), false_reports=false_reports,
            constants=_numbers(tried), changes=changes, trust=trust,
        )  # fmt: skip
    tuned.save(out, force=force)
    if chart is not None:
        from cnnum.report.read_outs import draw_tuned

        draw_tuned(chart, tuned, force=force)
    output.record({**tuned.record(), "file": str(out)}, f"{tuned}\nThe scene is in '{out}'.")


def _numbers(tried: tuple[str, ...]) -> dict[str, list[float]] | None:
    """Return the values of `--try` options, by parameter; None without any.

    Raises
    ------
    click.UsageError
        If one is not of the form NAME=V,V.
    """
    result: dict[str, list[float]] = {}
    for text in tried:
        name, _, values = text.partition("=")
        try:
            result[name] = [float(value) for value in values.split(",")]
        except ValueError:
            raise click.UsageError(
                f"Expected NAME=V,V…, as in 'look=0.04,0.16', got '{text}'."
            ) from None
    return result or None
