"""A benchmark's page: one HTML file with its picture, its table and its data inside."""

from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any

from cnnum.lab.bench.charts import CHARTS, png
from cnnum.lab.bench.records import data_text
from cnnum.report.environment import Environment
from cnnum.report.html import Cell, both, document, paragraph, section, table
from cnnum.report.plots import inline_svg, own_defaults, page_style
from cnnum.safety.files import write_files

Row = Mapping[str, object]
NARROW = 4.4
"""Width of a picture on a phone, inches."""

HEADINGS = {
    "p50_us": "median, µs",
    "p99_us": "99 % below, µs",
    "ratio": "times",
    "own_launch_us": "launch in this thread, µs",
    "own_ratio": "times that",
    "flops": "flop/s",
    "peak_flops": "peak, flop/s",
    "ns_per_update": "ns an update",
    "seconds": "time, s",
    "peer_seconds": "peer's time, s",
    "near_seconds": "time to a loss of 1e-4, s",
    "near_error": "loss then",
    "ordinary_seconds": "ordinary time, s",
    "spread": "spread, s",
    "tail": "p99 over median",
    "instructions": "instructions a frame",
    "ram_bytes": "RAM, bytes",
    "false_reports": "false reports in ten minutes",
    "reports_differ": "report frames that differ",
    "clock_hz": "clock, Hz",
    "gnu_instructions": "instructions by GCC and QEMU",
    "gnu_flash_bytes": "flash by GCC, bytes",
    "beside_one_template": "over one template’s rate",
}
"""Columns whose name in the data is no heading."""

ENDINGS = {"_per_s": " a second", "_us": ", µs", "_s": ", s", "_bytes": ", bytes", "_j": ", J"}


def write_report(
    folder: Path,
    name: str,
    rows: Sequence[Row],
    device: str,
    omissions: Sequence[str],
    command: str | None = None,
    *,
    force: bool = False,
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
        Command that measured them; by default the benchmark's without options.
    force : bool
        Whether files that are there, and are of no benchmark, are replaced.

    Returns
    -------
    tuple of Path
        PNG, JSON and HTML.

    Raises
    ------
    ReportError
        If another file is there, or one cannot be written.
    """
    places = report_files(folder, name)
    wanted = command or f"cnnum bench {name}"
    data = data_text(wanted, rows, device, omissions)
    page = _page(name, wanted, rows, data, device, omissions)
    with own_defaults():
        contents: tuple[bytes | str, ...] = (png(CHARTS[name](rows)), data, page)
    named = {place.name: content for place, content in zip(places, contents, strict=True)}
    write_files(folder, named, force=force)
    return places


def report_files(folder: Path, name: str) -> tuple[Path, Path, Path]:
    """Return the places of a benchmark's PNG, JSON and HTML."""
    picture, data, page = (folder / f"{name}.{kind}" for kind in ("png", "json", "html"))
    return picture, data, page


def _page(
    name: str, command: str, rows: Sequence[Row], data: str, device: str, omissions: Sequence[str]
) -> str:
    here = Environment.here(device)
    versions = ", ".join(f"{package} {number}" for package, number in here.versions)
    left_out = "".join(f"<li>{escape(text)}</li>" for text in omissions) or "<li>Nothing.</li>"
    body = (
        section(1, "picture", "Picture", _pictures(name, rows))
        + section(2, "figures", "Figures", _table(rows))
        + section(3, "omissions", "Omissions", f"<ul>{left_out}</ul>")
    )
    foot = f"Measured on {here.date}; {here.machine}; {here.device}; {versions}."
    foot += " The figures are in this file once more as JSON."
    lead = f"<p><code>{escape(command)}</code></p>"
    return document(f"cnnum bench {name}", lead, body, paragraph(foot, "note"), data)


def _pictures(name: str, rows: Sequence[Row]) -> str:
    """Return the picture; one with a single panel also as wide as a phone."""
    with page_style():
        figure: Any = CHARTS[name](rows)
        if len(figure.axes) > 1:
            return f'<div class="plot broad">{inline_svg(figure, name)}</div>'
        wide = inline_svg(figure, name)
        figure.set_size_inches(NARROW, figure.get_figheight())
        narrow = inline_svg(figure, name)
    return f'<div class="plot">{both(wide, narrow)}</div>'


def _table(rows: Sequence[Row]) -> str:
    # the device stands below, unless rows differ in it
    same = len({row.get("device") for row in rows}) == 1
    first, *others = [key for key in (rows[0] if rows else ("",)) if key != "device" or not same]
    lines = (
        (False, [Cell(cell(row[key]), strong=key == first) for key in (first, *others)])
        for row in rows
    )
    return table([heading(key) for key in (first, *others)], lines, style="fold")


def heading(key: str) -> str:
    """Return a column's heading, with its unit."""
    if key in HEADINGS:
        return HEADINGS[key]
    for ending, unit in ENDINGS.items():
        if key.endswith(ending):
            return key.removesuffix(ending).replace("_", " ") + unit
    return key.replace("_", " ")


def cell(value: object) -> str:
    """Return a value as a table shows it."""
    if value is None:
        return "–"
    if isinstance(value, float):
        return f"{value:,.0f}" if 1e3 <= abs(value) < 1e6 else f"{value:.3g}"
    if isinstance(value, int) and not isinstance(value, bool):
        return f"{value:,}"
    if isinstance(value, list | tuple):
        return "×".join(str(item) for item in value)  # pyright: ignore[reportUnknownVariableType, reportUnknownArgumentType]
    return str(value)
