"""Templates as TOML: the format of the library.

Keys: name, A, B, z, tau, boundary, input_boundary, initial, duration, output, description, source,
aliases, needs_state. The words about it: input, state, tags, experimental, published_boundary. The
tables are [[nonlinear]] (neighbour, weights, interpolation, points, and where needed centre, to,
source, centre_source, times_argument, reversed_sign). Then [[gain]] (to, source, interpolation,
points) and [delayed] (delay, A, B). The table [check] has the name of a closed form and its
parameters. Commands write the tables [measured] and [proof]. Matrices are nested lists of rows,
(k, k) or [to][from][row][col].
"""

import json
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Generic, TypeVar, cast

from cnnum.arrays import Floats
from cnnum.errors import ArrayError, TemplateError, UnknownNameError
from cnnum.safety.reading import parse_toml
from cnnum.templating.couplings import DelayedCoupling, Gain, NonlinearCoupling
from cnnum.templating.files.entry import (
    About,
    Entry,
    FileFormat,
    measured_toml,
    proof_toml,
    read_measured,
    read_proof,
)
from cnnum.templating.files.toml_values import (
    check,
    flag,
    matrix,
    names,
    number,
    number_or_text,
    per_layer,
    points,
    refuse_unknown,
    table,
    text,
    whole,
    wrong,
)
from cnnum.templating.functions import Table
from cnnum.templating.template import Check, Template

Reader = Callable[[str, str, object], Any]
T = TypeVar("T")

_FUNCTION: Mapping[str, Reader] = {"interpolation": text, "points": points}
_NONLINEAR: Mapping[str, Reader] = {
    "neighbour": text,
    "weights": matrix,
    **_FUNCTION,
    "centre": text,
    "to": whole,
    "source": whole,
    "centre_source": whole,
    "times_argument": flag,
    "reversed_sign": flag,
}
_GAIN: Mapping[str, Reader] = {"to": whole, "source": whole, **_FUNCTION}
_DELAYED: Mapping[str, Reader] = {"delay": number, "A": matrix, "B": matrix}


@dataclass(frozen=True, slots=True)
class _Tables(Generic[T]):
    """Tables of one kind: a reader for every key, the needed keys, and the coupling they make."""

    readers: Mapping[str, Reader]
    needed: tuple[str, ...]
    make: Callable[[dict[str, Any]], T]

    def several(self, file: str, key: str, value: object) -> tuple[T, ...]:
        """Return the couplings of a list of tables."""
        if not isinstance(value, list):
            raise wrong(file, key, f"a list of tables [[{key}]]", value)
        items = enumerate(cast("list[object]", value))
        return tuple(self.one(file, f"{key}[{n}]", item) for n, item in items)

    def one(self, file: str, key: str, value: object) -> T:
        """Return the coupling of a table."""
        content = table(file, key, value)
        refuse_unknown(file, content, self.readers, f"{key}.")
        for name in self.needed:
            if name not in content:
                raise TemplateError(f"'{file}': the key '{key}.{name}' is missing.")
        parts = {name: self.readers[name](file, f"{key}.{name}", content[name]) for name in content}
        try:
            return self.make(parts)
        except (TemplateError, ArrayError) as error:
            raise TemplateError(f"'{file}': the table '{key}' is wrong: {error}") from None


def nonlinear(file: str, key: str, value: object) -> tuple[NonlinearCoupling, ...]:
    """Return the nonlinear couplings that the tables [[nonlinear]] describe.

    Raises
    ------
    TemplateError
        If a table misses a key, has an unknown one, or a value is wrong.
    """

    def one(parts: dict[str, Any]) -> NonlinearCoupling:
        return NonlinearCoupling(function=_read_function(parts), **parts)

    needed = ("neighbour", "weights", *_FUNCTION)
    return _Tables(_NONLINEAR, needed, one).several(file, key, value)


def gains(file: str, key: str, value: object) -> tuple[Gain, ...]:
    """Return the gains in time that the tables [[gain]] describe; raises as `nonlinear`."""

    def one(parts: dict[str, Any]) -> Gain:
        return Gain(parts.get("to", 0), parts.get("source", 0), _read_function(parts))

    return _Tables(_GAIN, tuple(_FUNCTION), one).several(file, key, value)


