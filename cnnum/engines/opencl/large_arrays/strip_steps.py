"""Steps of large arrays by strips of rows: the possible ones, and their arrays."""

from dataclasses import replace

from cnnum import kernels as ir
from cnnum.engines.opencl.large_arrays.lane_rows import lanes_fit
from cnnum.engines.opencl.large_arrays.strip_euler import keeps_states, state_steps
from cnnum.engines.opencl.large_arrays.strip_kernel import (
    SHOWN,
    StripText,
    of_layer,
    strip_kernel,
    strip_rows,
)
from cnnum.engines.opencl.large_arrays.strip_settling import BEFORE, watch
from cnnum.engines.opencl.large_arrays.strip_stage_sums import array_of, sum_cases
from cnnum.engines.opencl.large_arrays.strip_times import Moments
from cnnum.engines.opencl.transients.builder import TransientBuilder
from cnnum.engines.opencl.transients.feedforward import LATER, W
from cnnum.engines.opencl.transients.fixed_steps import fixed_figures
from cnnum.engines.opencl.transients.step_control import STEPS, Figures
from cnnum.integrators.schemes import AdaptiveSteps, ChebyshevSteps, FixedSteps, Stages, stages_of
from cnnum.templating.function_tables import Table

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
    """Return whether steps need nothing but states."""
    layers = _layers(text, scheme)
    return keeps_states(text, Moments(text, scheme, len(layers[0].stages)), layers)


def state_strips(text: TransientBuilder, scheme: FixedSteps) -> Figures:
    """Append steps that keep states alone, and return the figures of the run."""
    state_steps(text, scheme, tuple(one.scale for one in _layers(text, scheme)))
    return fixed_figures(text, scheme.count, settle=False)


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
