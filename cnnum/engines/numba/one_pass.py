"""Binary outputs that one pass over the input determines, row by row, without a transient.

`cnnum.runs.decided` explains why the transients end at these outputs.
"""

from _thread import allocate_lock, start_new_thread
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from cnnum.arrays import Floats
from cnnum.engines.numba.compiling import ROOM, compiled, inlined, kept, most_cores
from cnnum.engines.numba.records import Ints

Real = TypeVar("Real", np.float32, np.float64)

BLOCK = 32
"""Rows that are copied before they are processed, so that they stay in a core's cache."""

GROUP = 768
"""Numbers processed together, since a row may be short; eight such groups fit a cache."""

SHARED = 1 << 17
"""Cells from which all cores are used; starting a thread takes as long as some ten thousand
cells."""


@dataclass(frozen=True, slots=True, eq=False)
class Seen:
    """Pictures with their rims, as they were read.

    Attributes
    ----------
    wide : (frames, rows + 2 radius, cols + 2 radius) float
    radius : int
    """

    wide: NDArray[Any]
    radius: int

    @property
    def inner(self) -> NDArray[Any]:
        """The pictures, (frames, rows, cols)."""
        edge = slice(self.radius, -self.radius or None)
        return self.wide[:, edge, edge]


def signs(
    u: NDArray[Real],
    start: NDArray[Real],
    places: NDArray[np.int64],
    weights: NDArray[Real],
    levels: tuple[float, float, float],
    rim: tuple[int, float],
) -> tuple[Floats, Seen] | None:
    """Return 1 where a weighted sum of the input is high, −1 where it is low.

    Parameters
    ----------
    u : (frames, rows, cols) float
    start : (frames, rows, cols) float, or of no size
        Another map, added with its own weight, the last of `weights`.
    places : (couplings, 2) int
        Rows and columns of the neighbours.
    weights : (couplings + 1,) float
    levels : (constant, high, low)
        The constant added to each sum, and the levels from which it is high and up to which it is
        low.
    rim : (kind, value)
        0: virtual cells have that input; 1: zero-flux; 2: periodic.

    Returns
    -------
    (frames, rows, cols) float64, and the input
        None if a sum is neither, or a number of a map is beyond 1.
    """
    # three or nine neighbours at a time, so that sums are seldom read and written
    spare = -len(places) % (THREE if len(places) <= THREE else NINE)
    where = np.vstack([places, np.zeros((spare, 2), np.int64)])
    padded = np.concatenate([weights[:-1], np.zeros(spare, u.dtype)])
    real: Any = u.dtype.type
    numbers = (real(weights[-1]), *(real(level) for level in levels))
    seen, out = _around(u, places), np.empty(u.shape)
    scene: Any = (u.shape[1:], start.ravel(), _flat(where, seen), padded, numbers)
    around: Any = (rim[0], real(rim[1]), seen.radius)
    into: Any = (around, seen.wide.ravel(), out.ravel())
    take: Any = _signs

    def rows(first: int, last: int) -> bool:
        return bool(take(u.ravel(), *scene, first, last, *into))

    return (out, seen) if _by_cores(rows, u) else None


def ranks(
    u: NDArray[Real],
    start: float | None,
    places: NDArray[np.int64],
    between: tuple[int, int],
    shift: float,
    rim: tuple[int, float],
) -> tuple[Floats, Seen] | None:
    """Return the start of every cell, kept between two neighbours by their rank.

    Parameters
    ----------
    u : (frames, rows, cols) float
    start : float or None
        None: the input.
    places : (neighbours, 2) int
    between : (lower, upper)
        Ranks from 0 on; −1 where there is no such bound.
    shift : float
        Added to both.
    rim : (kind, value)
        As `signs` takes it.

    Returns
    -------
    (frames, rows, cols) float64, within −1 and 1, and the input
        None if a number of the input is beyond 1.
    """
    seen, out = _around(u, places), np.empty(u.shape)
    begun = (0.0, 0) if start is None else (start, 1)
    steps: Any = comparisons(len(places), between)
    scene: Any = (u.shape[1:], begun, _flat(places, seen), *steps, between, shift)
    around: Any = (rim[0], u.dtype.type(rim[1]), seen.radius)
    into: Any = (around, seen.wide.ravel(), out.ravel())
    take: Any = _ranks

    def rows(first: int, last: int) -> bool:
        return bool(take(u.ravel(), *scene, first, last, *into))

    return (out, seen) if _by_cores(rows, u) else None


