"""Where the numbers of a frame lie: skins without a square grid, other orders, other signs.

Skins whose taxels lie on no square grid: hexagonal, staggered and irregular ones.

Programs work on a grid of square cells. So a frame of taxels at known places is interpolated onto
one: linearly between each three neighbours (Delaunay's triangles), which is exact for a load that
changes evenly. The grid is laid so that taxels lie on its cells wherever it can be: there a cell
has the value of its taxel. Cells beyond the outermost taxels are masked: they read 0, and nothing
is ever found in them.

Numbers of a frame in another order or unit, or with other signs, than their source has them.

What a layout says of a file, a scene says in its table ``[frames]`` of any array, and a descriptor
of its own: which channel is which, whether a sign is turned, in which order the numbers follow each
other, which axes count from the other end, and in which unit they are.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from cnnum.arrays import Floats, Shape
from cnnum.drivers.driver import Closing, Counters, Driver
from cnnum.drivers.options import require, require_channels
from cnnum.errors import SceneError
from cnnum.frame import UNITS, Frame, Limits, TimeUnit, limits_of
from cnnum.recordings.recording import channel_names
from cnnum.safety.values import checked_name

Positions = tuple[tuple[float, float], ...]
"""Of each taxel x to the right and y downwards, mm, in the order of the frame's rows."""

FARTHEST = 1e4
"""mm from the origin to a taxel."""

FINER = (1, 2)
"""Cells to the distance of the taxels that are tried for one with all taxels on cells. Between
hexagons there is none, and the last one is taken."""

NEAREST, CELLS_APART = 0.1, 8.0
"""mm a taxel of a side below which positions are taken for metres, and cells between neighbours up
to which a pitch agrees with them."""

ON = 1e-3
"""Part of a cell within which a taxel lies on it."""

MOST, MOST_TAXELS = 64, 2048
"""Cells a taxel at most, and taxels whose places are given one by one."""


class Grid:
    """Interpolates frames of taxels at known positions onto the square grid of a program.

    Parameters
    ----------
    positions : sequence of (x, y), mm
    taxels : (rows, cols)
        Shape of the array's frames.
    pitch : float, optional
        Desired size of a cell, m. The default is the distance between taxels, or half of it if
        only then all of them lie on cells, and for hexagonal arrays.
    dead : sequence of (row, column)
        Taxels to leave out.

    Attributes
    ----------
    taxels, shape : (rows, cols)
        Shapes of the frames and of the maps.
    pitch : float
        Size of a cell, m.
    inside : (rows, cols) bool
        Cells that are not masked.

    Raises
    ------
    SceneError
        If the positions do not fit the taxels, two of them coincide, or they need a grid with too
        many cells.
    """

    def __init__(
        self,
        positions: Sequence[tuple[float, float]],
        taxels: Shape,
        pitch: float | None = None,
        dead: Sequence[tuple[int, int]] = (),
    ) -> None:
        places = checked_positions(positions, taxels[0] * taxels[1], pitch)
        gone = {row * taxels[1] + col for row, col in dead}
        lives = np.array([n not in gone for n in range(len(places))])
        self.taxels = taxels
        self._begin = places.min(axis=0)
        extent = places.max(axis=0) - self._begin
        counts = _counts(places, extent, None if pitch is None else 1e3 * pitch)
        self._step = np.where(counts > 1, extent / np.maximum(counts - 1, 1), 0.0)
        cols, rows = counts.tolist()
        self.shape: Shape = (rows, cols)
        known = self._step[self._step > 0.0]
        self.pitch = float(1e-3 * known.mean()) if len(known) else pitch or 1e-3
        y, x = (part.ravel() for part in np.indices(self.shape))
        cells = self._begin + self._step * np.stack([x, y], axis=1)
        self._weights, interpolation = _weights(places, lives, cells)
        self.inside: NDArray[np.bool_] = interpolation.reshape(self.shape)
        if not interpolation.any():
            raise SceneError("'dead' leaves too few taxels to interpolate between them.")

    def maps(self, values: Floats) -> Floats:
        """Return maps on the grid, (rows, cols, channels), for the values of the taxels."""
        flat = values.reshape(-1, values.shape[-1])
        return np.asarray(self._weights @ flat).reshape(*self.shape, values.shape[-1])

    def marks(self, marks: NDArray[np.bool_] | None) -> NDArray[np.bool_] | None:
        """Return the cells whose value depends on a marked taxel."""
        if marks is None:
            return None
        return np.asarray(self._weights @ marks.ravel().astype(float) > 0.0).reshape(self.shape)

    def place(self, row: float, column: float) -> tuple[float, float]:
        """Return x and y (mm) of a grid position, in the coordinates of the taxel positions."""
        x, y = self._begin + self._step * np.array([column, row])
        return float(x), float(y)


