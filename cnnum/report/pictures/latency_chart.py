"""How long a frame takes from host memory to its events: the distribution."""

from collections.abc import Iterator

import numpy as np

from cnnum.arrays import Floats
from cnnum.report.pictures.svg import Scale, box, line, picture, si, text
from cnnum.report.pictures.svg import micros as duration

LEFT, RIGHT, TOP, BOTTOM = 48.0, 14.0, 40.0, 36.0
HEIGHT = 220.0
BINS = 48


def latency_chart(seconds: Floats, width: float) -> str:
    """Return the histogram of (frames,) s over a logarithmic axis.

    Of a thousand frames the slowest is left to the last bar: the first one may build kernels.
    """
    micros = 1e6 * seconds[np.isfinite(seconds)]
    low, high = _range(micros)
    counts, edges = np.histogram(np.clip(micros, low, high), bins=np.geomspace(low, high, BINS + 1))
    x = Scale(low, high, LEFT, width - RIGHT, log=True)
    y = Scale(0.0, float(counts.max()) * 1.05, HEIGHT - BOTTOM, TOP)
    parts = [*_axes(x, y, width)]
    for count, left, right in zip(counts.tolist(), edges[:-1], edges[1:], strict=True):
        if count:
            title = f"{count} frames from {left:.0f} to {right:.0f} µs"
            parts.append(
                box(x(left), y(count), x(right) - x(left) - 1, y(0) - y(count), "bin", title)
            )
    parts += _marks(micros, x)
    return picture(width, HEIGHT, parts, "Histogram of the time a frame takes", "chart")


def _range(micros: Floats) -> tuple[float, float]:
    # a tenth beyond, so that equal values have a width
    return 0.9 * float(micros.min()), 1.1 * float(np.percentile(micros, 99.9))


def _axes(x: Scale, y: Scale, width: float) -> Iterator[str]:
    yield text(4.0, 12.0, "frames", "title")
    for tick in y.ticks(4):
        yield line(x.start, y(tick), x.end, y(tick), "axis" if tick == 0 else "grid")
        yield text(x.start - 6.0, y(tick) + 4.0, f"{tick:.0f}", "tick", "end")
    for tick in x.ticks():
        yield text(x(tick), y.start + 15.0, si(1e-6 * tick, "s", 1), "tick", "middle")
    yield text(x.end, HEIGHT - 4.0, "time of a frame", "tick", "end")


def _marks(micros: Floats, x: Scale) -> Iterator[str]:
    for share, height in ((50, 24.0), (99, 36.0)):
        value = float(np.percentile(micros, share))
        place = x(value)
        side = "end" if place > (x.start + x.end) / 2 else "start"
        yield line(place, height - 8.0, place, HEIGHT - BOTTOM, "median")
        away = -4.0 if side == "end" else 4.0
        yield text(place + away, height, f"p{share} {duration(value)}", "title", side)
