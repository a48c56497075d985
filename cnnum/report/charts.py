"""Charts as SVG: scales and ticks, and error against run time."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from html import escape
from math import ceil, floor, isfinite, log10

import numpy as np

from cnnum.arrays import Floats
from cnnum.report.work_precision import WorkPrecision
from cnnum.templating.checks import CheckResult


@dataclass(frozen=True, slots=True)
class Scale:
    """Maps a quantity to a position on the page, linearly or logarithmically.

    Attributes
    ----------
    low, high : float
        Range of the quantity.
    start, end : float
        Range of the position.
    log : bool
    """

    low: float
    high: float
    start: float
    end: float
    log: bool = False

    def __call__(self, value: float) -> float:
        """Return the position of a value."""
        low, high = (log10(self.low), log10(self.high)) if self.log else (self.low, self.high)
        at = log10(value) if self.log else value
        return self.start + (at - low) / (high - low) * (self.end - self.start)

    def ticks(self, count: int = 5) -> tuple[float, ...]:
        """Return round values within the scale."""
        return decades(self.low, self.high) if self.log else steps(self.low, self.high, count)


def steps(low: float, high: float, count: int) -> tuple[float, ...]:
    """Return about `count` values at a step of 1, 2 or 5 times a power of ten."""
    rough = (high - low) / max(count, 1)
    power = 10.0 ** floor(log10(rough))
    step = next(m * power for m in (1, 2, 5, 10) if m * power >= rough * 0.999)
    first = ceil(low / step - 1e-9)
    return tuple(round(n * step, 12) for n in range(first, floor(high / step + 1e-9) + 1))


def decades(low: float, high: float) -> tuple[float, ...]:
    """Return the powers of ten within a range, or 1, 2 and 5 of each where those are few."""
    first, last = floor(log10(low)), ceil(log10(high))
    apart = 2 if last - first > 9 else 1
    result = [10.0**n for n in range(first, last + 1, apart) if low <= 10.0**n <= high]
    if len(result) < 3:
        fine = (m * 10.0**n for n in range(first, last + 1) for m in (1, 2, 5))
        result = [value for value in fine if low <= value <= high]
    return tuple(result)


def round_up(value: float) -> float:
    """Return the next of 1, 1.5, 2, 3, 4, 5, 6, 8 times a power of ten; 1 for nothing."""
    if not (value > 0 and isfinite(value)):
        return 1.0
    power = 10.0 ** floor(log10(value))
    steps = (1, 1.5, 2, 3, 4, 5, 6, 8, 10)
    return next(round(m * power, 12) for m in steps if m * power >= value * 0.9999)


_SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def power_of_ten(value: float) -> str:
    """Return "10⁻³", or "5·10⁻³" where it is no power of ten."""
    exponent = floor(log10(value) + 1e-9)
    factor = round(value / 10.0**exponent)
    return ("10" if factor == 1 else f"{factor}·10") + str(exponent).translate(_SUPERSCRIPT)


def si(value: float, unit: str, digits: int = 3) -> str:
    """Return a quantity with a prefix: "253 µs"; "–" if it is none."""
    if not isfinite(value):
        return "–"
    if value == 0:
        return f"0 {unit}"
    index = min(max(floor(log10(abs(value) * (1 + 1e-12)) / 3), -4), 3)
    prefix = ("p", "n", "µ", "m", "", "k", "M", "G")[index + 4]
    return f"{plain(value / 1000.0**index, digits)} {prefix}{unit}"


def micros(value: float) -> str:
    """Return a time in µs with the unit that fits it."""
    return si(1e-6 * value, "s")


def plain(value: float, digits: int = 3) -> str:
    """Return a number with a count of digits, a true minus and no exponent."""
    if value == 0 or not isfinite(value):
        return "0" if value == 0 else "–"
    places = max(0, digits - 1 - floor(log10(abs(value))))
    return f"{value:.{places}f}".replace("-", "−")


def scientific(value: float) -> str:
    """Return "1.2 × 10⁻⁵", "0", or "∞"."""
    if value == 0:
        return "0"
    if not isfinite(value):
        return "∞"
    mantissa, exponent = f"{value:.1e}".split("e")
    return f"{mantissa} × 10{str(int(exponent)).translate(_SUPERSCRIPT)}"


def at(value: float) -> str:
    """Return a coordinate, as short as it may be."""
    return f"{value:.1f}".removesuffix(".0")


def text(x: float, y: float, words: str, style: str = "", anchor: str = "") -> str:
    """Return a text element; the style is a CSS class."""
    kind = f' class="{style}"' if style else ""
    where = f' text-anchor="{anchor}"' if anchor else ""
    return f'<text x="{at(x)}" y="{at(y)}"{kind}{where}>{escape(words)}</text>'


def line(x1: float, y1: float, x2: float, y2: float, style: str) -> str:
    """Return a straight line."""
    return f'<path class="{style}" d="M{at(x1)} {at(y1)}L{at(x2)} {at(y2)}"/>'


def box(x: float, y: float, width: float, height: float, style: str, title: str = "") -> str:
    """Return a rectangle; the title shows under the pointer."""
    inside = f"><title>{escape(title)}</title></rect>" if title else "/>"
    size = f'width="{at(max(width, 0))}" height="{at(max(height, 0))}"'
    return f'<rect class="{style}" x="{at(x)}" y="{at(y)}" {size}{inside}'


def polyline(points: Iterable[tuple[float, float]], style: str) -> str:
    """Return a line through points; those that cannot be seen are left out."""
    return f'<path class="{style}" d="{path(points)}"/>'


def path(points: Iterable[tuple[float, float]]) -> str:
    """Return the data of a path through points."""
    kept = [(at(x), at(y)) for x, y in points]
    shown = [
        point
        for n, point in enumerate(kept)
        if n in (0, len(kept) - 1) or not kept[n - 1][1] == point[1] == kept[n + 1][1]
    ]
    return "M" + "L".join(f"{x} {y}" for x, y in shown) if shown else ""


def picture(width: float, height: float, parts: Sequence[str], label: str, style: str = "") -> str:
    """Return an SVG element that scales with its box; the label is for screen readers."""
    return (
        f'<svg class="{style}" viewBox="0 0 {at(width)} {at(height)}" role="img" '
        f'aria-label="{escape(label)}">{"".join(parts)}</svg>'
    )


LEFT, RIGHT, BOTTOM = 48.0, 14.0, 36.0
BELOW_MARKS = 40.0
"""Top of the distribution: the marks of its quantiles stand above."""
HEIGHT = 220.0
BINS = 48


def latency_chart(seconds: Floats, width: float) -> str:
    """Return the histogram of (frames,) s over a logarithmic axis.

    The slowest of a thousand frames goes into the last bar, since the first may build kernels.
    """
    micros = 1e6 * seconds[np.isfinite(seconds)]
    low, high = _range(micros)
    counts, edges = np.histogram(np.clip(micros, low, high), bins=np.geomspace(low, high, BINS + 1))
    x = Scale(low, high, LEFT, width - RIGHT, log=True)
    y = Scale(0.0, float(counts.max()) * 1.05, HEIGHT - BOTTOM, BELOW_MARKS)
    parts = [*_latency_axes(x, y, width)]
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


def _latency_axes(x: Scale, y: Scale, width: float) -> Iterator[str]:
    yield text(4.0, 12.0, "frames", "title")
    for tick in y.ticks(4):
        yield line(x.start, y(tick), x.end, y(tick), "axis" if tick == 0 else "grid")
        yield text(x.start - 6.0, y(tick) + 4.0, f"{tick:.0f}", "tick", "end")
    for tick in x.ticks():
        yield text(x(tick), y.start + 15.0, si(1e-6 * tick, "s", 1), "tick", "middle")
    yield text(x.end, HEIGHT - 4.0, "time of a frame", "tick", "end")


def _marks(taken: Floats, x: Scale) -> Iterator[str]:
    for share, height in ((50, 24.0), (99, 36.0)):
        value = float(np.percentile(taken, share))
        place = x(value)
        side = "end" if place > (x.start + x.end) / 2 else "start"
        yield line(place, height - 8.0, place, HEIGHT - BOTTOM, "median")
        away = -4.0 if side == "end" else 4.0
        yield text(place + away, height, f"p{share} {micros(value)}", "title", side)


TOP = 22.0
NONE = 13.0
"""Height, for each series, of the band below the axis for errors of exactly 0, which no logarithm
shows."""


def check_chart(checks: Sequence[CheckResult], width: float) -> str:
    """Return each check as a point: its error over the time of one run."""
    height = 330.0
    errors = [c.error for c in checks if 0 < c.error < float("inf")]
    series = list(dict.fromkeys(series_of(c) for c in checks))
    zeros = NONE * len(series) + 18.0 if any(c.error == 0 for c in checks) else 0.0
    bottom = height - BOTTOM - zeros
    x = _scale([c.seconds for c in checks], LEFT, width - RIGHT)
    y = _scale(errors, bottom, TOP, room=3.0)
    parts = [*_axes(x, y, bottom, height - BOTTOM, "largest error", zeros)]
    for check in checks:
        place = _height(
            check.error, y, height - BOTTOM - NONE * (series.index(series_of(check)) + 0.5)
        )
        parts.append(_point(x(check.seconds), place, _check_style(check), _check_title(check)))
    parts.append(text(width - RIGHT, height - 4.0, "median time of one run", "tick", "end"))
    return picture(width, height, parts, "Error of every check against its run time", "chart")


def series_of(check: CheckResult) -> str:
    """Return the name under which a check is drawn."""
    return f"{check.engine}, {check.precision}"


def series_style(engine: str, precision: str) -> str:
    """Return the class that gives a series its shape and colour."""
    return f"s-{engine} p-{precision}"


def ladder_chart(points: Sequence[WorkPrecision], case: str, width: float) -> str:
    """Return one template by every method: its error over the time of one picture."""
    height = 270.0
    mine = [p for p in points if p.case == case and p.error < float("inf")]
    bottom = height - BOTTOM
    x = _scale([p.seconds / p.pictures for p in mine], LEFT, width - RIGHT)
    y = _scale([p.error for p in mine if p.error > 0], bottom, TOP, room=3.0)
    parts = [*_axes(x, y, bottom, bottom, f"{case}: error", 0.0)]
    for key, rungs in ladder_series(mine).items():
        places = [
            (x(p.seconds / p.pictures), _height(p.error, y, bottom - 4.0))
            for p in sorted(rungs, key=lambda p: p.error)
        ]
        style = ladder_style(*key)
        way = "L".join(f"{at(a)} {at(b)}" for a, b in places)
        parts.append(f'<path class="rungs {style}" d="M{way}"/>')
        for place, point in zip(places, sorted(rungs, key=lambda p: p.error), strict=True):
            parts.append(_point(*place, f"dot {style}", _rung_title(point)))
    parts.append(text(width - RIGHT, height - 4.0, "median time of one picture", "tick", "end"))
    return picture(width, height, parts, f"Error of {case} against run time", "chart")


def ladder_series(
    points: Iterable[WorkPrecision],
) -> dict[tuple[str, str, str], list[WorkPrecision]]:
    """Return the points by method, engine and precision."""
    result: dict[tuple[str, str, str], list[WorkPrecision]] = {}
    for point in points:
        result.setdefault((point.method, point.engine, point.precision), []).append(point)
    return result


def ladder_style(method: str, engine: str, precision: str) -> str:
    """Return the class that gives a line its colour and dashes."""
    return f"m-{method} s-{engine} p-{precision}"


def symbol(style: str) -> str:
    """Return a point for a legend."""
    return picture(12.0, 12.0, [_point(6.0, 6.0, style, "")], "", "glyph")


def _scale(values: Sequence[float], start: float, end: float, room: float = 1.25) -> Scale:
    """Return a logarithmic scale that holds the values with some room, half a decade at least."""
    low, high = (min(values), max(values)) if values else (1e-6, 1.0)
    room = max(room, (10**0.5 * low / high) ** 0.5)
    return Scale(low / room, high * room, start, end, log=True)


def _height(error: float, y: Scale, zero: float) -> float:
    return zero if error == 0 else y(min(max(error, y.low), y.high))


def _axes(
    x: Scale, y: Scale, bottom: float, floor: float, title: str, zeros: float
) -> Iterator[str]:
    yield text(4.0, 12.0, title, "title")
    for tick in y.ticks():
        yield line(x.start, y(tick), x.end, y(tick), "grid")
        yield text(x.start - 6.0, y(tick) + 4.0, power_of_ten(tick), "tick", "end")
    for tick in x.ticks():
        yield line(x(tick), y.end, x(tick), floor, "grid")
        yield text(x(tick), floor + 15.0, si(tick, "s", 1), "tick", "middle")
    yield line(x.start, floor, x.end, floor, "axis")
    if zeros:
        yield line(x.start, bottom + 9.0, x.end, bottom + 9.0, "break")
        yield text(x.start - 6.0, floor - (zeros - 18.0) / 2 + 4.0, "0", "tick", "end")


def _point(x: float, y: float, style: str, title: str) -> str:
    if "wrong" in style:
        shape = f"M{at(x - 4)} {at(y - 4)}l8 8m0-8l-8 8"
    elif "s-reference" in style:
        shape = f"M{at(x - 3.4)} {at(y - 3.4)}h6.8v6.8h-6.8z"
    elif "s-numba" in style:
        shape = f"M{at(x)} {at(y - 4.6)}l4.4 7.6h-8.8z"
    else:
        shape = f"M{at(x - 3.8)} {at(y)}a3.8 3.8 0 1 0 7.6 0a3.8 3.8 0 1 0 -7.6 0z"
    inside = f"><title>{escape(title)}</title></path>" if title else "/>"
    return f'<path class="point {style}" d="{shape}"{inside}'


def _check_style(check: CheckResult) -> str:
    style = series_style(check.engine, check.precision)
    return style if check.passed else f"{style} wrong"


def _check_title(check: CheckResult) -> str:
    return (
        f"{check.template} on {series_of(check)} by {check.method}: "
        f"error {scientific(check.error)}, {si(check.seconds, 's')}"
    )


def _rung_title(p: WorkPrecision) -> str:
    setting = f"tolerance {scientific(p.tolerance)}" if p.tolerance else "exact in time"
    setting = f"step {p.step:g} (unit of τ)" if p.step else setting
    return (
        f"{p.method}, {setting} on {p.engine}, {p.precision}: error {scientific(p.error)}, "
        f"{si(p.seconds / p.pictures, 's')} a picture, {p.steps} steps"
    )
