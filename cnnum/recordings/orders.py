"""Orders and signs of an array's numbers, by a press: what a file says of them, or denies.

Under a press straight down the load is compact, and the shear points away from its centre in the
sense in which the normal channel moves: along x it is proportional to (x - x₀) times the load,
along y to (y - y₀) times it. Counts and forces show this as they stand; strain and stress show it,
too, since a push is below 0 in them and the shear below it turns with it. A pull adds a shear of
one direction, which is taken off. A twist or a load that slides has another pattern, and says
nothing on orders.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import permutations, product

import numpy as np

from cnnum.arrays import Floats, Shape

CLEAR = 0.6
"""Correlation from which a pattern is seen."""

LEAD, DENIED = 0.35, 0.05
"""Correlation by which another order must be ahead of the present one, and up to which the press
denies the present one. Two touches at once show a little of it."""

SMALLEST = 3
"""Rows and columns in which there is a pattern."""

TOUCHED = 0.1
"""Share of the peak from which a taxel is under the load."""

ENOUGH = 5
"""Taxels under the load: fewer show no pattern."""

AXES = "xyz"


@dataclass(frozen=True, slots=True)
class Order:
    """An order of the numbers of a frame, against the one in which they came.

    Attributes
    ----------
    channels : (int, int, int)
        Places of the shear to the right, the shear downwards and the normal load.
    signs : (float, float)
        Of both shears.
    grid : str
        How the numbers of a frame lie in it: "" as they came; "columns" where taxels follow each
        other down the columns; "channels" where all numbers of a channel follow each other.
    """

    channels: tuple[int, int, int] = (0, 1, 2)
    signs: tuple[float, float] = (1.0, 1.0)
    grid: str = ""

    @property
    def changes(self) -> int:
        """How much it changes: of two orders that fit as well, the one with less is meant."""
        moved = sum(place != n for n, place in enumerate(self.channels))
        return moved + self.signs.count(-1.0) + 2 * bool(self.grid)

    def of(self, values: Floats) -> Floats:
        """Return (…, rows, cols, 3) values in this order."""
        *lead, rows, cols, count = values.shape
        if self.grid == "columns":
            values = np.swapaxes(values.reshape(*lead, cols, rows, count), -3, -2)
        elif self.grid == "channels":
            values = np.moveaxis(values.reshape(*lead, count, rows, cols), -3, -1)
        return np.asarray(values[..., list(self.channels)] * np.array([*self.signs, 1.0]))

    def names(self) -> list[str]:
        """Return the names of the channels as they came, with a minus where a sign turns."""
        found = [""] * 3
        for axis, place in enumerate(self.channels):
            turned = axis < 2 and self.signs[axis] < 0
            found[place] = f"-{AXES[axis]}" if turned else AXES[axis]
        return found


def orders(shape: Shape) -> Iterator[Order]:
    """Yield all orders that are looked at, the present one first."""
    grids = ["", "channels", *(["columns"] if shape[0] != shape[1] else [])]
    for grid, channels in product(grids, permutations((0, 1, 2))):
        for signs in product((1.0, -1.0), repeat=2):
            if channels == (1, 0, 2) and signs[0] != signs[1]:
                continue  # the shear turned by a quarter, as a twist has it
            yield Order((channels[0], channels[1], channels[2]), (signs[0], signs[1]), grid)


def pattern(away: Floats) -> Floats | None:
    """Return the correlations of both shears with those of a press.

    Parameters
    ----------
    away : (rows, cols, 3) float
        A frame less its rest.

    Returns
    -------
    (2, 2) float or None
        [shear, direction of the places]; None where too few taxels are under the load, or the
        normal channel is no load: it has both signs, or no neighbours agree.
    """
    normal = away[..., 2]
    peak = float(np.abs(normal).max())
    if not peak > 0.0:
        return None
    load = np.where(np.abs(normal) > TOUCHED * peak, normal, 0.0)
    weight = np.abs(load)
    one_sided = abs(float(load.sum())) / float(weight.sum())
    if np.count_nonzero(load) < ENOUGH or one_sided < 0.5 or smoothness(weight) < CLEAR / 2:
        return None
    y, x = np.mgrid[: normal.shape[0], : normal.shape[1]]
    total = float(weight.sum())
    places = (x - float((weight * x).sum()) / total, y - float((weight * y).sum()) / total)
    found = np.zeros((2, 2))
    for shear in (0, 1):
        kept = np.where(load != 0.0, away[..., shear], 0.0)
        kept = kept - load * float((kept * load).sum()) / float((load * load).sum())
        for axis, place in enumerate(places):
            wanted = place * load
            size = float(np.sqrt((kept * kept).sum() * (wanted * wanted).sum()))
            found[shear, axis] = float((kept * wanted).sum()) / size if size > 0.0 else 0.0
    return found


def smoothness(values: Floats) -> float:
    """Return the correlation of each taxel with the mean of its neighbours; 0 where it has none."""
    rows, cols = values.shape
    total, count = np.zeros((rows, cols)), np.zeros((rows, cols))
    for axis, size in enumerate((rows, cols)):
        if size > 1:
            first = (slice(None),) * axis + (slice(1, None),)
            second = (slice(None),) * axis + (slice(None, -1),)
            total[first] += values[second]
            total[second] += values[first]
            count[first] += 1
            count[second] += 1
    if not count.all():
        return 0.0
    one, other = values - values.mean(), total / count
    other = other - other.mean()
    size = float(np.sqrt((one * one).sum() * (other * other).sum()))
    return float((one * other).sum()) / size if size > 0.0 else 0.0


def score(away: Floats) -> float:
    """Return how well a frame less its rest shows a press straight down: 1 for a perfect one.

    It is the smaller of both shears' correlations with their own direction, less the larger of
    those with the other direction; -1 where there is no load.
    """
    found = pattern(away)
    if found is None:
        return -1.0
    return float(min(found[0, 0], found[1, 1]) - max(abs(found[0, 1]), abs(found[1, 0])))


def pad_pressed(presses: Floats, pads: int) -> Floats:
    """Return the columns of the pad under the most load, of pads side by side."""
    if pads < 2 or presses.shape[2] % pads:
        return presses
    parts = np.split(presses, pads, axis=2)
    return max(parts, key=lambda part: float(np.abs(part).sum()))


def best_order(presses: Floats) -> tuple[Order | None, float, float]:
    """Return the order that presses show, its score, and that of the present order.

    Parameters
    ----------
    presses : (frames, rows, cols, 3) float
        Frames under a load, less their rest.

    Returns
    -------
    (Order or None, float, float)
        None where nothing is shown: no order has a clear pattern. The present order where another
        one is not clearly ahead.
    """
    shape = presses.shape[1:3]
    if min(shape) < SMALLEST or presses.shape[3] != 3:
        return None, -1.0, -1.0
    found = [
        (float(np.median([score(frame) for frame in order.of(presses)])), -order.changes, order)
        for order in orders((shape[0], shape[1]))
    ]
    present = found[0][0]
    most = max(value for value, _, _ in found)
    # of those that fit nearly as well, the one that changes least
    value, _, order = max(
        (one for one in found if one[0] > most - 0.05), key=lambda one: (one[1], one[0])
    )
    if most < CLEAR:
        return None, most, present
    if present > most - LEAD:
        return Order(), present, present
    return (order, value, present) if present <= DENIED else (None, most, present)
