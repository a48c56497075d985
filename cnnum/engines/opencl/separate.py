"""The kernel text of cells that see only themselves: the pieces of their way, without a step.

The formulas, and what d is, stand in `cnnum.integrators.separate`.
"""

import math

import numpy as np

from cnnum.engines.opencl.drive import drive_of
from cnnum.engines.opencl.start import start_of
from cnnum.engines.opencl.text import comment
from cnnum.engines.opencl.transients import TransientText
from cnnum.integrators.separate import STEEPEST, Separate, growth, moved, roundings


def separate(text: TransientText, scheme: Separate) -> dict[str, str]:
    """Append the text that sets the states `x` to their end and return the figures of the run."""
    text.lines.append(comment(f"exact after {text.solver.duration:g}: no cell sees another"))
    text.lines.append("real largest = ZERO;")
    text.array("x", text.layers * text.cells)
    for layer in range(text.layers):
        text.over_cells(_cell(text, scheme, layer))
    rounding = text.number(float(np.finfo(text.tables.dtype).eps) * roundings(text.template))
    figures = {
        "time": text.number(text.solver.duration),
        "steps": "ZERO",
        "error": f"{rounding} * largest",
    }
    return figures | ({"settled": "ONE"} if text.solver.settle else {})


def _cell(text: TransientText, scheme: Separate, layer: int) -> list[str]:
    own, time = float(scheme.own[layer]), float(scheme.time[layer])
    a, slope, d = text.number(own), text.number(own - 1.0), text.number(math.exp(-time))
    to = f"PICK(away != ZERO, e + {d} * (from - e), PICK(crosses != ZERO, over, between))"
    if text.operands.mask is not None:
        to = f"PICK({text.operands.mask} != ZERO, from, {to})"
    return [
        f"const real from = {start_of(text, layer)}, drive = {drive_of(text, layer)};",
        "const real s = PICK(from > ONE, ONE, PICK(from < -ONE, -ONE, ZERO));",
        f"const real e = drive + {a} * s;",
        # d when it comes to its edge; 0 where it never does, or is within it
        "const real edge = PICK(s * e < s * s, (s - e) / (from - e), ZERO);",
        f"const real away = PICK(edge > {d}, ZERO, s * s);",
        "const real now = clamp(from, -ONE, ONE);",
        f"const real g = {slope} * now + drive;",
        "const real b = PICK(g < ZERO, -ONE, ONE);",
        f"const real at_b = {slope} * b + drive;",
        *_inside(text, own - 1.0, time),
        f"const real to = {to};",
        f"x[{text.at(layer)}] = to;",
        *_rounded(text, own, time),
    ]


def _inside(text: TransientText, slope: float, time: float) -> list[str]:
    """Return where cells are at the end that are in the middle piece at first, or enter it."""
    if math.isinf(time):
        return _at_rest(text.number(slope))
    return _weight_of_two(text, time) if slope == 1.0 else _on_time(text, slope, time)


def _at_rest(slope: str) -> list[str]:
    """Return where cells come to rest that are in the middle piece, or enter it."""
    return [
        "const real crosses = PICK(b * at_b > ZERO, ONE, ZERO), over = b + at_b;",
        f"const real between = PICK(g != ZERO, -drive / {slope}, now);",
    ]


def _weight_of_two(text: TransientText, time: float) -> list[str]:
    """Return where they are on time for m = 1, as most templates have it: e^t = 1/d is at hand."""
    d, grown = text.number(math.exp(-time)), text.number(growth(1.0, time))
    return [
        f"const real left = PICK(edge > {d}, {d} / edge, {d}), ends = g / at_b;",
        "const real crosses = PICK(b * at_b > ZERO && left < ends, ONE, ZERO);",
        "const real over = b + at_b * (ONE - left / ends);",
        f"const real between = now + g * ({grown} * PICK(edge > {d}, edge, ONE) - ONE);",
    ]


def _on_time(text: TransientText, slope: float, time: float) -> list[str]:
    """Return where they are on time for any m."""
    m, d = text.number(slope), text.number(math.exp(-time))
    if slope == 0.0:
        ends, entered = "(b - now) / g", "left"
    else:
        ends = f"log1p({m} * (b - now) / g) / {m}"
        entered = f"expm1(fmin({m} * left, {text.number(math.log(STEEPEST))})) / {m}"
    along = text.number(moved(slope, time))
    return [
        # time that is left, from where it enters; a quotient of decays is exact near the end
        f"const real left = PICK(edge > {d}, log(edge / {d}), {text.number(time)});",
        # and that it takes to leave the middle piece again
        f"const real ends = {ends};",
        "const real crosses = PICK(b * at_b > ZERO && ends < left, ONE, ZERO);",
        "const real over = b + at_b * (ONE - exp(ends - left));",
        f"const real between = now + g * PICK(edge > {d}, {entered}, {along});",
    ]


def _rounded(text: TransientText, own: float, time: float) -> list[str]:
    """Return what rounding leaves, as `cnnum.integrators.separate` has it."""
    slope, left = own - 1.0, text.number(math.exp(-time))
    late = "" if math.isinf(time) else f" + {text.number(time)} * after"
    at_rest = text.number(growth(slope, time))
    return [
        "const real seen = clamp(to, -ONE, ONE);",
        f"const real after = fabs({text.number(slope)} * seen + drive + (seen - to));",
        f"const real grown = PICK(g != ZERO, after / fabs(g), {at_rest});",
        f"const real sizes = fabs(drive) + fabs(from) + fabs({text.number(own)} * now);",
        f"largest = greater(largest, fabs(to) + PICK(away != ZERO, {left}, grown) * sizes{late});",
    ]
