"""The page of a sweep: how figures depend on every axis, and phase diagrams of pairs of axes."""

import itertools
import json
from pathlib import Path
from typing import Any

from cnnum.arrays import Floats
from cnnum.design.sweeping import failures
from cnnum.report.environment import Environment
from cnnum.report.html import document, paragraph, section
from cnnum.report.plots import inline_svg, page_style
from cnnum.safety.files import write_whole

FIGURES = (
    ("flipped", "share of templates with a wrong cell"),
    ("wrong", "share of wrong cells"),
    ("error", "largest error"),
    ("time", "longest run (unit of τ)"),
    ("settled", "share of pictures at rest"),
    ("lost", "share of runs that failed"),
)
LOGARITHMIC = ("error", "time")
"""Figures that may span decades."""

MOST_PAIRS = 6


def write_page(place: Path, results: Any, *, force: bool = False) -> Path:
    """Write the page of a dataset, as one file that needs nothing else.

    Parameters
    ----------
    place : Path
    results : xarray.Dataset
        Results of a sweep.
    force : bool
        Whether a file that is there, and is no page of cnnum, is replaced.

    Raises
    ------
    ReportError
        If another file is there, or it cannot be written.
    """
    write_whole(place, page(results), force=force)
    return place


def page(results: Any) -> str:
    """Return the page's text."""
    results = results.assign(lost=(results["failed"] > 0).astype("float64"))
    axes = [name for name in results.sizes if name != "draw" and results.sizes[name] > 1]
    numeric = [name for name in axes if results[name].dtype.kind == "f"]
    pairs = list(itertools.combinations(numeric, 2))[:MOST_PAIRS]
    with page_style():
        shown = [(name, _lines(results, name)) for name in axes]
        shown += [(" and ".join(pair), _phases(results, *pair)) for pair in pairs]
    parts = [section(n, f"s{n}", name, inside) for n, (name, inside) in enumerate(shown, 1)]
    here = Environment.here("")
    sizes = " × ".join(_size(str(name), count) for name, count in results.sizes.items())
    lead = paragraph(f"{sizes}. Each point is the mean over all other axes.", "lead")
    for reason, count in failures(results).items():
        lead += paragraph(f"{count} of {results['failed'].size} runs failed: {reason}", "note")
    foot = paragraph(f"Written by “cnnum sweep --page” on {here.date}; {here.machine}.", "note")
    attributes = json.dumps({key: str(value) for key, value in results.attrs.items()})
    return document(
        f"Sweep of {results.attrs.get('template', '')}", lead, "".join(parts), foot, attributes
    )


def _size(axis: str, count: int) -> str:
    if axis == "draw":
        return "1 draw" if count == 1 else f"{count} draws"
    return f"1 value of {axis}" if count == 1 else f"{count} values of {axis}"


def _lines(results: Any, axis: str) -> str:
    """Return the figures along one axis, a panel each; one that never changes is a sentence."""
    import numpy as np
    from matplotlib.figure import Figure

    values = results[axis].values
    places = values if values.dtype.kind == "f" else np.arange(len(values))
    panels, constant, unknown = list[str](), list[str](), list[str]()
    for name, label in FIGURES:
        along = results[name].where(np.isfinite(results[name]))
        means = along.mean([other for other in along.dims if other != axis]).values
        if bool(results[name].isnull().all()):
            unknown.append(label)
            continue
        if not np.isfinite(means).any():
            constant.append(f"{label}: infinite everywhere")
            continue
        if np.nanmax(means) == np.nanmin(means):
            if name != "lost" or means[0] > 0.0:
                constant.append(f"{label}: {np.nanmin(means):.3g} everywhere")
            continue
        figure: Any = Figure(figsize=(4.4, 2.8), layout="constrained")
        plot = figure.add_subplot()
        plot.plot(places, means, "o-", markersize=3)
        plot.set(xlabel=axis, title=label)
        if name in LOGARITHMIC and (means > 0.0).all() and means.max() > 100.0 * means.min():
            plot.set_yscale("log")
        if values.dtype.kind != "f":
            plot.set_xticks(places, [str(value) for value in values])
        panels.append(f'<div class="plot">{inline_svg(figure, f"{label} along {axis}")}</div>')
    if unknown:
        ends = "the template's check ends before cells saturate"
        why = "every run failed" if bool((results["lost"] == 1.0).all()) else ends
        constant.append(f"{', '.join(unknown)}: not known, for {why}")
    note = paragraph("; ".join(constant).capitalize() + ".", "note") if constant else ""
    return f'<div class="panels">{"".join(panels)}</div>{note}'


def _phases(results: Any, down: str, across: str) -> str:
    """Return the flip rate and the share at rest at the sampled points of two axes."""
    import numpy as np
    from matplotlib.figure import Figure

    panels = list[str]()
    for name in ("flipped", "settled"):
        if bool(results[name].isnull().all()):
            continue
        figure: Any = Figure(figsize=(4.6, 3.6), layout="constrained")
        plot = figure.add_subplot()
        others = [other for other in results[name].dims if other not in (down, across)]
        field = results[name].mean(others).transpose(down, across)
        x: Floats = np.tile(field[across].values, (len(field[down]), 1))
        y: Floats = np.tile(field[down].values, (len(field[across]), 1)).T
        # the sampled points alone: a filled map would claim what lies between and around them
        drawn = plot.scatter(x, y, c=field.values, s=60.0, marker="s", vmin=0.0, vmax=1.0)
        plot.set(xlabel=across, ylabel=down, title=dict(FIGURES)[name])
        figure.colorbar(drawn, ax=plot)
        title = f"{dict(FIGURES)[name]} over {across} and {down}"
        panels.append(f'<div class="plot">{inline_svg(figure, title)}</div>')
    return f'<div class="panels">{"".join(panels)}</div>'
