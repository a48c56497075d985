"""`cnnum templates analyse NAME`."""

from dataclasses import asdict
from typing import TYPE_CHECKING

import click

from cnnum.cli.library.templates_check import array_shape
from cnnum.cli.library.templates_choice import is_place
from cnnum.cli.options import completed, json_option
from cnnum.cli.output import Output, facts, table

if TYPE_CHECKING:
    from cnnum.runs.analysis import Analysis


@click.command("analyse")
@click.argument("name", shell_complete=completed("template", files=True))
@click.option("--shape", default="8x8", callback=array_shape, help="Size of the array, ROWSxCOLS.")
@json_option
def analyse(name: str, shape: tuple[int, int], as_json: bool) -> None:
    """Show the properties of a template before it runs.

    These are its rates and stiffness, the longest stable step of every method, its stability class
    with the reason, and the effect of saturation. NAME is a template of the library, a file, or a
    program, of which every template is shown.
    """
    from cnnum.runs.analysis import step, text

    output = Output(as_json)
    for one in _analysed(name, shape):
        output.record(_record(one))
        rows, cols = one.shape
        output.show(facts([("template", f"{one.template} on {rows}×{cols}"), *text(one)]), "")
        shown = table("Method", ">longest stable step")
        for method, bound in one.bounds.items():
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


def _record(one: "Analysis") -> dict[str, object]:
    """Return the record, with the step of each method in place of its bound."""
    found: dict[str, object] = asdict(one)
    del found["bounds"]
    return found | {"steps": {name: bound.step for name, bound in one.bounds.items()}}
