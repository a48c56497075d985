"""Steps of a fixed length: Runge–Kutta and Runge–Kutta–Chebyshev methods over all cells."""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

from cnnum import kernels as ir
from cnnum.engines.opencl.transients.builder import (
    CHANGE,
    PART,
    RATE,
    RUNNING,
    SETTLED,
    STEPS,
    STILL,
    TIME,
    XS,
    H,
    TransientBuilder,
    X,
    Y,
    rates_of,
    zeros,
)
from cnnum.engines.opencl.transients.couplings import arrive
from cnnum.engines.opencl.transients.state_equation import (
    RESTS,
    Instant,
    Then,
    into,
    outputs,
    rates,
    watched,
)
from cnnum.engines.opencl.transients.step_control import K0, Attempt, E, Figures, advance, judged
from cnnum.integrators.estimate import LOST
from cnnum.integrators.schemes import AdaptiveSteps, ChebyshevSteps, FixedSteps
from cnnum.integrators.tableau import MAX_STAGES, Row, chebyshev_method, coefficients
from cnnum.templating.batch import LADDER
from cnnum.templating.network import delays_outputs, lag

STAGES, OLD, K1 = ir.Name("stages"), ir.Name("old"), rates_of(1)
"""Number of stages in a step, the second-last stage, and the rates at the step's end."""

REACH, TABLE_ROW, STAGE, NEW = ir.names("reach row j new")
BEGIN, BACK1, BACK2, WEIGHT, START = ir.names("begin back1 back2 weight start")
"""Coefficients of a method's stages."""


def count_stages(scheme: ChebyshevSteps) -> list[ir.Statement]:
    """Return statements that find the number of stages; the lane with the longest step decides."""
    # the stability interval divided by s² − 1
    reach = chebyshev_method(MAX_STAGES).real_stability / (MAX_STAGES**2 - 1)
    stable = RUNNING * H * ir.Number(scheme.fastest) * ir.Number(1.0 / reach)
    longest = ir.call("LARGEST_LANE", stable) + ir.Cast("scalar", ir.Integer(1))
    short = ir.Cast("scalar", STAGES * STAGES) < REACH
    return [
        ir.Note("// the lane with the longest step says how many stages all of them take"),
        ir.fixed(REACH, longest, of="scalar"),
        ir.declare(STAGES, 2, of="int"),
        ir.While((STAGES < MAX_STAGES) & short, (ir.Assign(STAGES, ir.Integer(1), "+="),)),
    ]


def chebyshev_sweeps(text: TransientBuilder, scheme: ChebyshevSteps) -> Attempt:
    """Return a step's statements as sweeps over all cells."""
    table = text.tables.data(coefficients())
    for name in (XS, OLD, K1):
        text.array(name, text.states)

    def then(at: ir.Expression, _: int) -> list[ir.Statement]:
        states = (ir.ONE - BACK1 - BACK2) * X[at] + BACK1 * XS[at] + BACK2 * OLD[at]
        return [ir.Assign(OLD[at], states + H * (WEIGHT * RATE + START * K0[at]))]

    def number(place: int) -> ir.Expression:
        return text.tables.number_at(TABLE_ROW + place if place else TABLE_ROW)

    stage = text.aside(lambda: _rates(text, then))
    last_rates = text.aside(lambda: _rates(text, into(K1)))
    # the older values are no longer needed: swap the two
    swap: list[ir.Statement] = [
        ir.fixed(NEW, OLD[ir.CELL]),
        ir.Assign(OLD[ir.CELL], XS[ir.CELL]),
        ir.Assign(XS[ir.CELL], NEW),
    ]
    first = [
        ir.Assign(OLD[ir.CELL], X[ir.CELL]),
        ir.Assign(XS[ir.CELL], X[ir.CELL] + BEGIN * H * K0[ir.CELL]),
    ]
    stage_body = (
        ir.add(TABLE_ROW, ir.Integer(4)),
        ir.Declare("real", ((BACK1, number(0)), (BACK2, number(1))), fixed=True),
        ir.Declare("real", ((WEIGHT, number(2)), (START, number(3))), fixed=True),
        *stage,
        ir.sweep(ir.CELL, text.states, swap),
    )
    stages = [
        *count_stages(scheme),
        ir.declare(TABLE_ROW, ir.Integer(table) + STAGES * MAX_STAGES * 4, of="int"),
        ir.fixed(BEGIN, number(2)),
        ir.sweep(ir.CELL, text.states, first),
        ir.Counted(STAGE, 1, STAGES, None, stage_body),
        ir.Block(tuple(last_rates)),
    ]
    return Attempt(stages, _judge(text), advance(text, K1))


