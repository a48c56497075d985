"""A template as the text of a `.tem` file."""

from collections.abc import Iterator
from string import ascii_lowercase

import numpy as np

from cnnum.arrays import Floats
from cnnum.errors import NotSupportedError
from cnnum.templating.couplings import NonlinearCoupling
from cnnum.templating.files.entry import Entry
from cnnum.templating.function_tables import Table
from cnnum.templating.template import Template


class _Letters:
    """Letters of functions, one for each table that is written."""

    def __init__(self) -> None:
        self.tables = dict[Table, str]()

    def of(self, template: str, table: Table) -> str:
        """Return the letter of a table."""
        if table not in self.tables:
            if len(self.tables) == len(ascii_lowercase):
                raise _unsaid(template, "more than 26 functions")
            self.tables[table] = ascii_lowercase[len(self.tables)]
        return self.tables[table]

    def lines(self) -> Iterator[str]:
        """Yield the tables."""
        for table, letter in self.tables.items():
            points = " ".join(f"{v!r} {f!r}" for v, f in table.points)
            kind = int(table.interpolation == "linear")
            yield f"{letter} {kind} {len(table.points)} {points}"


def entry_to_tem(entry: Entry) -> str:
    """Return the text of a `.tem` file.

    Raises
    ------
    NotSupportedError
        If the template has parts that the format has no words for.
    """
    template = entry.template
    _refuse(template)
    lines = [*_header(entry), f"NEIGHBORHOOD {template.radius}"]
    letters, many = _Letters(), template.layers > 1
    if many:
        lines.append(f"NRLAYERS {template.layers}")
    if template.delayed is not None:
        lines.append(f"DELAY {template.delayed.delay!r}")
    for layer in range(template.layers):
        lines += [f"LAYER {layer + 1}"] if many else []
        lines += _layer(template, layer, letters)
    return "\r\n".join([*lines, *letters.lines(), ""])


def _header(entry: Entry) -> list[str]:
    template = entry.template
    edge = template.boundary
    said = f"Fixed({edge.constant!r})" if edge.constant is not None else "Zero-flux"
    start = "P" if template.initial == "input" else f"Arbitrary({template.initial!r})"
    kind = "DT-CNN" if template.output.discrete else "CT-CNN"
    layers = "Single-layer" if template.layers == 1 else f"Multi-layer({template.layers})"
    about = " ".join(template.description.split())
    return [
        f"%Function: {about}",
        f"%TemLibName: {template.name}",
        f"%CNNModel: {layers}, {kind}{', Delayed' if template.delayed else ''}",
        f"%Setting: Input:{'P' if template.inputs else '-'}, IniState:{start}, Boundary:{said}",
    ]


def _layer(template: Template, layer: int, letters: _Letters) -> Iterator[str]:
    side = 2 * template.radius + 1
    for source in range(template.layers):
        yield from _matrix("FEEDBACK", source, template.A[layer, source], side)
    for source in range(template.inputs):
        yield from _matrix("CONTROL", source, template.B[layer, source], side)
    if template.delayed is not None:
        for source in range(template.layers):
            kernel = template.delayed.A[layer, source]
            yield from _matrix("DELAYED_FEEDBACK", source, kernel, side)
        for source in range(template.inputs):
            kernel = template.delayed.B[layer, source]
            yield from _matrix("DELAYED_CONTROL", source, kernel, side)
    for coupling in template.nonlinear:
        if coupling.to == layer:
            yield from _nonlinear(template, coupling, side, letters)
    yield f"CURRENT {float(template.z[layer])!r}"


def _matrix(word: str, source: int, kernel: Floats, side: int) -> Iterator[str]:
    # B is written even where it is 0: it says that there is an input
    if kernel.any() or word == "CONTROL":
        yield f"{word} FROM {source + 1}"
        for row in np.pad(kernel, (side - len(kernel)) // 2).tolist():
            yield " ".join(repr(weight) for weight in row)


def _nonlinear(
    template: Template, coupling: NonlinearCoupling, side: int, letters: _Letters
) -> Iterator[str]:
    word = {("y", "y"): "NONLIN_FEEDBACK", ("u", "u"): "NONLIN_CONTROL"}.get(
        (coupling.neighbour, coupling.centre or coupling.neighbour)
    )
    if word is None or coupling.times_argument:
        difference = f"{coupling.centre}-{coupling.neighbour}"
        yield "NONLIN_D"
        yield f"{difference}#{difference if coupling.times_argument else ''}"
        sign = ""
    else:
        yield f"{word} FROM {coupling.source + 1}"
        sign = "0" if coupling.centre is None else "-"
    weights = np.pad(coupling.weights, (side - len(coupling.weights)) // 2)
    for row in weights.tolist():
        cells = [(_scaled(coupling, w) if w else None) for w in row]
        yield " ".join(
            "0" if table is None else letters.of(template.name, table) + sign for table in cells
        )


def _scaled(coupling: NonlinearCoupling, weight: float) -> Table:
    """Return the function times the weight, of centre less neighbour."""
    table = coupling.table
    points = [(v, weight * f) for v, f in table.points]
    if coupling.reversed_sign:
        flip = -1.0 if coupling.times_argument else 1.0
        points = [(-v, flip * f) for v, f in reversed(points)]
    return Table(table.interpolation, tuple(points))


def _refuse(template: Template) -> None:
    """Refuse features that the format has no words for."""
    steps = [c for c in template.nonlinear if c.reversed_sign]
    wrong = {
        "a time constant other than 1": bool((template.tau != 1.0).any()),
        "gains in time": bool(template.gains),
        "a periodic boundary": template.boundary.pad_mode == "wrap",
        "an input boundary of its own": template.input_boundary != template.boundary,
        f"the output '{template.output.name}'": template.output.name not in ("standard", "sign"),
        "a stepped function of neighbour less centre": any(
            c.table.interpolation == "constant" for c in steps
        ),
        "a coupling of x without a centre": any(
            c.neighbour == "x" and c.centre is None for c in template.nonlinear
        ),
        "a nonlinear coupling whose centre lies in another layer": any(
            c.centre is not None
            and c.centre_source
            != (c.source if (c.centre == "u") == (c.neighbour == "u") else _own(c))
            for c in template.nonlinear
        ),
        "a D form between different layers or inputs": any(
            _is_d(c) and (c.source if c.neighbour == "u" else c.source - c.to) != 0
            for c in template.nonlinear
        ),
    }
    for what, present in wrong.items():
        if present:
            raise _unsaid(template.name, what)


def _own(coupling: NonlinearCoupling) -> int:
    return 0 if coupling.centre == "u" else coupling.to


def _is_d(coupling: NonlinearCoupling) -> bool:
    same = (coupling.centre or coupling.neighbour) == coupling.neighbour
    return coupling.times_argument or not same or coupling.neighbour == "x"


def _unsaid(template: str, what: str) -> NotSupportedError:
    return NotSupportedError(
        f"Template '{template}' has {what}, which a .tem file cannot say: save it as .toml."
    )
