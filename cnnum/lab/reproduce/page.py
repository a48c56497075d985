"""The page: every row of the table, and every figure with the rows that belong to it."""

import json
import math
import platform
import re
from collections.abc import Callable, Iterable, Sequence
from datetime import UTC, datetime
from html import escape
from importlib.metadata import version
from pathlib import Path

from cnnum.errors import RecordingError
from cnnum.lab.reproduce.drawing import STYLE, draw
from cnnum.lab.reproduce.figure import Figure
from cnnum.lab.reproduce.record import Chapter, Row
from cnnum.lab.reproduce.registry import CHAPTERS
from cnnum.safety.files import make_folder, sentences, write_whole
from cnnum.sharing import json_value
from cnnum.version import __version__


def rows_table(rows: Sequence[Row]) -> str:
    """Return a table of rows, with a column for the print if one is an erratum."""
    errata = any(row.printed is not None for row in rows)
    heads = ["", "published", "ours", "error", "tolerance", ""]
    if errata:
        heads = ["", "as printed", "right", "ours", "error", "tolerance", ""]
    head = "".join(f'<th class="n">{name}</th>' if name else "<th></th>" for name in heads)
    body = "".join(_row(row, errata) for row in rows)
    return f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"


def tally(rows: Sequence[Row]) -> str:
    """Return how many of the checks passed, in a few words."""
    checks = [row for row in rows if row.passed is not None]
    passed = sum(bool(row.passed) for row in checks)
    compared = sum(row.passed is None and not row.missing for row in rows)
    alone = f"{compared} compared" if compared else "not run"
    return f"{passed} of {len(checks)}" if checks else alone


def number(value: float, digits: int = 4) -> str:
    """Return a number for people: 0.0123, 4.5 · 10⁻¹⁶, −2."""
    if not math.isfinite(value):
        return "–"
    text = f"{value:.{digits}g}"
    if "e" in text:
        mantissa, _, power = text.partition("e")
        times = "" if mantissa == "1" else f"{mantissa} · "
        text = f"{times}10<sup>{int(power)}</sup>"
    return text.replace("-", "−")


def written(text: str) -> str:
    """Return a text for a page, with indices set lower: T_x."""
    return re.sub(r"(\w)_(\w+)", r"\1<sub>\2</sub>", escape(text))


def _row(row: Row, errata: bool) -> str:
    item = row.item
    cells = [
        f'<td class="what">{written(item.title)} <span class="src">· {written(item.source)}</span>'
        f'<span class="why">{written(row.missing or item.reason)}</span></td>'
    ]
    if errata:
        shown = "–" if row.printed is None else number(row.printed)
        cells.append(_cell("as printed", f'<span class="printed">{shown}</span>'))
    cells.append(_cell("right" if errata else "published", _expected(row)))
    digits = 2 if item.expected == 0.0 else 4
    cells.append(_cell("ours", f"{number(row.got, digits)}{_unit(row)}"))
    percent = item.rule == "relative" or item.unit == "relative"
    cells.append(_cell("error", number(row.error, 2) + (" rel." if percent else "")))
    loose = number(item.tolerance, 2) if item.kind == "check" else "–"
    cells.append(_cell("tolerance", loose))
    cells.append(f"<td>{_badge(row)}</td>")
    return f'<tr id="{escape(item.name)}">{"".join(cells)}</tr>'


def _cell(label: str, content: str) -> str:
    return f'<td class="n" data-l="{label}">{content}</td>'


def _unit(row: Row) -> str:
    unit = row.item.unit
    return f' <span class="unit">{escape(unit)}</span>' if unit and unit != "relative" else ""


def _expected(row: Row) -> str:
    item = row.item
    if isinstance(item.expected, tuple):
        return f"{number(item.expected[0])} to {number(item.expected[1])}{_unit(row)}"
    sign = {"at least": "≥ ", "at most": "≤ "}.get(item.rule, "")
    return f"{sign}{number(item.expected)}{_unit(row)}"


def _badge(row: Row) -> str:
    if row.missing:
        return '<span class="badge cmp">○ not run</span>'
    if row.passed is None:
        return '<span class="badge cmp">≈ compared</span>'
    if row.passed:
        return '<span class="badge pass">✓ passed</span>'
    return '<span class="badge fail">✗ failed</span>'


NAME = "reproduce.html"
"""File name of the page."""


def figures_of(rows: Iterable[Row]) -> tuple[str, ...]:
    """Return the names of the figures that rows belong to, those that could be made."""
    return tuple(dict.fromkeys(r.item.figure for r in rows if r.item.figure and not r.missing))


def write_page(
    place: Path,
    rows: Sequence[Row],
    figures: Sequence[str],
    advance: Callable[[str], None] = lambda _: None,
    *,
    force: bool = False,
) -> Path:
    """Write the page of some rows.

    Parameters
    ----------
    place : Path
        A file whose name ends in ".html", or a folder.
    rows : sequence of Row
    figures : sequence of str
        Names of the figures to draw.
    advance : callable
        Called with each figure's name once it is drawn.
    force : bool
        Whether a file that is there, and is no page of cnnum, is replaced.

    Returns
    -------
    Path
        Path of the file.

    Raises
    ------
    RecordingError
        If another file is there, or it cannot be written.
    """
    target = target_of(place)
    text = page(rows, figures, advance)
    with sentences(target, RecordingError):
        make_folder(target.parent)
    write_whole(target, text, error=RecordingError, force=force)
    return target


