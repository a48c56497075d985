"""One step of a pair that estimates its own error: its stages, and the estimate.

The first stage takes over the step before, if it was accepted, and makes the first state; the last
one finds the worst of the error in a strip, and leaves the step to be judged.
"""

from dataclasses import replace

from cnnum import kernels as ir
from cnnum.engines.opencl.large_arrays.strip_adaptive import (
    CONTROL,
    attempt_rows,
    first_rates,
    strip_attempt,
)
from cnnum.engines.opencl.large_arrays.strip_couplings import coupled
from cnnum.engines.opencl.large_arrays.strip_error import A, B, figures, judged, magnitude
from cnnum.engines.opencl.large_arrays.strip_kernel import StripText
from cnnum.engines.opencl.large_arrays.strip_rows import ONES, At, Rows, constant, vector
from cnnum.engines.opencl.large_arrays.strip_times import gain_lines
from cnnum.engines.opencl.transients.builder import TransientBuilder
from cnnum.engines.opencl.transients.step_control import ACCEPT, TIME, Attempt, H, rates_of
from cnnum.integrators.schemes import AdaptiveSteps
from cnnum.integrators.tableau import Pair, Row

LENGTH, MOVED, BEGINS = range(3)
"""Places in the array of control: h, whether the step before was accepted, when this one begins."""

MOVED_NOW = ir.Name("moved")


def pair_attempts(text: TransientBuilder, scheme: AdaptiveSteps) -> Attempt:
    """Return the statements of a pair's steps, and keep their kernel with the tables."""
    stages = scheme.tableau.stages
    rows = attempt_rows(text, ("strip_x", "strip_xs", *(f"strip_k{n}" for n in range(stages))), 3)
    own = StripText(
        f"number % {stages}",
        lambda block: _pair_cases(rows, scheme, block),
        rest=first_rates(rows, "strip_k0"),
        end=f"(x[{rows.at(CONTROL.text)} + {MOVED}] != 0 ? {rows.at('strip_xs')} : 0)",
    )
    settings = [ir.Assign(CONTROL[LENGTH], H), ir.Assign(CONTROL[BEGINS], TIME)]
    attempt = strip_attempt(rows, own, stages, settings, None)
    return replace(
        attempt,
        begin=[ir.Assign(CONTROL[MOVED], ir.ZERO), *attempt.begin],
        advance=[ir.Assign(CONTROL[MOVED], ACCEPT)],
    )


def _pair_cases(rows: Rows, scheme: AdaptiveSteps, block: int) -> list[ir.Case]:
    """Return all stages of a number of rows."""
    last = scheme.tableau.stages - 1
    every, own = rows.block(block), tuple(-scale for scale in rows.scales)
    control = rows.offsets[CONTROL.text]
    length = f"x[{control} + {LENGTH}]"
    head = [f"const vec h = (vec)({length});"]

    def at_stage(stage: int) -> list[str]:
        c = rows.text.literal(float(sum(scheme.tableau.a[stage])))
        return [*head, *gain_lines(rows.text, f"x[{control} + {BEGINS}] + {c} * {length}")]

    first = [_first(rows, scheme.of(at.layer), at) for at in every]
    cases = [rows.case(0, first, [*head, f"const int moved = x[{control} + {MOVED}] != 0;"])]
    for stage in range(1, last):
        each = coupled(rows, every, own, "strip_xs")
        each += [_next(rows, scheme.of(at.layer), stage, at) for at in every]
        cases.append(rows.case(stage, each, at_stage(stage)))
    each = coupled(rows, every, own, "strip_xs")
    each += [_judge(rows, scheme.of(at.layer), at) for at in every]
    return [*cases, rows.case(last, judged(rows, each), at_stage(last))]


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


def _next(rows: Rows, tableau: Pair, stage: int, at: At) -> ir.Block:
    return ir.block(
        *_rate(rows, stage, at),
        *_loaded(rows, [tableau.a[stage + 1]], stage, at),
        constant(A, rows.array("strip_x", at)),
        *_moved(rows, tableau, stage + 1, at),
    )


def _moved(rows: Rows, tableau: Pair, stage: int, at: At) -> list[ir.Statement]:
    """Return the statements that make the state of a stage, and its outputs."""
    state = vector(B, A + H * _combination(tableau.a[stage]))
    return [state, *rows.show(at, B), rows.store("strip_xs", at, B)]


def _rate(rows: Rows, stage: int, at: At) -> list[ir.Statement]:
    rate: ir.Expression = at.sum
    if rows.text.template.output.limited:
        rate = ir.call("inwards", at.sum, rows.array("strip_xs", at), ONES)
    k = rates_of(stage)
    return [constant(k, rows.free(at, rate, ONES - ONES)), rows.store(f"strip_k{stage}", at, k)]


def _loaded(rows: Rows, weights: list[Row], stage: int, at: At) -> list[ir.Statement]:
    """Return the statements that load the weighted rates, but for the stage's own rate."""
    wanted = [n for n in range(stage) if any(n < len(row) and row[n] for row in weights)]
    return [constant(rates_of(n), rows.array(f"strip_k{n}", at)) for n in wanted]


def _combination(weights: Row) -> ir.Expression:
    terms = [ir.Number(float(w)) * rates_of(n) for n, w in enumerate(weights) if w]
    return ir.total(terms) if terms else ir.Number(0.0)


def _judge(rows: Rows, tableau: Pair, at: At) -> ir.Block:
    """Return the statements that take a row into the worst error of a step, and its end."""
    last = tableau.stages - 1
    errors = (*tableau.truncation, tableau.error)
    *parts, error = (magnitude(H * _combination(weights)) for weights in errors)
    states = rows.array("strip_x", at), rows.array("strip_xs", at)
    return ir.block(
        *_rate(rows, last, at),
        *_loaded(rows, [tableau.error, *tableau.truncation], last, at),
        *figures(rows, error, ir.total(parts), rates_of(last), states),
    )
