"""The final state of a saturated array whose cells only pull each other along, one by one.

A cell falls once its neighbours no longer hold it, which in turn weakens the hold on them. The
order in which cells are processed does not change which of them fall, so a queue of falling cells
suffices (`cnnum.runs.wavefront` explains why). A rising array is the same with all signs reversed.
"""

import math

import numpy as np
from numpy.typing import NDArray

from cnnum.arrays import Floats
from cnnum.engines.numba.compiling import ROOM, inlined, kept

END, MIXED, GREY = 0, 1, 2
"""Outcomes: the end is known; cells may go both ways, or too close to tell; the start is grey."""


def front(
    start: NDArray[np.floating],
    held: NDArray[np.bool_],
    drive: Floats,
    feedback: tuple[NDArray[np.int64], NDArray[np.int64], Floats],
    centre: float,
    rim: tuple[int, float],
    sign: float,
    margin: float,
    *,
    alone: bool = False,
) -> tuple[int, float, Floats]:
    """Let every cell fall that its neighbours no longer hold.

    Parameters
    ----------
    start : (rows, cols) float
        States, each at or beyond 1 or −1.
    held : (rows, cols) bool, or (0, 0)
        Cells that stay as they are.
    drive : (rows, cols) float
        Constant part of the rates: B ∗ u + z. It is overwritten.
    feedback : (rows, columns and weights), each (couplings,)
        Offsets and weights of the couplings to other cells; no weight is below 0.
    centre : float
        Weight of a cell's own output, above 1.
    rim : (kind, value)
        0: virtual cells have that output; 1: zero-flux; 2: periodic.
    sign : float
        1 for cells that fall, −1 for cells that rise.
    margin : float
        By which roundings may move a sum; 0 where sums are exact, and then a cell that sees just
        what holds it stays.
    alone : bool
        Cells at −1 stay there, whatever they see; the state is then no equilibrium.

    Returns
    -------
    outcome : int
    time : float
        Time constants after which all outputs are those at the end, at most.
    state : (rows, cols) float
        The equilibrium that the array comes to.
    """
    return _front(start, held, drive, *feedback, centre, *rim, sign, margin, alone)


def drive_of(
    u: NDArray[np.floating],
    bias: NDArray[np.floating],
    shape: tuple[int, int],
    control: tuple[NDArray[np.int64], NDArray[np.int64], Floats],
    constant: float,
    rim: tuple[int, float],
) -> tuple[Floats, float, float]:
    """Return the constant part of the rates, B ∗ u + z, as `front` takes it.

    Parameters
    ----------
    u : (rows, cols) float, or (0, 0) without an input
    bias : (rows, cols) float, or (0, 0)
        Added to `constant`.
    shape : (rows, cols)
    control : (rows, columns and weights), each (couplings,)
    constant : float
    rim : (kind, value)
        As `front` takes it, here of the input.

    Returns
    -------
    drive : (rows, cols) float64
    largest, most : float
        Largest magnitudes of the input and of the bias; NaN if they contain NaN.
    """
    return _driven(u, bias, shape, *control, constant, *rim)


@inlined
def _folded(place: int, count: int, kind: int) -> int:
    """Return the cell that a virtual one beyond the rim copies."""
    if kind == 2:
        return place % count
    return -1 - place if place < 0 else 2 * count - 1 - place if place >= count else place


@inlined
def _largest(numbers: NDArray[np.floating]) -> float:
    """Return the largest magnitude, NaN if there is one."""
    columns = np.zeros(numbers.shape[1])  # one for each column, so that the loop vectorises
    for r in range(numbers.shape[0]):
        for c in range(columns.size):
            size, known = abs(float(numbers[r, c])), columns[c]
            columns[c] = known if size <= known or known != known else size
    largest = 0.0
    for size in columns:
        largest = largest if size <= largest or largest != largest else size
    return largest


