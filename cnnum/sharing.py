"""Objects as others take them: datasets, tables, HTML of notebooks, and plots.

The colour scale of the maps: two hues from a neutral middle, equal steps to the eye.

Blue against orange is distinct with any common colour vision. The middle is the paper's colour,
light or dark, so that a map sits on the page either way. Interpolated in OKLab (Ottosson 2020).
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from importlib import import_module
from math import cos, radians, sin
from typing import Any, cast

import numpy as np

from cnnum.arrays import Floats
from cnnum.errors import missing_extra

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


def json_value(value: object) -> object:
    """Return a value as JSON has it; a number that is not finite has no form there and is null."""
    if isinstance(value, Mapping):
        return {str(k): json_value(v) for k, v in cast(Mapping[object, object], value).items()}
    if isinstance(value, tuple | list):
        return [json_value(item) for item in cast(Sequence[object], value)]
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else None
    item = getattr(cast(Any, value), "item", None)
    return json_value(item()) if item is not None else value


MOST_CELLS = 64
"""Rows or columns of a map that is shown cell by cell; a larger one is thinned."""

CELL = 12
"""Pixels of a cell's side, at most."""


def facts(title: str, pairs: Iterable[tuple[str, object]], maps: Sequence[str] = ()) -> str:
    """Return a table of names and values under a title, and pictures below it."""
    rows = "".join(
        f"<tr><th style='text-align:left'>{escape(name)}</th>"
        f"<td style='text-align:left'>{escape(str(value))}</td></tr>"
        for name, value in pairs
    )
    return f"<div><b>{escape(title)}</b><table>{rows}</table>{''.join(maps)}</div>"


def table(title: str, header: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Return a table with a header."""
    head = "".join(f"<th>{escape(name)}</th>" for name in header)
    body = "".join(
        "<tr>" + "".join(f"<td>{escape(str(cell))}</td>" for cell in row) + "</tr>" for row in rows
    )
    return f"<div><b>{escape(title)}</b><table><tr>{head}</tr>{body}</table></div>"


def picture(name: str, values: Floats, top: float | None = None, *, styled: bool = False) -> str:
    """Return a map as SVG: blue above 0, orange below, the middle at 0.

    Parameters
    ----------
    name : str
    values : (rows, cols) float
    top : float, optional
        Value of the strongest colour; the largest magnitude unless given.
    styled : bool
        Whether the page has the rules of `style_rules`, which follow light and dark paper.
    """
    thin = -(-max(values.shape) // MOST_CELLS)
    shown = np.nan_to_num(values[::thin, ::thin])
    rows, cols = shown.shape
    side = max(2, min(CELL, 240 // max(rows, cols)))
    reach = float(np.abs(shown).max()) if top is None else top
    looks = [f"class='k{n}'" if styled else f"fill='{c}'" for n, c in enumerate(scale(LIGHT))]
    cells = "".join(
        f"<rect x='{col * side}' y='{row * side}' width='{side}' height='{side}' "
        f"{looks[step(float(shown[row, col]), reach)]}/>"
        for row in range(rows)
        for col in range(cols)
    )
    return (
        f"<figure style='display:inline-block;margin:4px'><svg shape-rendering='crispEdges' "
        f"width='{cols * side}' "
        f"height='{rows * side}' viewBox='0 0 {cols * side} {rows * side}' role='img' "
        f"aria-label='{escape(name)}'>{cells}</svg>"
        f"<figcaption>{escape(name)}</figcaption></figure>"
    )


Variables = Mapping[str, tuple[Sequence[str], Any]]
"""Name of a variable to the names of its axes, and its values."""


def dataset(variables: Variables, coordinates: Variables, facts: Mapping[str, object]) -> Any:
    """Return an `xarray.Dataset`.

    Raises
    ------
    MissingExtraError
        If xarray is not installed.
    """
    made = _library("xarray").Dataset(
        {name: (list(axes), values) for name, (axes, values) in variables.items()},
        coords={name: (list(axes), values) for name, (axes, values) in coordinates.items()},
    )
    made.attrs.update(facts)
    return made


def data_frame(columns: Mapping[str, Any]) -> Any:
    """Return a `pandas.DataFrame` of columns of one length.

    Raises
    ------
    MissingExtraError
        If pandas is not installed.
    """
    return _library("pandas").DataFrame(dict(columns))


def cell_columns(name: str, values: Any) -> dict[str, Any]:
    """Return columns of (frames, …) values: one a cell, as in "name[0, 3]"."""
    if values.ndim == 1:
        return {name: values}
    import numpy as np

    return {
        f"{name}[{', '.join(map(str, place))}]": values[(slice(None), *place)]
        for place in np.ndindex(values.shape[1:])
    }


def _library(name: str) -> Any:
    try:
        return import_module(name)
    except ImportError:
        raise missing_extra("tables and datasets", name, "tables") from None


Axes = Any
"""A `matplotlib.axes.Axes`, or an array of them."""


def new_axes(ax: Axes | None, columns: int = 1, rows: int = 1) -> Any:
    """Return axes to draw on, as a flat array: the caller's, or those of a new figure."""
    if ax is not None:
        return np.atleast_1d(np.asarray(ax, dtype=object)).ravel()
    size = (2.6 * columns + 1.4, 2.4 * rows + 0.6)
    pyplot: Any = import_module("matplotlib.pyplot")
    _, made = pyplot.subplots(rows, columns, figsize=size, squeeze=False, layout="constrained")
    return made.ravel()


def colours() -> Any:
    """Return Matplotlib's colour map of a push: blue above 0, orange below."""
    return import_module("matplotlib.colors").ListedColormap(scale(LIGHT))


def maps(named: Mapping[str, Floats], ax: Axes | None = None, unit: str = "") -> Any:
    """Draw (rows, cols) maps side by side in one scale: blue above 0, orange below."""
    drawn = new_axes(ax, columns=len(named))
    top = max(float(np.nanmax(np.abs(values), initial=0.0)) for values in named.values())
    image: Any = None
    for axes, (name, values) in zip(drawn, named.items(), strict=False):
        image = axes.imshow(values, cmap=colours(), vmin=-(top or 1.0), vmax=top or 1.0)
        axes.set_title(name)
        axes.set_xlabel("column")
        axes.set_ylabel("row")
    if image is not None and ax is None:
        drawn[0].figure.colorbar(image, ax=list(drawn), label=unit or None)
    return drawn


def lines(x: Floats, named: Mapping[str, Floats], ax: Axes | None, labels: tuple[str, str]) -> Axes:
    """Draw (n,) lines over x on one axes, named in a legend."""
    axes = new_axes(ax)[0]
    for name, values in named.items():
        axes.plot(x, values, label=name)
    axes.set_xlabel(labels[0])
    axes.set_ylabel(labels[1])
    axes.legend()
    return axes


def marks(kinds: Sequence[str], times: Sequence[float], ax: Axes | None) -> Axes:
    """Draw events as marks over time, one row per kind."""
    axes = new_axes(ax)[0]
    rows = list(dict.fromkeys(kinds))
    axes.scatter(times, [rows.index(kind) for kind in kinds], marker="|", s=300)
    axes.set_yticks(range(len(rows)), rows)
    axes.set_ylim(max(len(rows), 1) - 0.5, -0.5)
    axes.set_xlabel("time (s)")
    return axes


def bars(named: Mapping[str, float], ax: Axes | None, label: str) -> Axes:
    """Draw horizontal bars, the first at the top."""
    axes = new_axes(ax)[0]
    axes.barh(list(named), list(named.values()))
    axes.invert_yaxis()
    axes.set_xlabel(label)
    return axes
