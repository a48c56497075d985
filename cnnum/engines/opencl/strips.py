"""Steps of large arrays by strips of rows: which can be, and what they keep in arrays."""

from dataclasses import replace

from cnnum.engines.opencl.stepping import Attempt
from cnnum.engines.opencl.strip_kernel import (
    BLOCK_ROWS,
    StripText,
    declare,
    levels_of,
    row_layout,
    strip_kernel,
)
from cnnum.engines.opencl.strip_layout import LANES_STEPS
from cnnum.engines.opencl.strip_pair import FIGURES, pair_cases
from cnnum.engines.opencl.strip_rows import Rows
from cnnum.engines.opencl.strip_stages import stages_of
from cnnum.engines.opencl.strip_sums import array_of, sum_cases
from cnnum.engines.opencl.text import rename
from cnnum.engines.opencl.transients import TransientText
from cnnum.integrators.choice import AdaptiveSteps, FixedSteps
from cnnum.integrators.schemes import ExponentialSteps


def strips_fit(text: TransientText, scheme: FixedSteps | ExponentialSteps | AdaptiveSteps) -> bool:
    """Return whether steps of a scheme can be taken strip by strip."""
    template, radius = text.template, text.radius
    simple = template.plain and text.layers == 1 and text.operands.mask is None
    known = template.output.name in ("standard", "linear", "full-range")
    return (
        simple
        and known
        and 0 < radius <= BLOCK_ROWS
        and min(text.shape) >= 4 * radius
        and not text.arena.private
        and _repeats(scheme, float(template.tau[0]))
    )


def _repeats(scheme: FixedSteps | ExponentialSteps | AdaptiveSteps, tau: float) -> bool:
    """Return whether all steps are alike, and of stages that strips can take."""
    if isinstance(scheme, AdaptiveSteps):
        return True
    even = not isinstance(scheme, FixedSteps) or scheme.last == scheme.step
    return even and scheme.count > 0 and not scheme.settle and stages_of(scheme, tau) is not None


def strip_steps(text: TransientText, scheme: FixedSteps | ExponentialSteps) -> None:
    """Append the name that stands for the steps, and keep their kernel with the tables."""
    stages = stages_of(scheme, float(text.template.tau[0]))
    assert stages is not None
    layout = row_layout(text, len(stages.stages) * scheme.count)
    names = tuple(array_of(n) for n in range(stages.arrays))
    rows = Rows(text, layout, stages.scale, declare(text, layout, names))
    shown = rename(text.template.output.opencl, {"x": "value"})
    own = StripText(
        stages.scale,
        len(stages.stages),
        lambda block: sum_cases(rows, stages, block),
        clear=[],
        rest=[f"outputs[0][p] = {shown};"],
        begin=[],
    )
    size = levels_of(text, layout, len(names))
    strips = strip_kernel(text, own, layout, names[0], size, layout.levels)
    text.lines.append(f"{strips.kernel};")
    text.tables.strips[strips.kernel] = strips


def strip_attempts(text: TransientText, scheme: AdaptiveSteps) -> Attempt:
    """Return the statements of steps that may be refused, and keep their kernel with the tables."""
    tableau = scheme.tableau
    # nobody knows how many steps there will be: as a rule enough for rows in lanes
    layout = row_layout(text, LANES_STEPS)
    names = ("strip_x", "strip_xs", *(f"strip_k{n}" for n in range(tableau.stages)))
    apart, scale = declare(text, layout, names), 1.0 / float(text.template.tau[0])
    size = levels_of(text, layout, len(names))
    span, most = layout.vectors * layout.width, size[1]
    found = len(FIGURES) * most * layout.width
    for name, length in (("strip_control", 2), ("strip_maxima", found), ("strip_cells", span)):
        text.array(name, length)
        apart[name] = text.arena.places[name] - text.arena.places[names[0]]
    clear = [f"x[{apart['strip_maxima']} + n] = 0;"]
    clear = [f"for (int n = 0; piece == 0 && n < {found}; ++n) {{", f"    {clear[0]}", "}"]
    if span == layout.cols:
        del apart["strip_cells"]
    else:
        clear += [
            f"for (int n = 0; piece == 0 && n < {span}; ++n) {{",
            f"    const int col = n % {layout.pieces} * {layout.length} + n / {layout.pieces};",
            f"    x[{apart['strip_cells']} + n] = col < {layout.cols};",
            "}",
        ]
    rows = Rows(text, layout, scale, apart)
    begin = [
        f"for (int n = 0; done == 0 && n < {len(FIGURES)}; ++n) {{",
        f"    const int own = {apart['strip_maxima']} + (n * {most} + piece) * {layout.width};",
        "    *(__global vec *)(x + own) = (vec)(0);",
        "}",
    ]
    own = StripText(
        scale,
        tableau.stages,
        lambda block: pair_cases(rows, tableau, most, block),
        clear=clear,
        rest=[f"x[p + {apart['strip_k0']}] = mine[{text.arena.places['k0']} + cell];"],
        begin=begin,
        end=f"(x[{apart['strip_control']} + 1] != 0 ? {apart['strip_xs']} : 0)",
    )
    strips = strip_kernel(text, own, layout, names[0], size, tableau.stages)
    name = strips.kernel
    text.tables.strips |= {
        f"{name}_begin": replace(strips, count=0, ends=False),
        name: replace(strips, begins=False, ends=False),
        f"{name}_end": replace(strips, count=0, begins=False),
    }
    each = most * layout.width
    judge = [f"for (int i = 0; i < {each}; ++i) {{"]
    judge += [
        f"    {figure} = greater({figure}, strip_maxima[{n * each} + i]);"
        for n, figure in enumerate(FIGURES)
    ]
    return Attempt(
        begin=["strip_control[1] = ZERO;", f"{name}_begin;"],
        stages=["strip_control[0] = h;", f"{name};"],
        judge=[*judge, "}"],
        advance=["strip_control[1] = accept;"],
        end=[f"{name}_end;"],
    )
