"""`cnnum templates check`: every template against its closed form, on every engine."""

import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import click
from rich.table import Table

from cnnum.cli.commands.templates_convert import chosen, is_place
from cnnum.cli.commands.templates_design import report
from cnnum.cli.options import completed, json_option
from cnnum.cli.output import Output, console, number, progress, quantity, table, verdict
from cnnum.cli.signals import until_stopped
from cnnum.errors import CnnumError, NotSupportedError, OneColourError, UnknownNameError
from cnnum.safety.values import visible

if TYPE_CHECKING:
    from cnnum.engine import Engine
    from cnnum.templating.checks import CheckResult
    from cnnum.templating.checks.program_run import ProgramForm
    from cnnum.templating.files import Entry

CHECKS_FAILED = 1

WIDE = 112
"""Columns from which all of a check's figures fit side by side."""


def array_shape(ctx: click.Context, parameter: click.Parameter, value: str) -> tuple[int, int]:
    """Return the rows and columns in an option's text."""
    rows, _, cols = value.lower().replace("×", "x").partition("x")
    if not (rows.isdigit() and cols.isdigit() and int(rows) and int(cols)):
        raise click.BadParameter(f"expected ROWSxCOLS, as in 8x8, got '{value}'.", ctx, parameter)
    return int(rows), int(cols)


