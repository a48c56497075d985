"""A figure as data: panels of curves, maps, dots and arrows, without any drawing."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from cnnum.arrays import Floats

Style = Literal["line", "dashed", "dotted", "points"]


@dataclass(frozen=True, slots=True, eq=False)
class Curve:
    """A line or points through (x, y).

    Attributes
    ----------
    x, y : (n,) float
    label : str
        For the legend; "" for none.
    style : str
    colour : int
        Number in the palette; −1 takes the next, −2 is the text's own.
    """

    x: Floats
    y: Floats
    label: str = ""
    style: Style = "line"
    colour: int = -1


@dataclass(frozen=True, slots=True, eq=False)
class Field:
    """A map over x and y.

    Attributes
    ----------
    x : (cols,) float
    y : (rows,) float
    values : (rows, cols) float
    unit : str
        Unit of the colour bar.
    levels : int
        Contour lines drawn over it; 0 for none.
    diverging : bool
        Zero in the middle of the colours.
    """

    x: Floats
    y: Floats
    values: Floats
    unit: str
    levels: int = 0
    diverging: bool = True


@dataclass(frozen=True, slots=True, eq=False)
class Dots:
    """Points whose size and colour mean something.

    Attributes
    ----------
    x, y, size : (n,) float
        Size is an area in points².
    colour : (n,) float or int
        Values for a colour scale, or one number in the palette.
    label : str
    """

    x: Floats
    y: Floats
    size: Floats
    colour: "Floats | int" = 0
    label: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class Arrows:
    """Vectors (u, v) at (x, y), in the units of the axes."""

    x: Floats
    y: Floats
    u: Floats
    v: Floats
    label: str = ""
    colour: int = 0


@dataclass(frozen=True, slots=True, eq=False)
class Matrix:
    """Counts in a table with named rows and columns."""

    values: Floats
    rows: tuple[str, ...]
    cols: tuple[str, ...]


Layer = Curve | Field | Dots | Arrows | Matrix


@dataclass(frozen=True, slots=True, eq=False)
class Panel:
    """One pair of axes.

    Attributes
    ----------
    title, x_label, y_label : str
        With units.
    layers : sequence of Layer
    equal : bool
        Same scale on both axes.
    log : str
        "" or "x", "y", "xy": logarithmic axes.
    depth : bool
        The vertical axis runs down.
    marks : sequence of (float, str)
        Vertical lines and their labels.
    reach : float or None
        Both axes end at ± this.
    ticks : sequence of str
        Names of 1, 2… on the vertical axis, instead of numbers.
    """

    title: str
    x_label: str
    y_label: str
    layers: Sequence[Layer]
    equal: bool = False
    log: str = ""
    depth: bool = False
    marks: Sequence[tuple[float, str]] = ()
    reach: float | None = None
    ticks: Sequence[str] = ()


@dataclass(frozen=True, slots=True, eq=False)
class Figure:
    """A figure of the report.

    Attributes
    ----------
    name : str
    source : str
        The figure of the dissertation that it is to be compared with.
    title : str
    caption : str
        The content, and the comparison.
    panels : sequence of Panel
    """

    name: str
    source: str
    title: str
    caption: str
    panels: Sequence[Panel]
