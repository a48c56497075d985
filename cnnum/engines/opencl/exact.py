"""The kernel text of transients without time steps, and what rounding leaves of their exactness."""

import numpy as np

from cnnum.arrays import Floats
from cnnum.engines.opencl.drive import constant_drive, drive_of
from cnnum.engines.opencl.start import start, start_of
from cnnum.engines.opencl.text import comment
from cnnum.engines.opencl.transients import TransientText
from cnnum.integrators.propagator import Decay, Propagator
from cnnum.integrators.spectral import Spectral


def exact(text: TransientText, scheme: Decay | Propagator | Spectral) -> dict[str, str]:
    """Append the text that sets the states `x` to their end and return the figures of the run."""
    text.lines.append(comment(f"exact after {text.solver.duration:g}"))
    text.lines.append("real largest = ZERO;")
    if isinstance(scheme, Decay):
        terms, gain = _decay(text, scheme), 1.0
    elif isinstance(scheme, Propagator):
        terms, gain = _propagate(text, scheme)
    else:
        terms, gain = _spectral(text, scheme)
    # a sum of n rounded products is off by at most n roundings of its largest value
    rounding = text.number(float(np.finfo(text.tables.dtype).eps) * (terms + 2) * gain)
    figures = {
        "time": text.number(text.solver.duration),
        "steps": "ZERO",
        "error": f"{rounding} * largest",
    }
    return figures | ({"settled": "ONE"} if text.solver.settle else {})


def _largest(value: str) -> str:
    return f"largest = greater(largest, fabs({value}));"


def _decay(text: TransientText, scheme: Decay) -> int:
    text.array("x", text.layers * text.cells)
    body: list[str] = []
    for layer in range(text.layers):
        kept, to, origin = float(scheme.kept[layer]), drive_of(text, layer), start_of(text, layer)
        value = to if kept == 0.0 else f"{to} + {text.number(kept)} * ({origin} - {to})"
        if text.operands.mask is not None:
            value = f"PICK({text.operands.mask} != ZERO, {origin}, {value})"
        body += [f"x[{text.at(layer)}] = {value};", _largest(to), _largest(origin)]
    text.over_cells(body)
    return int(np.count_nonzero(text.template.B)) + 2


def _drives(text: TransientText) -> bool:
    """Append the drive as an array where it is constant; return whether there is any."""
    constant = constant_drive(text)
    if constant is None:
        return True
    if not any(constant):
        return False
    text.array("w", text.layers * text.cells)
    text.over_cells([f"w[{text.at(m)}] = {text.number(z)};" for m, z in enumerate(constant)])
    return True


def _propagate(text: TransientText, scheme: Propagator) -> tuple[int, float]:
    n = text.layers * text.cells
    offset, gain, products, seen = text.tables.data(scheme.constant), 0.0, "", list[str]()
    if scheme.state.any():
        start(text, "x0")
        at = text.tables.data(scheme.state)
        products += f"sum += R(data[{at} + i * {n} + j]) * x0[j]; "
        seen.append(_largest("x0[i]"))
        gain += float(np.abs(scheme.state).sum(axis=1).max())
    if _drives(text):
        at = text.tables.data(scheme.drive)
        products += f"sum += R(data[{at} + i * {n} + j]) * w[j];"
        seen.append(_largest("w[i]"))
        gain += float(np.abs(scheme.drive).sum(axis=1).max())
    text.array("x", n)
    text.lines.append(f"for (int i = 0; i < {n}; ++i) {{")
    text.lines.append(f"    real sum = R(data[{offset} + i]);")
    text.lines.append(f"    for (int j = 0; j < {n}; ++j) {{ {products} }}")
    text.lines += ["    x[i] = sum;", *seen, "}"]
    return 2 * n, max(gain, 1.0)


