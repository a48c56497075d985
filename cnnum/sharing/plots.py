"""Plots of the house's objects with Matplotlib, on axes of the caller's or new ones."""

from collections.abc import Mapping, Sequence
from importlib import import_module
from typing import Any

import numpy as np

from cnnum.arrays import Floats
from cnnum.sharing.colours import LIGHT, scale

Axes = Any
"""A `matplotlib.axes.Axes`, or an array of them."""


def new_axes(ax: Axes | None, columns: int = 1, rows: int = 1) -> Any:
    """Return axes to draw on, as a flat array: the caller's, or those of a new figure."""
    if ax is not None:
        return np.atleast_1d(np.asarray(ax, dtype=object)).ravel()
    size = (2.6 * columns + 1.4, 2.4 * rows + 0.6)
    pyplot: Any = import_module("matplotlib.pyplot")
    _, made = pyplot.subplots(rows, columns, figsize=size, squeeze=False, layout="constrained")
    return made.ravel()


def colours() -> Any:
    """Return Matplotlib's colour map of a push: blue above 0, orange below."""
    return import_module("matplotlib.colors").ListedColormap(scale(LIGHT))


def maps(named: Mapping[str, Floats], ax: Axes | None = None, unit: str = "") -> Any:
    """Draw (rows, cols) maps side by side in one scale: blue above 0, orange below."""
    drawn = new_axes(ax, columns=len(named))
    top = max(float(np.nanmax(np.abs(values), initial=0.0)) for values in named.values())
    image: Any = None
    for axes, (name, values) in zip(drawn, named.items(), strict=False):
        image = axes.imshow(values, cmap=colours(), vmin=-(top or 1.0), vmax=top or 1.0)
        axes.set_title(name)
        axes.set_xlabel("column")
        axes.set_ylabel("row")
    if image is not None and ax is None:
        drawn[0].figure.colorbar(image, ax=list(drawn), label=unit or None)
    return drawn


def lines(x: Floats, named: Mapping[str, Floats], ax: Axes | None, labels: tuple[str, str]) -> Axes:
    """Draw (n,) lines over x on one axes, named in a legend."""
    axes = new_axes(ax)[0]
    for name, values in named.items():
        axes.plot(x, values, label=name)
    axes.set_xlabel(labels[0])
    axes.set_ylabel(labels[1])
    axes.legend()
    return axes


def marks(kinds: Sequence[str], times: Sequence[float], ax: Axes | None) -> Axes:
    """Draw events as marks over time, a row a kind."""
    axes = new_axes(ax)[0]
    rows = list(dict.fromkeys(kinds))
    axes.scatter(times, [rows.index(kind) for kind in kinds], marker="|", s=300)
    axes.set_yticks(range(len(rows)), rows)
    axes.set_ylim(max(len(rows), 1) - 0.5, -0.5)
    axes.set_xlabel("time (s)")
    return axes


def bars(named: Mapping[str, float], ax: Axes | None, label: str) -> Axes:
    """Draw horizontal bars, the first at the top."""
    axes = new_axes(ax)[0]
    axes.barh(list(named), list(named.values()))
    axes.invert_yaxis()
    axes.set_xlabel(label)
    return axes
