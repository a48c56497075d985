"""Steps of a fixed length: a loop of them, or rounds until nothing changes."""

from collections.abc import Sequence

from cnnum import kernels as ir
from cnnum.engines.opencl.transients.builder import TransientBuilder
from cnnum.engines.opencl.transients.names import (
    CHANGE,
    RUNNING,
    SETTLED,
    STEPS,
    STILL,
    TIME,
    H,
    zeros,
)
from cnnum.engines.opencl.transients.state_equation import RESTS
from cnnum.engines.opencl.transients.step_control import Figures
from cnnum.integrators.estimate import LOST
from cnnum.integrators.schemes import FixedSteps
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
        Length of the step `n`.
    body : sequence of Statement
        A step of length `h`; where steps settle, it leaves the change in `change`.
    """
    steps = f"{scheme.count} steps of {scheme.step:g}"
    if scheme.settle:
        about = f"{scheme.name}: at most {steps}, a lane stops where nothing changes any more"
        text.body += [ir.Note(f"// {about}"), *_until_rest(text, scheme, length, body)]
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
    """Return the rounds of steps; a lane stops where nothing changes any more."""
    # with a delay a state may be at a turn, so that nothing changes for longer
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
    """Return the figures of steps of a fixed length, whose error is not followed."""
    error = ir.Number(LOST)
    if scheme.settle:
        return {"time": TIME, "steps": STEPS, "settled": SETTLED, "error": error}
    time, steps = ir.Number(text.solver.duration), ir.Number(scheme.count)
    return {"time": time, "steps": steps, "error": error}
