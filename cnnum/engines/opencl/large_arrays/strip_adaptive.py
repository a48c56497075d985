"""Steps of large arrays that may be refused, by strips of rows: a run of levels each."""

from collections.abc import Callable
from dataclasses import dataclass, replace

from cnnum import kernels as ir
from cnnum.engines.opencl.large_arrays.lane_layout import RowLayout
from cnnum.engines.opencl.large_arrays.lane_rows import row_layout
from cnnum.engines.opencl.large_arrays.strip_boundary import OUTPUTS, by_turns
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
from cnnum.engines.opencl.large_arrays.strip_error import FIGURES, mark_cells
from cnnum.engines.opencl.large_arrays.strip_kernel import (
    StripText,
    declare_arrays,
    levels_of,
    strip_kernel,
)
from cnnum.engines.opencl.large_arrays.strip_pair import BEGINS, LENGTH, MOVED, pair_cases
from cnnum.engines.opencl.large_arrays.strip_rows import Rows
from cnnum.engines.opencl.transients.builder import TransientBuilder
from cnnum.engines.opencl.transients.step_control import ACCEPT, TIME, Attempt, H
from cnnum.integrators.chebyshev import MAX_STAGES
from cnnum.integrators.schemes import AdaptiveSteps

CONTROLS, MAXIMA = ir.Name("strip_control"), ir.Name("strip_maxima")
"""The registers between the plan's body and the strips."""

STAGES, LEVELS, AT = ir.Name("stages"), ir.Name("levels"), ir.Name("at")
"""Of a step; a variable of loops."""


@dataclass(frozen=True, slots=True)
class Trial:
    """The parts that depend on the method in steps that may be refused.

    In expressions `{name}` is how far the array `name` is from the first.

    Attributes
    ----------
    arrays : tuple of str
        Of all rows. The first holds the states at the start.
    rates : str
        That of them which holds the rates at the start.
    control : int
        Numbers in `strip_control`, which the plan's body sets.
    cases : callable
        The text of all cases, from rows, strips and the rows of a block.
    case : str
        The expression of the case that is the level `number`.
    end : str
        Where the states are in the end, from the first array.
    levels : int
        Of a step, at most.
    begin, tell, advance : list of Statement
        Statements that set the control: before all steps, before each, and after each.
    count : str
        Levels that a frame takes of at most `most` after those that are `done`.
    told : Name or None
        The number of the plan's body that says how many levels a frame takes.
    """

    arrays: tuple[str, ...]
    rates: str
    control: int
    cases: Callable[[Rows, int, int], list[str]]
    case: str
    end: str
    levels: int
    begin: list[ir.Statement]
    tell: list[ir.Statement]
    advance: list[ir.Statement]
    count: str = "most"
    told: ir.Name | None = None


def pair_attempts(text: TransientBuilder, scheme: AdaptiveSteps) -> Attempt:
    """Return the statements of a pair's steps, and keep their kernel with the tables."""
    stages = scheme.tableau.stages
    return _attempt(
        text,
        Trial(
            arrays=("strip_x", "strip_xs", *(f"strip_k{n}" for n in range(stages))),
            rates="strip_k0",
            control=3,
            cases=lambda rows, most, block: pair_cases(rows, scheme, most, block),
            case=f"number % {stages}",
            end=f"(x[{{strip_control}} + {MOVED}] != 0 ? {{strip_xs}} : 0)",
            levels=stages,
            begin=[ir.Assign(CONTROLS[MOVED], ir.ZERO)],
            tell=[ir.Assign(CONTROLS[LENGTH], H), ir.Assign(CONTROLS[BEGINS], TIME)],
            advance=[ir.Assign(CONTROLS[MOVED], ACCEPT)],
        ),
    )