def delayed(file: str, key: str, value: object) -> DelayedCoupling:
    """Return the coupling that the table [delayed] describes; raises as `nonlinear`."""

    def one(parts: dict[str, Any]) -> DelayedCoupling:
        return DelayedCoupling(**parts)

    return _Tables(_DELAYED, ("delay",), one).one(file, key, value)


def _read_function(parts: dict[str, Any]) -> Table:
    return Table.of(parts.pop("interpolation"), parts.pop("points"))


def value(item: float | str) -> str:
    """Return a number or a text."""
    return quoted(item) if isinstance(item, str) else repr(float(item))


def quoted(text: str) -> str:
    """Return a text in quotes."""
    # JSON and TOML escape alike but for DEL, and \u of a surrogate, which TOML does not know.
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


def yes_or_no(flag: bool) -> str:
    """Return true or false."""
    return "true" if flag else "false"


def several(values: Iterable[float]) -> str:
    """Return a list of numbers."""
    return f"[{', '.join(repr(float(item)) for item in values)}]"


def stacked(kernels: Floats) -> str:
    """Return weights (to, from, k, k), without the outer lists where both are 1."""
    if kernels.shape[:2] == (1, 1):
        return rows(kernels[0, 0])
    blocks = [", ".join(rows(block, "  ") for block in row) for row in kernels]
    return "[\n  " + ",\n  ".join(f"[{block}]" for block in blocks) + ",\n]"


def rows(block: Floats, indent: str = "") -> str:
    """Return a matrix, one row per line."""
    lines = "".join(f"{indent}  {several(row)},\n" for row in block)
    return f"[\n{lines}{indent}]"


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
    if template.needs_state:
        parts["needs_state"] = "true"
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


_REQUIRED = ("name", "A")
_ABOUT: Mapping[str, Callable[[str, str, object], Any]] = {
    "input": text,
    "state": text,
    "tags": names,
    "experimental": text,
    "published_boundary": text,
}

# In the order in which the error for an unknown key lists them.
_READERS: Mapping[str, Callable[[str, str, object], Any]] = {
    "name": text,
    "A": matrix,
    "B": matrix,
    "z": per_layer,
    "tau": per_layer,
    "boundary": number_or_text,
    "input_boundary": number_or_text,
    "initial": number_or_text,
    "duration": number_or_text,
    "output": text,
    "needs_state": flag,
    "description": text,
    "source": text,
    "nonlinear": nonlinear,
    "gain": gains,
    "delayed": delayed,
    "check": check,
}


def _read(content: str, file: str) -> Entry:
    try:
        table: dict[str, object] = parse_toml(content)
    except ValueError as error:
        raise TemplateError(f"'{file}' is not valid TOML: {error}.") from None
    aliases = names(file, "aliases", table.pop("aliases", []))
    figures, proved = table.pop("measured", None), table.pop("proof", None)
    words = {key: read(file, key, table.pop(key)) for key, read in _ABOUT.items() if key in table}
    template = _template(file, table)
    measured = None if figures is None else read_measured(file, "measured", figures)
    proof = None if proved is None else read_proof(file, "proof", proved)
    try:
        return Entry(template, aliases, About(**words), measured, proof)
    except TemplateError as error:
        raise TemplateError(f"'{file}': {error}") from None


def _template(file: str, table: dict[str, object]) -> Template:
    refuse_unknown(file, table, (*_READERS, "aliases", *_ABOUT, "measured", "proof"))
    for key in _REQUIRED:
        if key not in table:
            raise TemplateError(f"'{file}': the key '{key}' is missing; every template needs it.")
    values = {key: _READERS[key](file, key, value) for key, value in table.items()}
    values["gains"] = values.pop("gain", ())
    try:
        return Template(**values)
    except (TemplateError, ArrayError, UnknownNameError) as error:
        raise TemplateError(f"'{file}': {error}") from None


TOML = FileFormat(".toml", _read, entry_to_toml)
"""A template as TOML text; reading it back gives the same template."""
