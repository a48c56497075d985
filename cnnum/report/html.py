"""Pieces of HTML as text: tables, legends and pictures in two widths."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from html import escape
from importlib import resources


@dataclass(frozen=True, slots=True)
class Cell:
    """One cell of a table.

    Attributes
    ----------
    text : str
    sub : str
        A second line, smaller.
    style : str
        CSS class: "text" for text and "names" for a list that may wrap, "yes" or "no" for verdicts.
    strong : bool
    """

    text: str
    sub: str = ""
    style: str = ""
    strong: bool = False

    def html(self, label: str) -> str:
        """Return the cell; the label names its column where a table is folded."""
        words = f"<b>{escape(self.text)}</b>" if self.strong else escape(self.text)
        words = f"<span>{words}" + (
            f'<span class="sub">{escape(self.sub)}</span>' if self.sub else ""
        )
        kind = f' class="{self.style}"' if self.style else ""
        return f'<td{kind} data-label="{escape(label)}">{words}</span></td>'


def table(
    head: Sequence[str], rows: Iterable[tuple[bool, Sequence[Cell]]], *, style: str = ""
) -> str:
    """Return a table in its own box, which scrolls if the table is too wide.

    Parameters
    ----------
    head : sequence of str
    rows : iterable of (failed, cells)
    style : str
        CSS classes of the box: "tall" limits its height, "fold" turns rows into cards on a phone.
    """
    body = "".join(_row(head, failed, cells) for failed, cells in rows)
    top = "".join(f"<th>{escape(label)}</th>" for label in head)
    box = f"scroll {style}".strip()
    return (
        f'<div class="{box}" tabindex="0"><table><thead><tr>{top}</tr></thead>'
        f"<tbody>{body}</tbody></table></div>"
    )


def _row(head: Sequence[str], failed: bool, cells: Sequence[Cell]) -> str:
    inside = "".join(cell.html(label) for cell, label in zip(cells, head, strict=True))
    kind = ' class="failed"' if failed else ""
    return f"<tr{kind}>{inside}</tr>"


def legend(items: Iterable[str]) -> str:
    """Return a legend; the items are HTML."""
    return f'<ul class="legend">{"".join(f"<li>{item}</li>" for item in items)}</ul>'


def swatch(style: str, words: str) -> str:
    """Return an item of a legend."""
    return f'<i class="swatch {style}"></i>{escape(words)}'


def glyph(style: str, shape: str) -> str:
    """Return a small picture for a legend, 12 by 12."""
    drawn = f'<path class="{style}" d="{shape}"/>'
    return f'<svg class="glyph" viewBox="0 0 12 12" aria-hidden="true">{drawn}</svg>'


def both(wide: str, narrow: str) -> str:
    """Return a picture in a version for desktops and one for phones; one is shown."""
    return f'<div class="wide">{wide}</div><div class="narrow">{narrow}</div>'


def section(number: int, name: str, title: str, *parts: str) -> str:
    """Return a numbered section."""
    head = f"<h2><i>{number}</i>{escape(title)}</h2>"
    return f'<section id="{name}">{head}{"".join(parts)}</section>'


def paragraph(words: str, style: str = "") -> str:
    """Return a paragraph of plain text."""
    kind = f' class="{style}"' if style else ""
    return f"<p{kind}>{escape(words)}</p>"


def document(title: str, lead: str, body: str, foot: str, data: str) -> str:
    """Return a whole page that needs nothing else, in the style of all reports.

    Parameters
    ----------
    title : str
    lead, body, foot : str
        HTML under the title, of the page, and at its end.
    data : str
        JSON that the page carries.
    """
    style = (resources.files("cnnum.report") / "style.css").read_text(encoding="utf-8")
    inside = data.replace("<", "\\u003c")
    return (
        f'<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="generator" content="cnnum">'
        f"<title>{escape(title)}</title>"
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<style>{style}</style></head><body><header><h1>{escape(title)}</h1>{lead}</header>"
        f"<main>{body}</main><footer>{foot}</footer>"
        f'<script type="application/json" id="data">{inside}</script></body></html>\n'
    )
