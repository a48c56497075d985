"""Steps of large arrays that may be refused, by strips of rows: a run of levels each."""

from collections.abc import Sequence
from dataclasses import replace

from cnnum import kernels as ir
from cnnum.engines.opencl.large_arrays.strip_chebyshev import (
    ARRAYS,
    CONTROL,
    EVEN,
    ODD,
    RATES,
    ROWS,
    STAGES_AT,
    STATE,
    STEP,
    chebyshev_cases,
)
from cnnum.engines.opencl.large_arrays.strip_error import CELLS, FIGURES, mark_cells
from cnnum.engines.opencl.large_arrays.strip_kernel import (
    StripText,
    strip_kernel,
    strip_rows,
)
from cnnum.engines.opencl.large_arrays.strip_pair import BEGINS, LENGTH, MOVED, pair_cases
from cnnum.engines.opencl.large_arrays.strip_rows import Rows
from cnnum.engines.opencl.transients.builder import TransientBuilder
from cnnum.engines.opencl.transients.chebyshev_steps import STAGES, count_stages
from cnnum.engines.opencl.transients.step_control import ACCEPT, TIME, Attempt, H
from cnnum.integrators.chebyshev import MAX_STAGES, coefficients
from cnnum.integrators.schemes import AdaptiveSteps, ChebyshevSteps

CONTROL_ARRAY, MAXIMA_ARRAY = "strip_control", "strip_maxima"
CONTROLS, MAXIMA = ir.Name(CONTROL_ARRAY), ir.Name(MAXIMA_ARRAY)
"""The registers between the plan's body and the strips."""

LEVELS, AT = ir.names("levels at")
"""Of a step; a variable of loops."""


def pair_attempts(text: TransientBuilder, scheme: AdaptiveSteps) -> Attempt:
    """Return the statements of a pair's steps, and keep their kernel with the tables."""
    stages = scheme.tableau.stages
    rows = _rows(text, ("strip_x", "strip_xs", *(f"strip_k{n}" for n in range(stages))), 3)
    own = StripText(
        f"number % {stages}",
        lambda block: pair_cases(rows, scheme, block),
        rest=_first_rates(rows, "strip_k0"),
        end=f"(x[{rows.at(CONTROL_ARRAY)} + {MOVED}] != 0 ? {rows.at('strip_xs')} : 0)",
    )
    settings = [ir.Assign(CONTROLS[LENGTH], H), ir.Assign(CONTROLS[BEGINS], TIME)]
    attempt = _attempt(rows, own, stages, settings, None)
    return replace(
        attempt,
        begin=[ir.Assign(CONTROLS[MOVED], ir.ZERO), *attempt.begin],
        advance=[ir.Assign(CONTROLS[MOVED], ACCEPT)],
    )


def chebyshev_attempts(text: TransientBuilder, scheme: ChebyshevSteps) -> Attempt:
    """Return the statements of Chebyshev's steps, and keep their kernel with the tables."""
    table = text.tables.data(coefficients())
    rows, size = _rows(text, ARRAYS, CONTROL), CONTROL - ROWS
    control, distance = rows.at(CONTROL_ARRAY), rows.at(ARRAYS[1])
    stages = f"(int)x[{control} + {STAGES_AT}]"
    own = StripText(
        f"number == 0 ? 0 : number < {stages} ? 1 : 2",
        lambda block: chebyshev_cases(rows, block),
        rest=_first_rates(rows, ARRAYS[1]),
        end=f"(int)x[{control} + {STATE}] * {distance}",
        count=f"min(most, {stages} + 1 - done)",
    )
    row = text.tables.number_at(ir.Integer(table) + STAGES * size + AT)
    next_row = ir.Assign(CONTROLS[ir.Integer(ROWS) + AT], row)
    settings = [
        *count_stages(scheme),
        ir.Assign(CONTROLS[STEP], H),
        ir.Assign(CONTROLS[STAGES_AT], ir.Cast("real", STAGES)),
        # a loop of this kind is no sweep, which would be a launch of its own
        ir.declare(AT, 0, of="int"),
        ir.While(AT < size, (next_row, ir.Assign(AT, ir.Integer(1), "+="))),
        ir.fixed(LEVELS, STAGES + 1, of="int"),
    ]
    attempt = _attempt(rows, own, MAX_STAGES + 1, settings, LEVELS)
    begin = [
        ir.Assign(CONTROLS[place], ir.real(n)) for n, place in enumerate((STATE, RATES, EVEN, ODD))
    ]
    return replace(attempt, begin=[*begin, *attempt.begin], advance=_changed_places())


def _changed_places() -> list[ir.Statement]:
    """Return the statements that take a step over: its end is the begin of the next."""
    state, rates, even, odd = (ir.Name(name) for name in ("state", "rates", "even", "odd"))
    changed = (STAGES % 2).differs(0)
    taken = (
        ir.Declare("real", ((state, CONTROLS[STATE]), (rates, CONTROLS[RATES])), fixed=True),
        ir.Declare("real", ((even, CONTROLS[EVEN]), (odd, CONTROLS[ODD])), fixed=True),
        ir.Assign(CONTROLS[STATE], ir.pick(changed, odd, even)),
        ir.Assign(CONTROLS[RATES], ir.pick(changed, even, odd)),
        ir.Assign(CONTROLS[EVEN], state),
        ir.Assign(CONTROLS[ODD], rates),
    )
    return [ir.Branch(ACCEPT.differs(ir.ZERO), taken)]


def _rows(text: TransientBuilder, arrays: tuple[str, ...], control: int) -> Rows:
    """Return the rows of arrays; the first holds the states at the start."""
    rows = strip_rows(text, arrays, tuple(1.0 / float(tau) for tau in text.template.tau))
    rows.declare(CONTROL_ARRAY, control)
    rows.declare(MAXIMA_ARRAY, len(FIGURES) * rows.size[1] * rows.layout.width)
    rows.declare(CELLS, rows.span)
    if rows.span == rows.layout.cols:
        del rows.offsets[CELLS]
    return rows


def _first_rates(rows: Rows, array: str) -> list[str]:
    """Return the text that sets a row's rates at the start, and the cells that a mask holds."""
    k0 = rows.text.arena.places["k0"]
    return [f"to_lanes(x + p + {rows.at(array)}, mine + {k0} + cell, 1);", *rows.set_held()]


def _attempt(
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
    most, width, maxima = rows.size[1], rows.layout.width, rows.at(MAXIMA_ARRAY)
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