def _around(u: NDArray[Real], places: NDArray[np.int64]) -> Seen:
    radius = int(np.abs(places).max(initial=0))
    frames, rows, cols = u.shape
    return Seen(np.empty((frames, rows + 2 * radius, cols + 2 * radius), u.dtype), radius)


def _flat(places: NDArray[np.int64], seen: Seen) -> NDArray[np.int64]:
    """Return the offsets of the neighbours from the first virtual cell."""
    row, col = (places + seen.radius).T
    flat: Ints = row * seen.wide.shape[2] + col
    return flat


def _by_cores(rows: Callable[[int, int], bool], u: NDArray[np.floating]) -> bool:
    """Process all rows of all frames, on all cores if many; return whether all succeeded."""
    total = u.shape[0] * u.shape[1]
    count = min(most_cores(), total) if u.size >= SHARED else 1
    if count == 1:
        return rows(0, total)
    ends = [total * n // count for n in range(count + 1)]
    went, busy = [False] * count, [allocate_lock() for _ in range(count)]

    def share(n: int) -> None:
        try:
            went[n] = rows(ends[n], ends[n + 1])
        finally:
            busy[n].release()

    for n, lock in enumerate(busy):
        lock.acquire()
        if n:  # `Thread.start` would wait until it runs
            start_new_thread(share, (n,))
    share(0)
    for lock in busy:
        lock.acquire()
    return all(went)


# Loops are over places of flat arrays, which are known to be 0 or more: a slice for each row would
# count its users, on which cores wait for each other, and a negative place would be looked for.


@compiled
def _copied(source: NDArray[Real], begin: int, to: NDArray[Real], place: int, count: int) -> int:
    """Copy a row, and return whether an element is beyond 1 or NaN."""
    beyond = 0
    if begin >= 0 and place >= 0:
        for c in range(count):
            x = source[begin + c]
            to[place + c] = x
            beyond |= int(not abs(x) <= 1.0)
    return beyond


@compiled
def _fill(
    u: NDArray[Real],
    shape: tuple[int, int],
    frame: int,
    first: int,
    last: int,
    rim: tuple[int, Real, int],
    wide: NDArray[Real],
) -> int:
    """Copy some rows of a frame with their rims; return whether an element is beyond 1."""
    (rows, cols), (kind, value, radius) = shape, rim
    stride, beyond = cols + 2 * radius, 0
    top = frame * (rows + 2 * radius) + radius
    for r in range(first - radius, last + radius):
        into = (top + r) * stride
        if kind == 0 and not 0 <= r < rows:
            for c in range(into, into + stride):
                wide[c] = value
            continue
        if kind == 2:
            source = r % rows
        else:
            source = -1 - r if r < 0 else 2 * rows - 1 - r if r >= rows else r
        row = (frame * rows + source) * cols
        beyond |= _copied(u, row, wide, into + radius, cols)
        for k in range(1, radius + 1):
            left, right = u[row + k - 1], u[row + cols - k]
            if kind == 0:
                left = right = value
            elif kind == 2:
                left, right = right, left
            wide[into + radius - k] = left
            wide[into + radius + cols + k - 1] = right
    return beyond


THREE, NINE = 3, 9

EIGHT, MIDDLE = 8, (3, 4)
"""Neighbours of a median of nine cells, and the ranks from 0 on between which it keeps a cell."""

LESSER, GREATER = 1, 2
"""What a comparison keeps of two numbers; both are 3."""


@compiled
def _three(
    sums: NDArray[Real],
    count: int,
    wide: NDArray[Real],
    row: int,
    at: Ints,
    by: NDArray[Real],
    k: int,
    constant: Real,
) -> None:
    """Add three weighted rows, the first three to the constant."""
    a, b, d = row + at[k], row + at[k + 1], row + at[k + 2]
    p, q, r = by[k], by[k + 1], by[k + 2]
    if a >= 0 and b >= 0 and d >= 0:
        for c in range(count):
            total = p * wide[a + c] + q * wide[b + c] + r * wide[d + c]
            sums[c] = (sums[c] if k > 0 else constant) + total


@compiled
def _nine(
    sums: NDArray[Real],
    count: int,
    wide: NDArray[Real],
    row: int,
    at: Ints,
    by: NDArray[Real],
    k: int,
    constant: Real,
) -> None:
    """Add nine weighted rows, the first nine to the constant."""
    a0, a1, a2 = row + at[k], row + at[k + 1], row + at[k + 2]
    a3, a4, a5 = row + at[k + 3], row + at[k + 4], row + at[k + 5]
    a6, a7, a8 = row + at[k + 6], row + at[k + 7], row + at[k + 8]
    w0, w1, w2, w3, w4 = by[k], by[k + 1], by[k + 2], by[k + 3], by[k + 4]
    w5, w6, w7, w8 = by[k + 5], by[k + 6], by[k + 7], by[k + 8]
    inside = a0 >= 0 and a1 >= 0 and a2 >= 0 and a3 >= 0 and a4 >= 0 and a5 >= 0
    if inside and a6 >= 0 and a7 >= 0 and a8 >= 0:
        for c in range(count):
            total = w0 * wide[a0 + c] + w1 * wide[a1 + c] + w2 * wide[a2 + c]
            two = w3 * wide[a3 + c] + w4 * wide[a4 + c] + w5 * wide[a5 + c]
            end = w6 * wide[a6 + c] + w7 * wide[a7 + c] + w8 * wide[a8 + c]
            sums[c] = (sums[c] if k > 0 else constant) + total + two + end


@compiled
def _weigh_start(
    sums: NDArray[Real], row: int, start: NDArray[Real], place: int, weight: Real, count: int
) -> int:
    """Add a weighted row, and return whether an element is beyond 1 or NaN."""
    beyond = 0
    if place >= 0 and row >= 0:
        for c in range(count):
            x = start[place + c]
            sums[row + c] += weight * x
            beyond |= int(not abs(x) <= 1.0)
    return beyond


@compiled
def _decide(
    sums: NDArray[Real], row: int, high: Real, low: Real, to: Floats, place: int, count: int
) -> int:
    """Write the binary output for some sums, and return whether one is neither high nor low."""
    unknown = 0
    if place >= 0 and row >= 0:
        for c in range(count):
            above = sums[row + c] >= high
            unknown |= int(not (above or sums[row + c] <= low))
            to[place + c] = 1.0 if above else -1.0
    return unknown


@kept
def _signs(
    u: NDArray[Real],
    shape: tuple[int, int],
    start: NDArray[Real],
    places: Ints,
    weights: NDArray[Real],
    levels: tuple[Real, Real, Real, Real],
    first: int,
    last: int,
    rim: tuple[int, Real, int],
    wide: NDArray[Real],
    out: Floats,
    room: int = ROOM,
) -> bool:
    rows, cols = shape
    own, constant, high, low = levels
    radius = rim[2]
    stride = cols + 2 * radius
    group = max(1, GROUP // stride)
    sums = np.empty(group * stride, u.dtype)
    at = first
    while at < last:
        frame, begin = at // rows, at % rows
        end = min(rows, begin + BLOCK, begin + last - at)
        unknown = _fill(u, shape, frame, begin, end, rim, wide)
        for r in range(begin, end, group):
            together = min(group, end - r)
            row = (frame * (rows + 2 * radius) + r) * stride
            # what lies between rows is weighed like them, and not looked at
            length = together * stride - 2 * radius
            for c in range(0 if places.size else length):
                sums[c] = constant
            if places.size <= THREE:
                for k in range(0, places.size, THREE):
                    _three(sums, length, wide, row, places, weights, k, constant)
            else:
                for k in range(0, places.size, NINE):
                    _nine(sums, length, wide, row, places, weights, k, constant)
            for n in range(together):
                place = (frame * rows + r + n) * cols
                if start.size:
                    unknown |= _weigh_start(sums, n * stride, start, place, own, cols)
                unknown |= _decide(sums, n * stride, high, low, out, place, cols)
            if unknown:
                return False
        at += end - begin
    return True


@compiled
def _taken_in_order(
    wide: NDArray[Real], a: int, b: int, near: NDArray[Real], i: int, j: int, kept: int, count: int
) -> None:
    """Copy the elementwise minima of two rows to one place, and the maxima to another."""
    if a >= 0 and b >= 0 and i >= 0 and j >= 0:
        if kept & LESSER:
            for c in range(count):
                first, second = wide[a + c], wide[b + c]
                near[i + c] = first if first < second else second
        if kept & GREATER:
            for c in range(count):
                first, second = wide[a + c], wide[b + c]
                near[j + c] = second if first < second else first


@compiled
def _in_order(near: NDArray[Real], i: int, j: int, kept: int, count: int) -> None:
    """Move the elementwise minima of two rows to the first, the maxima to the second."""
    if i < 0 or j < 0:
        return
    if kept == LESSER:
        for c in range(count):
            first, second = near[i + c], near[j + c]
            near[i + c] = first if first < second else second
    elif kept == GREATER:
        for c in range(count):
            first, second = near[i + c], near[j + c]
            near[j + c] = second if first < second else first
    else:
        for c in range(count):
            first, second = near[i + c], near[j + c]
            near[i + c] = first if first < second else second
            near[j + c] = second if first < second else first


@inlined
def _rising(a: Any, b: Any, c: Any, d: Any) -> Any:
    """Return four numbers in rising order."""
    a, b = (a, b) if a < b else (b, a)
    c, d = (c, d) if c < d else (d, c)
    a, c = (a, c) if a < c else (c, a)
    b, d = (b, d) if b < d else (d, b)
    b, c = (b, c) if b < c else (c, b)
    return a, b, c, d


@compiled
def _middle_of_eight(
    wide: NDArray[Real], row: int, at: Ints, near: NDArray[Real], i: int, j: int, count: int
) -> None:
    """Write the fourth and the fifth of eight rows, elementwise in rising order, to two places.

    Of two fours in rising order, the lesser of the first number of one and the last of the other,
    of the second and the third, and so on are the four least of all (Batcher 1968). All is done in
    registers, in half the time of a network that writes rows.
    """
    a0, a1, a2, a3 = row + at[0], row + at[1], row + at[2], row + at[3]
    b0, b1, b2, b3 = row + at[4], row + at[5], row + at[6], row + at[7]
    inside = a0 >= 0 and a1 >= 0 and a2 >= 0 and a3 >= 0 and b0 >= 0 and b1 >= 0
    if inside and b2 >= 0 and b3 >= 0 and i >= 0 and j >= 0:
        for c in range(count):
            p, q, r, s = _rising(wide[a0 + c], wide[a1 + c], wide[a2 + c], wide[a3 + c])
            w, x, y, z = _rising(wide[b0 + c], wide[b1 + c], wide[b2 + c], wide[b3 + c])
            near[i + c] = max(max(min(p, z), min(q, y)), max(min(r, x), min(s, w)))
            near[j + c] = min(min(max(p, z), max(q, y)), min(max(r, x), max(s, w)))


@compiled
def _between(
    wide: NDArray[Real],
    own: int,
    begun: tuple[float, int],
    near: NDArray[Real],
    bounds: tuple[int, int],
    shift: float,
    to: Floats,
    place: int,
    count: int,
) -> None:
    """Write a row that is kept between others, where they are, and all of it within -1 and 1."""
    lower, upper = bounds
    least, most = max(lower, 0), max(upper, 0)
    if place < 0 or own < 0:
        return
    for c in range(count):
        x = begun[0] if begun[1] else float(wide[own + c])
        low = min(max(near[least + c] + shift, -1.0), 1.0) if lower >= 0 else -1.0
        high = min(max(near[most + c] + shift, -1.0), 1.0) if upper >= 0 else 1.0
        x = low if x < low else x
        to[place + c] = high if x > high else x


@kept
def _ranks(
    u: NDArray[Real],
    shape: tuple[int, int],
    begun: tuple[float, int],
    places: Ints,
    pairs: Ints,
    lone: Ints,
    network: Ints,
    between: tuple[int, int],
    shift: float,
    first: int,
    last: int,
    rim: tuple[int, Real, int],
    wide: NDArray[Real],
    out: Floats,
    room: int = ROOM,
) -> bool:
    rows, cols = shape
    radius = rim[2]
    stride = cols + 2 * radius
    group = max(1, GROUP // stride)
    span = group * stride
    near = np.empty(places.size * span, u.dtype)
    at = first
    while at < last:
        frame, begin = at // rows, at % rows
        end = min(rows, begin + BLOCK, begin + last - at)
        if _fill(u, shape, frame, begin, end, rim, wide):
            return False
        for r in range(begin, end, group):
            together = min(group, end - r)
            row = (frame * (rows + 2 * radius) + r) * stride
            length = together * stride - 2 * radius
            middle = places.size == EIGHT and between == MIDDLE
            if middle:
                _middle_of_eight(wide, row, places, near, 3 * span, 4 * span, length)
            for k in range(0 if middle else pairs.shape[0]):
                i, j = int(pairs[k, 0]), int(pairs[k, 1])
                a, b = row + int(places[i]), row + int(places[j])
                _taken_in_order(wide, a, b, near, i * span, j * span, int(pairs[k, 2]), length)
            for k in range(0 if middle else lone.size):
                i = int(lone[k])
                _copied(wide, row + int(places[i]), near, i * span, length)
            for k in range(0 if middle else network.shape[0]):
                i, j = network[k, 0] * span, network[k, 1] * span
                _in_order(near, i, j, int(network[k, 2]), length)
            for n in range(together):
                own = row + (radius + n) * stride + radius
                place = (frame * rows + r + n) * cols
                # a bound that is not there stays below 0
                bounds = (between[0] * span + n * stride, between[1] * span + n * stride)
                _between(wide, own, begun, near, bounds, shift, out, place, cols)
        at += end - begin
    return True


@lru_cache(maxsize=64)
def comparisons(count: int, wanted: tuple[int, ...]) -> tuple[Ints, Ints, Ints]:
    """Return the comparisons of a sorting network for the elements of some ranks.

    Batcher's merge exchange (Knuth, The Art of Computer Programming, vol. 3, 5.2.2 M), without the
    comparisons of which no wanted rank depends.

    Parameters
    ----------
    count : int
    wanted : tuple of int
        Ranks from 0 on; those below 0 are none.

    Returns
    -------
    first : (comparisons, 3) int
        The first ones, as long as no number is compared twice. The third column says what is kept:
        `LESSER` at the first place, `GREATER` at the second, or both.
    lone : (numbers,) int
        Numbers that are not among these.
    later : (comparisons, 3) int
        All others.
    """
    pairs = list[tuple[int, int]]()
    top = 1 << max((count - 1).bit_length() - 1, 0)
    p = top
    while p > 0:
        q, r, d = top, 0, p
        while True:
            pairs += [(i, i + d) for i in range(count - d) if i & p == r]
            if q == p:
                break
            d, q, r = q - p, q >> 1, p
        p >>= 1
    needed, live = list[tuple[int, int, int]](), {n for n in wanted if n >= 0}
    for i, j in reversed(pairs):
        kept = LESSER * (i in live) | GREATER * (j in live)
        if kept:
            needed.insert(0, (i, j, kept))
            live.update((i, j))
    seen, first = set[int](), 0
    while first < len(needed) and not seen.intersection(needed[first][:2]):
        seen.update(needed[first][:2])
        first += 1
    network = np.array(needed, np.int64).reshape(-1, 3)
    lone = np.array(sorted({*range(count)} - seen), np.int64)
    return network[:first], lone, network[first:]