def _rates(text: TransientBuilder, then: Then) -> None:
    outputs(text, text.each(XS))
    rates(text, XS, then, Instant())


def _judge(text: TransientBuilder) -> list[ir.Statement]:
    """Return statements that find the largest error of a step, and the change at its end."""
    # Sommeijer, Shampine & Verwer 1998, section 2.2
    states = ir.call("R", ir.Constant("0.8")) * (X[ir.CELL] - XS[ir.CELL])
    error = states + ir.call("R", ir.Constant("0.4")) * H * (K0[ir.CELL] + K1[ir.CELL])
    return [ir.sweep(ir.CELL, text.states, judged(text, ir.CELL, error, E, K1))]


def repeated(
    text: TransientBuilder,
    scheme: FixedSteps,
    length: ir.Expression,
    body: Sequence[ir.Statement],
) -> Figures:
    """Append a scheme's steps and return the results of the run.

    Parameters
    ----------
    text : TransientBuilder
    scheme : FixedSteps
    length : Expression
        Length of the step `n`.
    body : sequence of Statement
        A step of length `h`; where steps settle, it leaves the change in `change`.
    """
    steps = f"{scheme.count} steps of {scheme.step:g}"
    if scheme.settle:
        note = f"{scheme.name}: at most {steps}, a lane stops where nothing changes any more"
        text.body += [ir.Note(f"// {note}"), *_until_rest(text, scheme, length, body)]
    else:
        once = (ir.fixed(H, length), *body)
        text.body += [
            ir.Note(f"// {scheme.name}: {steps}"),
            ir.Counted(ir.ROUND, 0, scheme.count, None, once),
        ]
    return fixed_figures(text, scheme)


def _until_rest(
    text: TransientBuilder,
    scheme: FixedSteps,
    length: ir.Expression,
    body: Sequence[ir.Statement],
) -> list[ir.Statement]:
    """Return the iterations of steps; a lane stops once nothing changes any more."""
    # with a delay, a state may pause at a turning point without being at rest
    late, rests, counted = lag(text.template, scheme.step), RESTS, list[ir.Statement]()
    begun = [ir.Declare("real", ((RUNNING, ir.ONE), *zeros(TIME, STEPS, SETTLED)))]
    if late:
        begun.append(ir.declare(STILL, ir.ZERO))
        counted = [ir.Assign(STILL, ir.pick(rests, STILL + RUNNING, ir.ZERO))]
        rests = ir.Number(late + 0.5) <= STILL
    once = (
        ir.fixed(H, RUNNING * length),
        ir.declare(CHANGE, ir.ZERO),
        *body,
        ir.add(TIME, H),
        ir.add(STEPS, RUNNING),
        *counted,
        ir.Assign(SETTLED, ir.pick(rests, ir.ONE, SETTLED)),
        ir.Assign(RUNNING, ir.pick(rests, ir.ZERO, RUNNING)),
    )
    return [*begun, ir.Counted(ir.ROUND, 0, scheme.count, RUNNING, once)]


def fixed_figures(text: TransientBuilder, scheme: FixedSteps) -> Figures:
    """Return the results of steps of a fixed length, whose error is not estimated."""
    error = ir.Number(LOST)
    if scheme.settle:
        return {"time": TIME, "steps": STEPS, "settled": SETTLED, "error": error}
    time, steps = ir.Number(text.solver.duration), ir.Number(scheme.count)
    return {"time": time, "steps": steps, "error": error}


RING, NOW_AT, THEN_AT, NEXT_AT = ir.names("ring now_at then_at next_at")
"""Ring buffer of past outputs, and the positions in it of current, delayed and next outputs."""

SPAN = ir.Name("span")
"""Per-frame step length, if delays differ between frames."""

