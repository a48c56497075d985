"""The gallery: one page of all templates, each before, during and after its run."""

import base64
import json
import struct
import zlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from html import escape
from importlib import resources

import numpy as np

from cnnum.arrays import Floats
from cnnum.report.charts import plain
from cnnum.templating.checks import CheckResult, form_of
from cnnum.templating.checks.running import Engine, run_case, run_way, unsettled
from cnnum.templating.files import Entry
from cnnum.templating.numbers import functions, matrices
from cnnum.templating.template import Template

SHAPE = (16, 16)


FAINT = 0.5
"""Largest magnitude below which pictures are shown stretched."""


@dataclass(frozen=True, slots=True)
class Card:
    """A template on the page.

    Attributes
    ----------
    entry : Entry
    folder : str
        Folder in the library.
    pictures : tuple of (caption, (rows, cols) float)
        Values from −1, white, to 1, black.
    result : CheckResult or None
        Result of its check.
    live : mapping, optional
        What gallery.js needs to run it: "wasm" (base64), "rows", "cols", "scales" and "maps" of its
        inputs, and "scale" of its output.
    """

    entry: Entry
    folder: str
    pictures: tuple[tuple[str, Floats], ...]
    result: CheckResult | None
    live: Mapping[str, object] | None = None


def filmstrip(template: Template, engine: Engine) -> tuple[tuple[str, Floats], ...]:
    """Return input, start, half-way and end of one picture of a template's check."""
    form = form_of(template)
    case = form.cases(template, np.random.default_rng(3), SHAPE)
    whole = run_way(template, engine, case, form.rtol)
    end = float(np.max(whole.time))
    times = [0.1 * end, 0.3 * end] if template.delayed is None and end > 0 else [0.5 * end]
    if template.output.discrete:
        times = [max(1.0, float(int(0.5 * end)))]
    some = [run_case(template, engine, replace(case, duration=t), form.rtol) for t in times]
    given = case.input if case.input is not None else case.state
    outputs = [np.asarray(given), *(np.asarray(run.output) for run in [*some, whole])]
    captions = ["before", *(template.timed(t, 3 if t < 1e3 else 6) for t in (*times, end))]
    at = _liveliest(outputs)
    shown = [_plane(a[at]) for a in outputs]
    top = max(float(np.abs(a).max()) for a in shown)
    if 0.0 < top < FAINT:
        shown, captions[0] = [a / top for a in shown], f"before, all ×{plain(1.0 / top, 2)}"
    return tuple(zip(captions, shown, strict=True))


def _liveliest(outputs: Sequence[Floats]) -> int:
    """Return the picture that varies most before and after; empty ones show little."""
    spread = [[_plane(plane).std() for plane in a] for a in (outputs[0], outputs[-1])]
    return int(np.argmax(np.sum(spread, axis=0)))


def _plane(maps: Floats) -> Floats:
    return np.asarray(maps if maps.ndim == 2 else maps[-1], dtype=np.float64)


def png(picture: Floats) -> bytes:
    """Return a gray picture as PNG; −1 is white and 1 black."""
    gray = np.clip(np.rint(127.5 * (1.0 - picture)), 0, 255).astype(np.uint8)
    rows, cols = gray.shape
    raw = b"".join(b"\0" + row.tobytes() for row in gray)
    header = struct.pack(">2I5B", cols, rows, 8, 0, 0, 0, 0)
    chunks = ((b"IHDR", header), (b"IDAT", zlib.compress(raw, 9)), (b"IEND", b""))
    return b"\x89PNG\r\n\x1a\n" + b"".join(_chunk(*chunk) for chunk in chunks)


def _chunk(kind: bytes, data: bytes) -> bytes:
    length, check = struct.pack(">I", len(data)), struct.pack(">I", zlib.crc32(kind + data))
    return length + kind + data + check


