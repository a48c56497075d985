"""The colour scale of the maps: two hues from a neutral middle, equal steps to the eye.

Blue against orange is distinct with any common colour vision. The middle is the paper's colour,
light or dark, so that a map sits on the page either way. Interpolated in OKLab (Ottosson 2020).
"""

from math import cos, radians, sin

STEPS = 64
"""Even, so that there is a middle."""

Lab = tuple[float, float, float]


def _lab(lightness: float, chroma: float, hue: float) -> Lab:
    return lightness, chroma * cos(radians(hue)), chroma * sin(radians(hue))


LIGHT = (
    _lab(0.46, 0.12, 45),
    _lab(0.72, 0.14, 60),
    _lab(0.965, 0.004, 250),
    _lab(0.64, 0.13, 245),
    _lab(0.36, 0.14, 262),
)
"""From the lowest value to the highest, on light paper."""

DARK = (
    _lab(0.86, 0.12, 75),
    _lab(0.58, 0.13, 50),
    _lab(0.235, 0.012, 255),
    _lab(0.60, 0.14, 250),
    _lab(0.90, 0.09, 220),
)
"""The same on dark paper."""


def scale(anchors: tuple[Lab, ...]) -> tuple[str, ...]:
    """Return STEPS + 1 colours from the first anchor to the last, "#rrggbb"."""
    return tuple(_hex(_between(anchors, n / STEPS)) for n in range(STEPS + 1))


def style_rules() -> str:
    """Return the rules that give the classes k0, k1… their colours, for light and dark paper."""
    light = "".join(f".k{n}{{fill:{c}}}" for n, c in enumerate(scale(LIGHT)))
    dark = "".join(f".k{n}{{fill:{c}}}" for n, c in enumerate(scale(DARK)))
    return f"{light}@media screen and (prefers-color-scheme:dark){{{dark}}}"


def step(value: float, top: float) -> int:
    """Return the class of a value on a scale from −top to +top."""
    share = min(max(value / top, -1.0), 1.0) if top > 0 else 0.0
    return round((share + 1.0) * STEPS / 2)


def _between(anchors: tuple[Lab, ...], share: float) -> Lab:
    place = share * (len(anchors) - 1)
    left = min(int(place), len(anchors) - 2)
    part = place - left
    a, b = anchors[left], anchors[left + 1]
    return a[0] + part * (b[0] - a[0]), a[1] + part * (b[1] - a[1]), a[2] + part * (b[2] - a[2])


def _hex(lab: Lab) -> str:
    lightness, a, b = lab
    long = (lightness + 0.3963377774 * a + 0.2158037573 * b) ** 3
    middle = (lightness - 0.1055613458 * a - 0.0638541728 * b) ** 3
    short = (lightness - 0.0894841775 * a - 1.2914855480 * b) ** 3
    linear = (
        4.0767416621 * long - 3.3077115913 * middle + 0.2309699292 * short,
        -1.2684380046 * long + 2.6097574011 * middle - 0.3413193965 * short,
        -0.0041960863 * long - 0.7034186147 * middle + 1.7076147010 * short,
    )
    return "#" + "".join(f"{round(255 * _gamma(c)):02x}" for c in linear)


def _gamma(linear: float) -> float:
    c = min(max(linear, 0.0), 1.0)
    return 12.92 * c if c <= 0.0031308 else 1.055 * c ** (1 / 2.4) - 0.055
