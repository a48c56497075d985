"""The picture of `cnnum probe`: a map a channel of rest, noise and drift."""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from cnnum.arrays import Floats
from cnnum.errors import ReportError


def draw(
    path: Path,
    maps: Mapping[str, Floats],
    channels: tuple[str, ...],
    unit: str,
    marked: Iterable[tuple[int, int]] = (),
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

    Raises
    ------
    ReportError
        If the picture cannot be written.
    """
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
    try:
        figure.savefig(path, dpi=110)
    except (OSError, ValueError) as error:
        raise ReportError(f"The picture '{path}' cannot be written: {error}.") from None
