"""Closed-form transients without time steps, and the bound on their rounding error."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from cnnum import kernels as ir
from cnnum.arrays import Floats
from cnnum.engines.opencl.text import comment
from cnnum.engines.opencl.transients.builder import LARGEST, NOW, SUM, TransientBuilder, W, X
from cnnum.engines.opencl.transients.couplings import constant_drive, drive_of
from cnnum.engines.opencl.transients.step_control import Figures
from cnnum.integrators.closed_forms import (
    STEEPEST,
    UNSURE,
    Circulant,
    Decay,
    Propagator,
    Separate,
    Spectral,
    growth,
    moved,
    passes_in_fours,
    rounded_gain,
    roundings,
    summed,
    tips_over,
)
from cnnum.integrators.estimate import LOST
from cnnum.integrators.solver import Exact

FROM, TO, DRIVE, S, E, EDGE, AWAY = ir.names("from to drive s e edge away")
"""Start and end; the linear piece, its equilibrium, when a cell leaves it, and whether it never
does."""

G, B, AT_B, CROSSES, OVER, BETWEEN, LEFT, ENDS = ir.names("g b at_b crosses over between left ends")
"""In the middle piece: rate, the edge ahead and the rate there, whether and how the cell leaves."""

SEEN, AFTER, GROWN, SIZES = ir.names("seen after grown sizes")


def separate(text: TransientBuilder, scheme: Separate) -> float:
    """Append statements that set the states `x` to their end; return its error in roundings."""
    text.array(X, text.states)
    for layer in range(text.layers):
        text.over_cells((_sum if scheme.ends else _cell)(text, scheme, layer))
    return roundings(text.template)


def _sum(text: TransientBuilder, scheme: Separate, layer: int) -> list[ir.Statement]:
    """Return the argument of the output function that gives the output at the end, as a state."""
    factors = summed(float(scheme.own[layer]) - 1.0, float(scheme.time[layer]))
    kept, gain, weight = map(ir.Number, factors)
    start, rate = text.start_of(layer), drive_of(text, layer)
    if factors[2]:
        rate = rate + weight * start
    return [ir.Assign(X[text.at(layer)], text.unless_held(kept * start + gain * rate, start))]


def _cell(text: TransientBuilder, scheme: Separate, layer: int) -> list[ir.Statement]:
    own, time = float(scheme.own[layer]), float(scheme.time[layer])
    a, slope, d = ir.Number(own), ir.Number(own - 1.0), ir.Number(math.exp(-time))
    inside = ir.pick(CROSSES.differs(ir.ZERO), OVER, BETWEEN)
    to = text.unless_held(ir.pick(AWAY.differs(ir.ZERO), E + d * (FROM - E), inside), FROM)
    begun = ((FROM, text.start_of(layer)), (DRIVE, drive_of(text, layer)))
    return [
        ir.Declare("real", begun, fixed=True),
        ir.fixed(S, ir.pick(FROM > ir.ONE, ir.ONE, ir.pick(FROM < -ir.ONE, -ir.ONE, ir.ZERO))),
        ir.fixed(E, DRIVE + a * S),
        # d when it reaches its edge; 0 if it never does, or is within it
        ir.fixed(EDGE, ir.pick(S * E < S * S, (S - E) / (FROM - E), ir.ZERO)),
        ir.fixed(AWAY, ir.pick(EDGE > d, ir.ZERO, S * S)),
        ir.fixed(NOW, ir.clip(FROM)),
        ir.fixed(G, slope * NOW + DRIVE),
        ir.fixed(B, ir.pick(G < ir.ZERO, -ir.ONE, ir.ONE)),
        ir.fixed(AT_B, slope * B + DRIVE),
        *_inside(own - 1.0, time),
        ir.fixed(TO, to),
        ir.Assign(X[text.at(layer)], TO),
        *_rounded(text, own, time),
    ]


def _inside(slope: float, time: float) -> list[ir.Statement]:
    """Return the final states of cells that start in the middle piece or enter it."""
    m, d = ir.Number(slope), ir.Number(math.exp(-time))
    entered, crosses, begun = EDGE > d, B * AT_B > ir.ZERO, list[ir.Statement]()
    over: ir.Expression
    between: ir.Expression
    if math.isinf(time):
        if slope > 0.0:  # with zero rate a cell stays, although it would leave from either side
            crosses = crosses & G.differs(ir.ZERO)
        over, between = B + AT_B, ir.pick(G.differs(ir.ZERO), -DRIVE / m, NOW)
    elif slope == 1.0:  # as in most templates: e^t = 1/d is already known
        both = ((LEFT, ir.pick(entered, d / EDGE, d)), (ENDS, G / AT_B))
        begun = [ir.Declare("real", both, fixed=True)]
        crosses, over = crosses & (LEFT < ENDS), B + AT_B * (ir.ONE - LEFT / ENDS)
        grown = ir.Number(growth(1.0, time)) * ir.pick(entered, EDGE, ir.ONE)
        between = NOW + G * (grown - ir.ONE)
    else:
        ends: ir.Expression = (B - NOW) / G
        change: ir.Expression = LEFT
        if slope != 0.0:
            steepest = ir.Number(math.log(STEEPEST))
            ends = ir.call("log1p", m * (B - NOW) / G) / m
            change = ir.call("expm1", ir.call("fmin", m * LEFT, steepest)) / m
        # the time left after entering, and the time to leave again. A quotient of decays is exact
        # near the end
        left = ir.pick(entered, ir.call("log", EDGE / d), ir.Number(time))
        begun = [ir.fixed(LEFT, left), ir.fixed(ENDS, ends)]
        crosses = crosses & (ENDS < LEFT)
        over = B + AT_B * (ir.ONE - ir.call("exp", ENDS - LEFT))
        change = ir.pick(entered, change, ir.Number(moved(slope, time)))
        between = NOW + G * change
        if slope < 0.0:  # in which these two cancel
            falls = ir.pick(entered, ir.call("exp", m * LEFT), ir.Number(growth(slope, time)))
            between = NOW * falls + DRIVE * change
    return [
        *begun,
        ir.fixed(CROSSES, ir.pick(crosses, ir.ONE, ir.ZERO)),
        ir.fixed(OVER, over),
        ir.fixed(BETWEEN, between),
    ]


def _rounded(text: TransientBuilder, own: float, time: float) -> list[ir.Statement]:
    """Return the bound on rounding errors, as in `cnnum.integrators.closed_forms`."""
    slope, left = own - 1.0, ir.Number(math.exp(-time))
    rounding = float(np.finfo(text.tables.dtype).eps) * roundings(text.template)
    least = ir.Number(UNSURE * rounding) * SIZES if slope > 0.0 else ir.ZERO
    grown = ir.pick(ir.size(G) > least, AFTER / ir.size(G), ir.Number(growth(slope, time)))
    sum = ir.size(TO) + ir.pick(AWAY.differs(ir.ZERO), left, GROWN) * SIZES
    if not math.isinf(time):
        sum = sum + ir.Number(time) * AFTER
    if tips_over(own, time):
        near = ir.pick(ir.size(G) > ir.Number(rounding) * SIZES, ir.ZERO, ir.ONE - AWAY)
        near = ir.pick(ir.size(DRIVE) < ir.Number(slope), near, ir.ZERO)
        sum = sum + ir.Number(2.0 * LOST / rounding) * text.unless_held(near, ir.ZERO)
    return [
        ir.fixed(SEEN, ir.clip(TO)),
        ir.fixed(AFTER, ir.size(ir.Number(slope) * SEEN + DRIVE + (SEEN - TO))),
        ir.fixed(SIZES, ir.size(DRIVE) + ir.size(FROM) + ir.size(ir.Number(own) * NOW)),
        ir.fixed(GROWN, grown),
        ir.Accumulate(LARGEST, "greater", sum),
    ]


X0, HALFWAY, MODES = ir.names("x0 halfway modes")
J, K, V, DOWN = ir.names("j k v d")


def exact(text: TransientBuilder, scheme: Exact) -> Figures:
    """Append statements that set the states `x` to their end; return the results of the run.

    The end has an error of some roundings of `largest`.
    """
    alone = ": no cell sees another" if isinstance(scheme, Separate) else ""
    text.body.append(comment(f"exact after {text.solver.duration:g}{alone}"))
    text.body.append(ir.declare(LARGEST, ir.ZERO))
    unit = float(np.finfo(text.tables.dtype).eps)
    roundings = _ENDS[type(scheme)](text, scheme) + scheme.rounding / unit
    time, error = ir.Number(text.solver.duration), ir.Number(unit * roundings) * LARGEST
    figures: Figures = {"time": time, "steps": ir.ZERO, "error": error}
    return figures | ({"settled": ir.ONE} if text.solver.settle else {})


def _largest(value: ir.Expression) -> ir.Accumulate:
    return ir.Accumulate(LARGEST, "greater", ir.size(value))


def _decay(text: TransientBuilder, scheme: Decay) -> float:
    text.array(X, text.states)
    body: list[ir.Statement] = []
    for layer, state in enumerate(text.each(X)):
        kept, to, origin = float(scheme.kept[layer]), drive_of(text, layer), text.start_of(layer)
        value = to if kept == 0.0 else to + ir.Number(kept) * (origin - to)
        value = origin if kept == 1.0 else value
        value = text.unless_held(value, origin)
        body += [ir.Assign(state, value), _largest(to), _largest(origin)]
    text.over_cells(body)
    return float(np.count_nonzero(text.template.B)) + 4.0


def _parts(text: TransientBuilder, scheme: Propagator | Spectral) -> list[tuple[ir.Name, Floats]]:
    """Append the arrays from which an end is computed; return each with its matrix or factors."""
    parts: list[tuple[ir.Name, Floats]] = []
    if scheme.state.any():
        text.start(X0)
        parts.append((X0, scheme.state))
    if _driven(text):
        parts.append((W, scheme.drive))
    return parts


def _driven(text: TransientBuilder) -> list[int]:
    """Append the array of drives that are constant; return the layers that have one."""
    constant = constant_drive(text)
    if constant is None:
        result = text.template.B.any(axis=(1, 2, 3)) | (text.template.z != 0.0)
        return [n for n in range(text.layers) if result[n] or text.operands.biases]
    if any(constant):
        text.array(W, text.states)
        pairs = zip(text.each(W), constant, strict=True)
        text.over_cells([ir.Assign(w, ir.Number(z)) for w, z in pairs])
    return [n for n, z in enumerate(constant) if z]


def _propagate(text: TransientBuilder, scheme: Propagator) -> float:
    n, offset, parts = text.states, text.tables.data(scheme.constant), _parts(text, scheme)
    fours, alone = list[ir.Statement](), list[ir.Statement]()
    for array, matrix in parts:
        row = ir.Integer(text.tables.data(matrix)) + ir.CELL * n
        first, two, three, four = (
            text.tables.number_at(row + (J + k)) * array[J + k] for k in range(4)
        )
        # sums of four are independent of other products, and take part in a quarter of the
        # additions
        fours.append(ir.add(SUM, (first + two) + (three + four)))
        alone.append(ir.add(SUM, text.tables.number_at(row + J) * array[J]))
    text.array(X, n)
    body: list[ir.Statement] = [
        ir.declare(SUM, text.tables.number_at(ir.Integer(offset) + ir.CELL)),
        ir.Loop(J, n - n % 4, tuple(fours), step=4),
        *([ir.Loop(J, n, tuple(alone), start=n - n % 4)] if n % 4 else []),
        ir.Assign(X[ir.CELL], SUM),
        *(_largest(array[ir.CELL]) for array, _ in parts),
    ]
    text.body.append(ir.sweep(ir.CELL, n, body))
    return _of_products(text, scheme, [matrix for _, matrix in parts])


def _of_products(text: TransientBuilder, scheme: Propagator, matrices: list[Floats]) -> float:
    """Return the number of roundings in sums of products that are added four columns at a time."""
    later = float(len(matrices)) * passes_in_fours(len(scheme.constant))
    # the product, its sum of four, matrix and state as stored, and the sum of a cell's drive
    own = 5.0 + np.count_nonzero(text.template.B) / text.layers + 2.0
    rim = 0.0
    if scheme.constant.any():
        text.body.append(ir.Assign(LARGEST, ir.call("fmax", LARGEST, ir.ONE)))
        rim = float(np.abs(scheme.constant).max()) * (later[0] + 2.0)
    # one rounding is half the distance from 1 to the next number
    return 0.5 * (max(rounded_gain(matrices, [later + own] * len(matrices)), 1.0) + rim)


def _around_torus(text: TransientBuilder, scheme: Circulant) -> float:
    """Append sums of shifted drives, weighted by their distance on the torus.

    A table holds the weights of distances from 1 − n to n − 1, so that no index wraps around.
    """
    (rows, cols), driven = text.shape, _driven(text)
    apart = np.ix_(*(np.arange(1 - n, n) for n in text.shape))
    width, block = 2 * cols - 1, (2 * rows - 1) * (2 * cols - 1)
    state = X[TO * text.cells + ir.ROW * cols + K]
    shift = (ir.ROW - DOWN + (rows - 1)) * width + (K - J + (cols - 1))
    body: list[ir.Statement] = [ir.Loop(K, cols, (ir.Assign(state, ir.ZERO),))]
    for source in driven:
        weights = np.stack([scheme.drive[to, source][apart] for to in range(text.layers)])
        weight = text.tables.constant(weights, TO * block + shift)
        row = ir.Loop(K, cols, (ir.add(state, V * weight),))
        seen = ir.fixed(V, W[ir.Integer(source * text.cells) + DOWN * cols + J])
        body.append(ir.Loop(DOWN, rows, (ir.Loop(J, cols, (seen, row)),)))
    text.array(X, text.states)
    text.body.append(ir.Sweep(ir.ROW, rows, (ir.Loop(TO, text.layers, tuple(body)),)))
    text.over_cells([_largest(W[text.at(source)]) for source in driven])
    # a weight as stored, its product, the sum of a cell's drive, and all later additions
    passes = len(driven) * text.cells + np.count_nonzero(text.template.B) / text.layers + 4.0
    return 0.5 * max(scheme.gain(driven), 1.0) * float(passes)


def _spectral(text: TransientBuilder, scheme: Spectral) -> float:
    """Append the transform to modes, the factors per mode, and the inverse transform."""
    (rows, cols), n = text.shape, text.states
    parts = _parts(text, scheme)
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
        constants = [text.tables.constant(scheme.constant, at) for at in text.places]
        text.over_cells([ir.add(X[at], z) for at, z in zip(text.places, constants, strict=True)])
    strongest = sum(float(np.abs(factors).sum(axis=1).max()) for _, factors in parts)
    # the transforms are orthogonal, so they spread roundings over the cells without adding them up
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
        weight = text.tables.constant(right, ir.COL * cols + K)
        term = source[start + ir.ROW * cols + ir.COL] * weight
        _product(text, cols, HALFWAY[halfway + ir.ROW * cols + K], term)
        value = text.tables.constant(left, ir.ROW * rows + ir.COL)
        term = value * HALFWAY[halfway + ir.COL * cols + K]
        _product(text, rows, to[start + ir.ROW * cols + K], term)


def _product(text: TransientBuilder, inner: int, target: ir.Element, term: ir.Binary) -> None:
    """Append target(r, k) = Σ_c value(r, c) · weight(c, k), whose terms are products."""
    rows, across = text.shape
    if text.tables.lanes > 1:  # sums in registers
        sums = ir.Loop(ir.COL, inner, (ir.add(SUM, term),))
        column = (ir.declare(SUM, ir.ZERO), sums, ir.Assign(target, SUM))
        body: tuple[ir.Statement, ...] = (ir.Loop(K, across, column),)
    else:  # rows that compilers vectorise
        row = ir.Loop(K, across, (ir.add(target, V * term.right),))
        body = (
            ir.Loop(K, across, (ir.Assign(target, ir.ZERO),)),
            ir.Loop(ir.COL, inner, (ir.fixed(V, term.left), row)),
        )
    text.body.append(ir.Sweep(ir.ROW, rows, body))


_ENDS: dict[type, Callable[[TransientBuilder, Any], float]] = {
    Decay: _decay,
    Propagator: _propagate,
    Spectral: _spectral,
    Circulant: _around_torus,
    Separate: separate,
}
"""Each appends an end and returns a bound on its error, in roundings of the largest number."""
