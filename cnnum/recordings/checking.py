"""What a recording shows of its array: orders, signs, unit, rate, rest, dead and noisy taxels.

Orders and signs of an array's numbers, by a press: what a file says of them, or denies.

Under a press straight down the load is compact, and the shear points away from its centre in the
sense in which the normal channel moves: along x it is proportional to (x - x₀) times the load,
along y to (y - y₀) times it. Counts and forces show this as they stand; strain and stress show it,
too, since a push is below 0 in them and the shear below it turns with it. A pull adds a shear of
one direction, which is taken off. A twist or a load that slides has another pattern, and says
nothing on orders.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import permutations, product

import numpy as np
from numpy.typing import NDArray

from cnnum.arrays import Floats, Shape
from cnnum.frame import FORCE_AXES, Quality, time_unit_of
from cnnum.recordings.recording import Recording
from cnnum.recordings.times import rate_of

CLEAR = 0.6
"""Correlation from which a pattern is seen."""

LEAD, DENIED = 0.35, 0.05
"""Correlation by which another order must be ahead of the present one, and up to which the press
denies the present one. Two touches at once show a little of it."""

RAGGED = 4.0
"""How many times less neighbours of one channel agree in a wrong order of the taxels."""

SMALLEST = 3
"""Rows and columns in which there is a pattern."""

TOUCHED = 0.1
"""Share of the peak from which a taxel is under the load."""

ENOUGH = 5
"""Taxels under the load: fewer show no pattern."""

AXES = "xyz"

GRID = ("rows", "cols", "channels")
COLUMNS = ("cols", "rows", "channels")
GRIDS = {
    COLUMNS: "the taxels follow each other down the columns",
    ("channels", "rows", "cols"): "all numbers of a channel follow each other",
    ("channels", "cols", "rows"): "rows, columns and channels are reversed, as in Fortran's order",
    ("rows", "channels", "cols"): "all numbers of a channel follow each other in each row",
    ("cols", "channels", "rows"): "all numbers of a channel follow each other in each column",
}
"""What orders of the axes but the usual one are."""

FALLS = ("strain", "Pa")
"""Units in which a push is below 0, as they count tension as positive."""


@dataclass(frozen=True, slots=True)
class Order:
    """An order of the numbers of a frame, against the one in which they came.

    Attributes
    ----------
    channels : (int, int, int)
        Places of the shear to the right, the shear downwards and the normal load.
    signs : (float, float, float)
        Signs of the two shears and of the normal load.
    grid : tuple of str
        Axes of the numbers of a frame as they lie in it, from the slowest to the fastest.
    """

    channels: tuple[int, int, int] = (0, 1, 2)
    signs: tuple[float, float, float] = (1.0, 1.0, 1.0)
    grid: tuple[str, str, str] = GRID

    @property
    def changes(self) -> int:
        """How much it changes: of two orders that fit as well, the one with less is meant."""
        moved = sum(place != n for n, place in enumerate(self.channels))
        return moved + self.signs.count(-1.0) + 2 * (self.grid != GRID)

    def of(self, values: Floats) -> Floats:
        """Return (frames, rows, cols, 3) values in this order."""
        if self.grid != GRID:
            sizes: dict[str, int] = dict(zip(GRID, values.shape[1:], strict=True))
            held = values.reshape(-1, *(sizes[axis] for axis in self.grid))
            values = held.transpose(0, *(self.grid.index(axis) + 1 for axis in GRID))
        return np.asarray(values[..., list(self.channels)] * np.array(self.signs))

    def names(self) -> list[str]:
        """Return the names of the channels as they came, with a minus where a sign turns."""
        result = [""] * 3
        for axis, place in enumerate(self.channels):
            result[place] = f"-{AXES[axis]}" if self.signs[axis] < 0 else AXES[axis]
        return result


def orders(shape: Shape) -> Iterator[Order]:
    """Yield all orders that are looked at, the present one first."""
    for grid, channels in product((GRID, *GRIDS), permutations((0, 1, 2))):
        if grid == COLUMNS and shape[0] == shape[1]:
            continue  # the same as both shears swapped
        for x, y in product((1.0, -1.0), repeat=2):
            if channels == (1, 0, 2) and x != y:
                continue  # the shear turned by a quarter, as a twist has it
            yield Order((channels[0], channels[1], channels[2]), (x, y, 1.0), grid)


def patterns(normal: Floats, shears: Floats) -> Floats:
    """Return the correlations of shears with those of a press.

    Parameters
    ----------
    normal : (frames, rows, cols) float
        Loads above rest.
    shears : (shears, frames, rows, cols) float

    Returns
    -------
    (frames, shears, 2) float
        By direction of the places, right and down. NaN in a frame whose normal channel is no load:
        too few taxels are under it, it has both signs, or no neighbours agree.
    """
    size = np.abs(normal)
    load = np.where(size > TOUCHED * size.max(axis=(1, 2), keepdims=True), normal, 0.0)
    weight = np.abs(load)
    total = weight.sum(axis=(1, 2))
    shown = (np.count_nonzero(load, axis=(1, 2)) >= ENOUGH) & (total > 0.0)
    shown &= np.abs(load.sum(axis=(1, 2))) >= 0.5 * total
    shown &= smoothness(weight) >= CLEAR / 2
    y, x = np.mgrid[: normal.shape[1], : normal.shape[2]]
    with np.errstate(divide="ignore", invalid="ignore"):
        middles = [np.sum(weight * place, axis=(1, 2)) / total for place in (x, y)]
        wanted = np.stack(
            [(p - m[:, None, None]) * load for p, m in zip((x, y), middles, strict=True)]
        )
        kept = np.where(load != 0.0, shears, 0.0)
        along = _over_places("sfij,fij->sf", kept, load) / _over_places("fij,fij->f", load, load)
        kept = kept - load * along[..., None, None]
        powers = np.sqrt(
            _over_places("sfij,sfij->fs", kept, kept)[:, :, None]
            * _over_places("afij,afij->fa", wanted, wanted)[:, None, :]
        )
        values = _over_places("sfij,afij->fsa", kept, wanted) / powers
    values[~(powers > 0.0)] = 0.0
    values[~shown] = np.nan
    return values


def _over_places(sums: str, some: Floats, others: Floats) -> Floats:
    return np.asarray(np.einsum(sums, some, others))


def smoothness(values: Floats) -> Floats:
    """Return the correlation of each taxel with the mean of its neighbours; 0 where it has none.

    Parameters
    ----------
    values : (frames, rows, cols) float

    Returns
    -------
    (frames,) float
    """
    total, count = np.zeros(values.shape), np.zeros(values.shape[1:])
    for axis, size in enumerate(values.shape[1:]):
        if size > 1:
            first = (slice(None),) * axis + (slice(1, None),)
            second = (slice(None),) * axis + (slice(None, -1),)
            total[:, *first] += values[:, *second]
            total[:, *second] += values[:, *first]
            count[first] += 1
            count[second] += 1
    if not count.all():
        return np.zeros(len(values))
    near, other = (maps - maps.mean(axis=(1, 2), keepdims=True) for maps in (values, total / count))
    size = np.sqrt((near * near).sum(axis=(1, 2)) * (other * other).sum(axis=(1, 2)))
    both = (near * other).sum(axis=(1, 2))
    return np.asarray(np.divide(both, size, out=np.zeros(len(values)), where=size > 0.0))


def scores(presses: Floats) -> Floats:
    """Return how well each frame shows a press straight down: 1 for a perfect one.

    It is the smaller of both shears' correlations with their own direction, less the larger of
    those with the other direction; -1 where there is no load.

    Parameters
    ----------
    presses : (frames, rows, cols, 3) float
        Frames less their rest.
    """
    shears = np.moveaxis(presses[..., :2], -1, 0)
    return _scored(patterns(presses[..., 2], shears), Order())


def _scored(values: Floats, order: Order) -> Floats:
    x, y = (values[:, shear] for shear in order.channels[:2])
    own = np.minimum(order.signs[0] * x[:, 0], order.signs[1] * y[:, 1])
    score = own - np.maximum(np.abs(x[:, 1]), np.abs(y[:, 0]))
    return np.asarray(np.where(np.isnan(score), -1.0, score))


def pad_pressed(presses: Floats, pads: int) -> Floats:
    """Return the columns of the pad under the most load, of pads side by side."""
    if pads < 2 or presses.shape[2] % pads:
        return presses
    parts = np.split(presses, pads, axis=2)
    return max(parts, key=lambda part: float(np.abs(part).sum()))


def best_order(
    presses: Floats, unit: str = "count", pads: int = 1
) -> tuple[Order | None, float, float]:
    """Return the order that presses show, its score, and that of the present order.

    Both shears turned and the normal load turned look alike; which of them is meant is decided by
    the sense of a push in the unit.

    Parameters
    ----------
    presses : (frames, rows, cols, 3) float
        Frames under a load, less their rest.
    unit : str
        Unit of the readings; in strain and Pa a push is below 0.
    pads : int
        Pads side by side in the columns; the one under the most load is looked at.

    Returns
    -------
    (Order or None, float, float)
        None if nothing is shown: no order has a clear pattern. The present order where another
        one is not clearly ahead.
    """
    shape = presses.shape[1:3]
    if min(shape) < SMALLEST or presses.shape[3] != 3:
        return None, -1.0, -1.0
    known: dict[tuple[tuple[str, ...], int], tuple[Floats, float]] = {}
    parts = list[Floats]()
    tried = list(orders((shape[0], shape[1])))
    for n, order in enumerate(tried):
        *_, normal = order.channels
        if (order.grid, normal) not in known:
            placed = pad_pressed(Order(grid=order.grid).of(presses), pads)
            placed = np.moveaxis(placed, -1, 0)
            sense = float(placed[normal].sum())
            known[order.grid, normal] = patterns(placed[normal], placed), sense
        axes, sense = known[order.grid, normal]
        parts.append(_scored(axes, order))
        falls = sense < 0.0
        if order.signs[:2] == (-1.0, -1.0) and falls != (unit in FALLS):
            tried[n] = replace(order, signs=(1.0, 1.0, -1.0))
    fits = np.median(parts, axis=1).tolist()
    ranked = [(fit, -order.changes, order) for fit, order in zip(fits, tried, strict=True)]
    present = ranked[0][0]
    most = max(value for value, _, _ in ranked)
    # of those that fit nearly as well, the one that changes least
    value, _, order = max(
        (candidate for candidate in ranked if candidate[0] > most - 0.05),
        key=lambda candidate: (candidate[1], candidate[0]),
    )
    if most < CLEAR:
        return None, most, present
    if present > most - LEAD:
        return Order(), present, present
    return (order, value, present) if present <= DENIED else (None, most, present)


LEVELLED = 0.1
"""Share of the spread of all numbers at rest up to which that within the channels is small."""

MIXED = 0.6
"""The same share from which channels are mixed."""

TAXELS = 8
"""Taxels from which numbers at rest show this."""


def levelled(rest: Floats, moved: Floats) -> Order | None:
    """Return the order in which the numbers at rest are alike within each channel.

    In many arrays each channel rests at its own level, such as z of a Hall sensor, whose level
    differs from those of x and y. The levels do not distinguish rows from columns; where the array
    is not square, loads are smooth in one order only.

    Parameters
    ----------
    rest : (rows, cols, 3) float
    moved : (frames, rows, cols, 3) float
        Frames less their rest.

    Returns
    -------
    Order or None
        None if the numbers say nothing, or are in this order already.
    """
    total = float(rest.var())
    if rest.shape[0] * rest.shape[1] < TAXELS or not total > 0.0:
        return None
    result = [Order(grid=grid) for grid in (GRID, *GRIDS)]
    shares = [float(order.of(rest[np.newaxis]).var(axis=(1, 2)).mean()) / total for order in result]
    if min(shares) > LEVELLED or shares[0] < MIXED:
        return None
    alike = [n for n, share in enumerate(shares) if share <= min(shares) + 1e-9]
    smooth = [float(smoothness(result[n].of(np.abs(moved)).max(axis=-1)).mean()) for n in alike]
    return result[alike[int(np.argmax(np.round(smooth, 6)))]]


RESTING = 1.0
"""s at the begin, and at the end, that are looked at for the rest."""

LEAST, MOST = 5, 200
"""Frames of it."""

TOUCH = 20.0
"""Times the noise from which a frame is under a load."""

LOUD = 5.0
"""Times the noise of its channel from which a taxel is noisy."""

PRESSES = 16
"""Frames under a load whose orders are looked at."""

APART = 0.05
"""Share by which a rate may differ from that of the times."""

WRAPPED = 0.75
"""Share of the range of a number of few bits from which a step is none of a load."""

MOVES = {
    "strain": (1.0, "no cover is strained so far"),
    "N": (1000.0, "that is the weight of a person on one taxel"),
    "V": (120.0, "no array is fed with so much"),
    "Pa": (1e9, "no polymer of a cover bears it"),
}
"""Furthest that readings move under a load, by unit, and why; a scene refuses the same voltages and
pressures as bad frames."""

COARSE = 20.0
"""Units that whole numbers move by at least if they are counts: of loads in N, strains or volts
these are none."""

LISTED = 12


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that a recording shows.

    Attributes
    ----------
    what : str
        "order", "unit", "rate", "rest", "dead", "stuck", "noisy", "wrap", "lost" or "bad".
    sentence : str
    wrong : bool
        Whether it is a fault, and not a fact.
    cure : dict of str to object
        Keys of a layout, or of a scene with their tables ("frames.dead"), that cure it.
    others : sequence of dict
        Keys that cure it as well, where what the recording shows has several causes.
    """

    what: str
    sentence: str
    wrong: bool = True
    cure: Mapping[str, object] = field(default_factory=dict[str, object])
    others: Sequence[Mapping[str, object]] = ()


