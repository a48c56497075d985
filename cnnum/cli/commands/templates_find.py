"""`cnnum templates list`, `find` and `compare`: the library, searched by words or an example."""

import re
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, cast

import click
import numpy as np

from cnnum.cli.commands.templates_convert import is_place
from cnnum.cli.options import completed, force_option, json_option, picture_option
from cnnum.cli.output import Output, progress, table
from cnnum.cli.signals import STOPPED, stop_wanted

if TYPE_CHECKING:
    from cnnum.arrays import Floats
    from cnnum.templating.template import Template


@click.command("list")
@click.option("--wide", is_flag=True, help="Also show sizes and checks.")
@json_option
def list_templates(wide: bool, as_json: bool) -> None:
    """List the templates of the library with their purpose."""
    from cnnum.templating.library import get_template, template_names, template_path

    output = Output(as_json)
    more = (">layers", ">inputs", ">radius", "check") if wide else ()
    listed = table("Template", "group", *more, "what it does")
    for name in template_names():
        template = get_template(name)
        group = template_path(name).parent.name
        summary = first_sentence(template.description)
        check = template.check.name if template.check else ""
        output.record(
            {
                "template": template.name,
                "group": group,
                "layers": template.layers,
                "inputs": template.inputs,
                "radius": template.radius,
                "check": check,
                "description": summary,
            }
        )
        sizes = [str(n) for n in (template.layers, template.inputs, template.radius)]
        listed.add_row(template.name, group, *((*sizes, check) if wide else ()), summary)
    output.show(listed, spare=() if wide else ("group",))


def first_sentence(text: str) -> str:
    """Return the first sentence of a description."""
    head, stop, _ = " ".join(text.split()).partition(". ")
    return head + "." if stop else head


PICTURE = click.Path(path_type=Path, exists=True, dir_okay=False)


@click.command("find")
@click.argument("words", nargs=-1)
@click.option("--input", "given", type=PICTURE, help="Input picture of the example.")
@click.option("--wanted", type=PICTURE, help="Output picture of the example.")
@click.option("--state", type=PICTURE, help="Initial state; by default that of each template.")
@click.option("--tag", "tags", multiple=True, help="Only templates with this tag; repeatable.")
@click.option(
    "--programs/--no-programs",
    default=None,
    help="With an example, also rank programs of two templates; by default where no template fits.",
)
@click.option(
    "--most", default=10, show_default=True, type=click.IntRange(min=1), help="Number of results."
)
@json_option
def find(
    words: tuple[str, ...],
    given: Path | None,
    wanted: Path | None,
    state: Path | None,
    tags: tuple[str, ...],
    programs: bool | None,
    most: int,
    as_json: bool,
) -> int:
    """Find templates by WORDS, such as "fill holes", by tags, or by an example.

    An example is an input picture and the desired output picture. Every template with one input and
    one layer runs on it and, if none gives the desired output, programs of two such templates.
    Those with the fewest wrong cells come first, and among these, those with the largest margin.
    Ctrl-C ends the search with the best so far.
    """
    output = Output(as_json)
    example = given is not None or wanted is not None
    if bool(words or tags) == example:
        raise click.UsageError("Give words or tags, or an example with --input and --wanted.")
    if not example:
        if programs is not None or state is not None:
            raise click.UsageError("--programs and --state belong to an example with --input.")
        _by_words(" ".join(words), tags, most, output)
        return 0
    if given is None or wanted is None:
        raise click.UsageError("An example needs both --input and --wanted.")
    if programs and state is not None:
        raise click.UsageError("Programs of two templates start from the input: leave out --state.")
    return _by_example(given, wanted, state, programs, most, output)


def _by_words(words: str, tags: tuple[str, ...], most: int, output: Output) -> None:
    from cnnum.design.finding import find_by_words

    hits = find_by_words(words, most, tags=tags)
    shown = table("Template", ">fit", "what it does")
    for hit in hits:
        output.record(
            {"template": hit.name, "fit": round(hit.score, 3), "description": hit.summary}
        )
        shown.add_row(hit.name, f"{hit.score:.2f}", hit.summary)
    output.show(shown if hits else f"No template matches '{' '.join((words, *tags)).strip()}'.")


def _by_example(
    given: Path,
    wanted: Path,
    state: Path | None,
    programs: bool | None,
    most: int,
    output: Output,
) -> int:
    from cnnum.design.finding import find_by_example, find_programs
    from cnnum.pictures import load_picture
    from cnnum.templating.library import template_names

    start = None if state is None else load_picture(state)
    example, names = (load_picture(given), load_picture(wanted)), template_names()
    outputs = dict[str, "Floats"]()
    with stop_wanted() as stopped:

        def watch(_: str) -> bool:
            steps.advance()
            return not stopped()

        with progress("templates", len(names) + most, as_json=output.as_json) as steps:
            matches = find_by_example(
                *example, state=start, most=most, watch=watch, outputs=outputs
            )
        right = bool(matches) and matches[0].wrong == 0
        wished = programs or (programs is None and state is None and not right)
        if wished and not stopped():
            total = 2 * len(names) + most
            with progress("programs", total, as_json=output.as_json) as steps:
                pairs = find_programs(*example, most=most, watch=watch, outputs=outputs)
            matches = sorted([*matches, *pairs], key=lambda m: (m.wrong, len(m.templates)))
        early = stopped()
    shown = table("Template", ">wrong cells", ">of", ">margin")
    for match in matches[:most]:
        output.record(
            {
                "template": match.name,
                "templates": list(match.templates),
                "wrong": match.wrong,
                "cells": match.cells,
                "margin": None if np.isnan(match.margin) else match.margin,
            }
        )
        margin = "" if np.isnan(match.margin) else f"{match.margin:.3g}"
        shown.add_row(match.name, str(match.wrong), str(match.cells), margin)
    output.show(shown)
    if early:
        click.echo("Stopped: these are the best so far.", err=True)
    return STOPPED if early else 0


