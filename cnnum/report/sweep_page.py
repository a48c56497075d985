"""The page of a sweep: how figures depend on every axis, and phase diagrams of pairs of axes."""

import io
import itertools
import re
from html import escape
from pathlib import Path
from typing import Any

from cnnum.report.environment import Environment
from cnnum.safety.files import write_whole

FIGURES = (
    ("flipped", "share of templates with a wrong cell"),
    ("wrong", "share of wrong cells"),
    ("error", "largest error"),
    ("time", "longest run, τ"),
    ("settled", "share of pictures at rest"),
)
STYLE = (
    "body{font:16px/1.5 system-ui;max-width:60rem;margin:2rem auto;padding:0 1rem}"
    "svg{max-width:100%;height:auto}"
)
MOST_PAIRS = 6


def write_page(place: Path, results: Any) -> Path:
    """Write the page of a dataset, as one file that needs nothing else.

    Parameters
    ----------
    place : Path
    results : xarray.Dataset
        Of a sweep.
    """
    write_whole(place, page(results).encode("utf-8"))
    return place


def page(results: Any) -> str:
    """Return the page's text."""
    axes = [name for name in results.sizes if name != "draw" and results.sizes[name] > 1]
    parts = [f"<h2>{escape(name)}</h2>{_lines(results, name)}" for name in axes]
    numeric = [name for name in axes if results[name].dtype.kind == "f"]
    for pair in list(itertools.combinations(numeric, 2))[:MOST_PAIRS]:
        parts.append(f"<h2>{escape(' and '.join(pair))}</h2>{_phases(results, *pair)}")
    here = Environment.here("")
    sizes = " × ".join(f"{count} {name}" for name, count in results.sizes.items())
    name = escape(str(results.attrs.get("template", "")))
    return (
        '<!doctype html>\n<html lang="en">\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width,initial-scale=1">\n'
        f"<title>Sweep of {name}</title>\n<style>{STYLE}</style>\n<main>"
        f"<h1>Sweep of {name}</h1><p>{escape(sizes)}. Each point is the mean over all other axes."
        f"</p>{''.join(parts)}"
        f"<footer>{escape(here.date)} · {escape(here.machine)}</footer></main>\n"
    )


def _lines(results: Any, axis: str) -> str:
    """Return the figures along one axis."""
    import numpy as np
    from matplotlib.figure import Figure

    figure: Any = Figure(figsize=(11.0, 2.4), layout="constrained")
    values = results[axis].values
    places = values if values.dtype.kind == "f" else np.arange(len(values))
    for plot, (name, label) in zip(figure.subplots(1, len(FIGURES)), FIGURES, strict=True):
        along = results[name].where(np.isfinite(results[name]))
        others = [other for other in along.dims if other != axis]
        plot.plot(places, along.mean(others).values, "o-", markersize=3)
        plot.set_title(label, fontsize=8)
        plot.tick_params(labelsize=7)
        if values.dtype.kind != "f":
            plot.set_xticks(places, [str(value) for value in values], fontsize=7)
    return _svg(figure)


def _phases(results: Any, down: str, across: str) -> str:
    """Return maps of the flip rate and of the share at rest over two axes."""
    from matplotlib.figure import Figure

    figure: Any = Figure(figsize=(9.0, 3.4), layout="constrained")
    for plot, name in zip(figure.subplots(1, 2), ("flipped", "settled"), strict=True):
        others = [other for other in results[name].dims if other not in (down, across)]
        field = results[name].mean(others).transpose(down, across)
        drawn = plot.pcolormesh(
            field[across].values,
            field[down].values,
            field.values,
            vmin=0.0,
            vmax=1.0,
            shading="nearest",
        )
        plot.set(xlabel=across, ylabel=down, title=dict(FIGURES)[name])
        figure.colorbar(drawn, ax=plot)
    return _svg(figure)


def _svg(figure: Any) -> str:
    buffer = io.StringIO()
    figure.savefig(buffer, format="svg", metadata={"Date": None})
    return re.sub(r"^.*?(?=<svg)", "", buffer.getvalue(), flags=re.DOTALL)
