"""Steps of large arrays by strips of rows: the possible ones, and their arrays."""

from dataclasses import replace

from cnnum import kernels as ir
from cnnum.engines.opencl.large_arrays.lane_rows import lanes_fit
from cnnum.engines.opencl.large_arrays.strip_boundary import OUTPUTS
from cnnum.engines.opencl.large_arrays.strip_couplings import FROM, Kept, coupled
from cnnum.engines.opencl.large_arrays.strip_kernel import (
    SHOWN,
    StripText,
    of_layer,
    strip_kernel,
    strip_rows,
)
from cnnum.engines.opencl.large_arrays.strip_rows import ONES, TO, At, Rows
from cnnum.engines.opencl.large_arrays.strip_settling import BEFORE, watch
from cnnum.engines.opencl.large_arrays.strip_stage_sums import array_of, sum_cases
from cnnum.engines.opencl.large_arrays.strip_times import Moments
from cnnum.engines.opencl.transients.builder import TransientBuilder
from cnnum.engines.opencl.transients.feedforward import LATER, W
from cnnum.engines.opencl.transients.fixed_steps import fixed_figures
from cnnum.engines.opencl.transients.step_control import STEPS, Figures
from cnnum.integrators.schemes import AdaptiveSteps, ChebyshevSteps, FixedSteps, Stages, stages_of
from cnnum.templating.function_tables import Table

BARE = ("standard", "linear", "full-range")
"""Outputs that cost less to make than to keep."""

Steps = FixedSteps | AdaptiveSteps | ChebyshevSteps


def strips_fit(text: TransientBuilder, scheme: Steps) -> bool:
    """Return whether steps of a scheme can be taken strip by strip."""
    template = text.template
    # other functions, of outputs or of couplings, have no form for vectors
    known = template.output.name in SHOWN and all(
        isinstance(coupling.function, Table) for coupling in template.nonlinear
    )
    return known and lanes_fit(text) and _repeats(scheme)


def _repeats(scheme: Steps) -> bool:
    """Return whether all steps are alike, and of stages that strips can take."""
    if not isinstance(scheme, FixedSteps):
        return True
    return scheme.count > 0 and stages_of(scheme, 0, 1.0) is not None


def _layers(text: TransientBuilder, scheme: FixedSteps) -> tuple[Stages, ...]:
    """Return the stages of a step, by layer."""
    found = (stages_of(scheme, layer, float(tau)) for layer, tau in enumerate(text.template.tau))
    return tuple(stages for stages in found if stages is not None)


def states_suffice(text: TransientBuilder, scheme: FixedSteps) -> bool:
    """Return whether steps of a scheme that strips take need nothing but states."""
    template, stages = text.template, _layers(text, scheme)[0].stages
    moments = Moments(text, scheme, len(stages))
    plain = not (moments.uneven or moments.keeps or text.has_history or scheme.settle)
    linear = all(coupling.static for coupling in template.nonlinear)
    bare = template.output.name in BARE
    return plain and linear and bare and len(stages) == 1 and stages[0].whole


def state_strips(text: TransientBuilder, scheme: FixedSteps) -> Figures:
    """Append Euler's steps that keep states alone, and return the figures of the run.

    Outputs are made as states are read. A step then reads and writes half as much. Neighbours of a
    vector in the rows of a block stay in registers from one vector to the next. So each state is
    read, and its output made, once.
    """
    scales = tuple(one.scale for one in _layers(text, scheme))
    rows, moments = strip_rows(text, (), scales), Moments(text, scheme, 1)
    own = StripText(
        "0",
        lambda block: [_state_case(rows, moments, block)],
        rest=rows.set_held(),
        end=f"({scheme.count & 1} ? {rows.at(OUTPUTS[1])} : 0)",
    )
    text.body.append(ir.StripSteps(strip_kernel(rows, own, scheme.count)))
    return fixed_figures(text, scheme.count, settle=False)


def _state_case(rows: Rows, moments: Moments, block: int) -> ir.Case:
    every, kept = rows.block(block), Kept(rows, block)
    own = tuple(1.0 - scale for scale in rows.scales)
    each = [*kept.load, *coupled(rows, every, own, "from", kept=kept)]
    for at in every:
        each += _state_end(rows, at)
    return rows.case(0, [*each, *kept.move], [*moments.head(0), *kept.begin])


def _state_end(rows: Rows, at: At) -> list[ir.Statement]:
    state, lines = at.sum, list[ir.Statement]()
    if rows.masked:
        lines.append(ir.Assign(state, rows.free(at, state, rows.cells(FROM, at))))
    if rows.text.template.output.limited:
        lines.append(ir.Assign(state, ir.call("shown", state, ONES)))
    return [*lines, ir.Store(rows.place(TO, at), state)]


def strip_steps(text: TransientBuilder, scheme: FixedSteps) -> Figures:
    """Append the steps, keep their kernel with the tables, and return the figures of the run."""
    layers = _layers(text, scheme)
    stages, arrays = len(layers[0].stages), layers[0].arrays
    names, scales = tuple(map(array_of, range(arrays))), tuple(one.scale for one in layers)
    rows = strip_rows(text, (*names, BEFORE) if scheme.settle else names, scales)
    seen = watch(rows, stages) if scheme.settle else None
    moments = Moments(text, scheme, stages, seen.before if seen else "0")
    outputs = moments.keep_outputs(rows, seen.steps if seen else 0)
    if text.has_history:
        text.over_cells(
            [ir.add(later, w) for later, w in zip(text.each(LATER), text.each(W), strict=True)]
        )
    own = StripText(
        f"number % {stages}",
        lambda block: sum_cases(rows, layers, block, moments, seen),
        rest=[
            *moments.later(rows.offsets, of_layer(text, scales)),
            "show_row(outputs_of(x, 0) + p, x + p);",
            *rows.set_held(),
        ],
        outputs=outputs,
        ahead=moments.ahead,
        driven=moments.driven(rows.offsets),
    )
    if seen:
        again = seen.again()
        own = replace(own, clear=seen.clear(), begin=seen.begin(), count=seen.count, again=again)
    strips = strip_kernel(rows, own, stages * (seen.steps if seen else scheme.count))
    text.body += [ir.StripSteps(strips)] if seen is None else seen.body(scheme, strips)
    figures = fixed_figures(text, scheme.count, settle=scheme.settle)
    if scheme.settle:
        time = ir.call("fmin", STEPS * ir.Number(scheme.step), ir.Number(text.solver.duration))
        figures["time"] = time
    return figures
