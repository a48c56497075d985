"""`cnnum templates design`: a template from its specification, or the figures of one."""

import math
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from cnnum.cli.commands.templates_convert import is_place
from cnnum.cli.options import completed, force_option, json_option
from cnnum.cli.output import Output, facts, number, progress, table
from cnnum.cli.signals import STOPPED, stop_wanted

if TYPE_CHECKING:
    from cnnum.design.search import Advance
    from cnnum.engine import Engine
    from cnnum.templating.checks.robustness import Flips
    from cnnum.templating.template import Template

_UNCHECKED = (
    "Settling times are those of black-and-white pictures. Margin and robustness need the "
    "right answer: name a check in [check]."
)

_DRAWS = 50
"""Templates with random mismatch: their share that flips is known within about 0.14."""


@click.command("design")
@click.argument("name", shell_complete=completed("template", files=True))
@click.option("--engine", default="numba", show_default=True, help="Engine to run on.")
@click.option(
    "--weights", is_flag=True, help="Show how far each weight may change before a cell is wrong."
)
@click.option(
    "--output",
    type=click.Path(file_okay=False, path_type=Path),
    default=Path(),
    help="Folder for the designed templates; the current one by default.",
)
@force_option
@json_option
def design(name: str, engine: str, weights: bool, output: Path, force: bool, as_json: bool) -> int:
    """Design templates from the specification NAME, or show how robust the template NAME is.

    A specification is a TOML file with a rule in a table [design], tables [[example]], a table
    [search] for coupled templates, or a table [learn] for gradients. The designed templates are
    written as files with their proof. Ctrl-C ends a search, or the training of a template, with the
    best one so far.

    For a template of the library or a file, the command shows the stability class with the reason,
    the largest stable Euler step, settling time against array size, margin, cost, and how often
    cells flip under mismatch and with coarse weights.
    """
    from cnnum.design.designing import is_spec
    from cnnum.engine import Engine
    from cnnum.templating.files import load_template
    from cnnum.templating.library import get_template

    if is_place(name) and is_spec(name):
        return _design(name, Engine(engine), output, Output(as_json), force)
    template = load_template(name) if is_place(name) else get_template(name)
    report(template, Engine(engine), Output(as_json), weights=weights)
    return 0


def _design(name: str, engine: "Engine", folder: Path, output: Output, force: bool) -> int:
    """Design the templates of a specification, write them, and show their proofs."""
    from cnnum.design.designing import designed, load_spec
    from cnnum.errors import TemplateFileError
    from cnnum.safety.files import make_folder, named_after, refuse_target, sentences
    from cnnum.templating.files import save_entry

    spec = load_spec(name)
    with sentences(folder, TemplateFileError):
        make_folder(folder)
    if not spec.split:  # the files of a sequence are known when it is
        path = named_after(folder, spec.name, ".toml")
        refuse_target(path, error=TemplateFileError, force=force)
    stopped = ""
    with progress("designing", None, as_json=output.as_json) as steps, stop_wanted() as wanted:

        def watch(advance: "Advance") -> bool:
            nonlocal stopped
            steps.advance(str(advance))
            stopped = str(advance) if wanted() else ""
            return not stopped

        made = designed(spec, engine, watch)
    designs = {named_after(folder, design.entry.template.name, ".toml"): design for design in made}
    for path in designs:  # all are looked at before one is written
        refuse_target(path, error=TemplateFileError, force=force)
    columns = (">examples", ">margin", ">relative", ">at most", ">worst case", ">flips at", "file")
    shown = table("Template", *columns)
    for path, design in designs.items():
        proof, template = design.entry.proof, design.entry.template
        assert proof is not None
        save_entry(design.entry, path, force=force)
        output.record({"template": template.name, "file": str(path), **asdict(proof)})
        rates = ", ".join(
            f"{100 * f.mismatch:g} %: {100 * f.rate:.0f} % ({100 * f.low:.0f}-{100 * f.high:.0f})"
            for f in proof.flips
        )
        shown.add_row(
            template.name,
            str(proof.examples),
            number(proof.margin),
            number(proof.relative_margin, 4),
            "?" if proof.bound is None else number(proof.bound, 4),
            "?" if proof.worst_case is None else f"{_below(proof.worst_case)} %",
            rates,
            str(path),
        )
    output.show(shown)
    if stopped:
        click.echo(
            f"Stopped at {stopped}: the best template so far is written.", err=output.as_json
        )
    return STOPPED if stopped else 0


