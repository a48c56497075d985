"""The judgement of a step strip by strip: the largest of each figure in its cells.

Every strip keeps its findings in each lane, and the plan's body makes one number of them.
"""

from collections.abc import Sequence

from cnnum import kernels as ir
from cnnum.engines.opencl.large_arrays.strip_rows import ONES, START, P, Rows, X, constant, vector
from cnnum.engines.opencl.transients.step_control import rounding

MAXIMA = ir.Name("strip_maxima")
"""The array of the findings of strips."""

CELLS = "strip_cells"
"""The array whose cells are numbers of a row."""

FIGURES = ("worst", "added", "speed", "change")
"""The findings of a step: the largest of each in all cells."""


A, B, FOUND, PIECE = ir.names("a b found piece")


def judged(rows: Rows, each: Sequence[ir.Statement]) -> list[ir.Statement]:
    """Return statements `each` on a vector of cells that takes part in the figures."""
    size, first, most = rows.layout.width, rows.at(MAXIMA.text), rows.size[1]
    places = {
        ir.Name(name): X + (first + n * most * size) + PIECE * size
        for n, name in enumerate(FIGURES)
    }
    loaded = [vector(name, ir.Load(place)) for name, place in places.items()]
    return [*loaded, *each, *(ir.Store(place, name) for name, place in places.items())]


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
    text = rows.text
    tau = ir.Number(float(text.template.tau.max()))
    atol, rtol = ir.Number(text.solver.atol), ir.Number(text.solver.rtol)
    return [
        constant(A, magnitude(states[0])),
        constant(B, magnitude(states[1])),
        vector(FOUND, error / (atol + rtol * ir.Choice(A < B, B, A))),
        _most(rows, "worst"),
        ir.Assign(FOUND, left_out + rounding(text) * B),
        _most(rows, "added"),
        ir.Assign(FOUND, magnitude(rate)),
        _most(rows, "speed"),
        ir.Assign(FOUND, tau * FOUND / (atol + rtol * B)),
        _most(rows, "change"),
    ]


def magnitude(value: ir.Expression) -> ir.Expression:
    """Return |value| in every lane."""
    return ir.call("magnitude", value)


def no_cells(rows: Rows) -> ir.Expression | None:
    """Return in which lanes there is no cell; None where all have one."""
    if CELLS not in rows.offsets:
        return None
    return ir.Load(X + int(rows.offsets[CELLS]) + P - START) < ONES


def _most(rows: Rows, name: str) -> ir.Statement:
    """Return the statement that keeps the larger number; lanes without a cell have none."""
    none = no_cells(rows)
    found = FOUND if none is None else ir.Choice(none, ONES - ONES, FOUND)
    return ir.Accumulate(ir.Name(name), "greatest", found)


def mark_cells(rows: Rows) -> list[str]:
    """Return the text that keeps which numbers of a row are cells."""
    layout, to = rows.layout, rows.at(CELLS)
    return [
        f"for (int n = 0; piece == 0 && n < {rows.span}; ++n) {{",
        f"    const int col = n % {layout.width} * {layout.vectors} + n / {layout.width};",
        f"    x[{to} + n] = col < {layout.cols};",
        "}",
    ]
