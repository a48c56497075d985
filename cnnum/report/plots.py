"""Matplotlib figures as SVG that takes its colours and fonts from the page."""

import io
import re
from collections.abc import Generator, Iterable, Mapping
from contextlib import contextmanager
from html import escape
from pathlib import Path
from typing import Any

import numpy as np

from cnnum.arrays import Floats
from cnnum.errors import name_error
from cnnum.safety.files import write_whole

INK = "#010203"
"""Placeholder for the page's text colour, unlike any other colour here."""

PALETTE = ("#0a6ebd", "#d1590b", "#2a8c5a", "#8a4fbf", "#b8860b", "#c03a72")
"""Distinct with any common colour vision; the page lightens them on dark paper."""

INKED = ("text.color", "axes.edgecolor", "axes.labelcolor", "axes.titlecolor", "xtick.color",
         "ytick.color")  # fmt: skip
SETTINGS: Any = {
    "svg.fonttype": "none",
    "svg.hashsalt": "cnnum",
    "font.family": "sans-serif",
    "font.size": 9.5,
    "axes.titlesize": 10.5,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.linewidth": 0.7,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.unicode_minus": True,
    "xtick.major.width": 0.7,
    "ytick.major.width": 0.7,
    "legend.frameon": False,
    "legend.fontsize": 8.5,
    "lines.linewidth": 1.6,
    **dict.fromkeys(INKED, INK),
}


@contextmanager
def page_style() -> Generator[None]:
    """Have Matplotlib draw as pages look, until the block ends."""
    from cycler import cycler

    with own_defaults() as settings:
        settings.update(SETTINGS | {"axes.prop_cycle": cycler(color=list(PALETTE))})
        yield


@contextmanager
def own_defaults() -> Generator[Any]:
    """Have Matplotlib draw by its own defaults, which are yielded, until the block ends.

    A `matplotlibrc` in the working folder may be another's, and with `text.usetex` in it every
    figure would run LaTeX.
    """
    import matplotlib

    library: Any = matplotlib
    with library.rc_context():
        library.rcdefaults()
        yield library.rcParams


def inline_svg(figure: Any, title: str) -> str:
    """Return a figure as an SVG element for a page.

    Parameters
    ----------
    figure : matplotlib.figure.Figure
        Drawn in `page_style`.
    title : str
        For screen readers.

    Returns
    -------
    str
        SVG element as wide as its container.
    """
    from matplotlib.backends.backend_svg import FigureCanvasSVG

    figure.patch.set_alpha(0.0)
    for axes in figure.axes:
        axes.patch.set_alpha(0.0)
    target = io.StringIO()
    painter: Any = FigureCanvasSVG(figure)
    painter.print_svg(target, metadata={"Date": None})
    return _for_page(target.getvalue(), title)


def _for_page(svg: str, title: str) -> str:
    body = svg[svg.index("<svg") :]
    body = re.sub(r' xmlns(:\w+)?="[^"]*"', "", body)  # HTML knows them
    body = body.replace("xlink:href", "href")
    body = re.sub(r"<metadata>.*?</metadata>", "", body, flags=re.DOTALL)
    body = re.sub(r' id="[A-Za-z0-9.]+_\d+"', "", body)
    body = re.sub(r'(<svg[^>]*?) height="[^"]*"', r"\1", body, count=1)
    body = re.sub(r'(<svg[^>]*?) width="[^"]*"', r"\1", body, count=1)
    body = body.replace("<svg", f'<svg role="img" aria-label="{escape(title)}"', 1)
    body = re.sub(r"font: ([^;\"]*?)px [^;\"]*", r"font-size: \1px", body)
    for number, colour in enumerate(PALETTE):
        body = body.replace(colour, f"var(--c{number})")
    return re.sub(r"\n\s*", "\n", body.replace(INK, "currentColor"))


def draw(
    path: Path,
    maps: Mapping[str, Floats],
    channels: tuple[str, ...],
    unit: str,
    marked: Iterable[tuple[int, int]] = (),
    *,
    force: bool = False,
) -> None:
    """Draw maps of every cell, one row per kind and one column per channel.

    Parameters
    ----------
    path : Path
        Its suffix says the kind of picture.
    maps : mapping of str to (rows, cols, channels) float
    channels : tuple of str
    unit : str
    marked : iterable of (row, col)
        Cells marked with a cross.
    force : bool
        Whether an existing file is replaced.

    Raises
    ------
    UnknownNameError, ReportError
        As `write_picture`.
    """
    with own_defaults():
        write_picture(_figure(maps, channels, unit, marked), path, force=force)


def _figure(
    maps: Mapping[str, Floats],
    channels: tuple[str, ...],
    unit: str,
    marked: Iterable[tuple[int, int]],
) -> Any:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure: Any = Figure(figsize=(1.0 + 2.4 * len(channels), 2.4 * len(maps)), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(len(maps), len(channels), squeeze=False)
    crosses = np.array(list(marked)).reshape(-1, 2)
    for row, (name, values) in zip(axes, maps.items(), strict=True):
        for ax, channel, number in zip(row, channels, range(len(channels)), strict=True):
            shown = ax.imshow(values[..., number], cmap="viridis")
            ax.plot(crosses[:, 1], crosses[:, 0], "rx")
            ax.set(title=f"{name}, {channel} ({unit})", xticks=[], yticks=[])
            ax.title.set_fontsize(8)
            figure.colorbar(shown, ax=ax).ax.tick_params(labelsize=7)
    if len(crosses):
        figure.supxlabel("× cell that is dead, stuck or noisy", color="r", fontsize=8)
    return figure


KINDS = (".png", ".svg", ".pdf")


def refuse_unknown_kind(path: Path) -> None:
    """Check that a file has the suffix of a picture.

    Raises
    ------
    UnknownNameError
        The message lists the known suffixes.
    """
    if path.suffix.lower() not in KINDS:
        raise name_error("kind of picture", path.suffix or path.name, KINDS)


def write_picture(figure: Any, path: Path, *, force: bool = False) -> None:
    """Write a figure as the kind of picture that the suffix names.

    Raises
    ------
    UnknownNameError
        If the suffix is not that of a picture format.
    ReportError
        If there is such a file, or it cannot be written.
    """
    refuse_unknown_kind(path)
    write_whole(path, drawn(figure, path.suffix.lower().removeprefix(".")), force=force)


def drawn(figure: Any, kind: str = "png") -> bytes:
    """Return a figure as a picture file; a PNG says that cnnum made it."""
    made = io.BytesIO()
    options = {"metadata": {"Software": "cnnum"}} if kind == "png" else {}
    figure.savefig(made, dpi=110, format=kind, **options)
    return made.getvalue()
