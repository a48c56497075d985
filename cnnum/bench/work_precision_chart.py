"""The picture of error against run time: a row of small panels a template, one a device."""

from collections.abc import Mapping, Sequence
from typing import Any

from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter

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

PROGRAM_MARKERS = "osD^v<>ph*Xd"
PROGRAM_COLOURS = ("#2f6db5", "#d1495b", "#5b9a3c", "#7b4fa0", "#c27c0e")
"""Of programs, in turn; no two of the library look the same. Names stand below all panels, as
programs lie too near to each other for names beside them."""

FEW_DECADES = 2.3
"""Decades of an axis up to which it also has room for ticks at 2 and 5."""

LEAST = 1e-17
"""Errors below it, 0 among them, are drawn at it: a logarithmic axis has no 0."""


def work_precision(rows: Sequence[Row]) -> Picture:
    """Return error over time: templates by method, then programs by engine."""
    places = list(dict.fromkeys(_place(row) for row in rows))
    templates = list(dict.fromkeys(str(r["case"]) for r in rows if r["method"] in STYLES))
    programs = [c for c in dict.fromkeys(str(r["case"]) for r in rows) if c not in templates]
    lines = len(templates) + (1 if programs else 0)
    figure: Picture = Figure(
        figsize=(1.2 + 3.1 * len(places), _height(lines, len(programs), len(places))),
        layout="constrained",
    )
    grid: Any = figure.subplots(lines, len(places), sharex="row", sharey="row", squeeze=False)
    for line, case in enumerate(templates):
        for axes, place in zip(grid[line], places, strict=True):
            inside = [r for r in rows if r["case"] == case and _place(r) == place]
            _methods(axes, inside)
            _frame(axes, place if line == 0 else "", axes is grid[line][0], case)
    if programs:
        for axes, place in zip(grid[-1], places, strict=True):
            _programs(axes, programs, [r for r in rows if _place(r) == place])
            _frame(axes, "" if templates else place, axes is grid[-1][0], "tactile programs")
    for axes in grid.flat:
        _ticks(axes)
    for axes in grid[-1]:
        axes.set_xlabel("µs a picture (programs: a frame)" if programs else "µs a picture")
    _legend(figure, grid, list(STYLES), "outside upper center")
    _legend(figure, grid, programs, "outside lower center")
    return figure


def _height(lines: int, programs: int, places: int) -> float:
    """Return the height of so many panels and of the names above and below them, inches."""
    columns = _columns(places)
    return 0.5 + 2.15 * lines + 0.25 * (-(-len(STYLES) // columns) - (-programs // columns))


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
        # along its rungs, not along the time, so that a curve shows what a smaller step brings
        points = [_point(row) for row in rows if row["method"] == method]
        if points:
            x, y = zip(*points, strict=True)
            axes.plot(
                x, y, color=colour, marker=marker, label=method, linewidth=1.2,
                markersize=9 if marker == "*" else 4, alpha=0.9, clip_on=False,
                zorder=4 if marker == "*" else 3,
            )  # fmt: skip


def _programs(axes: Axes, names: Sequence[str], rows: Sequence[Row]) -> None:
    for number, name in enumerate(names):
        colour = PROGRAM_COLOURS[number % len(PROGRAM_COLOURS)]
        marker = PROGRAM_MARKERS[number % len(PROGRAM_MARKERS)]
        for row in (row for row in rows if row["case"] == name):
            x, y = _point(row)
            axes.plot(
                [x], [y], color=colour, marker=marker, markersize=6, linestyle="none",
                markerfacecolor="none", label=name,
            )  # fmt: skip
    axes.margins(x=0.1, y=0.2)


def _frame(axes: Axes, title: str, first: bool, case: str) -> None:
    axes.set(xscale="log", yscale="log")
    axes.set_title(title, fontsize=10)
    axes.grid(visible=True, which="major", color="#dddddd", linewidth=0.6)
    axes.tick_params(labelsize=7.5)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    if first:
        axes.set_ylabel(f"{case}\nlargest error", fontsize=8.5)


def _ticks(axes: Axes) -> None:
    """Mark 1, 2 and 5 where there is room for them, else whole decades; nothing in between."""
    low, high = axes.get_xlim()
    few = high / low < 10.0**FEW_DECADES
    axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if few else (1.0,), numticks=8))
    axes.xaxis.set_major_formatter("{x:g}")
    axes.xaxis.set_minor_formatter(NullFormatter())


def _legend(figure: Picture, grid: Any, names: Sequence[str], place: str) -> None:
    found = {
        text: line
        for axes in grid.flat
        for line, text in zip(*axes.get_legend_handles_labels(), strict=True)
    }
    ordered = {name: found[name] for name in names if name in found}
    if ordered:
        columns = min(len(ordered), _columns(grid.shape[1]))
        figure.legend(
            ordered.values(), ordered.keys(), loc=place, ncols=columns, fontsize=8.5, frameon=False
        )