SLIVER = 0.01
"""Fraction of a step below which a last step is due to rounding."""


def fixed_steps(text: TransientBuilder, scheme: FixedSteps) -> Figures:
    """Append steps of a fixed length and return the results of the run."""
    if scheme.stages > 1:
        declare_stages(text, 0, scheme.stages)
    late, delay = lag(text.template, scheme.step), _own_delay(text)
    if delays_outputs(text.template):
        text.array(RING, (late + 1) * text.states)
    if delay is not None:
        # the step is the same fraction of the delay in all frames. Delays lie within one rung of a
        # ladder, which bounds the number of steps of any frame
        text.body.append(ir.fixed(SPAN, delay * ir.Number(1.0 / late)))
        scheme = replace(scheme, count=math.ceil(LADDER * scheme.count) + 1)
    step = _euler_step if scheme.stages == 1 else _several_stages
    body = [*_ring(text, scheme, late), *text.aside(lambda: step(text, scheme))]
    figures = repeated(text, scheme, _length(text, scheme), body)
    if delay is not None and not scheme.settle:
        taken = ir.Number(text.solver.duration) / SPAN - ir.Number(SLIVER)
        figures["steps"] = ir.call("ceil", taken)
    return figures


def _euler_step(text: TransientBuilder, scheme: FixedSteps) -> None:
    outputs(text, text.each(X))
    _remember(text)

    def then(at: ir.Expression, layer: int) -> list[ir.Statement]:
        change = [watched(text, X[at])] if scheme.settle else []
        (weight,) = scheme.of(layer).b
        move = RATE if weight == 1 else ir.Number(float(weight)) * RATE
        return [*change, ir.Assign(X[at], _limited(text, X[at] + H * move))]

    rates(text, X, then, _instant(text, scheme, 0.0))


def _several_stages(text: TransientBuilder, scheme: FixedSteps) -> None:
    text.body += stages(text, scheme, 0, partial(_instant, text, scheme))
    body: list[ir.Statement] = []
    for layer, at in enumerate(text.places):
        tableau = scheme.of(layer)
        if scheme.settle:
            body.append(ir.block(ir.fixed(RATE, K0[at]), watched(text, X[at])))
        end: ir.Expression = X[at]
        if tableau.carried:
            end = end + ir.Number(tableau.carried) * (XS[at] - X[at])
        body.append(ir.Assign(X[at], _limited(text, end + H * combination(tableau.b, at))))
    text.over_cells(body)


def _limited(text: TransientBuilder, state: ir.Expression) -> ir.Expression:
    return ir.clip(state) if text.template.output.limited else state


# stages, of pairs too


def declare_stages(text: TransientBuilder, first: int, stages: int) -> None:
    """Append the arrays of the rates from one stage on, and of the states at stages."""
    for name in (*map(rates_of, range(first, stages)), XS):
        text.array(name, text.states)


def stages(
    text: TransientBuilder,
    scheme: FixedSteps | AdaptiveSteps,
    first: int,
    instant: Callable[[float], Instant],
) -> list[ir.Statement]:
    """Return the stages of a step `h` from `first` on; `instant` takes a fraction of the step."""
    rows = scheme.tableau.a
    step = (
        partial(_stage, text, scheme, number, instant(float(sum(rows[number]))))
        for number in range(first, scheme.tableau.stages)
    )
    return [ir.Block(tuple(text.aside(stage))) for stage in step]


def _stage(
    text: TransientBuilder, scheme: FixedSteps | AdaptiveSteps, number: int, instant: Instant
) -> None:
    """Append one stage: outputs at its state, then its rates."""
    if number == 0:
        outputs(text, text.each(X))
        _remember(text)
    else:
        rows = [scheme.of(layer).a[number] for layer in range(text.layers)]
        states = zip(text.places, rows, strict=True)
        outputs(text, [X[at] + H * combination(row, at) for at, row in states], keep=XS)
    # a cell that reaches its limit within a step of fixed length stays there to its end
    outwards = number > 0 and isinstance(scheme, FixedSteps)
    rates(text, XS if number else X, into(rates_of(number)), instant, outwards=outwards)


