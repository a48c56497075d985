"""Steps of large arrays that may be refused, by strips of rows: a run of levels each.

Every strip finds the largest of each figure in its cells. The plan's body makes one number of them.
"""

from collections.abc import Sequence
from dataclasses import replace

from cnnum import kernels as ir
from cnnum.engines.opencl.large_arrays.strip_kernel import StripText, apart, strip_kernel
from cnnum.engines.opencl.large_arrays.strip_rows import FINDINGS, ONES, Rows, constant, strip_rows
from cnnum.engines.opencl.transients.builder import TransientBuilder
from cnnum.engines.opencl.transients.step_control import K0, Attempt, rounding
from cnnum.integrators.estimate import AROUND, LEAST_SLOPE, slopes_count

FIGURES = ("worst", "added", "speed", "change")
"""The findings of a step: the largest of each in all cells."""

FOUND = {name: n for n, name in enumerate(FIGURES)}
"""Their numbers among the findings of a strip."""

A, B = ir.names("a b")


def attempt_rows(text: TransientBuilder, arrays: tuple[str, ...], registers: int) -> Rows:
    """Return the rows of arrays, and declare a number of registers.

    The first two arrays hold the states and the rates at the start.
    """
    rows = strip_rows(text, arrays, tuple(1.0 / float(tau) for tau in text.template.tau))
    rows.declare_findings(registers, len(FIGURES))
    return rows


def attempt(
    rows: Rows,
    own: StripText,
    levels: int,
    settings: Sequence[ir.Statement],
    *,
    begin: Sequence[ir.Statement],
    advance: Sequence[ir.Statement],
    counted: ir.Name | None = None,
) -> Attempt:
    """Return the statements of steps, and keep their kernel with the tables.

    Parameters
    ----------
    rows : Rows
    own : StripText
    levels : int
        Of a step, at most.
    settings, begin, advance : sequence of Statement
        Statements that set the registers before each step, before all of them, and after each.
    counted : Name, optional
        The number of the plan's body that says how many levels a frame takes.
    """
    _, rates, *_ = rows.offsets
    rest = [rows.brought(rates, K0.text)]
    strips = strip_kernel(rows, replace(own, rest=rest, findings=len(FIGURES)), levels)
    brought, stages, end = apart(strips)
    found = [
        ir.Accumulate(ir.Name(name), "greater", FINDINGS[ir.Integer(n * rows.finding) + ir.CELL])
        for name, n in FOUND.items()
    ]
    return Attempt(
        begin=[*begin, brought],
        stages=[*settings, ir.StripSteps(stages, counted)],
        judge=[ir.sweep(ir.CELL, rows.finding, found)],
        advance=advance,
        end=[end],
    )


def figures(
    rows: Rows,
    error: ir.Expression,
    left_out: ir.Expression,
    rate: ir.Name,
    states: tuple[ir.Expression, ir.Expression],
) -> list[ir.Statement]:
    """Return the statements that take the cells of a row into the figures.

    Parameters
    ----------
    rows : Rows
    error, left_out : Expression
        The step's estimate, and its share in the error that is followed.
    rate : Name
        The rates at the step's end.
    states : (Expression, Expression)
        Those before the step and at its end.
    """
    text, empty = rows.text, rows.empty
    tau = ir.Number(float(text.template.tau.max()))
    atol, rtol = ir.Number(text.solver.atol), ir.Number(text.solver.rtol)
    found = (
        error / (atol + rtol * ir.Choice(A < B, B, A)),
        left_out + rounding(text) * B,
        _passed_on(rows, rate),
        tau * ir.call("magnitude", rate) / (atol + rtol * B),
    )
    lines = [
        constant(name, ir.call("magnitude", state))
        for name, state in zip((A, B), states, strict=True)
    ]
    for name, figure in zip(FIGURES, found, strict=True):
        value = figure if empty is None else ir.Choice(empty, ONES - ONES, figure)
        lines.append(ir.Accumulate(ir.Name(name), "greatest", value))
    return lines


def _passed_on(rows: Rows, rate: ir.Name) -> ir.Expression:
    """Return |dx/dt| by how much a cell passes an error on; outputs of strips are odd functions."""
    size = ir.call("magnitude", rate)
    if not slopes_count(rows.text.template):
        return size
    around, half = ir.Number(AROUND), ir.Number(0.5 / AROUND)
    rise = ir.call("shown", B + around, ONES) - ir.call("shown", B - around, ONES)
    slope, least = half * ir.call("magnitude", rise), ir.Number(LEAST_SLOPE)
    return ir.Choice(slope < least, ONES * least, slope) * size
