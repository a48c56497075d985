"""`cnnum templates measure`, `audit` and `analyse`: what is known of templates."""

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

import click

from cnnum.cli.commands.templates_check import array_shape
from cnnum.cli.commands.templates_convert import chosen, is_place
from cnnum.cli.options import completed, json_option
from cnnum.cli.output import Output, facts, number, progress, table

if TYPE_CHECKING:
    from cnnum.runs.analysis import Analysis


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
    from cnnum.templating.checks.running import measure as take
    from cnnum.templating.files import load_entry, write_measured

    used, output = Engine(engine), Output(as_json)
    files = [path for path in chosen(names) if not (missing and _known(path))]
    shown = table("Template", ">mean", ">rms", ">settle on 8", ">12", ">16", ">margin")
    with progress("templates", len(files), as_json=as_json) as steps:
        for path in files:
            template = load_entry(path).template
            measured = take(template, used)
            write_measured(path, measured)
            output.record({"template": template.name, "file": str(path), "margin": measured.margin})
            times = [number(t, 3) for _, t in measured.settle] + ["-"] * (3 - len(measured.settle))
            margin = "-" if measured.margin is None else number(measured.margin, 3)
            shown.add_row(
                template.name, number(measured.mean), number(measured.rms), *times, margin
            )
            steps.advance(template.name)
    output.show(shown)


def _known(path: Path) -> bool:
    from cnnum.templating.files import load_entry

    entry = load_entry(path)
    return entry.measured is not None and entry.measured.digest == entry.template.digest


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
    from cnnum.templating.checks.running import audit as wrong_cells
    from cnnum.templating.files import load_entry

    used, output, files = Engine(engine), Output(as_json), chosen(names)
    shown = table("Template", ">own", "published", ">cells", ">wrong with 0", ">-1", ">zero-flux")
    with progress("templates", len(files), as_json=as_json) as steps:
        for entry in map(load_entry, files):
            wrong = wrong_cells(entry.template, used)
            if wrong is not None:
                published = entry.about.published_boundary
                output.record({**asdict(wrong), "published": published})
                counts = map(str, wrong.wrong)
                own = str(wrong.boundary)
                shown.add_row(wrong.template, own, published, str(wrong.cells), *counts)
            steps.advance(entry.template.name)
    output.show(shown)


@click.command("analyse")
@click.argument("name", shell_complete=completed("template", files=True))
@click.option("--shape", default="8x8", callback=array_shape, help="Size of the array, ROWSxCOLS.")
@json_option
def analyse(name: str, shape: tuple[int, int], as_json: bool) -> None:
    """Show the properties of a template before it runs.

    These are its rates and stiffness, the longest stable step of every method, its stability class
    with the reason, and the effect of saturation. NAME is a template of the library, a file, or a
    program, whose templates are all shown.
    """
    from cnnum.runs.analysis import step, text

    output = Output(as_json)
    for analysis in _analysed(name, shape):
        output.record(_record(analysis))
        rows, cols = analysis.shape
        output.show(
            facts([("template", f"{analysis.template} on {rows}×{cols}"), *text(analysis)]), ""
        )
        shown = table("Method", ">longest stable step")
        for method, bound in analysis.bounds.items():
            shown.add_row(method, step(bound, method))
        output.show(shown)


def _analysed(name: str, shape: tuple[int, int]) -> "tuple[Analysis, ...]":
    from cnnum.programs.library import get_program, program_names
    from cnnum.runs.analysis import analyse, analyse_program
    from cnnum.templating.files import load_template

    if is_place(name):
        return (analyse(load_template(name), shape),)
    if name in program_names():
        return analyse_program(get_program(name), shape)
    return (analyse(name, shape),)


def _record(analysis: "Analysis") -> dict[str, object]:
    """Return the record, with the step of each method in place of its bound."""
    result: dict[str, object] = asdict(analysis)
    del result["bounds"]
    return result | {"steps": {name: bound.step for name, bound in analysis.bounds.items()}}