@click.command("check")
@click.argument(
    "names", nargs=-1, metavar="[NAMES]...", shell_complete=completed("template", files=True)
)
@click.option(
    "--engine", "engines", multiple=True, help="Engine to run on; may be repeated; all by default."
)
@click.option("--device", help="Part of the OpenCL device's name.")
@click.option("--precision", help="float32 or float64; by default that of each engine.")
@click.option(
    "--shape", default="8x8", callback=array_shape, help="Size of the pictures, ROWSxCOLS."
)
@click.option("--seed", default=0, type=click.IntRange(min=0), help="Seed of the random pictures.")
@click.option("--method", default="auto", help="Integration method.")
@click.option(
    "--repeats",
    default=3,
    show_default=True,
    type=click.IntRange(min=1),
    help="Number of timed runs, of which the median is shown.",
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

    NAMES are templates of the library, template files, folders of files, or tactile programs; by
    default all that have a check. Templates with measured figures must also reproduce them. For a
    single file, the command also shows stability, steps, robustness and cost. A check whose correct
    outputs all have one colour proves nothing and is refused. The exit code is 1 if a check fails
    or is refused.
    """
    used = _engines(engines, device, precision)
    jobs, left_out = _planned(names, used, shape, seed, method, repeats)
    for name in engines:
        if name != "all" and name not in {job.engine for job in jobs}:
            raise _nothing(name, left_out)
    output, begin = Output(as_json), time.perf_counter()
    alone, plain = _alone(names), used[-1 if len(used) < 3 else 1]
    if alone is not None and alone.template.check is None:
        report(alone.template, plain, output)
    results: list[CheckResult] = []
    refused = dict[str, None]()
    with until_stopped() as stop, progress("checks", len(jobs), as_json=as_json) as steps:
        for job in jobs:
            try:
                results.append(job.run())
            except OneColourError as error:
                if len({planned.name for planned in jobs}) == 1:
                    raise
                refused[str(error)] = None
            else:
                output.record(asdict(results[-1]))
            steps.advance(job.name)
    failed = sum(not result.passed for result in results)
    total = quantity(time.perf_counter() - begin, "s")
    passed = f"{len(results) - failed} of {len(results)} passed. The checks took {total}."
    output.show(_table(results), passed, *_notes(results))
    for sentence in refused:
        click.echo(visible(sentence), err=True)
    if stop.stopped:
        return stop.say(len(results), len(jobs), "checks", as_json=as_json)
    for item in left_out:
        if as_json:
            click.echo(visible(item.text), err=True)
        output.show(item.text)
    if alone is not None and not as_json:
        report(alone.template, plain, output)
    return CHECKS_FAILED if failed or refused else 0


def _alone(names: tuple[str, ...]) -> "Entry | None":
    """Return the template of a single file; a designer asks more about it."""
    if len(names) != 1 or not is_place(names[0]) or not Path(names[0]).is_file():
        return None
    return _entries(names[0])[0]


def _engines(names: tuple[str, ...], device: str | None, precision: str | None) -> "list[Engine]":
    """Return the engines of those names; of all where none is named, those that work here."""
    from cnnum.engine import Engine
    from cnnum.engines.registry import backend_names, device_for, record_named

    if names and "all" not in names:
        return [
            Engine(name, device=device_for(name, device), precision=precision) for name in names
        ]
    fast = Engine(device=device, precision=precision)
    hosts = (name for name in backend_names() if not record_named(name).devices)
    others = (name for name in hosts if name != fast.name)
    return [fast, *(Engine(name, precision=precision) for name in others)]


@dataclass(frozen=True, slots=True)
class _Job:
    """One check on one engine."""

    name: str
    engine: str
    run: "Callable[[], CheckResult]"


@dataclass(frozen=True, slots=True)
class _LeftOut:
    """A check that some of the engines asked for are too slow for."""

    form: "ProgramForm"
    engines: tuple[str, ...]

    @property
    def text(self) -> str:
        """For people."""
        on = " and ".join(self.engines)
        return f"Left out: {self.form.program} on {on} ({self.form.left_out})."


def _planned(
    names: tuple[str, ...],
    used: "Sequence[Engine]",
    shape: tuple[int, int],
    seed: int,
    method: str,
    repeats: int,
) -> tuple[list[_Job], list[_LeftOut]]:
    """Return the checks to run, and those left out."""
    from cnnum.programs.library import get_program
    from cnnum.templating.checks import run_check
    from cnnum.templating.checks.program_registry import checked_programs, program_forms
    from cnnum.templating.checks.program_run import run_program_check
    from cnnum.templating.library import template_names

    programs = [name for name in names or checked_programs() if name in checked_programs()]
    listed = [n for n in names or template_names() if n not in programs]
    jobs = list[_Job]()
    # the engine that figures are measured on compares all of them
    usual = next((engine for engine in used if engine.name == "numba"), None)
    for entry in (entry for name in listed for entry in _entries(name)):
        template = entry.template
        if names or template.check is not None:
            run = partial(
                run_check,
                template,
                seed=seed,
                shape=shape,
                method=method,
                repeats=repeats,
                measured=entry.measured,
            )
            jobs += [
                _Job(
                    template.name,
                    engine.name,
                    partial(run, engine=engine, thorough=engine is usual),
                )
                for engine in used
            ]
    left_out = list[_LeftOut]()
    for form in (form for name in programs for form in program_forms(name)):
        run = partial(run_program_check, form, get_program(form.program), seed=seed, shape=shape)
        runs = [engine for engine in used if engine.name not in form.too_slow]
        jobs += [_Job(form.program, engine.name, partial(run, engine=engine)) for engine in runs]
        if slow := tuple(engine.name for engine in used if engine.name in form.too_slow):
            left_out.append(_LeftOut(form, slow))
    return jobs, left_out


def _entries(name: str) -> "list[Entry]":
    """Return the templates of a name, a file or a folder, or say that a program has no check."""
    from cnnum.programs.library import program_names
    from cnnum.templating.files import load_entry
    from cnnum.templating.library import get_entry

    if is_place(name):
        return [load_entry(path) for path in chosen((name,))]
    try:
        return [get_entry(name)]
    except UnknownNameError:
        if name not in program_names():
            raise
        raise NotSupportedError(
            f"The program '{name}' has no check: expected a template, or one of the programs "
            f"{', '.join(program_names('tactile'))}."
        ) from None


def _nothing(engine: str, left_out: "Sequence[_LeftOut]") -> CnnumError:
    """Return the error of an engine that was asked for and checks nothing."""
    from cnnum.engines.registry import backend_names

    forms = [item.form for item in left_out if engine in item.engines]
    programs = ", ".join(dict.fromkeys(form.program for form in forms))
    slow = {name for form in forms for name in form.too_slow}
    able = ", ".join(name for name in backend_names() if name not in slow)
    return NotSupportedError(
        f"'{engine}' cannot check {programs} ({forms[0].left_out}): use one of {able}, or give "
        "other names."
    )


def _table(results: "list[CheckResult]") -> Table:
    """Return all results; a narrow terminal gets neither tolerance nor closed form."""
    wide = console().width >= WIDE
    columns = ("Template", "engine", ">error", ">margin", ">settle", ">run time", "result")
    made = table(*columns, *((">tolerance", "method", "closed form") if wide else ()))
    for result in results:
        made.add_row(
            result.template,
            f"{result.engine} {result.precision.removeprefix('float')}",
            number(result.error, 2),
            _figure(result.margin),
            _figure(result.settle),
            quantity(result.seconds, "s"),
            verdict(result.passed),
            *((number(result.tolerance, 2), result.method, result.check) if wide else ()),
        )
    return made


def _figure(value: float | None) -> str:
    return "" if value is None else number(value, 3)


def _notes(results: "list[CheckResult]") -> list[str]:
    """Return the differences from the measured figures, a line each."""
    return [
        f"{result.template} on {result.engine}: {result.note}." for result in results if result.note
    ]
