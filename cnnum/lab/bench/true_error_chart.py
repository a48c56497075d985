"""The picture of the error that a user has: a panel a program, with its total error and parts."""

from collections.abc import Mapping, Sequence
from typing import Any

from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter

Row = Mapping[str, object]
Axes = Any
Picture = Any
"""Matplotlib says little of the types of its arguments."""

PARTS = (("error", "-", 1.2, "total"), ("discretisation", "-", 5.0, "discretisation"),
         ("arithmetic", ":", 1.2, "arithmetic"))  # fmt: skip
"""Key, line, width and name; a broad line of the discretisation shows below the total."""

COLOURS = {"float32": "#2f6db5", "float64": "#d1495b"}
ACROSS = 4

NEAR = 5.0
"""Ratio of errors up to which a panel shows them on a linear axis."""

FEW_DECADES = 2.3
"""Decades of an axis up to which it also has room for ticks at 2 and 5."""


def true_error(rows: Sequence[Row]) -> Picture:
    """Return error over time by the knob, and delay over time of programs that report events."""
    fields, events = (
        list(dict.fromkeys(_key(row) for row in rows if _is_event(row) == kind))
        for kind in (False, True)
    )
    keys = [*fields, *events]
    lines = -(-len(keys) // ACROSS)
    figure: Picture = Figure(figsize=(13, 0.9 + 2.7 * lines), layout="constrained")
    grid: list[Any] = list(figure.subplots(lines, ACROSS, squeeze=False).flat)
    named: dict[str, Any] = {}
    for axes, key in zip(grid, keys, strict=False):
        own = [row for row in rows if _key(row) == key]
        (_delays if key in events else _errors)(axes, own)
        axes.set_title(f"{key[0]}\n{own[0]['truth']}", fontsize=8)
        mark_few(axes)
        axes.grid(visible=True, which="major", color="#dddddd", linewidth=0.6)
        axes.tick_params(labelsize=7.5)
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
            named.setdefault(label, handle)
    for axes in grid[len(keys) :]:
        axes.set_axis_off()
    order = sorted(named, key=lambda label: label.split(", ", 1)[::-1])
    figure.legend([named[label] for label in order], order, loc="outside upper center", ncols=6,
                  fontsize=8, frameon=False)  # fmt: skip
    return figure


def _key(row: Row) -> tuple[str, str, bool]:
    return str(row["case"]), str(row["knob"]), _is_event(row)


def _is_event(row: Row) -> bool:
    return row["missed"] is not None


def _number(row: Row, key: str) -> float:
    value = row[key]
    return float(value) if isinstance(value, int | float) else float("nan")


def _errors(axes: Axes, rows: Sequence[Row]) -> None:
    for precision, colour in COLOURS.items():
        own = [row for row in rows if row["precision"] == precision]
        x = [1e6 * _number(row, "seconds") for row in own]
        for key, style, width, name in PARTS:
            y = [_number(row, key) for row in own]
            if any(value == value for value in y):  # not all missing
                label = f"{precision}, {name}"
                axes.plot(x, y, style, color=colour, lw=width, label=label,
                          marker="o" if width < 2.0 else "", ms=3.5,
                          alpha=1.0 if width < 2.0 else 0.25)  # fmt: skip
        # one precision is named: both have the same total
        for at, row in zip(x, own, strict=True) if precision == rows[0]["precision"] else ():
            axes.annotate(f"{_number(row, 'setting'):g}", (at, _number(row, "error")), fontsize=7.5,
                          xytext=(2, 5), textcoords="offset points")  # fmt: skip
    _scaled(axes, [_number(row, key) for row in rows for key, *_ in PARTS])
    unit = "mm" if str(rows[0]["truth"]).endswith("mm") else "share"
    axes.set_xlabel(f"µs a frame (at the points: {rows[0]['knob']})", fontsize=8)
    axes.set_ylabel(f"error, {unit}", fontsize=8)


def _scaled(axes: Axes, values: Sequence[float]) -> None:
    """Give logarithmic axes, with room for numbers; errors that are near each other begin at 0."""
    known = [value for value in values if value > 0.0]
    axes.margins(0.12)
    axes.set(xscale="log", yscale="log")
    if max(known) < NEAR * min(known):
        axes.set(yscale="linear")
        axes.set_ylim(0.0, 1.3 * max(known))


def _delays(axes: Axes, rows: Sequence[Row]) -> None:
    names = dict.fromkeys((str(row["precision"]), str(row["method"])) for row in rows)
    for (precision, method), mark in zip(names, "osD^v<>P", strict=False):
        own = [r for r in rows if (r["precision"], r["method"]) == (precision, method)]
        x = [1e6 * _number(row, "seconds") for row in own]
        y = [1e3 * _number(row, "delay_s") for row in own]
        colour = COLOURS[precision] if method == "auto" else None
        axes.plot(x, y, color=colour, marker=mark, ms=4, lw=1.2, label=f"{precision}, {method}")
        for at, delay, row in zip(x, y, own, strict=True):
            missed, first = _number(row, "missed"), (precision, method) == next(iter(names))
            text = [f"{_number(row, 'setting'):g}/s"] if first else []
            text += [f"{missed:.0%} missed"] if missed else []
            axes.annotate(", ".join(text), (at, delay), fontsize=7.5, xytext=(2, 5),
                          textcoords="offset points")  # fmt: skip
    axes.margins(0.12)
    axes.set(xscale="log")
    top = 1.3 * max([1.0, *(1e3 * _number(row, "delay_s") for row in rows)])
    axes.set_ylim(-0.05 * top, top)  # many report with the first frame
    axes.set_xlabel("µs of work a second of touch", fontsize=8)
    axes.set_ylabel("delay of the report, ms", fontsize=8)


def mark_few(axes: Axes) -> None:
    """Mark 1, 2 and 5 where there is room for them, else whole decades; nothing in between."""
    low, high = axes.get_xlim()
    few = high / low < 10.0**FEW_DECADES
    axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if few else (1.0,), numticks=8))
    axes.xaxis.set_major_formatter("{x:g}")
    axes.xaxis.set_minor_formatter(NullFormatter())
