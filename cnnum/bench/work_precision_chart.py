"""The picture of error against run time: a row of small panels a template, one a device."""

from collections.abc import Mapping, Sequence
from typing import Any

from matplotlib.figure import Figure

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
}
"""Colour and marker of a method: circles for fixed steps, squares for exponential ones, triangles
and diamonds for steps that follow the error, a star for none."""

LEAST = 1e-17
"""Errors below it, 0 among them, are drawn at it: a logarithmic axis has no 0."""


def work_precision(rows: Sequence[Row]) -> Picture:
    """Return error over time: templates by method, then programs by engine."""
    places = list(dict.fromkeys(_place(row) for row in rows))
    templates = list(dict.fromkeys(str(r["case"]) for r in rows if r["method"] in STYLES))
    programs = [c for c in dict.fromkeys(str(r["case"]) for r in rows) if c not in templates]
    lines = len(templates) + (1 if programs else 0)
    figure: Picture = Figure(
        figsize=(1.2 + 3.1 * len(places), 0.9 + 2.15 * lines), layout="constrained"
    )
    grid: Any = figure.subplots(lines, len(places), sharex="row", sharey="row", squeeze=False)
    for line, case in enumerate(templates):
        for axes, place in zip(grid[line], places, strict=True):
            inside = [r for r in rows if r["case"] == case and _place(r) == place]
            _methods(axes, inside)
            _frame(axes, place if line == 0 else "", axes is grid[line][0], case)
    if programs:
        for axes, place in zip(grid[-1], places, strict=True):
            _programs(axes, [r for r in rows if r["case"] in programs and _place(r) == place])
            _frame(axes, "" if templates else place, axes is grid[-1][0], "tactile programs")
    for axes in grid[-1]:
        axes.set_xlabel("µs a picture (programs: a frame)" if programs else "µs a picture")
    _legend(figure, grid)
    return figure


def _place(row: Row) -> str:
    return f"{row['engine']} {row['precision']}"


def _point(row: Row) -> tuple[float, float]:
    """Return µs a picture, and the error."""
    values = (row["seconds"], row["pictures"], row["error"])
    seconds, pictures, error = (float(v) if isinstance(v, int | float) else 0.0 for v in values)
    return 1e6 * seconds / max(pictures, 1.0), max(error, LEAST)


def _methods(axes: Axes, rows: Sequence[Row]) -> None:
    for method, (colour, marker) in STYLES.items():
        # along its rungs, not along the time, so that a curve shows what a smaller step brings
        points = [_point(row) for row in rows if row["method"] == method]
        if points:
            x, y = zip(*points, strict=True)
            axes.plot(
                x, y, color=colour, marker=marker, label=method, linewidth=1.2,
                markersize=9 if marker == "*" else 4, alpha=0.9, clip_on=False,
                zorder=4 if marker == "*" else 3,
            )  # fmt: skip


def _programs(axes: Axes, rows: Sequence[Row]) -> None:
    for row in rows:
        x, y = _point(row)
        axes.plot([x], [y], color="#2f6db5", marker="o", markersize=4, linestyle="none")
        axes.annotate(
            str(row["case"]), (x, y), xytext=(4, 2), textcoords="offset points", fontsize=6.5
        )
    axes.margins(x=0.25, y=0.2)


def _frame(axes: Axes, title: str, first: bool, case: str) -> None:
    axes.set(xscale="log", yscale="log")
    axes.set_title(title, fontsize=10)
    axes.grid(visible=True, which="major", color="#dddddd", linewidth=0.6)
    axes.tick_params(labelsize=7.5)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    if first:
        axes.set_ylabel(f"{case}\nlargest error", fontsize=8.5)


def _legend(figure: Picture, grid: Any) -> None:
    found = {
        text: line
        for axes in grid.flat
        for line, text in zip(*axes.get_legend_handles_labels(), strict=True)
    }
    ordered = {name: found[name] for name in STYLES if name in found}
    if ordered:
        columns = min(len(ordered), 2 * grid.shape[1] + 1)
        figure.legend(
            ordered.values(), ordered.keys(), loc="outside upper center", ncols=columns,
            fontsize=8.5, frameon=False,
        )  # fmt: skip
