"""Draws panels with matplotlib, as SVG that takes its colours and letters from the page."""

import re
from typing import Any

import numpy as np
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure as Canvas
from matplotlib.ticker import FuncFormatter

from cnnum.lab.reproduce.figure import Arrows, Curve, Dots, Field, Layer, Matrix, Panel
from cnnum.report.plots import INK, PALETTE, inline_svg, page_style

STYLE = """
:root{color-scheme:light dark;--paper:#fbfbfa;--card:#fff;--ink:#1c2430;--soft:#5d6877;
--line:#e1e4e8;--good:#1b7f4b;--bad:#c0271d;--mid:#8a6100;--c0:#0a6ebd;--c1:#d1590b;--c2:#2a8c5a;
--c3:#8a4fbf;--c4:#b8860b;--c5:#c03a72}
@media (prefers-color-scheme:dark){:root{--paper:#14181d;--card:#1b2027;--ink:#e4e8ee;
--soft:#98a3b1;--line:#2e353f;--good:#5cc890;--bad:#ff8077;--mid:#e0b04c;--c0:#5cb3f5;--c1:#ff9a57;
--c2:#62c894;--c3:#bd92ea;--c4:#dcb145;--c5:#f07cab}}
*{box-sizing:border-box}
body{margin:0;background:var(--paper);color:var(--ink);
font:16px/1.55 system-ui,-apple-system,"Segoe UI",Roboto,"Noto Sans","DejaVu Sans",sans-serif}
main{max-width:1180px;margin:0 auto;padding:2.5rem 1.5rem 5rem}
h1{font-size:2rem;line-height:1.15;margin:0 0 .6rem;letter-spacing:-.015em;text-wrap:balance}
h2{font-size:1.35rem;margin:3.4rem 0 .9rem;letter-spacing:-.01em}
h3{font-size:1.05rem;margin:0;line-height:1.35}
p{margin:.4rem 0;max-width:46rem}
.lead{font-size:1.06rem;color:var(--soft)}
.soft{color:var(--soft)}
a{color:var(--c0);text-decoration-thickness:1px;text-underline-offset:2px}
.tiles{display:flex;flex-wrap:wrap;gap:.8rem;margin:1.6rem 0 1rem}
.tile{background:var(--card);border:1px solid var(--line);border-radius:10px;padding:.7rem 1.1rem;
min-width:9rem;flex:0 1 auto}
.tile b{display:block;font-size:1.65rem;line-height:1.2;font-variant-numeric:tabular-nums}
.tile span{color:var(--soft);font-size:.86rem}
nav ul{list-style:none;padding:0;margin:1.2rem 0;display:grid;
grid-template-columns:repeat(auto-fill,minmax(19rem,1fr));gap:.15rem 1.6rem}
nav li{display:flex;justify-content:space-between;gap:1rem;border-bottom:1px solid var(--line);
padding:.3rem 0}
nav .count{color:var(--soft);font-variant-numeric:tabular-nums;white-space:nowrap}
.card{background:var(--card);border:1px solid var(--line);border-radius:12px;
padding:1.2rem 1.3rem 1rem;margin:1.1rem 0}
.card header{display:flex;gap:.2rem 1rem;justify-content:space-between;align-items:baseline;
flex-wrap:wrap}
.card .of{color:var(--soft);font-size:.88rem}
.panels{display:grid;grid-template-columns:repeat(auto-fit,minmax(min(24rem,100%),1fr));
gap:.6rem 1.4rem;margin:1rem 0 .6rem;justify-items:center}
.panels svg{width:100%;max-width:34rem;height:auto;display:block;color:var(--ink)}
.panels svg text{font-family:inherit}
.three .panels{grid-template-columns:repeat(auto-fit,minmax(min(17rem,100%),1fr))}
.caption{font-size:.92rem;color:var(--soft);max-width:60rem;margin-bottom:.8rem}
table{border-collapse:collapse;width:100%;font-size:.9rem;font-variant-numeric:tabular-nums}
th{font-weight:600;text-align:left;color:var(--soft);font-size:.8rem;
border-bottom:1px solid var(--line);padding:.35rem .6rem;white-space:nowrap}
td{padding:.5rem .6rem;border-bottom:1px solid var(--line);vertical-align:top}
tr:last-child td{border-bottom:0}
td.n,th.n{text-align:right;white-space:nowrap}
td.what{min-width:13rem}
td .why{display:block;color:var(--soft);font-size:.82rem;line-height:1.4;max-width:34rem}
td .src{color:var(--soft);font-size:.82rem}
.unit{color:var(--soft)}
.badge{white-space:nowrap;font-weight:600;font-size:.84rem}
.pass{color:var(--good)}.fail{color:var(--bad)}.cmp{color:var(--mid)}
.printed{color:var(--bad)}
sup,sub{line-height:0;font-size:.74em}
code{font-size:.86em;color:var(--soft);overflow-wrap:anywhere}
footer{margin-top:3.5rem;color:var(--soft);font-size:.86rem}
@media (max-width:760px){
main{padding:1.6rem 1rem 3rem}h1{font-size:1.55rem}
.card{padding:1rem .9rem .8rem}
table,tbody,tr,td{display:block}thead{display:none}
tr{border-bottom:1px solid var(--line);padding:.7rem 0;display:grid;
grid-template-columns:1fr 1fr;column-gap:1rem}tr:last-child{border-bottom:0}
td.what{grid-column:1/-1;padding-bottom:.3rem}
td,td.n{border:0;padding:.1rem 0;text-align:left;white-space:normal}
td[data-l]::before{content:attr(data-l);color:var(--soft);display:block;font-size:.76rem;
line-height:1.2;padding-top:.25rem}
td.what{font-size:.95rem}
.tile{flex:1 1 28%;min-width:0;padding:.6rem .7rem}.tile b{font-size:1.15rem}
.tile span{font-size:.78rem;display:block;line-height:1.35}
}
@media print{body{background:#fff}.card{break-inside:avoid}}
"""
"""Of the page."""


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
