"""Draws panels with matplotlib, as SVG that takes its colours and letters from the page."""

import re
from typing import Any

import numpy as np
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure as Canvas
from matplotlib.ticker import FuncFormatter

from cnnum.lab.reproduce.figure import Arrows, Curve, Dots, Field, Layer, Matrix, Panel
from cnnum.report.plots import INK, PALETTE, inline_svg, page_style

WIDE, NARROW = (5.3, 3.6), (4.0, 3.1)
"""Size of a panel, inches, two or three to a row; letters have the same size on the page."""

HOT = LinearSegmentedColormap.from_list(
    "pushed", ("#0b3f8c", "#3f8fd6", "#f4f5f7", "#eb8a3e", "#8f2f06")
)
MANY = 400
"""Dots above which they are drawn as a picture: as elements they would make the page heavy."""

SUBSCRIPT = r"(\w)_(\w+)"
"""A letter and its index."""

STYLES = {"line": "-", "dashed": "--", "dotted": ":", "points": "none"}


def draw(panel: Panel, *, wide: bool = True) -> str:
    """Return a panel as an SVG element for a page.

    Parameters
    ----------
    panel : Panel
    wide : bool
        Two panels to a row, instead of three.

    Returns
    -------
    str
        As wide as its place; with its title for screen readers.
    """
    with page_style():
        canvas = Canvas(figsize=WIDE if wide else NARROW, layout="constrained", dpi=130)
        axes: Any = canvas.add_subplot()
        for number, layer in enumerate(panel.layers):
            _draw_layer(axes, layer, number)
        _dress(axes, panel)
        body = inline_svg(canvas, panel.title)
    return re.sub(r"(<text[^>]*>)([^<]*_[^<]*)(</text>)", _lowered, body)


def _draw_layer(axes: Any, layer: Layer, number: int) -> None:
    match layer:
        case Curve():
            _draw_curve(axes, layer, number)
        case Field():
            _draw_field(axes, layer)
        case Dots():
            _draw_dots(axes, layer)
        case Arrows():
            axes.quiver(
                layer.x, layer.y, layer.u, layer.v, angles="xy", scale_units="xy", scale=1.0,
                color=PALETTE[layer.colour], width=0.006, label=layer.label or None,
            )  # fmt: skip
        case Matrix():
            _draw_matrix(axes, layer)


def _draw_curve(axes: Any, curve: Curve, number: int) -> None:
    which = number if curve.colour == -1 else curve.colour
    axes.plot(
        curve.x,
        curve.y,
        linestyle=STYLES[curve.style],
        marker="o" if curve.style == "points" else "",
        markersize=3.5,
        color=INK if which == -2 else PALETTE[which % len(PALETTE)],
        label=curve.label or None,
    )


def _draw_field(axes: Any, field: Field) -> None:
    top = float(np.abs(field.values).max()) or 1.0
    limits = {"vmin": -top, "vmax": top} if field.diverging else {}
    colours = HOT if field.diverging else "viridis"
    drawn = axes.pcolormesh(
        field.x, field.y, field.values, cmap=colours, shading="nearest", rasterized=True, **limits
    )
    if field.levels:
        axes.contour(
            field.x, field.y, field.values, field.levels, colors="#00000055", linewidths=0.5,
            linestyles="solid",
        )  # fmt: skip
    bar = axes.figure.colorbar(drawn, ax=axes, shrink=0.9, pad=0.02)
    bar.outline.set_visible(False)
    bar.set_label(field.unit)


def _draw_dots(axes: Any, dots: Dots) -> None:
    if isinstance(dots.colour, int):
        axes.scatter(
            dots.x, dots.y, dots.size, color=PALETTE[dots.colour], alpha=0.7, linewidths=0,
            label=dots.label or None, rasterized=dots.x.size > MANY,
        )  # fmt: skip
        return
    drawn = axes.scatter(
        dots.x, dots.y, dots.size, c=dots.colour, cmap="viridis", linewidths=0,
        rasterized=dots.x.size > MANY,
    )  # fmt: skip
    bar = axes.figure.colorbar(drawn, ax=axes, shrink=0.9, pad=0.02)
    bar.outline.set_visible(False)
    bar.set_label(dots.label)


def _draw_matrix(axes: Any, matrix: Matrix) -> None:
    share = matrix.values / np.maximum(matrix.values.sum(axis=1, keepdims=True), 1.0)
    axes.imshow(share, cmap="Blues", vmin=0.0, vmax=1.0, aspect="auto")
    axes.set_xticks(range(len(matrix.cols)), matrix.cols)
    axes.set_yticks(range(len(matrix.rows)), matrix.rows)
    axes.tick_params(length=0)
    for (row, col), value in np.ndenumerate(matrix.values):
        axes.text(
            col, row, f"{value:.0f}", ha="center", va="center",
            color="#ffffff" if share[row, col] > 0.5 else "#102030",
        )  # fmt: skip


def _dress(axes: Any, panel: Panel) -> None:
    axes.set(title=panel.title, xlabel=panel.x_label, ylabel=panel.y_label)
    for name in panel.log:
        _logarithmic(axes, name)
    if panel.reach is not None:
        axes.set(xlim=(-panel.reach, panel.reach), ylim=(-panel.reach, panel.reach))
    if panel.ticks:
        axes.set_yticks(range(1, len(panel.ticks) + 1), panel.ticks)
    if panel.equal:
        fixed = _has_field(panel) or panel.reach is not None
        axes.set_aspect("equal", "box" if fixed else "datalim")
    if panel.depth:
        axes.invert_yaxis()
    for place, name in panel.marks:
        axes.axvline(place, color=INK, alpha=0.35, linewidth=0.8, linestyle=":")
        axes.annotate(
            name, (place, 1.0), xycoords=("data", "axes fraction"), xytext=(3, -9),
            textcoords="offset points", fontsize=8.5,
        )  # fmt: skip
    if not _has_field(panel) and not isinstance(panel.layers[0], Matrix):
        axes.grid(color=INK, alpha=0.1, linewidth=0.6)
        axes.set_axisbelow(True)
    if any(getattr(layer, "label", "") for layer in panel.layers if not _is_scaled(layer)):
        axes.legend(loc="best", handlelength=1.6)


def _logarithmic(axes: Any, name: str) -> None:
    """Make an axis logarithmic, with plain numbers."""
    axes.set(**{f"{name}scale": "log"})
    axis = getattr(axes, f"{name}axis")
    axis.set_major_formatter(FuncFormatter(_plain))
    axis.set_minor_formatter(FuncFormatter(_plain_if_few))


def _plain(value: float, _: object) -> str:
    return f"{value:g}"


def _plain_if_few(value: float, _: object) -> str:
    """Return 2 and 5 of a decade: more would not fit."""
    return f"{value:g}" if f"{value:.0e}"[0] in "25" else ""


def _has_field(panel: Panel) -> bool:
    return any(isinstance(layer, Field) for layer in panel.layers)


def _is_scaled(layer: Layer) -> bool:
    """Return whether a layer's label is that of its colour bar."""
    return isinstance(layer, Dots) and not isinstance(layer.colour, int)


def _lowered(text: re.Match[str]) -> str:
    """Return a text element where the text after an underscore is set lower."""
    low = r'\1<tspan dy="2.5" font-size="75%">\2</tspan><tspan dy="-2.5">&#8203;</tspan>'
    return text[1] + re.sub(SUBSCRIPT, low, text[2]) + text[3]
