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
from cnnum.engines.opencl.strip_layout import LANES_STEPS, RowLayout
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
    known = template.output.name in ("standard", "linear", "full-range")
    return (
        template.plain
        and known
        and 0 < radius <= BLOCK_ROWS
        and min(text.shape) >= 4 * radius
        and not text.arena.private
        and _repeats(scheme)
    )


def _repeats(scheme: FixedSteps | ExponentialSteps | AdaptiveSteps) -> bool:
    """Return whether all steps are alike, and of stages that strips can take."""
    if isinstance(scheme, AdaptiveSteps):
        return True
    even = not isinstance(scheme, FixedSteps) or scheme.last == scheme.step
    return even and scheme.count > 0 and not scheme.settle and stages_of(scheme, 1.0) is not None


def strip_steps(text: TransientText, scheme: FixedSteps | ExponentialSteps) -> None:
    """Append the name that stands for the steps, and keep their kernel with the tables."""
    found = (stages_of(scheme, float(tau)) for tau in text.template.tau)
    layers = tuple(stages for stages in found if stages is not None)
    stages, arrays = len(layers[0].stages), layers[0].arrays
    layout = row_layout(text, stages * scheme.count)
    names = tuple(array_of(n) for n in range(arrays))
    scales = tuple(one.scale for one in layers)
    rows = Rows(text, layout, scales, declare(text, layout, names))
    shown = rename(text.template.output.opencl, {"x": "value"})
    own = StripText(
        scales,
        stages,
        lambda block: sum_cases(rows, layers, block),
        clear=[],
        rest=[f"outputs[0][p] = {shown};", *rows.set_held()],
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
    apart = declare(text, layout, names)
    scales = tuple(1.0 / float(tau) for tau in text.template.tau)
    size = levels_of(text, layout, len(names))
    span, most = layout.vectors * layout.width, size[1]
    found = len(FIGURES) * most * layout.width
    for name, length in (("strip_control", 2), ("strip_maxima", found), ("strip_cells", span)):
        text.array(name, length)
        apart[name] = text.arena.places[name] - text.arena.places[names[0]]
    clear = [f"for (int n = 0; piece == 0 && n < {found}; ++n) {{"]
    clear += [f"    x[{apart['strip_maxima']} + n] = 0;", "}"]
    if span == layout.cols:
        del apart["strip_cells"]
    else:
        clear += _mark_cells(layout, apart["strip_cells"])
    rows = Rows(text, layout, scales, apart)
    begin = [
        f"for (int n = 0; done == 0 && n < {len(FIGURES)}; ++n) {{",
        f"    const int own = {apart['strip_maxima']} + (n * {most} + piece) * {layout.width};",
        "    *(__global vec *)(x + own) = (vec)(0);",
        "}",
    ]
    own = StripText(
        scales,
        tableau.stages,
        lambda block: pair_cases(rows, scheme, most, block),
        clear=clear,
        rest=[
            f"x[p + {apart['strip_k0']}] = mine[{text.arena.places['k0']} + cell];",
            *rows.set_held(),
        ],
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


def _mark_cells(layout: RowLayout, to: int) -> list[str]:
    """Return the text that keeps which numbers of a row are cells."""
    return [
        f"for (int n = 0; piece == 0 && n < {layout.vectors * layout.width}; ++n) {{",
        f"    const int col = n % {layout.pieces} * {layout.length} + n / {layout.pieces};",
        f"    x[{to} + n] = col < {layout.cols};",
        "}",
    ]
