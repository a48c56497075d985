"""The picture of error against run time: a row of small panels a template, one a device."""

from collections.abc import Mapping, Sequence
from typing import Any

from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter

from cnnum.report.work_precision import LEAST

Row = Mapping[str, object]
Axes = Any
Picture = Any
"""Matplotlib says little of the types of its arguments."""

STYLES = {
    "euler": ("#d1495b", "o"),
    "heun": ("#e8a33d", "o"),
    "rk4": ("#5b9a3c", "o"),
    "exponential-euler": ("#c06fb0", "s"),
    "etd-rk2": ("#7b4fa0", "s"),
    "bogacki-shampine": ("#2a9d8f", "^"),
    "dormand-prince": ("#2f6db5", "^"),
    "runge-kutta-chebyshev": ("#1d3557", "D"),
    "propagator": ("#000000", "*"),
    "auto": ("#6b7280", "X"),
}
"""Colour and marker of a method: circles for fixed steps, squares for exponential ones. Triangles
and diamonds are steps that follow the error, a star none, a cross each transient's own method."""

FEW_DECADES = 2.3
"""Decades of an axis up to which it also has room for ticks at 2 and 5."""


def work_precision(rows: Sequence[Row]) -> Picture:
    """Return error over time, by method: a row of panels a case."""
    places = list(dict.fromkeys(_place(row) for row in rows))
    cases = list(dict.fromkeys(str(row["case"]) for row in rows))
    figure: Picture = Figure(
        figsize=(1.2 + 3.1 * len(places), _height(len(cases), len(places))), layout="constrained"
    )
    grid: Any = figure.subplots(len(cases), len(places), sharex="row", sharey="row", squeeze=False)
    for line, case in enumerate(cases):
        for axes, place in zip(grid[line], places, strict=True):
            inside = [r for r in rows if r["case"] == case and _place(r) == place]
            _methods(axes, inside)
            _frame(axes, place if line == 0 else "", axes is grid[line][0], case)
    for axes in grid.flat:
        mark_few(axes)
    for axes in grid[-1]:
        axes.set_xlabel("µs a picture, or a frame of a stream")
    _legend(figure, grid)
    return figure


def _height(lines: int, places: int) -> float:
    """Return the height of a number of panels and of the names above them, inches."""
    return 0.5 + 2.15 * lines + 0.25 * -(-len(STYLES) // _columns(places))


def _columns(places: int) -> int:
    return 2 * places


def _place(row: Row) -> str:
    return f"{row['engine']} {row['precision']}"


def _point(row: Row) -> tuple[float, float]:
    """Return µs a picture, and the error."""
    values = (row["seconds"], row["pictures"], row["error"])
    seconds, pictures, error = (float(v) if isinstance(v, int | float) else 0.0 for v in values)
    return 1e6 * seconds / max(pictures, 1.0), max(error, LEAST)


def _methods(axes: Axes, rows: Sequence[Row]) -> None:
    for method, (colour, marker) in STYLES.items():
        # along its rungs, not along the time, so that a curve shows the gain of a smaller step
        points = [_point(row) for row in rows if row["method"] == method]
        if points:
            x, y = zip(*points, strict=True)
            axes.plot(
                x, y, color=colour, marker=marker, label=method, linewidth=1.2,
                markersize=9 if marker == "*" else 4, alpha=0.9, clip_on=False,
                zorder=4 if marker == "*" else 3,
            )  # fmt: skip


def _frame(axes: Axes, title: str, first: bool, case: str) -> None:
    axes.set(xscale="log", yscale="log")
    axes.set_title(title, fontsize=10)
    axes.grid(visible=True, which="major", color="#dddddd", linewidth=0.6)
    axes.tick_params(labelsize=7.5)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    if first:
        axes.set_ylabel(f"{case}\nlargest error", fontsize=8.5)


def mark_few(axes: Axes) -> None:
    """Mark 1, 2 and 5 where there is room for them, else whole decades; nothing in between."""
    low, high = axes.get_xlim()
    few = high / low < 10.0**FEW_DECADES
    axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if few else (1.0,), numticks=8))
    axes.xaxis.set_major_formatter("{x:g}")
    axes.xaxis.set_minor_formatter(NullFormatter())


def _legend(figure: Picture, grid: Any) -> None:
    found = {
        text: line
        for axes in grid.flat
        for line, text in zip(*axes.get_legend_handles_labels(), strict=True)
    }
    ordered = {name: found[name] for name in STYLES if name in found}
    if ordered:
        figure.legend(
            ordered.values(),
            ordered.keys(),
            loc="outside upper center",
            ncols=min(len(ordered), _columns(grid.shape[1])),
            fontsize=8.5,
            frameon=False,
        )
