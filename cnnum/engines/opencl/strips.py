"""Steps of large arrays by strips of rows: which can be, and what they keep in arrays."""

from cnnum.engines.opencl.strip_kernel import (
    BLOCK_ROWS,
    SHOWN,
    StripText,
    declare,
    levels_of,
    row_layout,
    strip_kernel,
)
from cnnum.engines.opencl.strip_rows import Rows
from cnnum.engines.opencl.strip_stages import stages_of
from cnnum.engines.opencl.strip_sums import array_of, sum_cases
from cnnum.engines.opencl.transients import TransientText
from cnnum.integrators.choice import AdaptiveSteps, FixedSteps
from cnnum.integrators.schemes import ChebyshevSteps, ExponentialSteps

Steps = FixedSteps | ExponentialSteps | AdaptiveSteps | ChebyshevSteps


def strips_fit(text: TransientText, scheme: Steps) -> bool:
    """Return whether steps of a scheme can be taken strip by strip."""
    template, radius = text.template, text.radius
    known = template.output.name in SHOWN
    return (
        template.plain
        and known
        and 0 < radius <= BLOCK_ROWS
        and min(text.shape) >= 4 * radius
        and not text.arena.private
        and _repeats(scheme)
    )


def _repeats(scheme: Steps) -> bool:
    """Return whether all steps are alike, and of stages that strips can take."""
    if isinstance(scheme, AdaptiveSteps | ChebyshevSteps):
        return True
    even = not isinstance(scheme, FixedSteps) or scheme.last == scheme.step
    return even and scheme.count > 0 and not scheme.settle and stages_of(scheme, 1.0) is not None


def strip_steps(text: TransientText, scheme: FixedSteps | ExponentialSteps) -> None:
    """Append the name that stands for the steps, and keep their kernel with the tables."""
    found = (stages_of(scheme, float(tau)) for tau in text.template.tau)
    layers = tuple(stages for stages in found if stages is not None)
    stages, arrays = len(layers[0].stages), layers[0].arrays
    layout = row_layout(text)
    names = tuple(array_of(n) for n in range(arrays))
    scales = tuple(one.scale for one in layers)
    rows = Rows(text, layout, scales, declare(text, layout, names))
    own = StripText(
        scales,
        f"number % {stages}",
        lambda block: sum_cases(rows, layers, block),
        clear=[],
        rest=["show_row(outputs[0] + p, x + p);", *rows.set_held()],
        begin=[],
    )
    size = levels_of(text, layout, len(names))
    strips = strip_kernel(text, own, layout, names[0], size, stages * scheme.count)
    text.lines.append(f"{strips.kernel};")
    text.tables.strips[strips.kernel] = strips