@kept
def _driven(
    u: NDArray[np.floating],
    bias: NDArray[np.floating],
    shape: tuple[int, int],
    downs: NDArray[np.int64],
    rights: NDArray[np.int64],
    weights: Floats,
    constant: float,
    kind: int,
    value: float,
    room: int = ROOM,
) -> tuple[Floats, float, float]:
    rows, cols = shape
    drive = np.empty((rows, cols))
    for r in range(rows):
        row = drive[r]
        for c in range(cols):
            row[c] = constant
        if bias.size:
            for c in range(cols):
                row[c] += float(bias[r, c])
        for k in range(weights.size):
            w, right, a = weights[k], rights[k], r + downs[k]
            out = a < 0 or a >= rows
            if out and kind == 0:
                for c in range(cols):
                    row[c] += w * value
                continue
            seen = u[_folded(a, rows, kind) if out else a]
            first, last = max(0, -right), min(cols, cols - right)
            for c in range(first):
                row[c] += w * (value if kind == 0 else float(seen[_folded(c + right, cols, kind)]))
            # an index that may be negative would keep the loop from being vectorised
            inner, to = seen[first + right : last + right], row[first:last]
            for c in range(to.size):
                to[c] += w * float(inner[c])
            for c in range(last, cols):
                row[c] += w * (value if kind == 0 else float(seen[_folded(c + right, cols, kind)]))
    return drive, _largest(u), _largest(bias)


@inlined
def _fall(total: float, centre: float, largest: float) -> float:
    """Return the time constants in which a cell falls from the largest state to -1, at most.

    Above 1 it decays towards `centre + total`, which is below 1; between 1 and -1 it moves away
    from an equilibrium that lies above 1.
    """
    end = centre + total
    slope = centre - 1.0
    above = -total / slope
    return math.log((largest - end) / (1.0 - end)) + math.log((above + 1.0) / (above - 1.0)) / slope


@inlined
def _see_less(
    seer: int,
    lost: float,
    edge: float,
    s: Floats,
    y: NDArray[np.int8],
    queue: NDArray[np.int32],
    count: int,
    level: float,
) -> tuple[int, float]:
    """Let a cell see less, and put it into the queue if that no longer holds it.

    Returns
    -------
    count : int
        Cells in the queue.
    level : float
        What the one among those that fall next sees which is held best.
    """
    total = float(s[seer] - lost)
    s[seer] = total
    if y[seer] == 1 and total < edge:
        y[seer] = -1
        queue[count] = seer
        return count + 1, max(level, total)
    return count, level


