"""The parts of charts: scales, ticks and a few SVG elements as text."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from html import escape
from math import ceil, floor, isfinite, log10


@dataclass(frozen=True, slots=True)
class Scale:
    """From a quantity to a place on the page, linear or logarithmic.

    Attributes
    ----------
    low, high : float
        Of the quantity.
    start, end : float
        Of the place.
    log : bool
    """

    low: float
    high: float
    start: float
    end: float
    log: bool = False

    def __call__(self, value: float) -> float:
        """Return the place of a value."""
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
    found = [10.0**n for n in range(first, last + 1, apart) if low <= 10.0**n <= high]
    if len(found) < 3:
        fine = (m * 10.0**n for n in range(first, last + 1) for m in (1, 2, 5))
        found = [value for value in fine if low <= value <= high]
    return tuple(found)


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
    """Return an SVG element that scales with its box; the label is for who does not see it."""
    return (
        f'<svg class="{style}" viewBox="0 0 {at(width)} {at(height)}" role="img" '
        f'aria-label="{escape(label)}">{"".join(parts)}</svg>'
    )