def _spectral(text: TransientText, scheme: Spectral) -> tuple[int, float]:
    """Append the way into the modes, their factors, and the way back."""
    (rows, cols), n = text.shape, text.layers * text.cells
    parts: list[tuple[str, Floats]] = []
    if scheme.state.any():
        start(text, "x0")
        parts.append(("x0", scheme.state))
    if _drives(text):
        parts.append(("w", scheme.drive))
    text.array("halfway", text.cells)
    for array, _ in parts:
        text.array(f"{array}_modes", n)
        for layer in range(text.layers):
            at = f"{layer * text.cells}"
            _right(text, array, at, "halfway", "0", scheme.cols.T)
            _left(text, "halfway", "0", f"{array}_modes", at, scheme.rows)
    text.array("modes", n)
    body: list[str] = []
    for to in range(text.layers):
        terms = [
            f"R(data[{text.tables.data(factors[to, source])} + i]) * "
            f"{array}_modes[{text.at(source)}]"
            for array, factors in parts
            for source in range(text.layers)
            if factors[to, source].any()
        ]
        body.append(f"modes[{text.at(to)}] = {' + '.join(terms) or 'ZERO'};")
    body += [_largest(f"{array}[{text.at(m)}]") for array, _ in parts for m in range(text.layers)]
    text.over_cells(body)
    text.array("x", n)
    for layer in range(text.layers):
        at = f"{layer * text.cells}"
        _right(text, "modes", at, "halfway", "0", scheme.cols)
        _left(text, "halfway", "0", "x", at, scheme.rows.T)
    if scheme.constant.any():
        offset = text.tables.data(scheme.constant)
        text.over_cells(
            [f"x[{text.at(m)}] += R(data[{offset} + {text.at(m)}]);" for m in range(text.layers)]
        )
    strongest = sum(float(np.abs(factors).sum(axis=1).max()) for _, factors in parts)
    # the transforms keep lengths, so they spread roundings over the cells and do not add them up
    return 2 * (rows + cols), max(1.0, strongest)


def _right(text: TransientText, source: str, at: str, to: str, place: str, matrix: Floats) -> None:
    """Append to = source · matrix, maps row by row."""
    rows, cols = text.shape
    data = text.tables.data(np.ascontiguousarray(matrix))
    value, weight = f"{source}[{at} + r * {cols} + c]", f"R(data[{data} + c * {cols} + k])"
    _product(text, rows, cols, cols, (f"{to}[{place} + r * {cols} + k]", value, weight))


def _left(text: TransientText, source: str, at: str, to: str, place: str, matrix: Floats) -> None:
    """Append to = matrix · source."""
    rows, cols = text.shape
    data = text.tables.data(np.ascontiguousarray(matrix))
    value, weight = f"R(data[{data} + r * {rows} + c])", f"{source}[{at} + c * {cols} + k]"
    _product(text, rows, rows, cols, (f"{to}[{place} + r * {cols} + k]", value, weight))


def _product(
    text: TransientText, outer: int, inner: int, across: int, names: tuple[str, str, str]
) -> None:
    """Append target(r, k) = Σ_c value(r, c) · weight(c, k)."""
    target, value, weight = names
    lines = [f"for (int r = 0; r < {outer}; ++r) {{"]
    if text.tables.lanes > 1:  # sums in registers
        lines += [
            f"    for (int k = 0; k < {across}; ++k) {{",
            "        real sum = ZERO;",
            f"        for (int c = 0; c < {inner}; ++c) {{ sum += {value} * {weight}; }}",
            f"        {target} = sum;",
            "    }",
        ]
    else:  # rows that compilers vectorise
        lines += [
            f"    for (int k = 0; k < {across}; ++k) {{ {target} = ZERO; }}",
            f"    for (int c = 0; c < {inner}; ++c) {{",
            f"        const real v = {value};",
            f"        for (int k = 0; k < {across}; ++k) {{ {target} += v * {weight}; }}",
            "    }",
        ]
    text.lines += [*lines, "}"]
