"""Pictures of benchmark rows: one function per kind, Matplotlib without a display."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, cast

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter

from cnnum.lab.bench.true_error import Axes, Picture, Row, mark_few, true_error
from cnnum.report.plots import drawn
from cnnum.report.work_precision import LEAST

METHOD_STYLES = {
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


SAME = 2.0
"""Ratio of errors up to which a method makes no difference: their roundings alone differ."""


def work_precision(rows: Sequence[Row]) -> Picture:
    """Return error over time, by method: a row of panels a case.

    Cases whose error does not depend on the method have no panels, and are named.
    """
    places = list(dict.fromkeys(_where(row) for row in rows))
    named = list(dict.fromkeys(str(row["case"]) for row in rows))
    cases = [case for case in named if _changes([r for r in rows if r["case"] == case])] or named
    figure: Picture = Figure(
        figsize=(1.2 + 3.1 * len(places), _height(len(cases), len(places))), layout="constrained"
    )
    grid: Any = figure.subplots(len(cases), len(places), sharex="row", sharey="row", squeeze=False)
    for line, case in enumerate(cases):
        for axes, place in zip(grid[line], places, strict=True):
            inside = [r for r in rows if r["case"] == case and _where(r) == place]
            _methods(axes, inside)
            _frame(axes, place if line == 0 else "", axes is grid[line][0], case)
            axes.set_visible(bool(inside) or line == 0)
    for axes in grid.flat:
        mark_few(axes)
    for axes in grid[-1]:
        axes.set_xlabel("µs a picture, or a frame of a stream")
    _legend(figure, grid)
    if alike := [case for case in named if case not in cases]:
        said = f"Of one error by all methods, and not shown: {', '.join(alike)}"
        figure.text(0.5, 0.0, said, ha="center", va="bottom", fontsize=8.5)
        figure.get_layout_engine().set(rect=(0.0, 0.02, 1.0, 0.98))
    return figure


def _changes(rows: Sequence[Row]) -> bool:
    """Return whether the error of a case changes with the method anywhere."""
    at: dict[str, list[float]] = {}
    for row in rows:
        at.setdefault(_where(row), []).append(_point(row)[1])
    return any(max(errors) > SAME * min(errors) for errors in at.values())


def _height(lines: int, places: int) -> float:
    """Return the height of a number of panels and of the names above them, inches."""
    return 0.5 + 2.15 * lines + 0.25 * -(-len(METHOD_STYLES) // _columns(places))


def _columns(places: int) -> int:
    return 2 * places


def _where(row: Row) -> str:
    return f"{row['engine']} {row['precision']}"


def _point(row: Row) -> tuple[float, float]:
    """Return µs a picture, and the error."""
    values = (row["seconds"], row["pictures"], row["error"])
    seconds, pictures, error = (float(v) if isinstance(v, int | float) else 0.0 for v in values)
    return 1e6 * seconds / max(pictures, 1.0), max(error, LEAST)


def _methods(axes: Axes, rows: Sequence[Row]) -> None:
    for method, (colour, marker) in METHOD_STYLES.items():
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


def _legend(figure: Picture, grid: Any) -> None:
    handles = {
        text: line
        for axes in grid.flat
        for line, text in zip(*axes.get_legend_handles_labels(), strict=True)
    }
    ordered = {name: handles[name] for name in METHOD_STYLES if name in handles}
    if ordered:
        figure.legend(
            ordered.values(),
            ordered.keys(),
            loc="outside upper center",
            ncols=min(len(ordered), _columns(grid.shape[1])),
            fontsize=8.5,
            frameon=False,
        )


STYLES = {"q15": ("o", "C0"), "q7": ("s", "C1"), "q23": ("v", "C2"), "float32": ("D", "C3")}
OTHER = ("^", "C4")
"""Marker and colour of a precision; a method of Euler's steps is hollow."""

LEAST_EMBEDDED = 1e-9
"""A smaller error is drawn there: the axis is logarithmic."""

COSTS = {"instructions": "instructions a frame", "ram_bytes": "bytes of RAM"}


def _number(row: Row, key: str) -> float:
    value = row[key]
    return max(float(value), LEAST_EMBEDDED) if isinstance(value, int | float) else LEAST_EMBEDDED