def checked(recording: Recording, pads: int = 1, *, timed: bool = False) -> list[Finding]:
    """Return what a recording shows, faults first.

    Parameters
    ----------
    recording : Recording
    pads : int
        Pads side by side in its columns: each has presses of its own.
    timed : bool
        Whether the unit of its times is beyond doubt.
    """
    if set(recording.channels) == set(FORCE_AXES):  # in any order, as a cure may have them
        places = [recording.channels.index(name) for name in FORCE_AXES]
        if places != [0, 1, 2]:
            recording = _in_order(recording, places)
    good = recording.quality & int(Quality.CORRUPT | Quality.REPEATED) == 0
    lost: NDArray[np.bool_] = np.logical_not(np.isfinite(recording.values).any(axis=0).all(axis=-1))
    result: list[Finding] = []
    if lost.any() and not lost.all():
        gone = np.argwhere(lost).tolist()
        shown = ", ".join(f"({row}, {col})" for row, col in gone[:LISTED])
        said = f"The taxels {shown}{' …' if len(gone) > LISTED else ''} have no number at all."
        result.append(Finding("dead", said, cure={"frames.dead": gone}))
        rest = np.where(lost[..., np.newaxis], 0.0, recording.values)
        recording = _with_values(recording, rest)
    blank = ~np.isfinite(recording.values).any(axis=(0, 1, 2))
    for name in np.array(recording.channels)[blank & ~blank.all()].tolist():
        said = (
            f"The channel '{name}' has no number at all, so that each frame is bad: leave it out."
        )
        result.append(Finding("dead", said))
    good &= np.isfinite(recording.values).all(axis=(1, 2, 3))
    result += [*_counted(recording, good), *_rates(recording, timed=timed)]
    values, times = recording.values[good], recording.times[good]
    if len(values) < 2 * LEAST:
        few = f"{len(values)} good frames are too few to look at."
        return [*result, Finding("frames", few, wrong=False)]
    rest, noise, begins = rest_and_noise(values, times)
    result += _rests(values, times, rest, noise, begins)
    result += _taxels(recording, values, lost)
    result += _wraps(values)
    result += _units(recording, values, rest)
    result += _orders(recording, values, rest, noise, pads)
    return sorted(result, key=lambda finding: not finding.wrong)


