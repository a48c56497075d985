"""The kernel text that judges a step strip by strip: the largest of each figure in its cells.

Every strip keeps its findings in each lane, and the plan's body makes one number of them.
"""

import numpy as np

from cnnum.engines.opencl.large_arrays.lane_layout import RowLayout
from cnnum.engines.opencl.large_arrays.strip_rows import Rows
from cnnum.integrators.estimate import ROUNDINGS

CELLS = "strip_cells"
"""The array of which numbers of a row are cells."""

FIGURES = ("worst", "added", "speed", "change")
"""The findings of a step: the largest of each in all cells."""


def judged(rows: Rows, most: int, each: list[str]) -> list[str]:
    """Return the text of a vector of cells that takes part in the figures.

    Parameters
    ----------
    rows : Rows
    most : int
        Strips that keep their findings.
    each : list of str
        Statements in between.
    """
    size, first = rows.layout.width, rows.offsets["strip_maxima"]
    places = [
        f"*(__global vec *)(x + {first} + {n * most * size} + piece * {size})"
        for n in range(len(FIGURES))
    ]
    loaded = [f"vec {name} = {at};" for name, at in zip(FIGURES, places, strict=True)]
    kept = [f"{at} = {name};" for name, at in zip(FIGURES, places, strict=True)]
    return [*loaded, *each, *kept]


def figures(rows: Rows, error: str, left_out: str, rate: str, states: tuple[str, str]) -> list[str]:
    """Return the text that takes the cells of a row into the figures.

    Parameters
    ----------
    rows : Rows
    error, left_out : str
        Expressions: the step's estimate, and its share in the error that is followed.
    rate : str
        The variable of the rates at the step's end.
    states : (str, str)
        Those before the step and at its end.
    """
    text = rows.text
    tau = rows.vector(float(text.template.tau.max()))
    rounding = rows.vector(ROUNDINGS * float(np.finfo(text.tables.dtype).eps))
    atol, rtol = rows.vector(text.solver.atol), rows.vector(text.solver.rtol)
    return [
        f"const vec a = magnitude({states[0]});",
        f"const vec b = magnitude({states[1]});",
        f"vec found = {error} / ({atol} + {rtol} * (a < b ? b : a));",
        _most(rows, "worst", "found"),
        f"found = {left_out} + {rounding} * b;",
        _most(rows, "added", "found"),
        f"found = magnitude({rate});",
        _most(rows, "speed", "found"),
        f"found = {tau} * found / ({atol} + {rtol} * b);",
        _most(rows, "change", "found"),
    ]


def _most(rows: Rows, name: str, found: str) -> str:
    """Return the statement that keeps the larger number; lanes without a cell have none."""
    if CELLS not in rows.offsets:
        return f"{name} = greatest({name}, {found});"
    cells = f"*(__global const vec *)(x + {rows.offsets[CELLS]} + p - start)"
    return f"{name} = greatest({name}, {cells} < one ? one - one : {found});"


def mark_cells(layout: RowLayout, to: int) -> list[str]:
    """Return the text that keeps which numbers of a row are cells."""
    return [
        f"for (int n = 0; piece == 0 && n < {layout.vectors * layout.width}; ++n) {{",
        f"    const int col = n % {layout.width} * {layout.vectors} + n / {layout.width};",
        f"    x[{to} + n] = col < {layout.cols};",
        "}",
    ]
