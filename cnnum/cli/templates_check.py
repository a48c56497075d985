"""`cnnum templates check`: every template against its closed form, on every engine."""

from dataclasses import asdict
from typing import TYPE_CHECKING

import click
from rich.table import Table

from cnnum.cli.options import json_option
from cnnum.cli.output import Output, console, number, quantity, table, verdict
from cnnum.cli.progress import progress

if TYPE_CHECKING:
    from cnnum.checks import CheckResult

CHECKS_FAILED = 1

WIDE = 112
"""Columns from which all of a check's figures fit side by side."""


def _shape(ctx: click.Context, parameter: click.Parameter, value: str) -> tuple[int, int]:
    rows, _, cols = value.lower().replace("×", "x").partition("x")
    if not (rows.isdigit() and cols.isdigit() and int(rows) and int(cols)):
        raise click.BadParameter(f"expected ROWSxCOLS, as in 8x8, got '{value}'.", ctx, parameter)
    return int(rows), int(cols)


@click.command("check")
@click.argument("names", nargs=-1, metavar="[NAMES]...")
@click.option("--engine", "engines", multiple=True, help="Again for more; all unless given.")
@click.option("--device", help="Part of the OpenCL device's name.")
@click.option("--precision", help="float32 or float64; each engine's own unless given.")
@click.option("--shape", default="8x8", callback=_shape, help="Array of the pictures: ROWSxCOLS.")
@click.option("--seed", default=0, type=click.IntRange(min=0), help="Of the random pictures.")
@click.option("--method", default="auto", help="Integration method.")
@click.option(
    "--repeats",
    default=3,
    show_default=True,
    type=click.IntRange(min=1),
    help="Timed runs; the run time is their median.",
)
@json_option
def check(
    names: tuple[str, ...],
    engines: tuple[str, ...],
    device: str | None,
    precision: str | None,
    shape: tuple[int, int],
    seed: int,
    method: str,
    repeats: int,
    as_json: bool,
) -> int:
    """Run templates on random pictures and compare them with their closed forms.

    NAMES are templates of the library, or tactile programs; all that have a check unless given.
    Exits with 1 if one fails.
    """
    from cnnum.checks import run_check
    from cnnum.checks.program_registry import checked_programs, program_forms
    from cnnum.checks.program_run import run_program_check
    from cnnum.engine import Engine
    from cnnum.engines.backend import backend_names
    from cnnum.library import get_template, template_names
    from cnnum.program_library import get_program

    programs = [name for name in names or checked_programs() if name in checked_programs()]
    forms = [form for name in programs for form in program_forms(name)]
    templates = [get_template(n) for n in names or template_names() if n not in programs]
    if not names:
        templates = [template for template in templates if template.check is not None]
    used = [
        Engine(name, device=device if name == "opencl" else None, precision=precision)
        for name in (backend_names() if "all" in engines or not engines else engines)
    ]
    output = Output(as_json)
    results: list[CheckResult] = []
    with progress("checks", (len(templates) + len(forms)) * len(used), as_json=as_json) as steps:
        for template in templates:
            for engine in used:
                results.append(
                    run_check(
                        template, engine, seed=seed, shape=shape, method=method, repeats=repeats
                    )
                )
                output.record(asdict(results[-1]))
                steps.advance(template.name)
        for form in forms:
            for engine in (engine for engine in used if engine.name in form.engines):
                program = get_program(form.program)
                result = run_program_check(form, program, engine, seed=seed, shape=shape)
                results.append(result)
                output.record(asdict(result))
                steps.advance(form.program)
    failed = sum(not result.passed for result in results)
    output.show(_table(results), f"{len(results) - failed} of {len(results)} passed.")
    return CHECKS_FAILED if failed else 0


def _table(results: "list[CheckResult]") -> Table:
    """Return all results; a narrow terminal gets no method and no closed form."""
    wide = console().width >= WIDE
    columns = ("Template", "engine", ">error", ">tolerance", ">run time", "result")
    made = table(*columns, *(("method", "closed form") if wide else ()))
    for result in results:
        made.add_row(
            result.template,
            f"{result.engine} {result.precision.removeprefix('float')}",
            number(result.error, 2),
            number(result.tolerance, 2),
            quantity(result.seconds, "s"),
            verdict(result.passed),
            *((result.method, result.check) if wide else ()),
        )
    return made
