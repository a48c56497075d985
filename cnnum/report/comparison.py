"""A picture of two templates side by side: their numbers, and where their answers differ."""

from pathlib import Path
from typing import Any, cast

import numpy as np

from cnnum.arrays import Floats
from cnnum.design.finding import Comparison
from cnnum.report.plots import own_defaults, write_picture

MOST, ACROSS = 48, 12
"""Neighbourhoods that are drawn, and those in a row."""

LINES = ("A", "B", "z", "boundary", "initial", "duration")


def write_comparison(path: Path, comparison: Comparison, *, force: bool = False) -> None:
    """Write a comparison of two templates as a picture, of the kind that the suffix names.

    Raises
    ------
    UnknownNameError, ReportError
        As `write_picture`.
    """
    with own_defaults():
        write_picture(_figure(comparison), path, force=force)


def _figure(comparison: Comparison) -> Any:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    shown = comparison.inputs[:MOST] if comparison.exhaustive else comparison.inputs[:1]
    across = min(ACROSS, max(1, len(shown)))
    down = -(-len(shown) // across) if comparison.exhaustive else len(shown)
    text = _text(comparison)
    high = 0.16 * (text.count("\n") + 1)
    wide = 9.0
    panels = 4 if comparison.states is None else 5
    side = wide / ACROSS if comparison.exhaustive else wide / panels
    figure: Any = Figure(figsize=(wide, high + 0.4 + side * 1.35 * down))
    FigureCanvasAgg(figure)
    top = high / figure.get_figheight()
    figure.text(
        0.02, 1.0 - 0.1 / figure.get_figheight(), text, va="top", family="monospace", size=8
    )
    below = 1.0 - top - 0.3 / figure.get_figheight()
    for number, picture in enumerate(shown):
        row, column = divmod(number, across)
        height = below / max(1, down)
        if comparison.exhaustive:
            place = (column / ACROSS, below - (row + 1) * height, 0.9 / ACROSS, 0.8 * height)
            black = comparison.names[0 if comparison.answers[0][number] > 0.0 else 1]
            state = (
                ""
                if comparison.states is None
                else f", state {comparison.states[number][1, 1]:+.0f}"
            )
            _draw(figure.add_axes(place), picture, f"{black}{state}")
            continue
        answers = [comparison.answers[0][number], comparison.answers[1][number]]
        differ = np.sign(answers[0]) - np.sign(answers[1])
        named = {"input": picture}
        if comparison.states is not None:
            named["state"] = comparison.states[number]
        named |= {**dict(zip(comparison.names, answers, strict=True)), "difference": differ / 2.0}
        for at, (title, panel) in enumerate(named.items()):
            place = (at / panels + 0.005, below - (row + 1) * height, 0.95 / panels, 0.85 * height)
            _draw(figure.add_axes(place), panel, title)
    return figure


def _draw(ax: Any, picture: Floats, title: str) -> None:
    ax.imshow(picture, cmap="gray_r", vmin=-1.0, vmax=1.0, interpolation="nearest")
    rows, cols = picture.shape
    if rows <= 5:
        ax.hlines(np.arange(rows + 1) - 0.5, -0.5, cols - 0.5, color="0.6", linewidth=0.5)
        ax.vlines(np.arange(cols + 1) - 0.5, -0.5, rows - 0.5, color="0.6", linewidth=0.5)
    ax.set(xticks=[], yticks=[])
    ax.set_title(title, fontsize=6)


def _text(comparison: Comparison) -> str:
    """Return what differs, in two columns."""
    rows = [("", *comparison.names)]
    rows += [
        (key, _value(this), _value(other)) for key, (this, other) in comparison.differs.items()
    ]
    rows += comparison_rows(comparison)
    lines = list[str]()
    split = [[cell.split("\n") for cell in row] for row in rows]
    widths = [max(len(line) for row in split for line in row[at]) for at in range(3)]
    for row in split:
        for number in range(max(map(len, row))):
            cells = [part[number] if number < len(part) else "" for part in row]
            lines.append("  ".join(c.ljust(w) for c, w in zip(cells, widths, strict=True)).rstrip())
    lines.append(verdict(comparison))
    if comparison.exhaustive and comparison.unlike:
        some = f" The first {MOST} are drawn." if comparison.unlike > MOST else ""
        lines.append(f"Above each neighbourhood stands the template that answers black.{some}")
    return "\n".join(lines)


def comparison_rows(comparison: Comparison) -> list[tuple[str, str, str]]:
    """Return stability class, cost, settling time and margin of both, as words."""
    pair = comparison.figures
    words = {
        "stability": [figures.stability for figures in pair],
        "products a step": [str(figures.products) for figures in pair],
        "look-ups a step": [str(figures.tables) for figures in pair],
        "products once": [str(figures.once) for figures in pair],
        "settles within": [_known(figures.settle) for figures in pair],
        "margin of the bias": [_known(figures.margin) for figures in pair],
    }
    return [(key, this, other) for key, (this, other) in words.items()]


def verdict(comparison: Comparison) -> str:
    """Return in how many cases the answers differ, as a sentence."""
    if not comparison.cases:
        return "Answers of templates of several layers or inputs are not compared."
    kind = "neighbourhoods" if comparison.states is None else "neighbourhoods and states"
    of = (
        f"{comparison.cases} {kind}"
        if comparison.exhaustive
        else f"{comparison.cases:,} cells of pictures"
    )
    return f"Their answers differ in {comparison.unlike:,} of {of}."


def _known(value: float | None) -> str:
    return "not known" if value is None else f"{value:.3g}"


def _value(given: object) -> str:
    """Return a number, a matrix in lines, or a word."""
    if not isinstance(given, np.ndarray):
        return str(given) if len(str(given)) <= 40 else f"{str(given)[:37]}..."
    array = cast("Floats", given)
    rows = array.reshape(-1, array.shape[-1]) if array.ndim > 1 else array.reshape(1, -1)
    return "\n".join(" ".join(f"{number:5g}" for number in row) for row in rows)
