"""One step of a pair that estimates its own error: its stages, and the estimate.

The first stage takes over the step before, if it was accepted, and makes the first state. The last
one finds the worst of the error in a strip, and leaves the step to be judged.
"""

from cnnum import kernels as ir
from cnnum.engines.opencl.large_arrays.strip_attempt import FOUND, attempt, attempt_rows, figures
from cnnum.engines.opencl.large_arrays.strip_couplings import coupled
from cnnum.engines.opencl.large_arrays.strip_kernel import StripText
from cnnum.engines.opencl.large_arrays.strip_rows import CONTROL, ONES, At, Rows, constant, vector
from cnnum.engines.opencl.large_arrays.strip_times import gain_lines
from cnnum.engines.opencl.transients.builder import TransientBuilder
from cnnum.engines.opencl.transients.names import TIME, H, rates_of
from cnnum.engines.opencl.transients.pair_steps import LEFT_OUT
from cnnum.engines.opencl.transients.step_control import ACCEPT, Attempt
from cnnum.integrators.schemes import AdaptiveSteps
from cnnum.integrators.tableau import Pair, Row

LENGTH, MOVED, BEGINS = range(3)
"""Registers: h, whether the step before was accepted, when this one begins."""

MOVED_NOW, A, B = ir.names("moved a b")
OFF = ir.Name("off")
"""The estimate of a pair."""


def pair_attempts(text: TransientBuilder, scheme: AdaptiveSteps) -> Attempt:
    """Return the statements of a pair's steps, and keep their kernel with the tables."""
    stages = scheme.tableau.stages
    later_rates = (f"strip_k{n}" for n in range(1, stages))
    rows = attempt_rows(text, ("strip_x", "strip_k0", "strip_xs", *later_rates), 3)
    own = StripText(
        f"number % {stages}",
        lambda rows: _pair_cases(rows, scheme),
        end=f"({rows.register(MOVED)} != 0 ? {rows.at('strip_xs')} : 0)",
    )
    return attempt(
        rows,
        own,
        stages,
        [ir.Assign(CONTROL[LENGTH], H), ir.Assign(CONTROL[BEGINS], TIME)],
        begin=[ir.Assign(CONTROL[MOVED], ir.ZERO)],
        advance=[ir.Assign(CONTROL[MOVED], ACCEPT)],
    )


def _pair_cases(rows: Rows, scheme: AdaptiveSteps) -> list[ir.Case]:
    """Return all stages of a number of rows."""
    last, length = scheme.tableau.stages - 1, rows.register(LENGTH)
    head = [f"const vec h = (vec)({length});"]
    first = [_first(rows, scheme.of(at.layer), at) for at in rows.block]
    moved = f"const int moved = {rows.register(MOVED)} != 0;"
    cases = [rows.case(0, first, [*head, moved])]
    for stage in range(1, last + 1):
        c = rows.text.literal(float(sum(scheme.tableau.a[stage])))
        gains = gain_lines(rows.text, f"{rows.register(BEGINS)} + {c} * {length}")
        end, found = (_judge, FOUND) if stage == last else (_next, None)
        each = coupled(rows, "strip_xs")
        each += [end(rows, scheme, stage, at) for at in rows.block]
        cases.append(rows.case(stage, each, [*head, *gains], found))
    return cases


def _first(rows: Rows, tableau: Pair, at: At) -> ir.Block:
    last = tableau.stages - 1
    before = ir.Choice(MOVED_NOW, rows.array("strip_xs", at), rows.array("strip_x", at))
    rates = ir.Choice(MOVED_NOW, rows.array(f"strip_k{last}", at), rows.array("strip_k0", at))
    return ir.block(
        constant(A, before),
        constant(rates_of(0), rates),
        rows.store("strip_x", at, A),
        rows.store("strip_k0", at, rates_of(0)),
        *_moved(rows, tableau, 1, at),
    )


def _next(rows: Rows, scheme: AdaptiveSteps, stage: int, at: At) -> ir.Block:
    tableau = scheme.of(at.layer)
    return ir.block(
        *_rates(rows, [tableau.a[stage + 1]], stage, at),
        constant(A, rows.array("strip_x", at)),
        *_moved(rows, tableau, stage + 1, at),
    )


def _moved(rows: Rows, tableau: Pair, stage: int, at: At) -> list[ir.Statement]:
    """Return the statements that make the state of a stage, and its outputs."""
    state = vector(B, A + H * _combination(tableau.a[stage]))
    return [state, *rows.show(at, B), rows.store("strip_xs", at, B)]


def _rates(rows: Rows, weights: list[Row], stage: int, at: At) -> list[ir.Statement]:
    """Return the statements that keep the stage's own rate, and load the weighted ones before."""
    rate: ir.Expression = at.sum
    if rows.text.template.output.limited:
        rate = ir.call("inwards", at.sum, rows.array("strip_xs", at), ONES)
    k = rates_of(stage)
    wanted = [n for n in range(stage) if any(n < len(row) and row[n] for row in weights)]
    return [
        constant(k, rows.free(at, rate, ONES - ONES)),
        rows.store(f"strip_k{stage}", at, k),
        *(constant(rates_of(n), rows.array(f"strip_k{n}", at)) for n in wanted),
    ]


def _combination(weights: Row) -> ir.Expression:
    terms = [ir.Number(float(w)) * rates_of(n) for n, w in enumerate(weights) if w]
    return ir.total(terms) if terms else ir.Number(0.0)


def _judge(rows: Rows, scheme: AdaptiveSteps, last: int, at: At) -> ir.Block:
    """Return the statements that take a row into the worst error of a step, and its end."""
    tableau = scheme.of(at.layer)
    *parts, error = (
        ir.call("magnitude", H * _combination(weights))
        for weights in (*tableau.truncation, tableau.error)
    )
    off: ir.Expression = error
    left_out = ir.total(parts)
    lines = list[ir.Statement]()
    if scheme.bends:
        lines = [constant(LEFT_OUT, left_out), constant(OFF, error)]
        left_out, off = LEFT_OUT, ir.Choice(OFF < LEFT_OUT, LEFT_OUT, OFF)
    states = rows.array("strip_x", at), rows.array("strip_xs", at)
    return ir.block(
        *_rates(rows, [tableau.error, *tableau.truncation], last, at),
        *lines,
        *figures(rows, off, left_out, rates_of(last), states),
    )