def _title(row: Row) -> str:
    rows, cols = cast("Sequence[int]", row["shape"])
    return f"{row['case']}, {rows}×{cols}"


def _front(points: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    """Return the corners of a staircase below which no point lies."""
    result = list[tuple[float, float]]()
    for x, y in sorted(points):
        if not result or y < result[-1][1]:
            result.append((x, y))
    return result


def _panel(axes: Axes, rows: Sequence[Row], cost: str, first: bool) -> None:
    for row in rows:
        name = f"{row['precision']} {row['method']}, {row['core']}"
        marker, colour = STYLES.get(str(row["precision"]), OTHER)
        filled = row["method"] == "auto"
        axes.plot(
            [_number(row, cost)], [_number(row, "error")], marker, label=name, color=colour,
            markerfacecolor=colour if filled else "none", markersize=6, linestyle="none",
        )  # fmt: skip
    x, y = zip(*_front([(_number(r, cost), _number(r, "error")) for r in rows]), strict=True)
    axes.step(x, y, where="post", color="0.6", linewidth=1, zorder=0, label="Pareto front")
    axes.set(xscale="log", yscale="log", xlabel=COSTS[cost])
    axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes.xaxis.set_major_formatter("{x:,.0f}")
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.tick_params(axis="x", labelsize=8, labelrotation=30)  # bytes of one decade lie close
    axes.set_title(_title(rows[0]), fontsize=9)
    axes.grid(visible=True, alpha=0.3)
    axes.margins(0.15)
    if first:
        axes.set_ylabel("relative error of the worst output")
        axes.legend(fontsize=7)


def embedded(rows: Sequence[Row]) -> Picture:
    """Return the picture of costs on microcontrollers."""
    groups: dict[str, list[Row]] = {}
    for row in rows:
        groups.setdefault(_title(row), []).append(row)
    figure: Picture = Figure(figsize=(9, 3.6 * len(groups)), layout="constrained")
    grid = figure.subplots(len(groups), 2, squeeze=False)
    for line, mine in enumerate(groups.values()):
        for place, cost in enumerate(COSTS):
            _panel(grid[line][place], mine, cost, place == 0)
    return figure


MARKERS = "osD^v<>Ph*X"


def _value(row: Row, key: str) -> float:
    value = row.get(key)
    return float(value) if isinstance(value, int | float) else float("nan")


def _curves(rows: Sequence[Row], keys: Sequence[str]) -> dict[str, list[Row]]:
    result: dict[str, list[Row]] = {}
    for row in rows:
        result.setdefault(" ".join(str(row[key]) for key in keys), []).append(row)
    return result


def _line(axes: Axes, x: Sequence[float], y: Sequence[float], name: str, style: int) -> None:
    axes.plot(
        x, y, label=name, color=f"C{style % 10}", marker=MARKERS[style % len(MARKERS)],
        markersize=4, linewidth=1, linestyle=("-", "--", ":")[style // 10 % 3],
    )  # fmt: skip


def bars(rows: Sequence[Row], label: Sequence[str], value: str, title: str) -> Picture:
    """Return one horizontal bar per row; the common part of all rows stands once, above."""
    figure: Picture = Figure(figsize=(8, 1.2 + 0.36 * len(rows)), layout="constrained")
    axes: Axes = figure.add_subplot()
    common = [key for key in label[1:] if len({str(row[key]) for row in rows}) == 1]
    own = [key for key in label if key not in common]
    names = ["\n".join(str(row[key]) for key in own) for row in rows]
    numbers = [_value(row, value) for row in rows]
    if common:
        figure.suptitle("\n".join(str(rows[0][key]) for key in common), fontsize=8)
    axes.barh(range(len(rows)), numbers, color="C0")
    axes.set_yticks(range(len(rows)), names, fontsize=8)
    axes.invert_yaxis()
    axes.set_xlabel(title, loc="right")  # on a phone it is wider than the bars
    for place, number in enumerate(numbers):
        text = f" {number:,.0f}" if number >= 1000.0 else f" {number:.3g}"
        axes.text(number, place, text, va="center", fontsize=8)
    axes.margins(x=0.15)
    return figure


def throughput(rows: Sequence[Row]) -> Picture:
    """Return the share of the device's peak."""
    return bars(rows, ["case", "device"], "share_of_peak", "share of the multiply-add peak")


def latency(rows: Sequence[Row]) -> Picture:
    """Return the median latency of each program; some take a hundred times as long as others."""
    figure = bars(rows, ["case", "device"], "p50_us", "µs a frame, median")
    figure.axes[0].set_xscale("log")
    return figure


def scenes(rows: Sequence[Row]) -> Picture:
    """Return the cost of a frame for each scene."""
    return bars(rows, ["case", "device"], "p50_us", "µs a frame, median")


def compile_time(rows: Sequence[Row]) -> Picture:
    """Return the cold build time."""
    return bars(rows, ["case", "device"], "cold_s", "s to the first result, empty caches")


def denormals(rows: Sequence[Row]) -> Picture:
    """Return how much longer runs next to zero take."""
    return bars(rows, ["case", "precision"], "ratio", "time over that of numbers of order 1")


def fusing(rows: Sequence[Row]) -> Picture:
    """Return how many times longer plans take with nothing fused."""
    return bars(rows, ["case", "shape", "batch"], "ratio", "times as long with nothing fused")


def peers(rows: Sequence[Row]) -> Picture:
    """Return how many times longer each peer takes."""
    figure = bars(rows, ["case", "peer"], "ratio", "times as long as this engine")
    axes = figure.axes[0]
    axes.set_xscale("log")
    least = min(_value(row, "ratio") for row in rows)
    axes.set_xlim(left=min(1.0, 0.7 * least))  # 1: as quick
    axes.xaxis.set_minor_formatter(NullFormatter())
    return figure


UNITS = {
    "array": "array, cells; one frame",
    "batch": "batch, frames of 8×8 cells",
    "radius": "radius of the templates, cells",
    "layers": "layers",
    "taxel grid": "taxel grid; batch of 1024",
}
"""The quantity along each panel of `scaling`."""


def scaling(rows: Sequence[Row]) -> Picture:
    """Return the cost of a cell update along each curve, one panel per curve."""
    curves = _curves(rows, ["case"])
    columns = min(3, len(curves))
    lines = -(-len(curves) // columns)
    figure: Picture = Figure(figsize=(5.2 * columns, 3.9 * lines), layout="constrained")
    first: Axes = None
    for place, (case, inside) in enumerate(curves.items()):
        # one scale for all: a curve is as flat as it looks
        axes: Axes = figure.add_subplot(lines, columns, place + 1, sharey=first)
        first = first or axes
        names = [_place(row) for row in inside]
        costs = [_value(row, "ns_per_update") for row in inside]
        _line(axes, list(range(len(names))), costs, case, 0)
        for at, cost in enumerate(costs):
            axes.annotate(
                f"{cost:.2g}", (at, cost), (0, 5), textcoords="offset points", ha="center",
                fontsize=7,
            )  # fmt: skip
        axes.set_xticks(range(len(names)), names, rotation=45, fontsize=8)
        axes.set(ylabel="ns a cell update", yscale="log", xlabel=UNITS.get(case, case))
        axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axes.yaxis.set_major_formatter("{x:g}")
        axes.yaxis.set_minor_formatter(NullFormatter())
        axes.margins(x=0.1, y=0.15)
        axes.grid(visible=True, which="both", alpha=0.3)
    return figure


def _place(row: Row) -> str:
    shape = row["shape"]
    several = cast("Sequence[int]", shape) if isinstance(shape, list | tuple) else (shape,)
    sides = "×".join(str(side) for side in several)
    at = {"batch": row["batch"], "radius": row["radius"], "layers": row["layers"]}
    return str(at.get(str(row["case"]), sides))


CHARTS: Mapping[str, Callable[[Sequence[Row]], Picture]] = {
    "work-precision": work_precision,
    "throughput": throughput,
    "latency": latency,
    "scenes": scenes,
    "compile": compile_time,
    "denormals": denormals,
    "fusing": fusing,
    "scaling": scaling,
    "peers": peers,
    "answers": peers,
    "embedded": embedded,
    "truth": true_error,
    "design": peers,
}


def png(figure: Picture) -> bytes:
    """Return a figure as PNG."""
    canvas: Any = FigureCanvasAgg(figure)
    return drawn(canvas.figure)
