"""Transients without time steps, exact to rounding, and the bound on their rounding."""

from collections.abc import Callable
from typing import Any

import numpy as np

from cnnum import kernels as ir
from cnnum.arrays import Floats
from cnnum.engines.opencl.text import comment
from cnnum.engines.opencl.transients.builder import COL, ROW, SUM, TransientBuilder, X
from cnnum.engines.opencl.transients.feedforward import W, constant_drive, drive_of
from cnnum.engines.opencl.transients.step_control import Figures
from cnnum.integrators.propagator import Decay, Propagator, passes_in_fours, rounded_gain
from cnnum.integrators.solver import Linear
from cnnum.integrators.spectral import Spectral

LARGEST, X0, HALFWAY, MODES = ir.names("largest x0 halfway modes")
J, K, V = ir.names("j k v")


def exact(text: TransientBuilder, scheme: Linear) -> Figures:
    """Append statements that set the states `x` to their end; return the figures of the run."""
    begin_exact(text, "")
    roundings = _ENDS[type(scheme)](text, scheme)
    own = scheme.rounding / float(np.finfo(text.tables.dtype).eps)
    return exact_figures(text, roundings + own)


def begin_exact(text: TransientBuilder, why: str) -> None:
    """Append the statements that stand before all others."""
    text.body.append(comment(f"exact after {text.solver.duration:g}{why}"))
    text.body.append(ir.declare(LARGEST, ir.ZERO))


def exact_figures(text: TransientBuilder, roundings: float) -> Figures:
    """Return the figures of a run without steps, which is off by some roundings of `largest`."""
    rounding = ir.Number(float(np.finfo(text.tables.dtype).eps) * roundings)
    figures: Figures = {
        "time": ir.Number(text.solver.duration),
        "steps": ir.ZERO,
        "error": rounding * LARGEST,
    }
    return figures | ({"settled": ir.ONE} if text.solver.settle else {})


def _largest(value: ir.Expression) -> ir.Accumulate:
    return ir.Accumulate(LARGEST, "greater", ir.size(value))


def _decay(text: TransientBuilder, scheme: Decay) -> float:
    text.array(X, text.states)
    body: list[ir.Statement] = []
    for layer in range(text.layers):
        kept, to, origin = float(scheme.kept[layer]), drive_of(text, layer), text.start_of(layer)
        value = to if kept == 0.0 else to + ir.Number(kept) * (origin - to)
        value = text.unless_held(value, origin)
        body += [ir.Assign(X[text.at(layer)], value), _largest(to), _largest(origin)]
    text.over_cells(body)
    return float(np.count_nonzero(text.template.B)) + 4.0


def _drives(text: TransientBuilder) -> bool:
    """Append the drive as an array where it is constant; return whether there is any."""
    constant = constant_drive(text)
    if constant is None:
        return True
    if not any(constant):
        return False
    text.array(W, text.states)
    text.over_cells(
        [ir.Assign(w, ir.Number(z)) for w, z in zip(text.each(W), constant, strict=True)]
    )
    return True


def _propagate(text: TransientBuilder, scheme: Propagator) -> float:
    n, matrices = text.states, list[Floats]()
    offset, seen = text.tables.data(scheme.constant), list[ir.Statement]()
    fours, alone = list[ir.Statement](), list[ir.Statement]()

    def multiply(matrix: Floats, array: ir.Name) -> None:
        row = ir.Integer(text.tables.data(matrix)) + ir.CELL * n
        one, two, three, four = (
            text.tables.number_at(row + (J + k)) * array[J + k] for k in range(4)
        )
        # the sums of four wait for no other product, and are rounded by a quarter of the additions
        fours.append(ir.add(SUM, (one + two) + (three + four)))
        alone.append(ir.add(SUM, text.tables.number_at(row + J) * array[J]))
        seen.append(_largest(array[ir.CELL]))
        matrices.append(matrix)

    if scheme.state.any():
        text.start(X0)
        multiply(scheme.state, X0)
    if _drives(text):
        multiply(scheme.drive, W)
    text.array(X, n)
    body = [
        ir.declare(SUM, text.tables.number_at(ir.Integer(offset) + ir.CELL)),
        ir.Loop(J, n - n % 4, tuple(fours), step=4),
        *([ir.Loop(J, n, tuple(alone), start=n - n % 4)] if n % 4 else []),
        ir.Assign(X[ir.CELL], SUM),
        *seen,
    ]
    text.body.append(ir.sweep(ir.CELL, n, body))
    return _of_products(text, scheme, matrices)


