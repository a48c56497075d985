"""Error against instructions and against RAM: a panel a program, with its Pareto front."""

from collections.abc import Mapping, Sequence
from typing import Any, cast

from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter

Row = Mapping[str, object]
Axes = Any
Picture = Any

STYLES = {"q15": ("o", "C0"), "q7": ("s", "C1"), "q23": ("v", "C2"), "float32": ("D", "C3")}
OTHER = ("^", "C4")
"""Marker and colour of a precision; a method of Euler's steps is hollow."""

LEAST = 1e-9
"""A smaller error is drawn there: the axis is logarithmic."""

COSTS = {"instructions": "instructions a frame", "ram_bytes": "bytes of RAM"}


def _number(row: Row, key: str) -> float:
    value = row[key]
    return max(float(value), LEAST) if isinstance(value, int | float) else LEAST


def _title(row: Row) -> str:
    rows, cols = cast("Sequence[int]", row["shape"])
    return f"{row['case']}, {rows}×{cols}"


def _front(points: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    """Return the corners of a staircase below which no point lies."""
    found = list[tuple[float, float]]()
    for x, y in sorted(points):
        if not found or y < found[-1][1]:
            found.append((x, y))
    return found


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
