"""Nonlinear couplings: tables as expressions, taps of their neighbourhoods."""

from collections.abc import Callable
from itertools import pairwise

import numpy as np

from cnnum import kernels as ir
from cnnum.engines.opencl.transients.builder import SUM, TransientBuilder
from cnnum.kernels.formulas import formula
from cnnum.templating.couplings import NonlinearCoupling, Quantity
from cnnum.templating.function_tables import Table
from cnnum.templating.network import Tap
from cnnum.templating.pair_functions import PairFunction

ARRAYS = {"x": ir.Name("xp"), "y": ir.Name("y"), "u": ir.Name("u")}
"""Padded arrays that hold a quantity."""

Reads = Callable[[Quantity, int, int, int], ir.Expression]
"""A quantity of a layer, or input, in a cell some rows and columns away."""

V, OWN, SINCE = ir.names("v own since")


def table(function: Table, argument: ir.Name) -> ir.Expression:
    """Return the expression of a function table of an argument."""
    points = function.points
    if function.interpolation == "constant":
        value: ir.Expression = ir.Number(points[-1][1])
        for place, level in reversed(points[:-1]):
            value = ir.pick(argument <= ir.Number(place), ir.Number(level), value)
        return value
    value = ir.Number(points[0][1])
    for (v0, f0), (v1, f1) in pairwise(points):
        if f1 != f0:
            slope, low, high = (ir.Number(n) for n in ((f1 - f0) / (v1 - v0), v0, v1))
            value = value + slope * (ir.call("clamp", argument, low, high) - low)
    return value


def own_table(
    function: Table, argument: ir.Name, number: Callable[[float], ir.Expression]
) -> ir.Expression:
    """Return the expression of a table whose values are variables."""
    places, values = [p for p, _ in function.points], [number(v) for _, v in function.points]
    if function.interpolation == "constant":
        value = values[-1]
        for place, level in zip(reversed(places[:-1]), reversed(values[:-1]), strict=True):
            value = ir.pick(argument <= ir.Number(place), level, value)
        return value
    value = values[0]
    for (low, before), (high, after) in pairwise(zip(places, values, strict=True)):
        ends = ir.Number(low), ir.Number(high)
        share = (ir.call("clamp", argument, *ends) - ends[0]) * ir.Number(1.0 / (high - low))
        value = value + share * (after - before)
    return value


def nonlinear(text: TransientBuilder, coupling: NonlinearCoupling) -> list[ir.Statement]:
    """Return statements that add a nonlinear coupling's sum in cell `p` to `sum`."""

    def quantity(name: Quantity, source: int, row: int, col: int) -> ir.Expression:
        return text.neighbour(ARRAYS[name], Tap(source, row, col, 1.0))

    return summed(coupling, quantity, SUM, number=text.number)


def summed(
    coupling: NonlinearCoupling,
    quantity: Reads,
    to: ir.Name,
    scale: float = 1.0,
    of: str = "real",
    number: Callable[[float], ir.Expression] = ir.Number,
) -> list[ir.Statement]:
    """Return statements that add a nonlinear coupling's scaled sum to a number of a type.

    `number` gives the expression of a scaled weight.
    """
    radius, lines = coupling.weights.shape[0] // 2, list[ir.Statement]()
    for row, col in np.argwhere(coupling.weights):
        offsets = int(row) - radius, int(col) - radius
        argument = quantity(coupling.neighbour, coupling.source, *offsets)
        weight = number(scale * float(coupling.weights[row, col]))
        if isinstance(coupling.function, PairFunction):
            own = quantity(coupling.centre or coupling.neighbour, coupling.centre_source, 0, 0)
            both = ir.fixed(OWN, own, of=of), ir.fixed(V, argument, of=of)
            value = weight * formula(coupling.function.opencl, c=OWN, n=V)
            lines.append(ir.block(*both, ir.add(to, value)))
            continue
        if coupling.centre is not None:
            centre = quantity(coupling.centre, coupling.centre_source, 0, 0)
            argument = argument - centre if coupling.reversed_sign else centre - argument
        value = weight * table(coupling.function, V)
        added = ir.add(to, value * V if coupling.times_argument else value)
        lines.append(ir.block(ir.fixed(V, argument, of=of), added))
    return lines


def gain_name(number: int) -> ir.Name:
    """Return the variable of the gain of a coupling that varies in time."""
    return ir.Name(f"gain{number}")


def gains(text: TransientBuilder, since: ir.Expression) -> list[ir.Statement]:
    """Return the statements that find the gains that vary in time, at a time since the start."""
    found = text.template.gains
    lines: list[ir.Statement] = [ir.fixed(SINCE, since)] if found else []

    def value(function: Table) -> ir.Expression:
        if text.operands.own is None:
            return table(function, SINCE)
        return own_table(function, SINCE, text.number)

    return lines + [ir.fixed(gain_name(k), value(gain.table)) for k, gain in enumerate(found)]