def _in_order(recording: Recording, places: list[int]) -> Recording:
    return _with_values(recording, recording.values[..., places], FORCE_AXES)


def _with_values(
    recording: Recording, values: Floats, channels: Sequence[str] | None = None
) -> Recording:
    return Recording(
        values,
        rate=recording.rate,
        unit=recording.unit,
        channels=channels or recording.channels,
        times=recording.times,
        quality=recording.quality,
        sequence=recording.sequence,
    )


def steps_noise(values: Floats) -> Floats:
    """Return the noise of each number by its steps from frame to frame, (rows, cols, channels).

    A touch is a few large steps among many small ones, so that it makes no taxel noisy.
    """
    # of normal noise the median step is 0.954 standard deviations; the mean is less coarse where
    # most steps are 0
    steps = np.abs(np.diff(values, axis=0))
    middle = np.median(steps, axis=0) / 0.954
    mean = steps.mean(axis=0) * np.sqrt(np.pi) / 2.0
    return np.asarray(np.where(middle > 0.0, np.minimum(middle, mean), mean))


def _counted(recording: Recording, good: NDArray[np.bool_]) -> list[Finding]:
    result: list[Finding] = []
    flags = recording.quality
    bad = int((~np.isfinite(recording.values).all(axis=(1, 2, 3))).sum())
    bad += int((flags & int(Quality.CORRUPT) != 0).sum())
    if bad:
        result.append(Finding("bad", f"{bad} frames hold missing values, or are flagged as bad."))
    repeated = int((flags & int(Quality.REPEATED) != 0).sum())
    if repeated:
        said = f"{repeated} of {len(good)} frames repeat the one before."
        result.append(Finding("repeated", said, wrong=False))
    ahead = np.diff(recording.sequence) - 1
    gaps = int((ahead > 0).sum())
    if gaps:
        longest = float(np.diff(recording.times)[ahead > 0].max())
        said = f"{gaps} gaps with {int(ahead[ahead > 0].sum())} scans missing, the longest"
        result.append(Finding("lost", f"{said} {longest:.3g} s.", wrong=False))
    return result