def target_of(place: Path) -> Path:
    """Return the file of a page: the place itself, or one of our name in that folder."""
    return place if place.suffix.lower() == ".html" else place / NAME


def page(
    rows: Sequence[Row],
    figures: Sequence[str] = (),
    advance: Callable[[str], None] = lambda _: None,
) -> str:
    """Return the page as one file that needs nothing else.

    Parameters
    ----------
    rows, figures, advance
        As in `write_page`.
    """
    parts = [_chapter(chapter, rows, figures, advance) for chapter in CHAPTERS]
    records = json_value([row.record() for row in rows])
    data = json.dumps(records, ensure_ascii=False).replace("<", "\\u003c")
    return (
        '<!doctype html>\n<html lang="en">\n<meta charset="utf-8">\n'
        '<meta name="generator" content="cnnum">\n'
        '<meta name="viewport" content="width=device-width,initial-scale=1">\n'
        f"<title>The elastic cover and the taxel, reproduced</title>\n<style>{STYLE}</style>\n"
        f"<main>\n{_head(rows)}\n{''.join(parts)}\n{_foot()}\n</main>\n"
        f'<script type="application/json" id="rows">{data}</script>\n</html>\n'
    )


def _head(rows: Sequence[Row]) -> str:
    checks = [row for row in rows if row.passed is not None]
    failed = sum(row.passed is False for row in checks)
    compared = sum(row.item.kind == "comparison" for row in rows)
    errata = sum(row.printed is not None for row in rows)
    tiles = [
        (f"{len(checks) - failed} of {len(checks)}", "checks passed"),
        (f"{compared}", "comparisons"),
        (f"{errata}", "errata, shown both ways"),
    ]
    tiled = "".join(f'<div class="tile"><b>{a}</b><span>{b}</span></div>' for a, b in tiles)
    return (
        "<h1>The elastic cover and the taxel, reproduced</h1>"
        '<p class="lead">G. Vásárhelyi’s dissertation is “The Design of Tactile Sensors and their '
        "Elastic Cover” (Pázmány Péter Catholic University, Budapest 2007). Here is every number "
        "and figure of it that a model can give, with ours next to it.</p>"
        '<p class="soft">Each check states how far it may be off, and why. Where a figure has no '
        "digits, the row names the comparison: a zero, an extremum, a slope. A check fails if the "
        "function that it is about is broken (<code>cnnum reproduce --mutants</code> breaks each). "
        "What no such fault could fail, and what real covers and sensors do unlike any model here, "
        "is a comparison, which neither passes nor fails.</p>"
        f'<div class="tiles">{tiled}</div>{_contents(rows)}'
    )


def _contents(rows: Sequence[Row]) -> str:
    entries: list[str] = []
    for number, chapter in enumerate(CHAPTERS):
        mine = _mine(chapter, rows)
        if mine:
            entries.append(
                f'<li><a href="#c{number}">{escape(chapter.title)}</a>'
                f'<span class="count">{tally(mine)}</span></li>'
            )
    return f"<nav><ul>{''.join(entries)}</ul></nav>"


def _mine(chapter: Chapter, rows: Sequence[Row]) -> list[Row]:
    names = {item.name for item in chapter.items}
    return [row for row in rows if row.item.name in names]


def _chapter(
    chapter: Chapter, rows: Sequence[Row], figures: Sequence[str], advance: Callable[[str], None]
) -> str:
    mine = _mine(chapter, rows)
    if not mine:
        return ""
    parts = [f'<section id="c{CHAPTERS.index(chapter)}"><h2>{escape(chapter.title)}</h2>']
    drawn = [name for name in chapter.figures if name in figures]
    alone = [row for row in mine if row.item.figure not in drawn]
    if alone:
        parts.append(f'<div class="card">{rows_table(alone)}</div>')
    for name in drawn:
        parts.append(
            _card(chapter.figures[name](), [row for row in mine if row.item.figure == name])
        )
        advance(name)
    return "".join([*parts, "</section>\n"])


def _card(figure: Figure, rows: Sequence[Row]) -> str:
    wide = len(figure.panels) % 3 != 0
    drawings = "".join(draw(panel, wide=wide) for panel in figure.panels)
    style = "card" if wide else "card three"
    return (
        f'<article class="{style}" id="figure-{figure.name}">'
        f"<header><h3>{written(figure.title)}</h3>"
        f'<span class="of">{escape(figure.source)}</span></header>'
        f'<div class="panels">{drawings}</div>'
        f'<p class="caption">{written(figure.caption)}</p>{rows_table(rows)}</article>'
    )


def _foot() -> str:
    others = [f"{name} {version(name)}" for name in ("numpy", "scipy", "matplotlib")]
    packages = ", ".join([f"cnnum {__version__}", *others])
    date = datetime.now(UTC).date().isoformat()
    return (
        f"<footer><p>Written by <code>cnnum reproduce --out</code> on {date}, Python "
        f"{platform.python_version()}, {packages}. The rows are in this file once more as JSON "
        "(script element “rows”).</p></footer>"
    )
