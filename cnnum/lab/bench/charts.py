"""Pictures of benchmark rows: one function a kind, Matplotlib without a display."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, cast

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter

from cnnum.lab.bench.true_error_chart import true_error
from cnnum.lab.bench.work_precision_chart import work_precision
from cnnum.lab.embedded.chart import embedded
from cnnum.report.probe_picture import drawn

Row = Mapping[str, object]
Axes = Any
Picture = Any
"""Matplotlib says little of the types of its arguments."""
MARKERS = "osD^v<>Ph*X"


def _value(row: Row, key: str) -> float:
    value = row.get(key)
    return float(value) if isinstance(value, int | float) else float("nan")


def _curves(rows: Sequence[Row], keys: Sequence[str]) -> dict[str, list[Row]]:
    found: dict[str, list[Row]] = {}
    for row in rows:
        found.setdefault(" ".join(str(row[key]) for key in keys), []).append(row)
    return found


def _line(axes: Axes, x: Sequence[float], y: Sequence[float], name: str, style: int) -> None:
    axes.plot(
        x, y, label=name, color=f"C{style % 10}", marker=MARKERS[style % len(MARKERS)],
        markersize=4, linewidth=1, linestyle=("-", "--", ":")[style // 10 % 3],
    )  # fmt: skip


def bars(rows: Sequence[Row], label: Sequence[str], value: str, title: str) -> Picture:
    """Return one horizontal bar a row; the common part of all rows stands once, above."""
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
    axes.set_xlim(left=min([1.0, *(_value(row, "ratio") for row in rows)]))  # 1: as quick
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
    """Return the cost of a cell update along each curve, a panel a curve."""
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
    "embedded": embedded,
    "truth": true_error,
    "design": peers,
}


def png(figure: Picture) -> bytes:
    """Return a figure as PNG."""
    canvas: Any = FigureCanvasAgg(figure)
    return drawn(canvas.figure)
