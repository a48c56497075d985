"""The kernel text of nonlinear couplings: tables as expressions, taps of their neighbourhoods."""

import numpy as np

from cnnum.engines.opencl.transients import TransientText
from cnnum.templating.couplings import NonlinearCoupling
from cnnum.templating.function_tables import Table
from cnnum.templating.network import Tap

ARRAYS = {"x": "xp", "y": "y", "u": "u"}
"""Padded arrays that hold a quantity."""


def table(text: TransientText, function: Table, argument: str) -> str:
    """Return the expression of a function table of an argument (a plain variable)."""
    if function.interpolation == "constant":
        value = text.number(function.points[-1][1])
        for place, level in reversed(function.points[:-1]):
            value = f"PICK({argument} <= {text.number(place)}, {text.number(level)}, {value})"
        return value
    value = text.number(function.points[0][1])
    for (v0, f0), (v1, f1) in zip(function.points, function.points[1:], strict=False):
        if f1 != f0:
            slope, low, high = (text.number(n) for n in ((f1 - f0) / (v1 - v0), v0, v1))
            value += f" + {slope} * (clamp({argument}, {low}, {high}) - {low})"
    return value


def nonlinear(text: TransientText, coupling: NonlinearCoupling) -> list[str]:
    """Return statements that add a nonlinear coupling's sum in cell `p` to `sum`."""
    radius = coupling.weights.shape[0] // 2
    array = ARRAYS[coupling.neighbour]
    lines: list[str] = []
    for row, col in np.argwhere(coupling.weights):
        tap = Tap(coupling.source, int(row) - radius, int(col) - radius, 1.0)
        argument = text.neighbour(array, tap)
        if coupling.centre is not None:
            centre = f"{ARRAYS[coupling.centre]}[p + {coupling.centre_source * text.padded}]"
            pair = (argument, centre) if coupling.reversed_sign else (centre, argument)
            argument = f"{pair[0]} - {pair[1]}"
        factor = " * v" if coupling.times_argument else ""
        weight = text.number(float(coupling.weights[row, col]))
        value = table(text, coupling.function, "v")
        lines.append(f"{{ const real v = {argument}; sum += {weight} * ({value}){factor}; }}")
    return lines