def checked_positions(
    positions: Sequence[tuple[float, float]], taxels: int, pitch: float | None = None
) -> Floats:
    """Return positions as an array of shape (taxels, 2), mm.

    Raises
    ------
    SceneError
        If their number differs from that of the taxels, one is not finite, two are the same, or
        they seem to be in metres and no pitch (m) confirms the distance.
    """
    places = np.asarray(positions, dtype=np.float64).reshape(-1, 2)
    if len(places) != taxels:
        raise SceneError(
            f"'positions' must give a position [x, y] in mm for each of the {taxels} taxels, row "
            f"by row, got {len(places)}."
        )
    if taxels > MOST_TAXELS:
        raise SceneError(f"'positions' must list at most {MOST_TAXELS} taxels, got {taxels}.")
    if not np.isfinite(places).all() or np.abs(places).max() > FARTHEST:
        raise SceneError(f"'positions' must be finite and below {FARTHEST:g} mm.")
    near, which = _nearest(places)
    same = np.flatnonzero(near < 1e-6)
    if len(same):
        first, second = sorted((int(same[0]), int(which[same[0]])))
        raise SceneError(
            f"'positions': the taxels {first} and {second} are at the same position, "
            f"{places[first].tolist()} mm: give each its own."
        )
    distance = float(np.median(near))
    known = pitch is not None and 1e3 * pitch <= CELLS_APART * distance
    # by the whole array, as two taxels may lie close
    if float(np.ptp(places, axis=0).max()) < NEAREST * taxels**0.5 and not known and taxels > 1:
        raise SceneError(
            f"'positions' are in mm, and these are {distance:.3g} mm apart, closer than taxels "
            "can be: if they are in metres, multiply them by 1000; if not, confirm the distance "
            f"with 'pitch', as in pitch = {1e-3 * distance:.3g} (m)."
        )
    return places


def _nearest(places: Floats) -> tuple[Floats, NDArray[np.intp]]:
    """Return the distance of each taxel to the nearest other one, and which it is."""
    from scipy.spatial import KDTree

    if len(places) == 1:
        return np.array([np.inf]), np.zeros(1, np.intp)
    near, which = KDTree(places).query(places, k=2)
    return np.asarray(near)[:, 1], np.asarray(which)[:, 1]


def _counts(places: Floats, extent: Floats, pitch: float | None) -> NDArray[np.int64]:
    """Return columns and rows of the grid."""
    if len(places) == 1:
        return np.ones(2, np.int64)
    distance = float(np.median(_nearest(places)[0]))
    counts = np.ones(2, np.int64)
    for size in [pitch] if pitch else [distance / finer for finer in FINER]:
        counts = np.maximum(np.rint(extent / size), extent > 1e-6).astype(np.int64) + 1
        step = np.where(counts > 1, extent / np.maximum(counts - 1, 1), 1.0)
        off = (places - places.min(axis=0)) / step
        if np.abs(off - np.rint(off)).max() < ON:
            break
    if counts.prod() > MOST * len(places) + MOST:
        raise SceneError(
            f"The positions of {len(places)} taxels, {distance:.3g} mm apart, need a grid of "
            f"{counts[1]}×{counts[0]} cells, expected at most {MOST} cells per taxel: give a "
            "larger 'pitch' (m)."
        )
    return counts


