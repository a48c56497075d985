"""Nonlinear couplings of cells, and the external drive."""

from collections.abc import Callable
from itertools import pairwise

import numpy as np

from cnnum import kernels as ir
from cnnum.engines.opencl.large_arrays.lane_layout import keep_rows, lanes_fit
from cnnum.engines.opencl.text import comment
from cnnum.engines.opencl.transients.builder import LATER, NOW, SUM, XP, TransientBuilder, U, W, Y
from cnnum.kernels.expressions import formula
from cnnum.templating.couplings import NonlinearCoupling, Quantity
from cnnum.templating.functions import PairFunction, Table
from cnnum.templating.network import (
    Tap,
    delays_inputs,
    moving_inputs,
    reads_inputs,
    reads_inputs_around,
    taps,
)

ARRAYS = {"x": XP, "y": Y, "u": U}
"""Padded arrays that hold a quantity."""

Reads = Callable[[Quantity, int, int, int], ir.Expression]
"""A quantity of a layer or input, in a cell at a row and column offset."""

V, OWN, SINCE, AMID = ir.names("v own since amid")

SHORTEST = 1e-30
"""A length that devices do not flush to 0."""


def table(
    function: Table,
    argument: ir.Name,
    number: Callable[[float], ir.Expression] | None = None,
) -> ir.Expression:
    """Return the expression of a function table; `number` gives values that are variables."""
    points, held = function.points, number or ir.Number
    if function.interpolation == "constant":
        value: ir.Expression = held(points[-1][1])
        for place, level in reversed(points[:-1]):
            value = ir.pick(argument <= ir.Number(place), held(level), value)
        return value
    value = held(points[0][1])
    for (low, before), (high, after) in pairwise(points):
        if number is None and after == before:
            continue
        # a sum of ramps would propagate the rounding errors of steep ones to all that follow
        share = _along((argument - ir.Number(low)) * ir.Number(1.0 / (high - low)))
        between = held(before) * (ir.ONE - share) + held(after) * share
        value = ir.pick(argument <= ir.Number(low), value, between)
    return value


def _along(share: ir.Expression) -> ir.Expression:
    return ir.call("clamp", share, ir.ZERO, ir.ONE)


def mean(
    function: Table,
    begin: ir.Expression,
    length: ir.Expression,
    number: Callable[[float], ir.Expression] | None = None,
) -> ir.Expression:
    """Return the expression of a table's mean over an interval, like `Table.mean`."""
    points, held = function.points, number or ir.Number
    value = held(points[0][1])
    for (low, before), (high, after) in pairwise(points):
        if number is None and after == before:
            continue
        if function.interpolation == "constant":
            share = _along((begin + length - ir.Number(low)) / length)
        else:
            part = ir.Number(1.0 / (high - low))
            least = _along((begin - ir.Number(low)) * part)
            most = _along((begin + length - ir.Number(low)) * part)
            inside = ir.Number(0.5) * (most - least) * (most + least)
            beyond = _along((begin + length - ir.Number(high)) / length)
            share = inside / (part * length) + beyond
        value = value + share * (held(after) - held(before))
    return value


def nonlinear(text: TransientBuilder, layer: int, *, static: bool) -> list[ir.Statement]:
    """Return statements that add a layer's nonlinear couplings in cell `p` to `sum`.

    `static` selects those that are constant in time, else all others are added.
    """
    result = [
        coupling
        for coupling in text.template.nonlinear
        if coupling.static == static and coupling.to == layer
    ]

    def quantity(name: Quantity, source: int, row: int, col: int) -> ir.Expression:
        return text.neighbour(ARRAYS[name], Tap(source, row, col, 1.0))

    return [
        line for coupling in result for line in summed(coupling, quantity, SUM, number=text.number)
    ]


