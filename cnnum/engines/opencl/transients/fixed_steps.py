"""Steps of a fixed length: a loop of them, or rounds until nothing changes."""

import math
from collections.abc import Sequence

from cnnum.engines.opencl.ir.expressions import (
    ONE,
    ROUND,
    ZERO,
    Choice,
    Expression,
    Number,
    pick,
)
from cnnum.engines.opencl.ir.statements import (
    Assign,
    Counted,
    Declare,
    Note,
    Statement,
    add,
    fixed,
)
from cnnum.engines.opencl.transients.builder import TransientBuilder
from cnnum.engines.opencl.transients.state_equation import CHANGE
from cnnum.engines.opencl.transients.step_control import RUNNING, SETTLED, STEPS, TIME, Figures, H
from cnnum.integrators.estimate import LOST
from cnnum.integrators.schemes import FixedSteps


def repeated(
    text: TransientBuilder,
    scheme: FixedSteps,
    length: Expression,
    body: Sequence[Statement],
) -> Figures:
    """Append a scheme's steps and return the figures of the run.

    Parameters
    ----------
    text : TransientBuilder
    scheme : FixedSteps
    length : Expression
        Of the step `n`.
    body : sequence of Statement
        A step of length `h`; where steps settle, it leaves in `change` what changes.
    """
    steps = f"{scheme.count} steps of {scheme.step:g}"
    if scheme.settle:
        text.body += _settling(scheme.count, f"{scheme.name}: at most {steps}", length, body)
    else:
        once = (fixed(H, length), *body)
        text.body += [
            Note(f"// {scheme.name}: {steps}"),
            Counted(ROUND, 0, scheme.count, None, once),
        ]
    return fixed_figures(text, scheme.count, settle=scheme.settle)


def last_number(count: int, usual: float, last: float) -> Expression:
    """Return a number that is another one in the last of a number of steps."""
    if math.isclose(usual, last, rel_tol=1e-9):
        return Number(usual)
    return Choice(ROUND.equals(count - 1), Number(last), Number(usual))


def _settling(
    count: int, about: str, step: Expression, body: Sequence[Statement]
) -> list[Statement]:
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
        A step of length `h`, which leaves in `change` what changes.
    """
    still = CHANGE <= ONE
    return [
        Note(f"// {about}, a lane stops where nothing changes any more"),
        Declare("real", ((RUNNING, ONE), (TIME, ZERO), (STEPS, ZERO), (SETTLED, ZERO))),
        Counted(
            ROUND,
            0,
            count,
            RUNNING,
            (
                fixed(H, RUNNING * step),
                Declare("real", ((CHANGE, ZERO),)),
                *body,
                add(TIME, H),
                add(STEPS, RUNNING),
                Assign(SETTLED, pick(still, ONE, SETTLED)),
                Assign(RUNNING, pick(still, ZERO, RUNNING)),
            ),
        ),
    ]


def fixed_figures(text: TransientBuilder, count: int, *, settle: bool) -> Figures:
    """Return the figures of steps of a fixed length, whose error is not followed."""
    error = Number(LOST)
    if settle:
        return {"time": TIME, "steps": STEPS, "settled": SETTLED, "error": error}
    return {"time": Number(text.solver.duration), "steps": Number(count), "error": error}
