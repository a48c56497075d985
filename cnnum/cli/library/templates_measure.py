"""`cnnum templates measure`: writes the figures of templates into their files."""

from pathlib import Path

import click

from cnnum.cli.library.templates_choice import chosen
from cnnum.cli.options import completed, json_option
from cnnum.cli.output import Output, number, table
from cnnum.cli.progress import progress


@click.command("measure")
@click.argument("names", nargs=-1, metavar="[NAMES]...", shell_complete=completed("template"))
@click.option("--engine", default="numba", show_default=True, help="Engine to measure on.")
@click.option("--missing", is_flag=True, help="Measure only templates without up-to-date figures.")
@json_option
def measure(names: tuple[str, ...], engine: str, missing: bool, as_json: bool) -> None:
    """Measure templates and write the figures into the table [measured] of their files.

    NAMES are templates of the library, files or folders; by default the whole library. The figures
    are a digest of the numbers, mean and RMS of the end state, the margin, and the settling time
    on squares of 8, 12 and 16 cells.
    """
    from cnnum.engine import Engine
    from cnnum.templating.checks.measuring import measure as take
    from cnnum.templating.files import load_entry, write_measured

    used, output = Engine(engine), Output(as_json)
    files = [path for path in chosen(names) if not (missing and _known(path))]
    shown = table("Template", ">mean", ">rms", ">settle on 8", ">12", ">16", ">margin")
    with progress("templates", len(files), as_json=as_json) as steps:
        for path in files:
            template = load_entry(path).template
            found = take(template, used)
            write_measured(path, found)
            output.record({"template": template.name, "file": str(path), "margin": found.margin})
            times = [number(t, 3) for _, t in found.settle] + ["-"] * (3 - len(found.settle))
            margin = "-" if found.margin is None else number(found.margin, 3)
            shown.add_row(template.name, number(found.mean), number(found.rms), *times, margin)
            steps.advance(template.name)
    output.show(shown)


def _known(path: Path) -> bool:
    from cnnum.templating.files import load_entry

    entry = load_entry(path)
    return entry.measured is not None and entry.measured.digest == entry.template.digest
