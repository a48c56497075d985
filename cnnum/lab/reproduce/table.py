"""Rows as an HTML table, that becomes a list on narrow paper."""

import math
import re
from collections.abc import Sequence
from html import escape

from cnnum.lab.reproduce.record import Row


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
    return f"{passed} of {len(checks)}" if checks else "not run"


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
