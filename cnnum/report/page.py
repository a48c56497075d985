"""The page: its sections in the order in which a reader needs them."""

from html import escape
from importlib import resources

from cnnum.report import sections
from cnnum.report.encoding import ReportData, to_json
from cnnum.sharing.colours import style_rules


def page(data: ReportData) -> str:
    """Return a whole HTML document that needs nothing from outside itself."""
    title = f"cnnum: the scene “{data.record.name}”"
    parts = (
        "<!DOCTYPE html>\n",
        '<html lang="en"><head><meta charset="utf-8"><meta name="generator" content="cnnum">',
        f"<title>{escape(title)}</title>",
        '<meta name="viewport" content="width=device-width, initial-scale=1">',
        f"<style>{_resource('style.css')}{style_rules()}</style></head><body>",
        sections.head(data),
        f"<main>{_body(data)}</main>",
        sections.foot(data),
        f'<script type="application/json" id="data">{to_json(data)}</script>',
        f"<script>{_resource('player.js')}</script></body></html>\n",
    )
    return "".join(parts)


def _body(data: ReportData) -> str:
    chosen = (
        sections.story,
        sections.frames,
        sections.events,
        sections.errors,
        sections.plans,
        sections.latency,
        sections.further,
    )
    return "".join(part(number, data) for number, part in enumerate(chosen, start=1))


def _resource(name: str) -> str:
    return (resources.files("cnnum.report") / name).read_text(encoding="utf-8")
