"""Steps of large arrays that may be refused, by strips of rows: a run of levels each."""

from collections.abc import Sequence
from dataclasses import replace

from cnnum import kernels as ir
from cnnum.engines.opencl.large_arrays.strip_error import CELLS, FIGURES, MAXIMA, mark_cells
from cnnum.engines.opencl.large_arrays.strip_kernel import StripText, strip_kernel, strip_rows
from cnnum.engines.opencl.large_arrays.strip_rows import Rows
from cnnum.engines.opencl.transients.builder import TransientBuilder
from cnnum.engines.opencl.transients.step_control import Attempt

CONTROL = ir.Name("strip_control")
"""The registers between the plan's body and the strips."""


def attempt_rows(text: TransientBuilder, arrays: tuple[str, ...], control: int) -> Rows:
    """Return the rows of arrays; the first holds the states at the start."""
    rows = strip_rows(text, arrays, tuple(1.0 / float(tau) for tau in text.template.tau))
    rows.declare(CONTROL.text, control)
    rows.declare(MAXIMA.text, len(FIGURES) * rows.size[1] * rows.layout.width)
    rows.declare(CELLS, rows.span)
    if rows.span == rows.layout.cols:
        del rows.offsets[CELLS]
    return rows


def first_rates(rows: Rows, array: str) -> list[str]:
    """Return the text that sets a row's rates at the start, and the cells that a mask holds."""
    k0 = rows.text.arena.places["k0"]
    return [f"to_lanes(x + p + {rows.at(array)}, mine + {k0} + cell, 1);", *rows.set_held()]


def strip_attempt(
    rows: Rows,
    own: StripText,
    levels: int,
    settings: Sequence[ir.Statement],
    counted: ir.Name | None,
) -> Attempt:
    """Return the statements of steps, and keep their kernel with the tables.

    Parameters
    ----------
    rows : Rows
    own : StripText
    levels : int
        Of a step, at most.
    settings : sequence of Statement
        Statements that set the control before each step.
    counted : Name or None
        The number of the plan's body that says how many levels a frame takes.
    """
    most, width, maxima = rows.size[1], rows.layout.width, rows.at(MAXIMA.text)
    each = most * width
    clear = [f"for (int n = 0; piece == 0 && n < {len(FIGURES) * each}; ++n) {{"]
    clear += [f"    x[{maxima} + n] = 0;", "}"]
    # a strip forgets its findings in the step before
    begin = [
        f"for (int n = 0; done == 0 && n < {len(FIGURES)}; ++n) {{",
        f"    const int own = {maxima} + (n * {most} + piece) * {width};",
        "    *(__global vec *)(x + own) = (vec)(0);",
        "}",
    ]
    own = replace(
        own, begin=begin, clear=clear + (mark_cells(rows) if CELLS in rows.offsets else [])
    )
    strips = strip_kernel(rows, own, levels)
    return Attempt(
        begin=[ir.StripSteps(replace(strips, count=0, ends=False))],
        stages=[*settings, ir.StripSteps(replace(strips, begins=False, ends=False), counted)],
        judge=_gathered(each),
        advance=[],
        end=[ir.StripSteps(replace(strips, count=0, begins=False))],
    )


def _gathered(each: int) -> list[ir.Statement]:
    """Return the statements that make one number of the findings of all strips and lanes."""
    judge = [
        ir.Accumulate(ir.Name(figure), "greater", MAXIMA[ir.Integer(n * each) + ir.CELL])
        for n, figure in enumerate(FIGURES)
    ]
    return [ir.sweep(ir.CELL, each, judge)]