def _rates(recording: Recording, *, timed: bool) -> list[Finding]:
    new = recording.quality & int(Quality.REPEATED) == 0
    rate = rate_of(recording.times[new])
    if not rate:
        return [Finding("rate", "The times of the frames give no rate.")]
    if unit := "" if timed else time_unit_of(recording.times[new]):
        said = (
            f"The rate is {rate:.4g} Hz by the times: they seem to be in {unit} instead of s. If "
            "it is right, time_unit = 's' says so."
        )
        return [Finding("rate", said, cure={"time_unit": unit})]
    if abs(rate - recording.rate) > APART * rate:
        said = f"The rate is {recording.rate:g} Hz, and {rate:.4g} Hz by the times."
        return [Finding("rate", said, cure={"rate": float(f"{rate:.6g}")})]
    # a recording without times has those that follow from its rate
    said = f"The rate is {recording.rate:g} Hz, and the times agree with it."
    return [Finding("rate", said, wrong=False)]


def rest_and_noise(values: Floats, times: Floats) -> tuple[Floats, Floats, bool]:
    """Return the rest, the noise of each number, and whether the recording begins at rest."""
    count = int((times < times[0] + RESTING).sum())
    count = min(max(count, LEAST), MOST, len(values) // 2)
    first, last = values[:count], values[-count:]
    noise = steps_noise(values)
    floor = np.maximum(noise, 1e-9 * max(1.0, float(np.abs(values).max())))
    moving = [float((np.ptp(part, axis=0) / floor).max()) for part in (first, last)]
    apart = np.abs(np.median(first, axis=0) - np.median(last, axis=0)) / floor
    begins = True
    if apart.max() > TOUCH:
        # the rest is the end where the load is smaller: the median of all lies nearer to it
        middle = np.median(values, axis=0)
        away = [float((np.abs(np.median(p, axis=0) - middle) / floor).sum()) for p in (first, last)]
        begins = moving[0] <= 2.0 * moving[1] or away[0] <= away[1]
    part = first if begins else last
    return np.median(part, axis=0), floor, begins


def _rests(
    values: Floats, times: Floats, rest: Floats, noise: Floats, begins: bool
) -> list[Finding]:
    result: list[Finding] = []
    if not begins:
        said = "The recording seems to begin under a load: rest is taken from its end."
        result.append(Finding("rest", said, cure=_tare(values, times, rest, noise)))
    count = max(LEAST, min(MOST, int((times < times[0] + 0.1).sum())))
    early: Floats = np.abs(values[:count] - rest) / noise
    if begins and early.max() > TOUCH:
        row, col = np.unravel_index(int(early.max(axis=(0, 3)).argmax()), rest.shape[:2])
        said = (
            f"In the first {times[min(count, len(times)) - 1] - times[0]:.2g} s the taxel ({row}, "
            f"{col}) moves by {early.max():.0f} times its noise: programs take these frames for "
            "their rest."
        )
        result.append(Finding("rest", said, cure=_tare(values, times, rest, noise)))
    return result


def _tare(values: Floats, times: Floats, rest: Floats, noise: Floats) -> dict[str, object]:
    """Return a time from which the array is at rest for a while, to learn the rest anew at."""
    moved = (np.abs(values - rest) / noise).max(axis=(1, 2, 3)) > TOUCH
    since = float(times[0])
    for time, moves in zip(times.tolist(), moved.tolist(), strict=True):
        since = time if moves else since
        if time - since >= 0.5 * RESTING:
            return {"frames.tare": [round(since - float(times[0]) + 0.1, 3)]}
    return {}


def _taxels(recording: Recording, values: Floats, lost: NDArray[np.bool_]) -> list[Finding]:
    still = (values == values[0]).all(axis=0)
    noise = steps_noise(values)
    middle = np.median(noise, axis=(0, 1))
    loud = (noise > LOUD * middle) & (middle > 0.0)
    result: list[Finding] = []
    for what, marks, said in (
        ("dead", still & (values[0] == 0.0) & ~lost[..., np.newaxis], "read 0 all the time"),
        ("stuck", still & (values[0] != 0.0), "read the same number all the time"),
        ("noisy", loud, f"are more than {LOUD:g} times as noisy as the others"),
    ):
        whole = marks.all(axis=(0, 1))
        if marks.any() and not whole.all():
            places = np.argwhere((marks & ~whole).any(axis=-1)).tolist()
            shown = ", ".join(f"({row}, {col})" for row, col in places[:LISTED])
            more = f" and {len(places) - LISTED} more" if len(places) > LISTED else ""
            if places:
                cure = {"frames.dead": places}
                result.append(Finding(what, f"The taxels {shown}{more} {said}.", cure=cure))
            for n in np.flatnonzero(whole).tolist():
                name = recording.channels[n]
                result.append(Finding(what, f"All taxels {said} in the channel '{name}'."))
        elif whole.all() and marks.size:
            result.append(Finding(what, f"All taxels {said}: the array is not connected."))
    return result


def _wraps(values: Floats) -> list[Finding]:
    if not (values % 1.0 == 0.0).all():
        return []
    for bits, low in product((8, 10, 12, 16), (0.0, -0.5)):
        top = float(1 << bits)
        begin = low * top
        if low and values.min() >= 0.0:
            continue
        values = values - begin
        if values.min() >= 0.0 and top / 2 < values.max() < top:
            jumps = np.abs(np.diff(values, axis=0)) > WRAPPED * top
            # a load that passes the end of the range comes back from the other one
            if np.count_nonzero(jumps.any(axis=0)) and (values.max(axis=0) > 0.9 * top).any():
                row, col = np.argwhere(jumps.any(axis=(0, 3)))[0].tolist()
                said = (
                    f"Numbers jump from one end of {begin:.0f} to {begin + top - 1:.0f} to the "
                    "other, first in the "
                    f"taxel ({row}, {col}): numbers of {bits} bits that ran over. The loads are "
                    "lost: record them with more bits."
                )
                return [Finding("wrap", said)]
        values = values + begin
    return []


def _units(recording: Recording, values: Floats, rest: Floats) -> list[Finding]:
    unit, away = recording.unit, float(np.abs(values - rest).max())
    whole = bool((values % 1.0 == 0.0).all())
    if unit in MOVES:
        most, why = MOVES[unit]
        said = f"The unit is {unit}, and values move by {away:.4g}: {why}."
        if away > most:
            return [Finding("unit", said, cure={"unit": "count"})]
        if unit != "Pa" and whole and away > COARSE:
            said = (
                f"The unit is {unit}, and all values are whole numbers, which move by {away:.4g}."
            )
            return [Finding("unit", said, cure={"unit": "count"})]
    if unit == "count" and not whole and away < 100.0:
        said = (
            "The unit is count, and the values are no whole numbers: name it where you know it, as "
            "in the line below."
        )
        return [Finding("unit", said, wrong=False, cure={"unit": "N"})]
    return []


def _orders(
    recording: Recording, values: Floats, rest: Floats, noise: Floats, pads: int
) -> list[Finding]:
    away = values - rest
    if len(recording.channels) == 1:
        return [_of_one_channel(away[..., 0], noise[..., 0])]
    if recording.channels != FORCE_AXES:
        said = "Orders are looked at in arrays of one or three axes alone."
        return [Finding("order", said, wrong=False)]
    # whatever the channels are called, a load moves one of them
    size = np.abs(away / noise).max(axis=(1, 2, 3))
    # fewer frames than show a press, such as one with a number that is cut, do not set its level
    top = float(np.sort(size)[-LEAST])
    pressed = np.flatnonzero(size > max(TOUCH, 0.3 * top))
    if len(pressed) < LEAST:
        said = "No press is seen, so that nothing shows the orders."
        return [_by_levels(rest, away) or Finding("order", said, wrong=False)]
    some = pressed[:: max(1, len(pressed) // PRESSES)]
    order, value, present = best_order(away[some], recording.unit, pads)
    if order is None and (turned := _turned(away[pressed[:PRESSES]], away[some], pads)):
        return [turned]
    if order is None:
        said = (
            "No press straight down is seen, so that nothing shows the orders and signs: press the "
            "middle of the array without a pull, and look again."
        )
        return [_by_levels(rest, away[some]) or Finding("order", said, wrong=False)]
    if order == Order():
        said = f"The orders and signs are right: the shear points away from a press ({value:.2f})."
        return [Finding("order", said, wrong=False)]
    others = _other_cures(order, square=values.shape[1] == values.shape[2])
    return [Finding("order", *sentence_of(order, value, present), others)]


def _of_one_channel(away: Floats, noise: Floats) -> Finding:
    """Return whether the taxels of one channel lie column by column, as far as that shows."""
    size = np.abs(away / noise).max(axis=(1, 2))
    pressed = np.flatnonzero(size > max(TOUCH, 0.3 * float(np.sort(size)[-LEAST:][0])))
    (rows, cols), said = away.shape[1:], "Nothing shows whether rows and columns are swapped or"
    if len(pressed) >= LEAST and min(rows, cols) >= SMALLEST and rows != cols:
        some = np.abs(away[pressed[:: max(1, len(pressed) // PRESSES)]])
        here = float(np.median(smoothness(some)))
        there = float(np.median(smoothness(some.reshape(-1, cols, rows).swapaxes(1, 2))))
        if there >= CLEAR and 1.0 - here >= RAGGED * (1.0 - there):
            said = (
                f"A press is smooth ({there:.2f}) if the taxels follow each other down the "
                f"columns, and ragged ({here:.2f}) as they are read."
            )
            return Finding("order", said, cure={"order": f"frames {' '.join(COLUMNS)}"})
        if here >= CLEAR and 1.0 - there >= RAGGED * (1.0 - here):
            said = f"Rows and columns are right, as a press is smooth ({here:.2f}), but may be"
    said += " mirrored: press one corner, and see where 'cnnum layout' draws it."
    return Finding("order", said, wrong=False)


TURNS = (Order((1, 0, 2), (1.0, -1.0, 1.0)), Order((1, 0, 2), (-1.0, 1.0, 1.0)))
"""Shears that are turned by a quarter against rows and columns, to either side."""


def _turned(first: Floats, some: Floats, pads: int) -> Finding | None:
    """Return that the shear runs around a press, from its first frames on, or None if it does not.

    A pad that is turned with its axes is another frame, and shows nothing.
    """
    tried = [replace(order, grid=grid) for grid in (GRID, *GRIDS) for order in TURNS]
    fits = list[list[float]]()
    for presses in (first, some):
        fits.append([])
        for order in tried:
            placed = np.moveaxis(pad_pressed(Order(grid=order.grid).of(presses), pads), -1, 0)
            fits[-1].append(float(np.median(_scored(patterns(placed[2], placed), order))))
    least: Floats = np.asarray(fits, dtype=np.float64).min(axis=0).round(2)
    value, found = float(least.max()), tried[int(least.argmax())]
    if value < CLEAR:
        return None
    said = (
        f"The shear runs around a press ({value:.2f}) from its first frames on: the array was "
        "twisted as it was pressed, or its rows and columns are turned by a quarter against the "
        "axes of the shear, which the keys below turn back."
    )
    others = _other_cures(found, square=first.shape[1] == first.shape[2])
    return Finding("order", said, wrong=False, cure=_keys(found), others=others)


def _other_cures(order: Order, *, square: bool) -> list[dict[str, object]]:
    """Return other keys under which a press looks as under those of an order.

    A mirrored axis looks as a turned shear, a turned normal load as two turned shears, and on a
    square array rows and columns that are swapped as swapped shears.
    """
    result = list[dict[str, object]]()
    swaps = [False, True] if square else [False]
    for swap, z, x, y in product(swaps, *[[False, True]] * 3):
        # either the shear of an axis is turned or the axis itself
        signs = list(order.signs)
        if z:
            signs = [-sign for sign in signs]
        flip = [name for name, back in (("rows", y), ("cols", x)) if back]
        signs[0] *= -1.0 if x else 1.0
        signs[1] *= -1.0 if y else 1.0
        grid, channels = order.grid, order.channels
        if swap:
            names = {"rows": "cols", "cols": "rows"}
            grid = (
                names.get(grid[0], grid[0]),
                names.get(grid[1], grid[1]),
                names.get(grid[2], grid[2]),
            )
            channels = (channels[1], channels[0], channels[2])
            signs = [signs[1], signs[0], signs[2]]
            flip = [names[axis] for axis in flip]
        other = Order(channels, (signs[0], signs[1], signs[2]), grid)
        keys = _keys(other) | ({"flip": flip} if flip else {})
        if signs[2] > 0.0 or order.signs[2] < 0.0:
            result.append(keys)
    own = _keys(order)
    result = [keys for keys in result if keys and keys != own]
    return sorted(result, key=lambda keys: len(str(keys)))[:ALTERNATIVES]


def _keys(order: Order) -> dict[str, object]:
    """Return the keys of a layout for an order."""
    keys: dict[str, object] = {}
    if order.grid != GRID:
        keys["order"] = " ".join(("frames", *order.grid))
    if order.names() != ["x", "y", "z"]:
        keys["channels"] = order.names()
    return keys


ALTERNATIVES = 7
"""Other cures that are listed, the shortest first."""


def _by_levels(rest: Floats, moved: Floats) -> Finding | None:
    order = levelled(rest, moved)
    if order is None:
        return None
    cure = " ".join(("frames", *order.grid))
    said = (
        "The numbers at rest are mixed in all channels, and would be alike in each if "
        f"{GRIDS[order.grid]}"
    )
    others: list[dict[str, object]] = []
    if rest.shape[0] == rest.shape[1]:
        other = " ".join({"rows": "cols", "cols": "rows"}.get(n, n) for n in cure.split())
        said += f", or with rows and columns swapped, '{other}': a press shows which"
        others = [{"order": other}]
    return Finding("order", f"{said}.", cure={"order": cure}, others=others)


def sentence_of(order: Order, value: float, present: float) -> tuple[str, bool, dict[str, object]]:
    """Return a sentence on an order that is wrong, that it is, and its cure."""
    cure: dict[str, object] = {}
    parts: list[str] = []
    if order.grid != GRID:
        parts.append(GRIDS[order.grid])
        cure["order"] = " ".join(("frames", *order.grid))
    names = order.names()
    if order.channels != (0, 1, 2):
        named = f"the channels are {', '.join(n.lstrip('-') for n in names)}"
        swapped = order.channels == (1, 0, 2) and order.grid == GRID
        parts.append(f"{named}, or rows and columns are swapped" if swapped else named)
    turned = [name.lstrip("-") for name in names if name.startswith("-")]
    if turned == ["z"]:
        parts.append("the sign of z is turned, or those of both x and y")
    elif turned:
        other = {"x": "columns", "y": "rows"}
        parts.append(
            f"the sign of {' and '.join(turned)} is turned, or the "
            f"{' and the '.join(other[name] for name in turned)} count from the other end"
        )
    if names != ["x", "y", "z"]:
        cure["channels"] = names
    said = (
        f"The shear does not point away from a press as it should ({present:.2f} of 1): it would "
        f"({value:.2f}) if {', and '.join(parts)}."
    )
    return said, True, cure
