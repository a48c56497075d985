"""Nonlinear couplings: tables as expressions, taps of their neighbourhoods."""

from itertools import pairwise

import numpy as np

from cnnum.engines.opencl.ir.expressions import Expression, Name, Number, call, pick
from cnnum.engines.opencl.ir.statements import Statement, add, block, fixed
from cnnum.engines.opencl.transients.builder import SUM, TransientBuilder
from cnnum.templating.couplings import NonlinearCoupling
from cnnum.templating.function_tables import Table
from cnnum.templating.network import Tap

ARRAYS = {"x": Name("xp"), "y": Name("y"), "u": Name("u")}
"""Padded arrays that hold a quantity."""

V, SINCE = Name("v"), Name("since")


def table(function: Table, argument: Name) -> Expression:
    """Return the expression of a function table of an argument."""
    points = function.points
    if function.interpolation == "constant":
        value: Expression = Number(points[-1][1])
        for place, level in reversed(points[:-1]):
            value = pick(argument <= Number(place), Number(level), value)
        return value
    value = Number(points[0][1])
    for (v0, f0), (v1, f1) in pairwise(points):
        if f1 != f0:
            slope, low, high = (Number(n) for n in ((f1 - f0) / (v1 - v0), v0, v1))
            value = value + slope * (call("clamp", argument, low, high) - low)
    return value


def nonlinear(text: TransientBuilder, coupling: NonlinearCoupling) -> list[Statement]:
    """Return statements that add a nonlinear coupling's sum in cell `p` to `sum`."""
    radius = coupling.weights.shape[0] // 2
    array = ARRAYS[coupling.neighbour]
    lines: list[Statement] = []
    for row, col in np.argwhere(coupling.weights):
        tap = Tap(coupling.source, int(row) - radius, int(col) - radius, 1.0)
        argument: Expression = text.neighbour(array, tap)
        if coupling.centre is not None:
            centre = text.neighbour(ARRAYS[coupling.centre], Tap(coupling.centre_source, 0, 0, 1.0))
            argument = argument - centre if coupling.reversed_sign else centre - argument
        value = Number(float(coupling.weights[row, col])) * table(coupling.function, V)
        lines.append(
            block(fixed(V, argument), add(SUM, value * V if coupling.times_argument else value))
        )
    return lines


def gain_name(number: int) -> Name:
    """Return the variable of what a coupling that varies in time comes with."""
    return Name(f"gain{number}")


def gains(text: TransientBuilder, since: Expression) -> list[Statement]:
    """Return the statements that find what varies in time, at a time since the start."""
    found = text.template.gains
    lines: list[Statement] = [fixed(SINCE, since)] if found else []
    return lines + [fixed(gain_name(k), table(gain.table, SINCE)) for k, gain in enumerate(found)]
