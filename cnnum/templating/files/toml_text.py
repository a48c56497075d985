"""The TOML text of a template."""

from collections.abc import Iterator

from cnnum.errors import TemplateError
from cnnum.templating.couplings import DelayedCoupling, Gain, NonlinearCoupling
from cnnum.templating.files.entry import About, Entry
from cnnum.templating.files.measured import measured_toml
from cnnum.templating.files.proof import proof_toml
from cnnum.templating.files.toml_scalars import quoted, rows, several, stacked, value, yes_or_no
from cnnum.templating.function_tables import Table
from cnnum.templating.template import Check, Template


def entry_to_toml(entry: Entry) -> str:
    """Return the TOML text of a template and its aliases; every part is written out."""
    template = entry.template
    lines = list(_assigned(_parts(entry)))
    for coupling in template.nonlinear:
        lines += ["", "[[nonlinear]]", *_assigned(_nonlinear(coupling))]
    for gain in template.gains:
        lines += ["", "[[gain]]", *_assigned(_gain(gain))]
    if template.delayed is not None:
        lines += ["", "[delayed]", *_assigned(_delayed(template.delayed, template))]
    if template.check is not None:
        lines += ["", "[check]", *_check(template.check)]
    if entry.proof is not None:
        lines += ["", *proof_toml(entry.proof)]
    if entry.measured is not None:
        lines += ["", measured_toml(entry.measured).rstrip()]
    return "\n".join([*lines, ""])


def _assigned(parts: dict[str, str]) -> Iterator[str]:
    return (f"{key} = {text}" for key, text in parts.items())


def _parts(entry: Entry) -> dict[str, str]:
    template = entry.template
    parts = {
        "name": quoted(template.name),
        "aliases": f"[{', '.join(quoted(alias) for alias in entry.aliases)}]",
        "description": quoted(template.description),
        "source": quoted(template.source),
        **_about(entry.about),
        "A": stacked(template.A),
        "z": several(template.z),
        "tau": several(template.tau),
        "boundary": value(template.boundary.name),
        "input_boundary": value(template.input_boundary.name),
        "initial": value(template.initial),
        "duration": value(template.duration),
        "output": quoted(template.output.name),
    }
    return {**parts, "B": stacked(template.B)} if template.inputs else parts


def _about(about: About) -> dict[str, str]:
    words = {
        "input": quoted(about.input),
        "state": quoted(about.state),
        "tags": f"[{', '.join(quoted(tag) for tag in about.tags)}]",
        "experimental": quoted(about.experimental),
        "published_boundary": quoted(about.published_boundary),
    }
    return {key: words[key] for key in words if getattr(about, key)}


def _nonlinear(coupling: NonlinearCoupling) -> dict[str, str]:
    parts = {
        "to": str(coupling.to),
        "source": str(coupling.source),
        "neighbour": quoted(coupling.neighbour),
        "centre_source": str(coupling.centre_source),
        "times_argument": yes_or_no(coupling.times_argument),
        "reversed_sign": yes_or_no(coupling.reversed_sign),
        "weights": rows(coupling.weights),
        **_function(coupling.table),
    }
    return parts if coupling.centre is None else {**parts, "centre": quoted(coupling.centre)}


def _gain(gain: Gain) -> dict[str, str]:
    return {"to": str(gain.to), "source": str(gain.source), **_function(gain.table)}


def _function(table: Table) -> dict[str, str]:
    points = ", ".join(several(point) for point in table.points)
    return {"interpolation": quoted(table.interpolation), "points": f"[{points}]"}


def _delayed(coupling: DelayedCoupling, template: Template) -> dict[str, str]:
    parts = {"delay": value(coupling.delay), "A": stacked(coupling.A)}
    return {**parts, "B": stacked(coupling.B)} if template.inputs else parts


def _check(check: Check) -> list[str]:
    names = [name for name, _ in check.parameters]
    if "name" in names or len(set(names)) < len(names):
        raise TemplateError(
            f"The check '{check.name}' must have parameters of different names, none of them "
            f"'name', got {names}."
        )
    given = [f"{quoted(name)} = {value(item)}" for name, item in check.parameters]
    return [f"name = {quoted(check.name)}", *given]