def report(
    template: "Template", engine: "Engine", output: Output, *, weights: bool = False
) -> None:
    """Print the figures of a template on an engine."""
    from cnnum.design.worst_case import worst_case
    from cnnum.integrators.stability import stability_bound
    from cnnum.templating.checks.robustness import flips, tolerances
    from cnnum.templating.checks.running import measure, settle_times
    from cnnum.templating.stability_class import stability_class

    kind = stability_class(template)
    record = {
        "template": template.name,
        "stability": kind.name,
        "why": kind.why,
        "layers": template.layers,
        "inputs": template.inputs,
        "radius": template.radius,
        "euler_step": stability_bound(template, (8, 8), "euler").step,
        **_cost(template),
    }
    if template.check is None:
        record["settle"] = settle_times(template, engine)
        output.record(record)
        output.show(facts(_lines(record, template.unit_of_time)), _UNCHECKED)
        return
    measured = measure(template, engine)
    changes = flips(template, engine, draws=_DRAWS)
    record |= {"settle": measured.settle, "margin": measured.margin}
    worst = worst_case(template)
    record["worst_case"] = None if worst is None else worst.share
    record["worst_case_weights"] = "" if worst is None else worst.words
    output.record(record | {"flips": [asdict(change) for change in changes]})
    output.show(facts(_lines(record, template.unit_of_time)))
    shown = table("change of the weights", ">templates that flip", ">wrong cells")
    for change in changes:
        shown.add_row(change.change, _share(change), f"{100 * change.wrong:.2g} %")
    output.show(
        shown,
        f"{_DRAWS} chips are drawn for each mismatch, and brackets have the 95 % interval of the "
        "share.",
    )
    for change in changes:
        if change.failed:
            output.show(f"{change.change}: {change.failed} were not run. {change.reason}")
    if weights:
        _weights(output, list(tolerances(template, engine)))


def _share(change: "Flips") -> str:
    """Return the share that flips; a coarse template is one, and flips or does not."""
    if change.draws == 0:
        return "-"
    if change.draws == 1:
        return "yes" if change.flipped else "no"
    low, high = 100 * change.low, 100 * change.high
    return f"{100 * change.flipped:.0f} % ({low:.0f}-{high:.0f})"


def _cost(template: "Template") -> dict[str, Any]:
    """Return multiplications a cell: of an evaluation of the rates, and of the input, once."""
    from cnnum.design.finding import figures

    known = figures(template)
    return {
        "products_a_step": known.products,
        "tables_a_step": known.tables,
        "products_once": known.once,
    }


def _lines(record: dict[str, Any], unit: str) -> list[tuple[str, str]]:
    settle = ", ".join(f"{n}×{n}: {number(t)} {unit}" for n, t in record.get("settle", ()))
    sizes = ", ".join(f"{size} {record[size]}" for size in ("layers", "inputs", "radius"))
    return [
        ("template", record["template"]),
        ("form", f"well-formed: {sizes}"),
        ("stability", f"{record['stability']}. {record['why']}"),
        ("largest Euler step", f"{number(record['euler_step'])} {unit}"),
        ("settles within", settle or "not measured"),
        ("margin of the bias", _margin(record)),
        ("worst case", _worst(record.get("worst_case"), record.get("worst_case_weights", ""))),
        ("cost of a cell", _spent(record)),
    ]


def _margin(record: dict[str, Any]) -> str:
    if "margin" not in record:
        return "not known without a check"
    margin = record["margin"]
    return "none: a gray answer" if margin is None else number(margin)


def _worst(share: float | None, weights: str) -> str:
    if share is None:
        return "no bound is known"
    bound = f"with all weights off at once by less than {_below(share)} %, no cell ends wrong"
    return f"{bound}; beyond it one does with {weights}" if share < 1.0 else bound


def _below(share: float) -> str:
    """Return a bound in per cent with three digits, never rounded up."""
    digits = 2 - math.floor(math.log10(100.0 * share)) if share > 0.0 else 0
    return f"{math.floor(100.0 * share * 10.0**digits) / 10.0**digits:g}"


def _spent(record: dict[str, Any]) -> str:
    step, tables, once = (
        record[key] for key in ("products_a_step", "tables_a_step", "products_once")
    )
    return f"{step} products and {tables} table look-ups a step, {once} products once"


def _weights(output: Output, records: list[Any]) -> None:
    shown = table("weight", ">value", ">down", ">up")
    for record in records:
        output.record(asdict(record))
        shown.add_row(
            record.weight,
            number(record.value, 4),
            *(f"{100 * x:.0f} %" for x in (record.down, record.up)),
        )
    output.show(shown, "The largest change that was tried of one weight with no wrong cell.")
