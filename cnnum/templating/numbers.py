"""All numbers of a template, by the part that they belong to."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from cnnum.arrays import Floats
from cnnum.templating.couplings import NonlinearCoupling
from cnnum.templating.functions import Table
from cnnum.templating.template import Template

Numbers = Mapping[str, Floats]


def weights_of(template: Template) -> dict[str, Floats]:
    """Return the weights of cells and inputs, and the bias.

    Returns
    -------
    dict
        "A", "z", "B", "coupling 1" (weights of a nonlinear coupling), "delayed A", "delayed B",
        as far as the template has them.
    """
    result = {"A": template.A, "z": template.z}
    result |= {"B": template.B} if template.inputs else {}
    result |= {
        f"coupling {n}": coupling.weights for n, coupling in enumerate(template.nonlinear, 1)
    }
    if template.delayed is not None:
        result |= {"delayed A": template.delayed.A, "delayed B": template.delayed.B}
    return result


def numbers_of(template: Template) -> dict[str, Floats]:
    """Return all weights, and the values of function tables, "table 1", and of gains, "gain 1"."""
    functions = {f"table {n}": c.function for n, c in enumerate(template.nonlinear, 1)}
    tables = {name: function for name, function in functions.items() if isinstance(function, Table)}
    tables |= {f"gain {n}": gain.table for n, gain in enumerate(template.gains, 1)}
    return weights_of(template) | {name: _values(table) for name, table in tables.items()}


def with_numbers(template: Template, numbers: Numbers) -> Template:
    """Return a template with other numbers in some parts, named as `numbers_of` names them.

    Raises
    ------
    TemplateError
        If a number is not finite.
    """
    parts: dict[str, Any] = {part: numbers[part] for part in ("A", "B") if part in numbers}
    if "z" in numbers:
        parts["z"] = numbers["z"].tolist()
    if template.nonlinear:
        coupled = enumerate(template.nonlinear, 1)
        parts["nonlinear"] = [_coupled(numbered, n, numbers) for n, numbered in coupled]
    if template.delayed is not None:
        late = {part: numbers.get(f"delayed {part}") for part in ("A", "B")}
        given: dict[str, Any] = {part: value for part, value in late.items() if value is not None}
        parts["delayed"] = replace(template.delayed, **given)
    if template.gains:
        numbered = enumerate(template.gains, 1)
        parts["gains"] = [
            replace(gain, table=_tabled(gain.table, numbers.get(f"gain {n}")))
            for n, gain in numbered
        ]
    return replace(template, **parts)


def _coupled(coupling: NonlinearCoupling, n: int, numbers: Numbers) -> NonlinearCoupling:
    function = coupling.function
    if isinstance(function, Table):
        function = _tabled(function, numbers.get(f"table {n}"))
    weights = numbers.get(f"coupling {n}", coupling.weights)
    return replace(coupling, weights=weights, function=function)


def _values(table: Table) -> Floats:
    return np.array([value for _, value in table.points])


def _tabled(table: Table, values: Floats | None) -> Table:
    if values is None:
        return table
    places = [place for place, _ in table.points]
    return replace(table, points=tuple(zip(places, values.tolist(), strict=True)))


def on_grid(values: ArrayLike, top: float, bits: int) -> Floats:
    """Return numbers rounded to integer multiples of `top` / (2^(bits − 1) − 1)."""
    step = max(top, 1e-30) / (2 ** (bits - 1) - 1)
    return np.asarray(step * np.rint(np.asarray(values) / step), dtype=np.float64)


def matrices(template: Template) -> list[tuple[str, Floats]]:
    """Return each (k, k) matrix with its label, leaving out zero matrices if there are others."""
    parts = {"A": template.A, "B": template.B}
    if template.delayed is not None:
        late = f" of {template.timed(template.delayed.delay)} ago"
        both = {f"A{late}": template.delayed.A, f"B{late}": template.delayed.B}
        parts |= {label: couplings for label, couplings in both.items() if couplings.any()}
    result = [pair for label, couplings in parts.items() for pair in _kernels(label, couplings)]
    return result + [
        (
            f"coupling {n}{_place(template, coupling)}, weights of f{n}({_argument(coupling)}",
            coupling.weights,
        )
        for n, coupling in enumerate(template.nonlinear, 1)
    ]


def functions(template: Template) -> list[tuple[str, str]]:
    """Return the name and a description of each function of a nonlinear coupling or gain."""
    result = [(f"f{n}", _function(coupling)) for n, coupling in enumerate(template.nonlinear, 1)]
    return result + [
        (f"gain of A[{gain.to}, {gain.source}] in time", _steps(gain.table))
        for gain in template.gains
    ]


def _kernels(label: str, couplings: Floats) -> list[tuple[str, Floats]]:
    layers, sources = couplings.shape[:2]
    if layers * sources == 1:
        return [(label, couplings[0, 0])]
    result = [
        (f"{label}[{to}, {source}]", couplings[to, source])
        for to in range(layers)
        for source in range(sources)
    ]
    return [pair for pair in result if pair[1].any()] or result[:1]


def _place(template: Template, coupling: NonlinearCoupling) -> str:
    """Return the layers of a coupling, if the template has several."""
    if template.layers == 1 and template.inputs <= 1:
        return ""
    return f"[{coupling.to}, {coupling.source}]"


def _argument(coupling: NonlinearCoupling) -> str:
    near = f"{coupling.neighbour} of the neighbour"
    if coupling.centre is None:
        return f"{near})"
    own = f"{coupling.centre} of the cell"
    ends = (near, own) if coupling.reversed_sign else (own, near)
    return " - ".join(ends) + (") times its argument" if coupling.times_argument else ")")


def _function(coupling: NonlinearCoupling) -> str:
    function = coupling.function
    if isinstance(function, Table):
        return _steps(function)
    return f"{function.opencl}, c of the cell and n of the neighbour"


def _steps(table: Table) -> str:
    if table.interpolation == "linear":
        return "straight lines through " + ", ".join(f"({v:g}, {f:g})" for v, f in table.points)
    *before, (_, last) = table.points
    return ", ".join([*(f"{f:g} up to {v:g}" for v, f in before), f"{last:g} beyond"])