def chebyshev_attempts(text: TransientBuilder, table: int) -> Attempt:
    """Return the statements of Chebyshev's steps, and keep their kernel with the tables.

    Parameters
    ----------
    text : TransientBuilder
    table : int
        Where in the data the methods' rows begin.
    """
    stages = f"(int)x[{{strip_control}} + {STAGES_AT}]"
    size = CONTROL - ROWS
    row = text.tables.number_at(ir.Integer(table) + STAGES * size + AT)
    return _attempt(
        text,
        Trial(
            arrays=ARRAYS,
            rates=ARRAYS[1],
            control=CONTROL,
            cases=chebyshev_cases,
            case=f"number == 0 ? 0 : number < {stages} ? 1 : 2",
            end=f"(int)x[{{strip_control}} + {STATE}] * {{{ARRAYS[1]}}}",
            levels=MAX_STAGES + 1,
            begin=[
                ir.Assign(CONTROLS[place], ir.real(n))
                for n, place in enumerate((STATE, RATES, EVEN, ODD))
            ],
            tell=[
                ir.Assign(CONTROLS[STEP], H),
                ir.Assign(CONTROLS[STAGES_AT], ir.Cast("real", STAGES)),
                # a loop of this kind is no sweep, which would be a launch of its own
                ir.declare(AT, 0, of="int"),
                ir.While(
                    AT < size,
                    (
                        ir.Assign(CONTROLS[ir.Integer(ROWS) + AT], row),
                        ir.Assign(AT, ir.Integer(1), "+="),
                    ),
                ),
                ir.fixed(LEVELS, STAGES + 1, of="int"),
            ],
            advance=_changed_places(),
            count=f"min(most, {stages} + 1 - done)",
            told=LEVELS,
        ),
    )


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


def _attempt(text: TransientBuilder, trial: Trial) -> Attempt:
    """Return the statements of steps, and keep their kernel with the tables."""
    layout = row_layout(text)
    offsets = declare_arrays(text, layout, trial.arrays)
    scales = tuple(1.0 / float(tau) for tau in text.template.tau)
    size = levels_of(text, layout, offsets)
    each = size[1] * layout.width
    span = layout.vectors * layout.width
    lengths = {"control": trial.control, "maxima": len(FIGURES) * each, "cells": span}
    for name, length in lengths.items():
        text.array(ir.Name(f"strip_{name}"), length)
        place = text.arena.places[f"strip_{name}"]
        offsets[f"strip_{name}"] = place - text.arena.places[trial.arrays[0]]
    places = dict(offsets)
    clear = [f"for (int n = 0; piece == 0 && n < {len(FIGURES) * each}; ++n) {{"]
    clear += [f"    x[{offsets['strip_maxima']} + n] = 0;", "}"]
    if span == layout.cols:
        del offsets["strip_cells"]
    else:
        clear += mark_cells(layout, offsets["strip_cells"])
    rows = Rows(text, layout, scales, offsets)
    k0 = f"to_lanes(x + p + {offsets[trial.rates]}, mine + {text.arena.places['k0']} + cell, 1);"
    own = StripText(
        offsets,
        scales,
        trial.case.format(**places),
        lambda block: trial.cases(rows, size[1], block),
        clear=clear,
        rest=[k0, *rows.set_held()],
        begin=_forget(places["strip_maxima"], size[1], layout),
        outputs=by_turns(offsets, OUTPUTS),
        end=trial.end.format(**places),
        count=trial.count.format(**places),
    )
    strips = strip_kernel(text, own, layout, size, trial.levels)
    text.tables.strips.append(strips.text)
    return Attempt(
        begin=[*trial.begin, ir.StripSteps(replace(strips, count=0, ends=False))],
        stages=[*trial.tell, ir.StripSteps(replace(strips, begins=False, ends=False), trial.told)],
        judge=_gathered(each),
        advance=trial.advance,
        end=[ir.StripSteps(replace(strips, count=0, begins=False))],
    )


def _forget(maxima: int, most: int, layout: RowLayout) -> list[str]:
    """Return the text by which a strip forgets its findings in the step before."""
    return [
        f"for (int n = 0; done == 0 && n < {len(FIGURES)}; ++n) {{",
        f"    const int own = {maxima} + (n * {most} + piece) * {layout.width};",
        "    *(__global vec *)(x + own) = (vec)(0);",
        "}",
    ]


def _gathered(each: int) -> list[ir.Statement]:
    """Return the statements that make one number of the findings of all strips and lanes."""
    judge = [
        ir.Accumulate(ir.Name(figure), "greater", MAXIMA[ir.Integer(n * each) + ir.CELL])
        for n, figure in enumerate(FIGURES)
    ]
    return [ir.sweep(ir.CELL, each, judge)]
