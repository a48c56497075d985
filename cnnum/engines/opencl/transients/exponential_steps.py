"""Exponential steps: the decay exactly, couplings by their start or slope."""

from collections.abc import Callable

import numpy as np

from cnnum.arrays import Floats
from cnnum.engines.opencl.ir.expressions import (
    CELL,
    ZERO,
    Expression,
    Integer,
    Name,
    Number,
    clip,
    pick,
)
from cnnum.engines.opencl.ir.statements import Assign, Block, Statement, block, fixed, sweep
from cnnum.engines.opencl.transients.builder import TransientBuilder
from cnnum.engines.opencl.transients.fixed_steps import repeated
from cnnum.engines.opencl.transients.initial_state import X
from cnnum.engines.opencl.transients.state_equation import (
    RATE,
    Instant,
    outputs,
    rates,
    watch_change,
)
from cnnum.engines.opencl.transients.step_control import K0, RUNNING, XS, Figures
from cnnum.integrators.schemes import ExponentialSteps

COUPLED = Name("coupled")

PerLayer = Callable[[int], Expression]


def exponential(text: TransientBuilder, scheme: ExponentialSteps) -> Figures:
    """Append the steps and return the figures of the run."""
    weights = scheme.method.weights(scheme.step, text.template.tau)
    kept, first, second = (_per_layer(text, values) for values in weights)
    tau = _per_layer(text, text.template.tau)
    if scheme.method.order == 2:
        text.array(K0, text.states)
    text.array(XS, text.states)

    def then(at: Expression, layer: int) -> list[Statement]:
        # rate · τ + x is the coupling; where a mask holds, it is x, and so is the step's end
        lines: list[Statement] = [fixed(COUPLED, tau(layer) * RATE + X[at])]
        if scheme.settle:
            lines.append(watch_change(text, X[at]))
        if scheme.method.order == 2:
            lines.append(Assign(K0[at], COUPLED))
        moved = kept(layer) * X[at] + first(layer) * COUPLED
        return [block(*lines, Assign(XS[at], _limited(text, moved)))]

    with text.aside() as step:
        outputs(text, text.each(X))
        rates(text, X, then, Instant())
        if scheme.method.order == 2:
            _correct(text, tau, second)
        end = pick(RUNNING.differs(ZERO), XS[CELL], X[CELL]) if scheme.settle else XS[CELL]
        text.body.append(sweep(CELL, text.states, [Assign(X[CELL], end)]))
    return repeated(text, scheme, Number(scheme.step), step)


def _per_layer(text: TransientBuilder, values: Floats) -> PerLayer:
    """Return what gives the number of a layer."""
    if np.ptp(values) == 0.0:
        return lambda _: Number(float(values[0]))
    at = text.tables.data(np.asarray(values, dtype=np.float64))
    return lambda layer: text.tables.number_at(Integer(at) + layer)


def _limited(text: TransientBuilder, value: Expression) -> Expression:
    return clip(value) if text.template.output.limited else value


def _correct(text: TransientBuilder, tau: PerLayer, second: PerLayer) -> None:
    """Append the second stage: the slope of the couplings over the step."""

    def then(at: Expression, layer: int) -> list[Statement]:
        moved = XS[at] + second(layer) * (tau(layer) * RATE + XS[at] - K0[at])
        return [Assign(XS[at], _limited(text, moved))]

    with text.aside() as lines:
        outputs(text, text.each(XS))
        rates(text, XS, then, Instant())
    text.body.append(Block(tuple(lines)))