def _weights(
    places: Floats, lives: NDArray[np.bool_], cells: Floats
) -> tuple[Any, NDArray[np.bool_]]:
    """Return the weights (cells, taxels) of living taxels, and which cells have some."""
    from scipy.interpolate import LinearNDInterpolator
    from scipy.sparse import csr_array
    from scipy.spatial import QhullError

    live = np.flatnonzero(lives)
    some = places[live]
    span = some.max(axis=0) - some.min(axis=0) if len(some) else np.zeros(2)
    if (span < 1e-6).any():  # one taxel, or a line along an axis
        weights = _on_line(some, span, cells)
    else:
        # cells on the rim are inside, whatever the rounding
        middle = some.mean(axis=0)
        within = middle + (cells - middle) * (1.0 - 1e-9)
        try:
            weights = LinearNDInterpolator(some, np.eye(len(some)))(within)
        except QhullError:
            raise SceneError(
                "'positions' lie on one slanted line, which gives no map: rotate them, so that "
                "the line runs along x or y."
            ) from None
    inside: NDArray[np.bool_] = np.asarray(np.isfinite(weights).all(axis=1))
    near = np.where(inside[:, np.newaxis], np.round(weights, 7), 0.0)
    whole = np.zeros((len(cells), len(places)))
    whole[:, live] = near
    return csr_array(whole), inside


def _on_line(some: Floats, span: Floats, cells: Floats) -> Floats:
    """Return the weights of taxels in one line."""
    along = int(span.argmax())
    rank = np.argsort(some[:, along])
    values = np.full((len(cells), len(some)), np.nan)
    on = np.abs(cells[:, 1 - along] - some[:1, 1 - along].sum()) < 1e-6
    for n, taxel in enumerate(rank.tolist()):
        unit = np.zeros(len(rank))
        unit[n] = 1.0
        values[on, taxel] = np.interp(
            cells[on, along], some[rank, along], unit, left=np.nan, right=np.nan
        )
    return values


AXES = ("rows", "cols", "channels")


