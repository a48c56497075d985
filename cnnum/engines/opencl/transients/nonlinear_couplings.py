"""Nonlinear couplings: tables as expressions, taps of their neighbourhoods."""

from itertools import pairwise

import numpy as np

from cnnum.engines.opencl import ir
from cnnum.engines.opencl.transients.builder import SUM, TransientBuilder
from cnnum.templating.couplings import NonlinearCoupling
from cnnum.templating.function_tables import Table
from cnnum.templating.network import Tap

ARRAYS = {"x": ir.Name("xp"), "y": ir.Name("y"), "u": ir.Name("u")}
"""Padded arrays that hold a quantity."""

V, SINCE = ir.Name("v"), ir.Name("since")


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


def nonlinear(text: TransientBuilder, coupling: NonlinearCoupling) -> list[ir.Statement]:
    """Return statements that add a nonlinear coupling's sum in cell `p` to `sum`."""
    radius = coupling.weights.shape[0] // 2
    array = ARRAYS[coupling.neighbour]
    lines: list[ir.Statement] = []
    for row, col in np.argwhere(coupling.weights):
        tap = Tap(coupling.source, int(row) - radius, int(col) - radius, 1.0)
        argument: ir.Expression = text.neighbour(array, tap)
        if coupling.centre is not None:
            centre = text.neighbour(ARRAYS[coupling.centre], Tap(coupling.centre_source, 0, 0, 1.0))
            argument = argument - centre if coupling.reversed_sign else centre - argument
        value = ir.Number(float(coupling.weights[row, col])) * table(coupling.function, V)
        lines.append(
            ir.block(
                ir.fixed(V, argument), ir.add(SUM, value * V if coupling.times_argument else value)
            )
        )
    return lines


def gain_name(number: int) -> ir.Name:
    """Return the variable of what a coupling that varies in time comes with."""
    return ir.Name(f"gain{number}")


def gains(text: TransientBuilder, since: ir.Expression) -> list[ir.Statement]:
    """Return the statements that find what varies in time, at a time since the start."""
    found = text.template.gains
    lines: list[ir.Statement] = [ir.fixed(SINCE, since)] if found else []
    return lines + [
        ir.fixed(gain_name(k), table(gain.table, SINCE)) for k, gain in enumerate(found)
    ]