def summed(
    coupling: NonlinearCoupling,
    quantity: Reads,
    to: ir.Name,
    scale: float = 1.0,
    of: str = "real",
    number: Callable[[float], ir.Expression] = ir.Number,
) -> list[ir.Statement]:
    """Return statements that add a nonlinear coupling's scaled sum to a variable.

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
    """Return the variable of the gain of a time-varying coupling."""
    return ir.Name(f"gain{number}")


def gains(
    text: TransientBuilder,
    since: ir.Expression,
    middle: ir.Expression,
    within: tuple[ir.Expression, ir.Expression] | None = None,
) -> list[ir.Statement]:
    """Return the statements that compute time-varying gains at a time since the start.

    Gains with jumps are evaluated in the middle of the step, since they may have two values at its
    ends. If a step may contain jumps, `within` gives its start and length, and gains are averaged
    over it.
    """
    number = None if text.operands.own is None else text.number
    lines: list[ir.Statement] = []
    if within is not None and text.template.gains:
        # a step of zero length moves nothing, whatever the gains are
        length = ir.call("fmax", within[1], ir.Number(SHORTEST))
        return [
            ir.fixed(SINCE, within[0]),
            ir.fixed(AMID, length),
            *(
                ir.fixed(gain_name(k), mean(gain.table, SINCE, AMID, number))
                for k, gain in enumerate(text.template.gains)
            ),
        ]
    for name, at, jumps in ((SINCE, since, False), (AMID, middle, True)):
        values = [
            ir.fixed(gain_name(k), table(gain.table, name, number))
            for k, gain in enumerate(text.template.gains)
            if (gain.table.interpolation == "constant") == jumps
        ]
        lines += [ir.fixed(name, at), *values] if values else []
    return lines


THEN = ir.Name("then")


def constant_drive(text: TransientBuilder) -> tuple[float, ...] | None:
    """Return z of every layer if nothing else drives the cells, else None."""
    if reads_inputs(text.template) or text.operands.biases:
        return None
    return tuple(float(z) for z in text.template.z)


def drive_of(text: TransientBuilder, layer: int) -> ir.Expression:
    """Return w in cell `i` of a layer."""
    constant = constant_drive(text)
    return W[text.at(layer)] if constant is None else ir.Number(constant[layer])


def drive(text: TransientBuilder) -> None:
    """Append the statements that compute w, unless it is just z."""
    text.body.append(comment(f"{text.template.name}: w = B * u + z"))
    if constant_drive(text) is not None:
        return
    template = text.template
    text.array(W, text.states)
    if reads_inputs_around(text.template):
        text.array(U, template.inputs * text.padded)
        if text.has_history:
            _history(text)
        _pad(text, text.operands.inputs)
    body: list[ir.Statement] = [ir.declare(SUM)]
    for layer in range(text.layers):
        start: ir.Expression = ir.Number(float(template.z[layer]))
        if text.operands.biases:
            start = start + text.operands.biases[layer]
        body.append(ir.Assign(SUM, start))
        body += _driven(text, layer)
        body += nonlinear(text, layer, static=True)
        if delays_inputs(template):
            body += _delayed(text, layer)
        body.append(ir.Assign(W[text.at(layer)], SUM))
    text.over_grid(body)
    if lanes_fit(text):  # steps by strips keep reading them
        for number in moving_inputs(text.template):
            keep_rows(text, number)


def _driven(text: TransientBuilder, layer: int) -> list[ir.Statement]:
    """Return statements that add B * u of a layer to `sum`."""
    result = taps(text.template.B, layer)
    if reads_inputs_around(text.template):
        return text.weighted(U, result)
    inputs = text.operands.inputs
    return [ir.add(SUM, ir.Number(tap.weight) * inputs[tap.source]) for tap in result]


def arrive(text: TransientBuilder) -> None:
    """Append the statements that switch delayed inputs to those since the start."""
    text.over_cells(
        [ir.add(w, change) for w, change in zip(text.each(W), text.each(LATER), strict=True)]
    )


def _pad(text: TransientBuilder, inputs: tuple[ir.Expression, ...]) -> None:
    boundary = text.template.input_boundary
    text.over_grid([ir.Assign(U[text.padded_at(m)], source) for m, source in enumerate(inputs)])
    text.fill_rims(U, text.template.inputs, boundary, boundary.constant)


def _delayed(text: TransientBuilder, layer: int) -> list[ir.Statement]:
    assert text.template.delayed is not None
    result, later = taps(text.template.delayed.B, layer), LATER[text.at(layer)]
    if not text.has_history:
        return text.weighted(U, result)
    # w starts from the inputs before the start; `later` is its change once the delay has elapsed
    return [
        ir.block(
            ir.declare(NOW, ir.ZERO),
            *text.weighted(U, result, NOW),
            ir.fixed(THEN, later),
            ir.add(SUM, THEN),
            ir.Assign(later, NOW - THEN),
        )
    ]


def _history(text: TransientBuilder) -> None:
    """Append statements that store in `later` the part of delayed inputs before the start."""
    assert text.template.delayed is not None
    text.array(LATER, text.states)
    _pad(text, text.operands.previous)
    body: list[ir.Statement] = [ir.declare(SUM)]
    for layer, later in enumerate(text.each(LATER)):
        terms = text.weighted(U, taps(text.template.delayed.B, layer))
        body += [ir.Assign(SUM, ir.ZERO), *terms, ir.Assign(later, SUM)]
    text.over_grid(body)