@dataclass(frozen=True, slots=True)
class Reading:
    """Interpretation of the numbers of a frame: channels, signs, order and units.

    Attributes
    ----------
    channels : tuple of str
        Names of a taxel's numbers in order; a minus reverses the sign. Empty to leave them
        unchanged.
    order : str
        Axes of the numbers from the slowest to the fastest, as in "frames cols rows channels"; ""
        for the order of the source.
    flip : tuple of "rows" and "cols"
        Axes to reverse.
    unit : str
        Unit of the numbers; "" for the one that the source states.
    time_unit : "s", "ms", "us" or "ns"
        Unit of the times of a recording, which would otherwise be read as seconds; "" to leave
        them unchanged.
    """

    channels: tuple[str, ...] = ()
    order: str = ""
    flip: tuple[Literal["rows", "cols"], ...] = ()
    unit: str = ""
    time_unit: TimeUnit = ""

    def __post_init__(self) -> None:
        if self.unit:
            checked_name("a unit", self.unit, SceneError)
        if self.channels:
            require_channels(self.plain)
        parts = self.order.split()
        holds = not parts or (parts[0] == "frames" and sorted(parts[1:]) == sorted(AXES))
        said = "axes from the slowest to the fastest, as in 'frames cols rows channels'"
        require("order", holds, said, self.order)

    def __bool__(self) -> bool:
        return bool(self.channels or self.order or self.flip or self.unit or self.time_unit)

    @property
    def scale(self) -> float:
        """The unit of the times, s."""
        return UNITS.get(self.time_unit, 1.0)

    @property
    def plain(self) -> tuple[str, ...]:
        """Names of the channels without signs."""
        return tuple(name.removeprefix("-") for name in self.channels)

    def names(self, known: tuple[str, ...]) -> tuple[str, ...]:
        """Return the full names of an array's channels.

        Raises
        ------
        SceneError
            If their number differs.
        """
        if not self.channels:
            return known
        said = f"a name for each of the {len(known)} channels, as in ['x', 'y', '-z']"
        require("channels", len(self.channels) == len(known), said, list(self.channels))
        return channel_names(self.plain, len(known))

    def of(self, values: Floats) -> Floats:
        """Return the numbers of a frame, (rows, cols, channels), in this interpretation."""
        if self.order:
            sizes: dict[str, int] = dict(zip(AXES, values.shape, strict=True))
            parts = self.order.split()[1:]
            whole = values.reshape([sizes[name] for name in parts])
            values = whole.transpose([parts.index(name) for name in AXES])
        back = tuple(axis for axis, name in enumerate(AXES) if name in self.flip)
        return np.asarray(np.flip(values, back) * self._signs, np.float64)

    @property
    def _signs(self) -> Any:
        return [-1.0 if n.startswith("-") else 1.0 for n in self.channels] if self.channels else 1.0

    def frame(self, frame: Frame) -> Frame:
        """Return a frame in this interpretation."""
        marks = frame.saturated
        if marks is not None and (self.order or self.flip):
            plain = replace(self, channels=(), unit="")
            flags = np.repeat(marks[..., np.newaxis].astype(float), frame.values.shape[2], axis=2)
            marks = np.asarray(plain.of(flags).any(axis=2))
        values, names = self.of(frame.values), self.names(frame.channels)
        unit = self.unit or frame.unit
        time = self.scale * frame.time
        return replace(frame, values=values, channels=names, saturated=marks, unit=unit, time=time)

    def limits(self, known: Limits | None, channels: int) -> Limits | None:
        """Return the limits of working taxels with the signs of the channels."""
        if known is None or not self.channels:
            return known
        ends = np.sort(limits_of(known, channels) * self._signs, axis=0)
        return tuple((float(low), float(high)) for low, high in ends.T)


class Reordered(Closing):
    """A driver whose frames are interpreted by a `Reading`, and which is otherwise unchanged.

    Raises
    ------
    SceneError
        If the channels are not those of the driver, or it is live and has a unit of times.
    """

    def __init__(self, driver: Driver, reading: Reading) -> None:
        if reading.scale != 1.0 and getattr(driver, "live", False):
            raise SceneError(
                f"'time_unit' is for the times of a recording, got '{reading.time_unit}' for a "
                "live array, whose descriptor gives the unit of its clock."
            )
        self._driver, self._reading = driver, reading
        self.channels = reading.names(driver.channels)
        known = getattr(driver, "limits", None)
        self.limits = reading.limits(known, len(driver.channels))
        self.timed = bool(reading.time_unit) or bool(getattr(driver, "timed", False))

    @property
    def shape(self) -> Shape:
        """Shape of the driver's frames."""
        return self._driver.shape

    @property
    def unit(self) -> str:
        """Unit of the driver, unless the reading states another."""
        return self._reading.unit or self._driver.unit

    @property
    def rate(self) -> float:
        """Rate of the driver, converted to Hz by the unit of its times."""
        return self._driver.rate / self._reading.scale

    @property
    def counters(self) -> Counters:
        """Counts of the driver."""
        return self._driver.counters

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):
            raise AttributeError(name)
        return getattr(self._driver, name)

    def frames(self) -> Iterator[Frame]:
        """Yield the frames of the driver in the interpretation of the reading."""
        for frame in self._driver.frames():
            yield self._reading.frame(frame)

    def close(self) -> None:
        """Close the driver."""
        self._driver.close()