def combination(weights: Row, at: ir.Expression) -> ir.Expression:
    """Return the weighted sum of the stages' rates at an index."""
    return ir.total(
        [ir.Number(float(weight)) * rates_of(n)[at] for n, weight in enumerate(weights) if weight]
    )


# delays: a ring buffer of past outputs, and per-frame steps


def _ring_at(text: TransientBuilder, slot: ir.Name, at: ir.Expression) -> ir.Element:
    return RING[ir.after(slot * text.states, at)]


def _remember(text: TransientBuilder) -> None:
    """Append statements that store this step's outputs in the ring buffer."""
    if delays_outputs(text.template):
        pairs = enumerate(text.places)
        text.over_grid(
            [ir.Assign(_ring_at(text, NOW_AT, at), Y[text.padded_at(m)]) for m, at in pairs]
        )


def _ring(text: TransientBuilder, scheme: FixedSteps, late: int) -> list[ir.Statement]:
    """Return the head of a step, which finds positions in the ring; the delay is `late` steps."""
    lines: list[ir.Statement] = []
    if delays_outputs(text.template):
        slots, share = late + 1, _last(scheme, 1.0, scheme.last / scheme.step)
        lines = [
            ir.fixed(NOW_AT, ir.ROUND % slots, of="int"),
            ir.fixed(THEN_AT, ir.call("max", ir.ROUND - late, 0) % slots, of="int"),
            ir.fixed(NEXT_AT, ir.call("max", ir.ROUND + 1 - late, 0) % slots, of="int"),
            ir.fixed(PART, share if _own_delay(text) is None else H / SPAN),
        ]
    if text.has_history:
        lines.append(ir.Branch(ir.ROUND.equals(late), tuple(text.aside(lambda: arrive(text)))))
    return lines


def _instant(text: TransientBuilder, scheme: FixedSteps, c: float) -> Instant:
    """Return the time of stage `c` of step `n`; delayed outputs are those of its start or end."""

    def past(at: ir.Expression) -> ir.Expression:
        first = _ring_at(text, THEN_AT, at)
        return first if c == 0.0 else first + PART * (_ring_at(text, NEXT_AT, at) - first)

    step = ir.Number(scheme.step) if _own_delay(text) is None else SPAN
    if not text.template.gains:
        return Instant(past=past)
    began: ir.Expression = step * ir.real(ir.ROUND)
    if scheme.pieces:
        began = _by_piece(
            scheme,
            [
                ir.Number(piece.start) + ir.Number(piece.step) * ir.real(ir.ROUND - piece.first)
                for piece in scheme.pieces
            ],
        )
    within = None if text.template.delayed is None else (began, H)
    return Instant(began + ir.Number(c) * H, began + ir.Number(0.5) * H, past, within)


def _by_piece(scheme: FixedSteps, values: Sequence[ir.Expression]) -> ir.Expression:
    """Return the value for the interval that contains step `n`."""
    value = values[-1]
    for piece, before in zip(reversed(scheme.pieces[1:]), reversed(values[:-1]), strict=True):
        value = ir.Choice(ir.ROUND < ir.Integer(piece.first), before, value)
    return value


def _own_delay(text: TransientBuilder) -> ir.Name | None:
    """Return the variable of frames' own delays, None if all have the same or none."""
    own = text.operands.own
    return None if own is None else own.delay


def _length(text: TransientBuilder, scheme: FixedSteps) -> ir.Expression:
    """Return the length of step `n`, which is 0 once a frame has finished."""
    if scheme.pieces:
        return _by_piece(scheme, [ir.Number(piece.step) for piece in scheme.pieces])
    if _own_delay(text) is None:
        return _last(scheme, scheme.step, scheme.last)
    left = ir.Number(text.solver.duration) - SPAN * ir.real(ir.ROUND)
    return ir.call("clamp", left, ir.ZERO, SPAN)


def _last(scheme: FixedSteps, usual: float, last: float) -> ir.Expression:
    """Return `usual`, or `last` in the last step."""
    if math.isclose(usual, last, rel_tol=1e-9):
        return ir.Number(usual)
    return ir.Choice(ir.ROUND.equals(scheme.count - 1), ir.Number(last), ir.Number(usual))
