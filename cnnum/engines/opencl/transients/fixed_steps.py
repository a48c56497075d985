"""Steps of a fixed length: a loop of them, or rounds until nothing changes."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from cnnum import kernels as ir
from cnnum.engines.opencl.transients.builder import TransientBuilder
from cnnum.engines.opencl.transients.state_equation import CHANGE
from cnnum.engines.opencl.transients.step_control import (
    RUNNING,
    SETTLED,
    STEPS,
    STILL,
    TIME,
    Figures,
    H,
)
from cnnum.integrators.estimate import LOST
from cnnum.integrators.schemes import FixedSteps
from cnnum.templating.network import taps
from cnnum.templating.reads import lag


def repeated(
    text: TransientBuilder,
    scheme: FixedSteps,
    length: ir.Expression,
    body: Sequence[ir.Statement],
) -> Figures:
    """Append a scheme's steps and return the figures of the run.

    Parameters
    ----------
    text : TransientBuilder
    scheme : FixedSteps
    length : Expression
        Of the step `n`.
    body : sequence of Statement
        A step of length `h`; where steps settle, it leaves the change in `change`.
    """
    steps = f"{scheme.count} steps of {scheme.step:g}"
    if scheme.settle:
        about, late = f"{scheme.name}: at most {steps}", lag(text.template, scheme.step)
        text.body += _settling(scheme.count, about, length, body, late)
    else:
        once = (ir.fixed(H, length), *body)
        text.body += [
            ir.Note(f"// {scheme.name}: {steps}"),
            ir.Counted(ir.ROUND, 0, scheme.count, None, once),
        ]
    return fixed_figures(text, scheme.count, settle=scheme.settle)


def last_number(count: int, usual: float, last: float) -> ir.Expression:
    """Return a number that is another one in the last of a number of steps."""
    if math.isclose(usual, last, rel_tol=1e-9):
        return ir.Number(usual)
    return ir.Choice(ir.ROUND.equals(count - 1), ir.Number(last), ir.Number(usual))


def _settling(
    count: int, about: str, step: ir.Expression, body: Sequence[ir.Statement], late: int
) -> list[ir.Statement]:
    """Return fixed steps until nothing changes; a lane stops where nothing does any more.

    Parameters
    ----------
    count : int
        Steps at most.
    about : str
        The method and its steps.
    step : Expression
        A step's length.
    body : sequence of Statement
        A step of length `h`, which leaves the change in `change`.
    late : int
        Steps in a delay: a state may be at a turn, so that nothing changes for longer.
    """
    still, found = CHANGE <= ir.ONE, CHANGE <= ir.ONE
    counted: list[ir.Statement] = []
    if late:
        counted = [ir.Assign(STILL, ir.pick(still, STILL + RUNNING, ir.ZERO))]
        found = ir.Number(late + 0.5) <= STILL
    return [
        ir.Note(f"// {about}, a lane stops where nothing changes any more"),
        ir.Declare(
            "real", ((RUNNING, ir.ONE), (TIME, ir.ZERO), (STEPS, ir.ZERO), (SETTLED, ir.ZERO))
        ),
        *([ir.Declare("real", ((STILL, ir.ZERO),))] if late else []),
        ir.Counted(
            ir.ROUND,
            0,
            count,
            RUNNING,
            (
                ir.fixed(H, RUNNING * step),
                ir.Declare("real", ((CHANGE, ir.ZERO),)),
                *body,
                ir.add(TIME, H),
                ir.add(STEPS, RUNNING),
                *counted,
                ir.Assign(SETTLED, ir.pick(found, ir.ONE, SETTLED)),
                ir.Assign(RUNNING, ir.pick(found, ir.ZERO, RUNNING)),
            ),
        ),
    ]


@dataclass(frozen=True, slots=True)
class StepWeights:
    """The numbers of Euler's step of linear couplings, each with h/τ of a layer in it."""

    text: TransientBuilder
    scheme: FixedSteps

    def declared(self) -> list[ir.Statement]:
        """Return statements that scale frames' own numbers: h/τ, 1 − h/τ, and each weight."""
        lines, text = list[ir.Statement](), self.text
        for layer in range(text.layers if text.operands.own else 0):
            move, kept = _move(layer), ir.Name(f"kept_{layer}")
            lines += [
                ir.fixed(move, ir.Number(self.scheme.move(layer, 1.0)) * text.rate(layer)),
                ir.fixed(kept, ir.ONE - move),
            ]
            own = [text.number(tap.weight) for tap in taps(text.template.A, layer)]
            lines += [ir.fixed(_scaled(n), move * n) for n in own if isinstance(n, ir.Name)]
        return lines

    def _share(self, layer: int) -> float:
        return self.scheme.move(layer, float(self.text.template.tau[layer]))

    def number(self, layer: int, factor: float = 1.0) -> ir.Expression:
        """Return a number times h/τ."""
        if self.text.operands.own is not None:
            return ir.Number(factor) * _move(layer)
        return ir.Number(factor * self._share(layer))

    def weight(self, layer: int, weight: float) -> ir.Expression:
        """Return a weight times h/τ."""
        own = self.text.number(weight)
        return _scaled(own) if isinstance(own, ir.Name) else self.number(layer, weight)

    def kept(self, layer: int) -> ir.Expression:
        """Return the share of a state that a step leaves."""
        own = self.text.operands.own
        return ir.Number(1.0 - self._share(layer)) if own is None else ir.Name(f"kept_{layer}")


def _move(layer: int) -> ir.Name:
    return ir.Name(f"move_{layer}")


def _scaled(weight: ir.Name) -> ir.Name:
    return ir.Name(f"{weight.text}_h")


def fixed_figures(text: TransientBuilder, count: int, *, settle: bool) -> Figures:
    """Return the figures of steps of a fixed length, whose error is not followed."""
    error = ir.Number(LOST)
    if settle:
        return {"time": TIME, "steps": STEPS, "settled": SETTLED, "error": error}
    return {"time": ir.Number(text.solver.duration), "steps": ir.Number(count), "error": error}
