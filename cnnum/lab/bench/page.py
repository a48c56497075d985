"""A benchmark's page: one HTML file with its picture, its table and its data inside."""

import base64
from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path

from cnnum.lab.bench.charts import CHARTS, save
from cnnum.lab.bench.records import write_data
from cnnum.report.environment import Environment
from cnnum.safety.files import write_whole

Row = Mapping[str, object]

_STYLE = """
body{font:15px/1.5 system-ui,sans-serif;max-width:75rem;margin:2rem auto;padding:0 1rem}
table{border-collapse:collapse;font-size:13px}td,th{padding:.2rem .7rem;text-align:right}
td:first-child,th:first-child{text-align:left}tr:nth-child(even){background:#8881}
img{max-width:100%;background:#fff}
"""


def write_report(
    folder: Path,
    name: str,
    rows: Sequence[Row],
    device: str,
    omissions: Sequence[str],
    command: str | None = None,
) -> tuple[Path, ...]:
    """Write picture, data and page of one benchmark into a folder.

    Parameters
    ----------
    folder : Path
        Made if it is not there.
    name : str
        The benchmark.
    rows : sequence of mapping
    device : str
    omissions : sequence of str
    command : str, optional
        That measured them; the benchmark's without options unless given.

    Returns
    -------
    tuple of Path
        PNG, JSON and HTML.
    """
    folder.mkdir(parents=True, exist_ok=True)
    picture, data, page = (folder / f"{name}.{kind}" for kind in ("png", "json", "html"))
    save(CHARTS[name](rows), picture)
    asked = command or f"cnnum bench {name}"
    write_data(data, asked, rows, device, omissions)
    text = _html(name, asked, rows, picture, data, device, omissions)
    write_whole(page, text.encode("utf-8"))
    return picture, data, page


def _html(
    name: str,
    command: str,
    rows: Sequence[Row],
    picture: Path,
    data: Path,
    device: str,
    omissions: Sequence[str],
) -> str:
    here = Environment.here(device)
    image = base64.b64encode(picture.read_bytes()).decode()
    versions = ", ".join(f"{package} {number}" for package, number in here.versions)
    left_out = "".join(f"<li>{escape(text)}</li>" for text in omissions) or "<li>Nothing.</li>"
    raw = data.read_text(encoding="utf-8").replace("<", "\\u003c")
    return (
        f"<!doctype html><html lang=en><meta charset=utf-8><title>cnnum bench {name}</title>"
        f"<style>{_STYLE}</style><h1>cnnum bench {name}</h1>"
        f"<p><code>{escape(command)}</code></p>"
        f"<p>{escape(here.date)} · {escape(here.machine)} · {escape(here.device)} · "
        f"{escape(versions)}</p><img alt='{name}' src='data:image/png;base64,{image}'>"
        f"{_table(rows)}<h2>Omissions</h2><ul>{left_out}</ul>"
        f"<script type=application/json id=data>{raw}</script></html>"
    )


def _table(rows: Sequence[Row]) -> str:
    # the device stands above, unless rows differ in it
    same = len({row.get("device") for row in rows}) == 1
    keys = [key for key in (rows[0] if rows else ()) if key != "device" or not same]
    head = "".join(f"<th>{escape(key)}</th>" for key in keys)
    body = "".join(
        "<tr>" + "".join(f"<td>{escape(cell(row[key]))}</td>" for key in keys) + "</tr>"
        for row in rows
    )
    return f"<table><tr>{head}</tr>{body}</table>"


def cell(value: object) -> str:
    """Return a value as a table shows it."""
    if value is None:
        return "–"
    if isinstance(value, float):
        return f"{value:.3g}"
    if isinstance(value, list | tuple):
        return "×".join(str(item) for item in value)  # pyright: ignore[reportUnknownVariableType, reportUnknownArgumentType]
    return str(value)
