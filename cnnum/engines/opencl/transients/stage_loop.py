"""Adaptive steps of a single small frame: all stages are rounds of one loop.

Written out a stage after the other the text is several times as long. It takes as much longer to
build. Each round takes all rates so far, those that its stage does not weigh times 0. The sum has
the same terms in the same order. But where a 0 stands between two products compilers may fuse
others of the multiply-adds, which round otherwise.
"""

import numpy as np

from cnnum import kernels as ir
from cnnum.engines.opencl.transients.builder import TransientBuilder, X
from cnnum.engines.opencl.transients.runge_kutta_steps import taken_over
from cnnum.engines.opencl.transients.state_equation import RATE, Instant, outputs, rates
from cnnum.engines.opencl.transients.step_control import TIME, XS, Attempt, H, rates_of
from cnnum.integrators.choice import AdaptiveSteps
from cnnum.integrators.tableau import Pair

LATER_RATES, STAGE = ir.names("later stage")
"""The rates of all stages but the first, one after the other; the stage at hand."""


def rolls(text: TransientBuilder) -> bool:
    """Whether steps are to be built quickly: frames side by side are worth the longer text."""
    return text.arena.private and text.tables.lanes == 1


def rolled(text: TransientBuilder, scheme: AdaptiveSteps) -> Attempt:
    """Return a step's statements as a loop over its stages."""
    stages, n = scheme.tableau.stages, text.states
    tableaux = tuple(scheme.of(layer) for layer in range(text.layers))
    text.array(LATER_RATES, (stages - 1) * n)
    text.array(XS, n)
    names = [f"*const k{stage} = later + {(stage - 1) * n}" for stage in range(1, stages)]
    text.body.append(ir.Verbatim((f"__private real {', '.join(names)};",)))
    once = "__attribute__((opencl_unroll_hint(1)))"
    body: list[ir.Statement] = [
        # rates that a refused step left may be infinite, and are multiplied by 0
        ir.sweep(ir.CELL, (stages - 1) * n, [ir.Assign(LATER_RATES[ir.CELL], ir.ZERO)]),
        ir.Counted(STAGE, 1, stages, None, tuple(text.aside(_stage, tableaux)), hint=once),
    ]
    return taken_over(text, scheme, body)


def _stage(text: TransientBuilder, tableaux: tuple[Pair, ...]) -> None:
    """Append the round of one stage."""
    stages = tableaux[0].stages
    states: list[ir.Expression] = []
    for layer, tableau in enumerate(tableaux):
        rows = np.zeros((stages, stages - 1))
        for stage, row in enumerate(tableau.a):
            rows[stage, : len(row)] = [float(weight) for weight in row]
        weights = [ir.Name(f"a{layer}_{m}") for m in range(stages - 1)]
        for m, weight in enumerate(weights):
            at = ir.Integer(text.tables.data(rows)) + STAGE * (stages - 1) + m
            text.body.append(ir.fixed(weight, text.tables.number_at(at)))
        place = text.at(layer)
        terms = [weight * rates_of(m)[place] for m, weight in enumerate(weights)]
        states.append(X[place] + H * ir.total(terms))
    outputs(text, states, keep=XS)
    time: ir.Expression = ir.ZERO
    times = np.array([float(sum(row)) for row in tableaux[0].a])
    if text.template.gains:
        time = TIME + text.tables.constant(times, STAGE) * H

    def keep(at: ir.Expression, _: int) -> list[ir.Statement]:
        return [ir.Assign(LATER_RATES[ir.after((STAGE - 1) * text.states, at)], RATE)]

    rates(text, XS, keep, Instant(time))