def _of_products(text: TransientBuilder, scheme: Propagator, matrices: list[Floats]) -> float:
    """Return how many roundings sums of products hold that are added up in fours of columns."""
    later = float(len(matrices)) * passes_in_fours(len(scheme.constant))
    # the product, its sum of four, matrix and state as they are held, and the sum of a cell's drive
    own = 5.0 + np.count_nonzero(text.template.B) / text.layers + 2.0
    rim = 0.0
    if scheme.constant.any():
        text.body.append(ir.Assign(LARGEST, ir.call("fmax", LARGEST, ir.ONE)))
        rim = float(np.abs(scheme.constant).max()) * (later[0] + 2.0)
    # one counts half of the distance from 1 to the next number
    return 0.5 * (max(rounded_gain(matrices, [later + own] * len(matrices)), 1.0) + rim)


def _spectral(text: TransientBuilder, scheme: Spectral) -> float:
    """Append the way into the modes, their factors, and the way back."""
    (rows, cols), n = text.shape, text.states
    parts: list[tuple[ir.Name, Floats]] = []
    if scheme.state.any():
        text.start(X0)
        parts.append((X0, scheme.state))
    if _drives(text):
        parts.append((W, scheme.drive))
    text.array(HALFWAY, text.cells)
    for array, _ in parts:
        text.array(_modes(array), n)
        _transform(text, array, _modes(array), (scheme.rows, scheme.cols.T))
    text.array(MODES, n)
    body: list[ir.Statement] = []
    for to in range(text.layers):
        terms: list[ir.Expression] = [
            text.tables.constant(factors[to, source], ir.CELL) * _modes(array)[text.at(source)]
            for array, factors in parts
            for source in range(text.layers)
            if factors[to, source].any()
        ]
        body.append(ir.Assign(MODES[text.at(to)], ir.total(terms)))
    body += [_largest(value) for array, _ in parts for value in text.each(array)]
    text.over_cells(body)
    text.array(X, n)
    _transform(text, MODES, X, (scheme.rows.T, scheme.cols))
    if scheme.constant.any():
        places = [text.at(m) for m in range(text.layers)]
        text.over_cells([ir.add(X[at], text.tables.constant(scheme.constant, at)) for at in places])
    strongest = sum(float(np.abs(factors).sum(axis=1).max()) for _, factors in parts)
    # the transforms keep lengths, so they spread roundings over the cells and do not add them up
    return (2.0 * (rows + cols) + 2.0) * max(1.0, strongest)


def _modes(array: ir.Name) -> ir.Name:
    return ir.Name(f"{array.text}_modes")


def _transform(
    text: TransientBuilder, source: ir.Name, to: ir.Name, matrices: tuple[Floats, Floats]
) -> None:
    """Append to = left · source · right in every layer, for the matrices (left, right)."""
    rows, cols = text.shape
    left, right = map(np.ascontiguousarray, matrices)
    for layer in range(text.layers):
        start, halfway = ir.Integer(layer * text.cells), ir.Integer(0)
        weight = text.tables.constant(right, COL * cols + K)
        term = source[start + ROW * cols + COL] * weight
        _product(text, cols, HALFWAY[halfway + ROW * cols + K], term)
        value = text.tables.constant(left, ROW * rows + COL)
        term = value * HALFWAY[halfway + COL * cols + K]
        _product(text, rows, to[start + ROW * cols + K], term)


def _product(text: TransientBuilder, inner: int, target: ir.Element, term: ir.Binary) -> None:
    """Append target(r, k) = Σ_c value(r, c) · weight(c, k), whose terms are products."""
    rows, across = text.shape
    if text.tables.lanes > 1:  # sums in registers
        sums = ir.Loop(COL, inner, (ir.add(SUM, term),))
        each = (ir.declare(SUM, ir.ZERO), sums, ir.Assign(target, SUM))
        body: tuple[ir.Statement, ...] = (ir.Loop(K, across, each),)
    else:  # rows that compilers vectorise
        row = ir.Loop(K, across, (ir.add(target, V * term.right),))
        body = (
            ir.Loop(K, across, (ir.Assign(target, ir.ZERO),)),
            ir.Loop(COL, inner, (ir.fixed(V, term.left), row)),
        )
    text.body.append(ir.Sweep(ROW, rows, body))


_ENDS: dict[type, Callable[[TransientBuilder, Any], float]] = {
    Decay: _decay,
    Propagator: _propagate,
    Spectral: _spectral,
}
"""Each appends an end, and returns how many roundings of the largest number it is off at most."""