@click.command("compare")
@click.argument("first", shell_complete=completed("template", files=True))
@click.argument("second", shell_complete=completed("template", files=True))
@picture_option("--picture", "Write the comparison as a picture.")
@force_option
@json_option
def compare(first: str, second: str, picture: Path | None, force: bool, as_json: bool) -> None:
    """Show where the numbers and the answers of the templates FIRST and SECOND differ.

    Each is a template of the library or a file. Uncoupled templates of radius 1 are compared on all
    512 neighbourhoods, others on random pictures. The command also shows stability class, cost,
    settling time and margin.
    """
    from cnnum.design.finding import compare as compared
    from cnnum.report.comparison import comparison_rows, verdict, write_comparison

    this, other = _template(first), _template(second)
    comparison, output = compared(this, other), Output(as_json)
    both = this, other
    differs = {
        name: [_of_field(template, name, value) for template, value in zip(both, pair, strict=True)]
        for name, pair in comparison.differs.items()
    }
    numbers = {
        name: [_plain(value) for value in (pair if isinstance(pair[0], np.ndarray) else parts)]
        for (name, pair), parts in zip(comparison.differs.items(), differs.values(), strict=True)
    }
    output.record(
        {
            "kind": "comparison",
            "templates": [this.name, other.name],
            "differs": numbers,
            "exhaustive": comparison.exhaustive,
            "cases": comparison.cases,
            "unlike": comparison.unlike,
            "figures": [asdict(figure) for figure in comparison.figures],
            "neighbourhoods": comparison.inputs.astype(int).tolist()
            if comparison.exhaustive
            else [],
        }
    )
    shown = table("", this.name, other.name)
    for name, pair in differs.items():
        shown.add_row(name, *(_written(value) for value in pair))
    for row in comparison_rows(comparison):
        shown.add_row(*row)
    output.show(
        *([] if comparison.differs else ["They have the same numbers."]), shown, verdict(comparison)
    )
    if comparison.exhaustive and comparison.unlike:
        pairs = zip(comparison.inputs, comparison.answers[0], strict=True)
        blocks = [_block(picture, black=answer > 0.0) for picture, answer in pairs]
        output.show(
            f"Black of {this.name} (■), or of {other.name} (□):", *_side_by_side(blocks[:12])
        )
    if picture is not None:
        write_comparison(picture, comparison, force=force)
        output.record({"kind": "picture", "file": str(picture)}, f"Written: {picture}")


def _template(name: str) -> "Template":
    from cnnum.templating.files import load_template
    from cnnum.templating.library import get_template

    return load_template(name) if is_place(name) else get_template(name)


LABELS = {
    "A": r"A(\[.*\])?$",
    "B": r"B(\[.*\])?$",
    "delayed": r".* ago",
    "nonlinear": r"coupling|f\d",
    "gains": r"gain",
}
"""The fields of a template that hold several matrices or functions, and how their labels begin."""


def _of_field(template: "Template", field: str, value: object) -> object:
    """Return a field's only matrix, its matrices and functions by their labels, or its value."""
    from cnnum.templating.numbers import functions, matrices

    if field not in LABELS:
        return value
    labelled: list[tuple[str, object]] = [*matrices(template), *functions(template)]
    parts = {label: part for label, part in labelled if re.match(LABELS[field], label)}
    return parts.get(field, parts) if len(parts) == 1 else parts


def _plain(value: object) -> object:
    if isinstance(value, dict):
        return {label: _plain(part) for label, part in cast("dict[str, object]", value).items()}
    return cast("Floats", value).tolist() if isinstance(value, np.ndarray) else str(value)


def _written(given: object) -> str:
    if isinstance(given, dict):
        parts = cast("dict[str, object]", given).items()
        return "\n".join(f"{label}:\n{_written(part)}" for label, part in parts) or "none"
    if isinstance(given, np.ndarray):
        value = cast("Floats", given)
        rows = value.reshape(-1, value.shape[-1]) if value.ndim > 1 else value.reshape(1, -1)
        return "\n".join(" ".join(f"{number:g}" for number in row) for row in rows)
    return str(given)


def _block(picture: np.ndarray, *, black: bool) -> list[str]:
    """Return a neighbourhood as three lines, and whose answer is black below it."""
    lines = ["".join("#" if cell > 0 else "." for cell in row) for row in picture]
    return [*lines, f" {'■' if black else '□'} "]


def _side_by_side(blocks: list[list[str]]) -> list[str]:
    return ["   ".join(lines) for lines in zip(*blocks, strict=True)]
