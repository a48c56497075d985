"""`cnnum templates audit`: wrong cells with the boundaries 0, -1 and zero-flux."""

from dataclasses import asdict

import click

from cnnum.cli.library.templates_choice import chosen
from cnnum.cli.options import completed, json_option
from cnnum.cli.output import Output, table
from cnnum.cli.progress import progress


@click.command("audit")
@click.argument("names", nargs=-1, metavar="[NAMES]...", shell_complete=completed("template"))
@click.option("--engine", default="numba", show_default=True, help="Engine to run on.")
@json_option
def audit(names: tuple[str, ...], engine: str, as_json: bool) -> None:
    """Count the cells that templates get wrong with the boundaries 0, -1 and zero-flux.

    NAMES are templates, files or folders; by default the whole library. The pictures have 12×12
    cells with objects that touch the frame, and the check of a template defines the right answer.
    Templates with a gray answer are left out.
    """
    from cnnum.engine import Engine
    from cnnum.templating.checks.audit import audit as wrong_cells
    from cnnum.templating.files import load_entry

    used, output, files = Engine(engine), Output(as_json), chosen(names)
    shown = table("Template", ">own", "published", ">cells", ">wrong with 0", ">-1", ">zero-flux")
    with progress("templates", len(files), as_json=as_json) as steps:
        for entry in map(load_entry, files):
            found = wrong_cells(entry.template, used)
            if found is not None:
                published = entry.about.published_boundary
                output.record({**asdict(found), "published": published})
                counts = map(str, found.wrong)
                own = str(found.boundary)
                shown.add_row(found.template, own, published, str(found.cells), *counts)
            steps.advance(entry.template.name)
    output.show(shown)
