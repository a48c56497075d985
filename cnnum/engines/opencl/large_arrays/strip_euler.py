"""Euler's steps of large arrays that keep states alone: outputs are made as states are read.

A step then reads and writes half as much. Neighbours of a vector in the rows of a block stay in
registers from one vector to the next. So each state is read, and its output made, once.
"""

from cnnum import kernels as ir
from cnnum.engines.opencl.large_arrays.strip_boundary import OUTPUTS
from cnnum.engines.opencl.large_arrays.strip_couplings import FROM, Kept, coupled
from cnnum.engines.opencl.large_arrays.strip_kernel import (
    StripText,
    strip_kernel,
    strip_rows,
)
from cnnum.engines.opencl.large_arrays.strip_rows import ONES, TO, At, Rows
from cnnum.engines.opencl.large_arrays.strip_times import Moments
from cnnum.engines.opencl.transients.builder import TransientBuilder
from cnnum.integrators.schemes import FixedSteps, Stages

BARE = ("standard", "linear", "full-range")
"""Outputs that cost less to make than to keep."""


def keeps_states(text: TransientBuilder, moments: Moments, layers: tuple[Stages, ...]) -> bool:
    """Return whether steps need nothing but states."""
    template = text.template
    simple = not moments.uneven and not moments.keeps and not text.has_history
    linear = all(coupling.static for coupling in template.nonlinear)
    whole = len(layers[0].stages) == 1 and layers[0].stages[0].whole
    return (
        simple and linear and whole and template.output.name in BARE and not moments.scheme.settle
    )


def state_steps(text: TransientBuilder, scheme: FixedSteps, scales: tuple[float, ...]) -> None:
    """Append the statement that stands for the steps, and keep their kernel with the tables."""
    rows, moments = strip_rows(text, (), scales), Moments(text, scheme, 1)
    own = StripText(
        "0",
        lambda block: [_case(rows, moments, block)],
        rest=rows.set_held(),
        end=f"({scheme.count & 1} ? {rows.at(OUTPUTS[1])} : 0)",
    )
    text.body.append(ir.StripSteps(strip_kernel(rows, own, scheme.count)))


def _case(rows: Rows, moments: Moments, block: int) -> ir.Case:
    every, kept = rows.block(block), Kept(rows, block)
    own = tuple(1.0 - scale for scale in rows.scales)
    each = [*kept.load, *coupled(rows, every, own, "from", kept=kept)]
    for at in every:
        each += _end(rows, at)
    return rows.case(0, [*each, *kept.move], [*moments.head(0), *kept.begin])


def _end(rows: Rows, at: At) -> list[ir.Statement]:
    state, lines = at.sum, list[ir.Statement]()
    if rows.masked:
        lines.append(ir.Assign(state, rows.free(at, state, rows.cells(FROM, at))))
    if rows.text.template.output.limited:
        lines.append(ir.Assign(state, ir.call("shown", state, ONES)))
    return [*lines, ir.Store(rows.place(TO, at), state)]
