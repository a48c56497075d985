"""One frame as a picture: normal as colour, shear as arrows, contact and stick region on top."""

from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from math import hypot, isfinite

import numpy as np
from numpy.typing import NDArray

from cnnum.report.pictures.svg import at, picture, round_up
from cnnum.report.record import NORMAL, SHEAR_X, SHEAR_Y, SceneRecord
from cnnum.sharing.colours import step

CELL = 10.0
"""Side of a taxel's square in the picture's units."""

DETECTED = {"contact_map": "in-contact", "stick_map": "in-stick"}
"""Maps of a program that are outlined, and how."""

FAINT = 0.12
"""Share of the longest arrow below which none is drawn: it would be a dot."""


@dataclass(frozen=True, slots=True)
class MapScale:
    """The scale of colours and of arrows' lengths, the same in all pictures of a report.

    Attributes
    ----------
    normal : float
        Value at the ends of the colour scale, symmetric about 0.
    shear : float
        Value of an arrow as long as the pitch.
    """

    normal: float
    shear: float

    @classmethod
    def of(cls, record: SceneRecord) -> "MapScale":
        """Return the scale that holds all frames of a record."""
        normal, x, y = (record.channel(name) for name in (NORMAL, SHEAR_X, SHEAR_Y))
        top = 0.0 if normal is None else float(np.nanmax(np.abs(normal), initial=0.0))
        long = 0.0
        if x is not None and y is not None:
            long = float(np.nanmax(np.hypot(x, y), initial=0.0))
        return cls(round_up(top), round_up(long))


def frame_picture(record: SceneRecord, frame: int, scale: MapScale, label: str) -> str:
    """Return a frame as an SVG element of equal squares, seen from above.

    The solid circle is the true contact, the dashed one the true stick region. The same lines
    around cells are the program's results.
    """
    rows, cols = record.shape
    parts = [
        *_heat(record, frame, scale),
        *_detected(record, frame),
        _taxels(rows, cols),
        *_circles(record, frame),
        *_arrows(record, frame, scale),
    ]
    return picture(CELL * cols, CELL * rows, parts, label, "map")


def _heat(record: SceneRecord, frame: int, scale: MapScale) -> Iterator[str]:
    normal = record.channel(NORMAL)
    if normal is None:
        rows, cols = record.shape
        yield f'<rect class="k32" width="{CELL * cols}" height="{CELL * rows}"/>'
        return
    squares: dict[int, list[str]] = defaultdict(list)
    for (row, col), value in np.ndenumerate(normal[frame]):
        if isfinite(value):
            place = f"M{at(CELL * col)} {at(CELL * row)}h10v10h-10z"
            squares[step(record.push * value, scale.normal)].append(place)
    for kind, places in sorted(squares.items()):
        yield f'<path class="k{kind}" d="{"".join(places)}"/>'


def _detected(record: SceneRecord, frame: int) -> Iterator[str]:
    for name, style in DETECTED.items():
        values = record.maps().get(name)
        if values is not None:
            held = np.nan_to_num(values[frame]) > 0.5
            yield f'<path class="detected {style}" d="{"".join(_edges(held))}"/>'


def _edges(held: NDArray[np.bool_]) -> Iterator[str]:
    """Yield the sides of cells that are held where the neighbour is not."""
    rows, cols = held.shape
    around = np.pad(held, 1)
    for row in range(rows + 1):
        for col in range(cols + 1):
            here = around[row + 1, col + 1]
            if here != around[row, col + 1]:
                yield f"M{at(CELL * col)} {at(CELL * row)}h10"
            if here != around[row + 1, col]:
                yield f"M{at(CELL * col)} {at(CELL * row)}v10"


def _taxels(rows: int, cols: int) -> str:
    places = (
        f"M{at(CELL * (c + 0.5))} {at(CELL * (r + 0.5))}h0"
        for r in range(rows)
        for c in range(cols)
    )
    return f'<path class="taxel" d="{"".join(places)}"/>'


def _arrows(record: SceneRecord, frame: int, scale: MapScale) -> Iterator[str]:
    x, y = record.channel(SHEAR_X), record.channel(SHEAR_Y)
    if x is None or y is None:
        return
    places: list[str] = []
    for (row, col), along in np.ndenumerate(x[frame]):
        unit = record.push * CELL / scale.shear
        dx, dy = unit * along, unit * float(y[frame, row, col])
        if hypot(dx, dy) > FAINT * CELL:
            places.append(arrow(CELL * (col + 0.5), CELL * (row + 0.5), dx, dy))
    if places:
        yield f'<path class="arrow" d="{"".join(places)}"/>'


def arrow(x: float, y: float, dx: float, dy: float) -> str:
    """Return the path of an arrow whose tail is at (x, y)."""
    tip_x, tip_y = x + dx, y + dy
    head = min(2.4, 0.45 * hypot(dx, dy)) / hypot(dx, dy)
    left = (-0.87 * dx - 0.5 * dy) * head, (-0.87 * dy + 0.5 * dx) * head
    right = (-0.87 * dx + 0.5 * dy) * head, (-0.87 * dy - 0.5 * dx) * head
    return (
        f"M{_two(x)} {_two(y)}L{_two(tip_x)} {_two(tip_y)}l{_two(left[0])} {_two(left[1])}"
        f"M{_two(tip_x)} {_two(tip_y)}l{_two(right[0])} {_two(right[1])}"
    )


def _two(value: float) -> str:
    return f"{value:.2f}"


def _circles(record: SceneRecord, frame: int) -> Iterator[str]:
    if record.pitch is None:
        return
    unit = CELL / record.pitch
    rows, cols = record.shape
    x = CELL * cols / 2 + unit * record.at("x", frame)
    y = CELL * rows / 2 + unit * record.at("y", frame)
    for name, style in (("contact_radius", "outline"), ("stick_radius", "stick-outline")):
        radius = unit * record.at(name, frame)
        if isfinite(x + y) and radius > 0.3:
            circle = f'cx="{_two(x)}" cy="{_two(y)}" r="{_two(radius)}"'
            yield f'<circle class="halo" {circle}/><circle class="{style}" {circle}/>'
