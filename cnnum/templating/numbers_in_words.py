"""All numbers of a template for people: matrices with their labels, and functions in words."""

from cnnum.arrays import Floats
from cnnum.templating.couplings import NonlinearCoupling
from cnnum.templating.function_tables import Table
from cnnum.templating.template import Template


def matrices(template: Template) -> list[tuple[str, Floats]]:
    """Return each (k, k) matrix with its label, those of only zeros left out where others are."""
    parts = {"A": template.A, "B": template.B}
    if template.delayed is not None:
        late = f" of {template.delayed.delay:g} τ ago"
        both = {f"A{late}": template.delayed.A, f"B{late}": template.delayed.B}
        parts |= {label: couplings for label, couplings in both.items() if couplings.any()}
    found = [pair for label, couplings in parts.items() for pair in _kernels(label, couplings)]
    return found + [
        (f"coupling {n}{_place(template, each)}, weights of f{n}({_argument(each)}", each.weights)
        for n, each in enumerate(template.nonlinear, 1)
    ]


def functions(template: Template) -> list[tuple[str, str]]:
    """Return each function of a nonlinear coupling or gain by its name, in words."""
    found = [(f"f{n}", _function(each)) for n, each in enumerate(template.nonlinear, 1)]
    return found + [
        (f"gain of A[{gain.to}, {gain.source}] in time", _steps(gain.table))
        for gain in template.gains
    ]


def _kernels(label: str, couplings: Floats) -> list[tuple[str, Floats]]:
    layers, sources = couplings.shape[:2]
    if layers * sources == 1:
        return [(label, couplings[0, 0])]
    found = [
        (f"{label}[{to}, {source}]", couplings[to, source])
        for to in range(layers)
        for source in range(sources)
    ]
    return [pair for pair in found if pair[1].any()] or found[:1]


def _place(template: Template, coupling: NonlinearCoupling) -> str:
    """Return the layers of a coupling, where there are several."""
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
