"""The picture of `cnnum probe`: a map a channel of rest, noise and drift."""

import io
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from cnnum.arrays import Floats
from cnnum.errors import ReportError
from cnnum.report.plots import own_defaults
from cnnum.safety.files import write_whole


def draw(
    path: Path,
    maps: Mapping[str, Floats],
    channels: tuple[str, ...],
    unit: str,
    marked: Iterable[tuple[int, int]] = (),
    *,
    force: bool = False,
) -> None:
    """Draw maps of every cell, one row a kind and one column a channel.

    Parameters
    ----------
    path : Path
        Its suffix says the kind of picture.
    maps : mapping of str to (rows, cols, channels) float
    channels : tuple of str
    unit : str
    marked : iterable of (row, col)
        Cells that get a cross.
    force : bool
        Whether an existing file is replaced.

    Raises
    ------
    ReportError
        If there is such a file, or the picture cannot be written.
    """
    kind = path.suffix.lower().removeprefix(".") or "png"
    try:
        with own_defaults():
            picture = drawn(_figure(maps, channels, unit, marked), kind)
    except ValueError as error:
        raise ReportError(f"The picture '{path}' cannot be written: {error}.") from None
    write_whole(path, picture, force=force)


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


def drawn(figure: Any, kind: str = "png") -> bytes:
    """Return a figure as a picture file; a PNG says that cnnum made it."""
    made = io.BytesIO()
    about = {"metadata": {"Software": "cnnum"}} if kind == "png" else {}
    figure.savefig(made, dpi=110, format=kind, **about)
    return made.getvalue()
