"""The page of the suite: a picture of every error over its tolerance, and all rows."""

import json
import math
from collections.abc import Sequence
from html import escape
from pathlib import Path
from typing import Any

from cnnum.lab.reproduce.drawing import STYLE
from cnnum.lab.stability.record import Row
from cnnum.report.environment import Environment
from cnnum.report.plots import PALETTE, inline_svg, page_style
from cnnum.safety.files import write_whole
from cnnum.sharing import json_value

FAMILIES = {
    "stiff": "Stiff: fast and slow parts in one array",
    "marginal": "Marginal: on the edge of growth, rest and order",
    "extreme": "Extreme: numbers and shapes at their limits",
    "precision": "Precision: roundings, orders of sums, long streams",
}
PICTURE = ".panels{overflow-x:auto}.panels svg{max-width:none;min-width:38rem}"
"""As wide as the page; on a phone it scrolls."""

LEAST = 1e-12
"""Share of the tolerance below which an error is drawn at the edge of the picture."""


def write_page(place: Path, rows: Sequence[Row], *, force: bool = False) -> Path:
    """Write the page of some rows, as one file that needs nothing else.

    Raises
    ------
    ReportError
        If a file is there that is no page of cnnum, and `force` does not say to replace it, or if
        it cannot be written.
    """
    write_whole(place, page(rows), force=force)
    return place


def page(rows: Sequence[Row]) -> str:
    """Return the page."""
    failed = sum(not row.passed for row in rows)
    refused = sum(row.passed and row.outcome == "refused" for row in rows)
    tiles = (
        (str(len({row.case for row in rows})), "cases"),
        (f"{len(rows) - failed} of {len(rows)}", "runs passed"),
        (str(refused), "refused for the right reason"),
        (str(failed), "wrong, or not ended"),
    )
    here = Environment.here("")
    records = json_value([row.record() for row in rows])
    data = json.dumps(records, ensure_ascii=False).replace("<", "\\u003c")
    with page_style():
        parts = [_family(name, title, rows) for name, title in FAMILIES.items()]
    versions = ", ".join(f"{package} {number}" for package, number in here.versions)
    return (
        '<!doctype html>\n<html lang="en">\n<meta charset="utf-8">\n'
        '<meta name="generator" content="cnnum">\n'
        '<meta name="viewport" content="width=device-width,initial-scale=1">\n'
        "<title>Stiff and extreme cases</title>\n"
        f"<style>{STYLE}{PICTURE}</style>\n<main>"
        "<h1>Stiff and extreme cases</h1>"
        '<p class="lead">Each case is solved within its tolerance, or refused with the right '
        "reason. The truth is a closed form, or a solver that shares nothing with the engines.</p>"
        '<div class="tiles">'
        + "".join(f'<div class="tile"><b>{a}</b><span>{b}</span></div>' for a, b in tiles)
        + f"</div>{''.join(parts)}"
        f"<footer>{escape(here.date)} · {escape(here.machine)} · {escape(versions)} · "
        "written by <code>cnnum stability --out</code></footer></main>"
        f'<script type="application/json" id="rows">{data}</script>\n</html>\n'
    )


def _family(name: str, title: str, rows: Sequence[Row]) -> str:
    mine = [row for row in rows if row.family == name]
    if not mine:
        return ""
    body = "".join(_line(row) for row in mine)
    heads = ("case", "engine", "outcome", "error", "tolerance", "time", "")
    head = "".join(f"<th>{label}</th>" for label in heads)
    return (
        f'<section><h2>{title}</h2><div class="card"><div class="panels">{_picture(mine)}</div>'
        '<p class="caption">Error over tolerance, one row per case; right of 1 is wrong. A cross '
        "is a case that was refused.</p>"
        f"<details><summary>All {len(mine)} runs</summary><table><thead><tr>{head}</tr></thead>"
        f"<tbody>{body}</tbody></table></details></div></section>"
    )


def _line(row: Row) -> str:
    error = _number(row.error) if row.outcome == "solved" else "–"
    badge = '<span class="badge pass">passed</span>'
    if not row.passed:
        badge = '<span class="badge fail">FAILED</span>'
    return (
        f'<tr><td class="what">{escape(row.case)}<span class="why">{escape(row.title)}. '
        f'{escape(row.why)}</span></td><td data-l="engine">{row.engine} {row.precision}</td>'
        f'<td data-l="outcome">{row.outcome}</td><td class="n" data-l="error">{error}</td>'
        f'<td class="n" data-l="tolerance">{_number(row.tolerance)}</td>'
        f'<td class="n" data-l="time">{row.seconds:.2f} s</td><td>{badge}</td></tr>'
    )


def _number(value: float) -> str:
    return f"{value:.2g}" if math.isfinite(value) else "∞"


def _picture(rows: Sequence[Row]) -> str:
    """Return a chart as SVG whose text takes the colour of the page."""
    from matplotlib.figure import Figure

    names = list(dict.fromkeys(row.case for row in rows))
    engines = list(dict.fromkeys((row.engine, row.precision) for row in rows))
    figure: Any = Figure(figsize=(8.0, 1.1 + 0.19 * len(names)), layout="constrained")
    axes: Any = figure.add_subplot()
    for number, (engine, precision) in enumerate(engines):
        mine = [row for row in rows if (row.engine, row.precision) == (engine, precision)]
        lift = 0.6 * ((number + 0.5) / len(engines) - 0.5)
        for outcome, marker in (("solved", "o"), ("refused", "x")):
            some = [row for row in mine if row.outcome == outcome]
            places = [min(max(row.share, LEAST), 1e3) if marker == "o" else 1.0 for row in some]
            label = f"{engine} {precision}" if marker == "o" else None
            heights = [names.index(row.case) + lift for row in some]
            axes.scatter(places, heights, s=14, marker=marker, c=PALETTE[number], label=label)
    axes.set_xscale("log")
    axes.axvline(1.0, color="#888", linewidth=1.0)
    axes.set_yticks(range(len(names)), names, fontsize=7)
    axes.set_ylim(len(names) - 0.4, -0.6)
    axes.set_xlabel("error over tolerance")
    axes.grid(axis="y", alpha=0.25, linewidth=0.6)
    figure.legend(loc="outside upper center", ncols=3, fontsize=8, frameon=False)
    return inline_svg(figure, "error over tolerance")
