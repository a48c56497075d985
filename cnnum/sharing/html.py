"""The view of an object in a notebook: its facts, and maps as small pictures."""

from collections.abc import Iterable, Sequence
from html import escape

import numpy as np

from cnnum.arrays import Floats
from cnnum.sharing.colours import LIGHT, scale, step

MOST_CELLS = 64
"""Rows or columns of a map that is shown cell by cell; a larger one is thinned."""

CELL = 12
"""Pixels of a cell's side, at most."""


def facts(title: str, pairs: Iterable[tuple[str, object]], maps: Sequence[str] = ()) -> str:
    """Return a table of names and values under a title, and pictures below it."""
    rows = "".join(
        f"<tr><th style='text-align:left'>{escape(name)}</th>"
        f"<td style='text-align:left'>{escape(str(value))}</td></tr>"
        for name, value in pairs
    )
    return f"<div><b>{escape(title)}</b><table>{rows}</table>{''.join(maps)}</div>"


def table(title: str, header: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Return a table with a header."""
    head = "".join(f"<th>{escape(name)}</th>" for name in header)
    body = "".join(
        "<tr>" + "".join(f"<td>{escape(str(cell))}</td>" for cell in row) + "</tr>" for row in rows
    )
    return f"<div><b>{escape(title)}</b><table><tr>{head}</tr>{body}</table></div>"


def picture(name: str, values: Floats, top: float | None = None, *, styled: bool = False) -> str:
    """Return a map as SVG: blue above 0, orange below, the middle at 0.

    Parameters
    ----------
    name : str
    values : (rows, cols) float
    top : float, optional
        Value of the strongest colour; the largest magnitude unless given.
    styled : bool
        Whether the page has the rules of `style_rules`, which follow light and dark paper.
    """
    thin = -(-max(values.shape) // MOST_CELLS)
    shown = np.nan_to_num(values[::thin, ::thin])
    rows, cols = shown.shape
    side = max(2, min(CELL, 240 // max(rows, cols)))
    reach = float(np.abs(shown).max()) if top is None else top
    looks = [f"class='k{n}'" if styled else f"fill='{c}'" for n, c in enumerate(scale(LIGHT))]
    cells = "".join(
        f"<rect x='{col * side}' y='{row * side}' width='{side}' height='{side}' "
        f"{looks[step(float(shown[row, col]), reach)]}/>"
        for row in range(rows)
        for col in range(cols)
    )
    return (
        f"<figure style='display:inline-block;margin:4px'><svg shape-rendering='crispEdges' "
        f"width='{cols * side}' "
        f"height='{rows * side}' viewBox='0 0 {cols * side} {rows * side}' role='img' "
        f"aria-label='{escape(name)}'>{cells}</svg>"
        f"<figcaption>{escape(name)}</figcaption></figure>"
    )