@kept
def _front(
    start: NDArray[np.floating],
    held: NDArray[np.bool_],
    drive: Floats,
    downs: NDArray[np.int64],
    rights: NDArray[np.int64],
    weights: Floats,
    centre: float,
    kind: int,
    value: float,
    sign: float,
    margin: float,
    alone: bool,
    room: int = ROOM,
) -> tuple[int, float, Floats]:
    rows, cols = start.shape
    couplings = weights.size
    radius = 0
    for k in range(couplings):
        radius = max(radius, abs(downs[k]), abs(rights[k]))
    wide = cols + 2 * radius
    # outputs with virtual cells around them; those of constant rims are added below
    y = np.zeros((rows + 2 * radius) * wide, np.int8)
    largest = 1.0
    grey = False
    for r in range(rows):
        row = y[(r + radius) * wide + radius : (r + radius) * wide + radius + cols]
        for c in range(cols):
            x = float(sign * start[r, c])
            grey |= not (x >= 1.0 or x <= -1.0)
            row[c] = 1 if x > 0.0 else -1
            largest = max(largest, x)
    if grey:
        return GREY, 0.0, drive
    if kind > 0:
        for r in range(-radius, rows + radius):
            for c in range(-radius, cols + radius):
                if not (0 <= r < rows and 0 <= c < cols):
                    if kind == 2:
                        a, b = r % rows, c % cols
                    else:
                        a = -1 - r if r < 0 else 2 * rows - 1 - r if r >= rows else r
                        b = -1 - c if c < 0 else 2 * cols - 1 - c if c >= cols else c
                    y[(r + radius) * wide + c + radius] = y[(a + radius) * wide + b + radius]
    s = np.empty(y.size)  # what every cell sees, where its output lies in `y`
    most = -math.inf
    anywhere = held.size > 0
    queue = np.empty(rows * cols, np.int32)
    count = 0
    mixed = False
    level = -math.inf  # of the cells that fall next, the one that is held best
    for r in range(rows):
        own = (r + radius) * wide + radius
        for c in range(cols):
            s[own + c] = sign * drive[r, c]
        for k in range(couplings):
            seen = y[own + downs[k] * wide + rights[k] :]
            w = weights[k]
            for c in range(cols):
                s[own + c] += w * seen[c]
            if kind == 0 and value != 0.0:
                a = r + downs[k]
                out = a < 0 or a >= rows
                for c in range(cols if out else min(cols, max(0, -rights[k]))):
                    s[own + c] += w * (sign * value)
                if not out:
                    for c in range(max(0, cols - max(0, rights[k])), cols):
                        s[own + c] += w * (sign * value)
        for c in range(cols):
            total = float(s[own + c])
            most = max(most, total)
            if anywhere and held[r, c]:
                continue
            if y[own + c] < 0:
                mixed |= not (alone or total - centre <= -1.0 - margin)
            elif centre + total < 1.0 - margin:
                queue[count] = own + c
                count += 1
                level = max(level, total)
        if mixed:
            return MIXED, 0.0, drive
    largest = max(largest, centre + most)
    flat = downs * wide + rights
    lost = 2.0 * weights
    edge = 1.0 - margin - centre
    for k in range(count):
        y[queue[k]] = -1
    # from here on, 1 says that a cell may still fall
    for r in range(-radius, rows + radius):
        for c in range(-radius, cols + radius):
            if not (0 <= r < rows and 0 <= c < cols):
                y[(r + radius) * wide + radius + c] = 0
            elif anywhere and held[r, c]:
                y[(r + radius) * wide + radius + c] *= 2
    first, last, time = 0, count, 0.0
    while first < last:
        time += _fall(level, centre, largest)
        level = -math.inf
        for at in range(first, last):
            place = queue[at]
            for k in range(couplings):
                seer = place - flat[k]
                count, level = _see_less(seer, lost[k], edge, s, y, queue, count, level)
            if kind == 0:
                continue
            r, c = place // wide - radius, place % wide - radius
            if radius <= r < rows - radius and radius <= c < cols - radius:
                continue
            for i in range(-1, 2):  # the virtual cells that copy it
                for j in range(-1, 2):
                    if kind == 2:
                        p, q = r + i * rows, c + j * cols
                    else:
                        p = r if i == 0 else -1 - r if i < 0 else 2 * rows - 1 - r
                        q = c if j == 0 else -1 - c if j < 0 else 2 * cols - 1 - c
                    here = i == 0 and j == 0
                    beyond = not (-radius <= p < rows + radius and -radius <= q < cols + radius)
                    if here or beyond:
                        continue
                    for k in range(couplings):
                        a, b = p - downs[k], q - rights[k]
                        if 0 <= a < rows and 0 <= b < cols:
                            seer = (a + radius) * wide + radius + b
                            count, level = _see_less(seer, lost[k], edge, s, y, queue, count, level)
        first, last = last, count
    for r in range(rows):
        own = (r + radius) * wide + radius
        for c in range(cols):
            if anywhere and held[r, c]:
                drive[r, c] = start[r, c]
            elif y[own + c] > 0:
                mixed |= not (centre + s[own + c] >= 1.0 + margin)
                drive[r, c] = sign * (centre + s[own + c])
            else:
                drive[r, c] = sign * (s[own + c] - centre)
    return (MIXED if mixed else END), time, drive
