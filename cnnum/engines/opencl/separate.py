"""The kernel text of cells that see only themselves: the pieces of their way, without a step.

The formulas, and what d is, stand in `cnnum.integrators.separate`.
"""

import numpy as np

from cnnum.engines.opencl.drive import drive_of
from cnnum.engines.opencl.start import start_of
from cnnum.engines.opencl.text import comment
from cnnum.engines.opencl.transients import TransientText
from cnnum.integrators.separate import ROUNDED, STEEPEST, Separate


def separate(text: TransientText, scheme: Separate) -> dict[str, str]:
    """Append the text that sets the states `x` to their end and return the figures of the run."""
    text.lines.append(comment(f"exact after {text.solver.duration:g}: no cell sees another"))
    text.lines.append("real largest = ZERO;")
    text.array("x", text.layers * text.cells)
    for layer in range(text.layers):
        text.over_cells(_cell(text, scheme, layer))
    rounding = text.number(float(np.finfo(text.tables.dtype).eps) * ROUNDED)
    figures = {
        "time": text.number(text.solver.duration),
        "steps": "ZERO",
        "error": f"{rounding} * largest",
    }
    return figures | ({"settled": "ONE"} if text.solver.settle else {})


def _cell(text: TransientText, scheme: Separate, layer: int) -> list[str]:
    own, left = float(scheme.own[layer]), float(scheme.left[layer])
    a, slope, d = text.number(own), text.number(own - 1.0), text.number(left)
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
        *(_at_rest(slope) if left == 0.0 else _on_time(text, own, left)),
        f"const real to = {to};",
        f"x[{text.at(layer)}] = to;",
        *_rounded(a),
    ]


def _at_rest(slope: str) -> list[str]:
    """Return where cells come to rest that are in the middle piece, or enter it."""
    return [
        "const real crosses = PICK(b * at_b > ZERO, ONE, ZERO), over = b + at_b;",
        f"const real between = PICK(g != ZERO, -drive / {slope}, now);",
    ]


def _on_time(text: TransientText, own: float, left: float) -> list[str]:
    """Return where cells are at the end that are in the middle piece at first, or enter it."""
    d = text.number(left)
    if own == 1.0:
        ends = "exp((now - b) / g)"
        time = text.number(-float(np.log(left)))
        moved = f"g * ({time} + PICK(edge > {d}, log(edge), ZERO))"
    else:
        ends = _power(text, "(g / at_b)", 1.0 / (own - 1.0))
        growth = text.number(min(left ** (1.0 - own), STEEPEST))
        entered = f"{growth} * {_power(text, 'edge', own - 1.0)}"
        moved = f"g * ((PICK(edge > {d}, {entered}, {growth}) - ONE) / {text.number(own - 1.0)})"
    return [
        f"const real d = PICK(edge > {d}, {d} / edge, {d});",
        # d, taken from where it entered, when it leaves the middle piece again
        f"const real ends = {ends};",
        "const real crosses = PICK(b * at_b > ZERO && d < ends, ONE, ZERO);",
        "const real over = b + at_b * (ONE - d / ends);",
        f"const real between = now + {moved};",
    ]


def _power(text: TransientText, base: str, exponent: float) -> str:
    if exponent == 1.0:
        return base
    if exponent == -1.0:
        return f"(ONE / {base})"
    return f"pow({base}, {text.number(exponent)})"


def _rounded(a: str) -> list[str]:
    """Return what rounding leaves: along its way an error grows as the rate of change does."""
    return [
        f"const real before = {a} * now + drive - from;",
        f"const real after = {a} * clamp(to, -ONE, ONE) + drive - to;",
        "const real grown = PICK(before != ZERO, fabs(after / before), ONE);",
        f"largest = greater(largest, fabs(to) + grown * (fabs(drive) + fabs(from) + fabs({a})));",
    ]
