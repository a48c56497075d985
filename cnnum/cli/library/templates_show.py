"""`cnnum templates show NAME`."""

from typing import TYPE_CHECKING, Any

import click

from cnnum.cli.options import json_option
from cnnum.cli.output import Output, facts, number

if TYPE_CHECKING:
    from cnnum.templating.template import Template


@click.command("show")
@click.argument("name")
@json_option
def show(name: str, as_json: bool) -> None:
    """Show the template NAME of the library, or of a file: its numbers and all that goes along."""
    from cnnum.templating.files import load_template
    from cnnum.templating.library import get_template

    template = load_template(name) if name.endswith(".toml") else get_template(name)
    output = Output(as_json)
    output.record(_record(template))
    output.show(facts(_facts(template)), "")
    for part in ("A", "B"):
        for label, kernel in _kernels(part, getattr(template, part)):
            output.show(f"{label} =", _matrix(kernel), "")


def _record(template: "Template") -> dict[str, object]:
    check = template.check
    return {
        "template": template.name,
        "description": template.description,
        "source": template.source,
        "A": template.A.tolist(),
        "B": template.B.tolist(),
        "z": template.z.tolist(),
        "tau": template.tau.tolist(),
        "boundary": template.boundary.name,
        "input_boundary": template.input_boundary.name,
        "initial": template.initial,
        "duration": template.duration,
        "output": template.output.name,
        "check": {"name": check.name, **dict(check.parameters)} if check else None,
    }


def _facts(template: "Template") -> list[tuple[str, str]]:
    check = template.check
    given = ", ".join(f"{key} = {value}" for key, value in check.parameters) if check else ""
    boundary = f"{template.boundary} (state), {template.input_boundary} (input)"
    settles = template.duration == "settle"
    return [
        ("template", template.name),
        ("", " ".join(template.description.split())),
        ("source", template.source or "not given"),
        ("z", ", ".join(number(z, 6) for z in template.z.tolist())),
        ("τ", ", ".join(number(t, 6) for t in template.tau.tolist())),
        ("boundary", boundary),
        ("initial state", str(template.initial)),
        ("duration", "until it settles" if settles else f"{template.duration:g} τ"),
        ("output", template.output.name),
        ("check", f"{check.name}{f' ({given})' if given else ''}" if check else "none"),
    ]


def _kernels(part: str, couplings: Any) -> list[tuple[str, list[list[float]]]]:
    """Return each (k, k) kernel with its name; a single one needs no indices."""
    layers, sources = couplings.shape[:2]
    return [
        (
            part if layers * sources == 1 else f"{part}[{to}, {source}]",
            couplings[to, source].tolist(),
        )
        for to in range(layers)
        for source in range(sources)
    ]


def _matrix(rows: list[list[float]]) -> str:
    cells = [[number(value, 6) for value in row] for row in rows]
    width = max(len(cell) for row in cells for cell in row)
    return "\n".join("    " + "  ".join(cell.rjust(width) for cell in row) for row in cells)