def gallery_page(cards: Iterable[Card]) -> str:
    """Return the page as HTML that needs no other file."""
    articles = [_article(card) for card in cards]
    return f"""<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><meta name="generator" content="cnnum">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>The template library</title>
<style>{_file("gallery.css")}</style></head><body>
<header><h1>The template library</h1>
<p>Black is +1 and white −1. Each template is shown on a picture of its own check.
<span id="count">{len(articles)} templates</span>.</p>
<input id="search" type="search" placeholder="Name, folder, tag or word, such as: shape propagating"
 aria-label="Search the templates"></header>
<main>{"".join(articles)}</main>
<script>{_file("gallery.js")}</script></body></html>
"""


def _file(name: str) -> str:
    return resources.files("cnnum.report").joinpath(name).read_text(encoding="utf-8")


def _article(card: Card) -> str:
    template, about = card.entry.template, card.entry.about
    text = " ".join(template.description.split())
    terms = (template.name, *card.entry.aliases, card.folder, *about.tags, text)
    terms += ("experimental",) if about.experimental else ()
    warning = (
        f'<p class="experimental">Experimental: {escape(" ".join(about.experimental.split()))}</p>'
        if about.experimental
        else ""
    )
    strip = "".join(_figure(name, picture) for name, picture in card.pictures)
    return f"""<article id="{escape(template.name)}" data-words="{escape(" ".join(terms).lower())}">
<h2>{escape(template.name)} <small>{escape(card.folder)}</small></h2>
<div class="strip">{strip}</div><p>{escape(text)}</p>{warning}
{"".join(f'<p class="facts">{escape(line)}</p>' for line in _facts(card))}
{_live(card)}<details><summary>Numbers</summary>{_numbers(template)}</details></article>
"""


def _live(card: Card) -> str:
    if card.live is None:
        return ""
    return (
        f'<details class="live" data-live="{escape(json.dumps(card.live))}"><summary>Draw</summary>'
        "<canvas></canvas><canvas></canvas></details>"
    )


def _figure(name: str, picture: Floats) -> str:
    data = base64.b64encode(png(picture)).decode()
    caption = escape(name)
    return (
        f'<figure><img alt="{caption}" src="data:image/png;base64,{data}">'
        f"<figcaption>{caption}</figcaption></figure>"
    )


def _facts(card: Card) -> list[str]:
    template, about = card.entry.template, card.entry.about
    check, measured, result = template.check, card.entry.measured, card.result
    lines = [
        f"Input: {about.input}. State: {about.state}. Boundary: {template.boundary}"
        + (f" (published: {about.published_boundary})." if about.published_boundary else "."),
    ]
    if check is not None and result is not None:
        verdict = "passed" if result.passed else "FAILED"
        lines.append(
            f"Check: {check.name}, error {result.error:.2g} of {result.tolerance:g} allowed, "
            f"{verdict}; {1e3 * result.seconds:.3g} ms on {result.engine}."
        )
    if measured is not None and measured.settle:
        times = ", ".join(f"{n}×{n}: {template.timed(time)}" for n, time in measured.settle)
        lines.append(f"Settles within {times}.")
    if measured is not None and check is not None and (why := unsettled(template, measured)):
        lines.append(f"No settle time: {why}")
    if measured is not None and measured.margin is not None:
        lines.append(f"Margin: {measured.margin:g} of bias.")
    return [*lines, f"Tags: {', '.join(about.tags)}. Source: {' '.join(template.source.split())}."]


def _numbers(template: Template) -> str:
    parts = [(f"{label} =", _rows(kernel)) for label, kernel in matrices(template)]
    parts += [(f"{label}:", text) for label, text in functions(template)]
    parts.append(("z =", ", ".join(f"{z:g}" for z in template.z)))
    return "".join(
        f'<p class="facts">{escape(label)}</p><pre>{escape(text)}</pre>' for label, text in parts
    )


def _rows(block: Floats) -> str:
    return "\n".join("  ".join(f"{weight:>6g}" for weight in row) for row in block.tolist())
