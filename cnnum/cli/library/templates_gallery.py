"""`cnnum templates gallery`: one page of all templates."""

from functools import partial
from pathlib import Path

import click

from cnnum.cli.library.templates_choice import chosen
from cnnum.cli.options import completed, file_option, force_option, json_option
from cnnum.cli.output import Output
from cnnum.cli.progress import progress


@click.command("gallery")
@click.argument("names", nargs=-1, metavar="[NAMES]...", shell_complete=completed("template"))
@file_option("gallery.html", "The page's file.")
@click.option("--engine", default="numba", show_default=True, help="Engine to run on.")
@force_option
@json_option
def gallery(names: tuple[str, ...], out: Path, engine: str, force: bool, as_json: bool) -> None:
    """Write one searchable page of templates with pictures, numbers and checks.

    NAMES are templates, files or folders; by default the whole library. The page needs no other
    file and no network.
    """
    from cnnum.engine import Engine
    from cnnum.report.gallery import Card, filmstrip, gallery_page
    from cnnum.safety.files import write_whole
    from cnnum.templating.checks import run_check
    from cnnum.templating.files import load_entry

    used, files, found = Engine(engine), chosen(names), list[Card]()
    check = partial(run_check, engine=used, repeats=1)
    with progress("templates", len(files), as_json=as_json) as steps:
        for path in files:
            entry = load_entry(path)
            result = check(entry.template, measured=entry.measured)
            strip = filmstrip(entry.template, used)
            found.append(Card(entry, path.parent.name, strip, result))
            steps.advance(entry.template.name)
    write_whole(out, gallery_page(found), force=force)
    done = {"templates": len(found), "file": str(out)}
    Output(as_json).record(done, f"{len(found)} templates: {out}")
