"""Steps of an embedded Runge–Kutta pair, as sweeps over all cells.

A single small frame runs its stages in one loop: unrolled, the code is several times as long and
takes correspondingly longer to compile. Each iteration sums all rates so far, those that its stage
does not use multiplied by 0. The sum has the same terms in the same order, but with the zero terms
compilers may fuse different multiply-adds, which round differently.
"""

from collections.abc import Sequence

import numpy as np

from cnnum import kernels as ir
from cnnum.engines.opencl.transients.builder import RATE, TIME, XS, H, TransientBuilder, X, rates_of
from cnnum.engines.opencl.transients.fixed_steps import combination, declare_stages, stages
from cnnum.engines.opencl.transients.state_equation import Instant, outputs, rates
from cnnum.engines.opencl.transients.step_control import AMID_STEP, Attempt, advance, judged
from cnnum.integrators.schemes import AdaptiveSteps

LEFT_OUT = ir.Name("left_out")
"""The truncation error of a step in a cell."""

LATER_RATES, STAGE = ir.names("later stage")
"""The rates of all stages but the first, concatenated; the current stage."""


def sweeps(text: TransientBuilder, scheme: AdaptiveSteps) -> Attempt:
    """Return a step's statements as sweeps over all cells, stage by stage."""
    declare_stages(text, 1, scheme.tableau.stages)
    body = stages(text, scheme, 1, lambda c: Instant(TIME + ir.Number(c) * H, AMID_STEP))
    return _judged(text, scheme, body)


def rolls(text: TransientBuilder) -> bool:
    """Return whether to roll the stages for a short build, as for frames run one by one."""
    return text.arena.private and text.tables.lanes == 1


def rolled(text: TransientBuilder, scheme: AdaptiveSteps) -> Attempt:
    """Return a step's statements as a loop over its stages."""
    count, n = scheme.tableau.stages, text.states
    text.array(LATER_RATES, (count - 1) * n)
    text.array(XS, n)
    text.body += [
        ir.Alias(rates_of(stage), LATER_RATES, (stage - 1) * n) for stage in range(1, count)
    ]
    once = "__attribute__((opencl_unroll_hint(1)))"
    stage = tuple(text.aside(lambda: _round(text, scheme)))
    body: list[ir.Statement] = [
        # rates left by a rejected step may be infinite, and are multiplied by 0
        ir.sweep(ir.CELL, (count - 1) * n, [ir.Assign(LATER_RATES[ir.CELL], ir.ZERO)]),
        ir.Counted(STAGE, 1, count, None, stage, hint=once),
    ]
    return _judged(text, scheme, body)


def _round(text: TransientBuilder, scheme: AdaptiveSteps) -> None:
    """Append the loop iteration of one stage."""
    count, states = scheme.tableau.stages, list[ir.Expression]()
    for layer, place in enumerate(text.places):
        rows = np.zeros((count, count - 1))
        for stage, row in enumerate(scheme.of(layer).a):
            rows[stage, : len(row)] = [float(weight) for weight in row]
        weights = [ir.Name(f"a{layer}_{m}") for m in range(count - 1)]
        start = ir.Integer(text.tables.data(rows)) + STAGE * (count - 1)
        text.body += [
            ir.fixed(weight, text.tables.number_at(start + m)) for m, weight in enumerate(weights)
        ]
        terms = [weight * rates_of(m)[place] for m, weight in enumerate(weights)]
        states.append(X[place] + H * ir.total(terms))
    outputs(text, states, keep=XS)
    time: ir.Expression = ir.ZERO
    times = np.array([float(sum(row)) for row in scheme.tableau.a])
    if text.template.gains:
        time = TIME + text.tables.constant(times, STAGE) * H

    def keep(at: ir.Expression, _: int) -> list[ir.Statement]:
        return [ir.Assign(LATER_RATES[ir.after((STAGE - 1) * text.states, at)], RATE)]

    rates(text, XS, keep, Instant(time, AMID_STEP))


def _judged(
    text: TransientBuilder, scheme: AdaptiveSteps, body_of_step: Sequence[ir.Statement]
) -> Attempt:
    """Return a step with these stages, and its largest error and the change at its end."""
    last, body = rates_of(scheme.tableau.stages - 1), list[ir.Statement]()
    for layer, at in enumerate(text.places):
        tableau, lines = scheme.of(layer), list[ir.Statement]()
        left_out = ir.total([ir.size(H * combination(d, at)) for d in tableau.truncation])
        error: ir.Expression = H * combination(tableau.error, at)
        if scheme.bends:
            lines.append(ir.fixed(LEFT_OUT, left_out))
            error, left_out = ir.call("fmax", ir.size(error), LEFT_OUT), LEFT_OUT
        body.append(ir.block(*lines, *judged(text, at, error, left_out, last)))
    return Attempt(body_of_step, [ir.sweep(ir.CELL, text.cells, body)], advance(text, last))
