"""Where a system of cells goes: Dormand and Prince's method of order 8, compiled.

The steps are those of SciPy's `DOP853`, with its coefficients, its error and its dense output; only
that they are compiled, which takes a hundredth of the time. Nothing here is of the package's own.
"""

import numpy as np
from numba import njit
from scipy import sparse
from scipy.integrate._ivp import dop853_coefficients as dop

STAGES, MORE = 12, 16
A, B, C = dop.A, dop.B, dop.C
E3, E5, D = dop.E3, dop.E5, dop.D
MOST = 8_000
"""Steps of a stretch, after which it is given up."""

CODES = {
    name: code
    for code, name in enumerate(
        ("standard", "full-range", "linear", "tanh", "sign", "soft", "steep")
    )
}


def packed(matrices):
    """Return square matrices as rows of one list: (matrices, n + 1) ends, places, weights."""
    rows = [sparse.csr_matrix(one) for one in matrices]
    firsts = np.cumsum([0, *(one.nnz for one in rows)])
    ends = np.array([one.indptr + first for one, first in zip(rows, firsts, strict=False)])
    return (
        ends.astype(np.int64),
        np.concatenate([one.indices for one in rows]).astype(np.int64),
        np.concatenate([one.data for one in rows]).astype(np.float64),
    )


@njit(cache=True)
def _respond(code, v):
    if code == 0 or code == 1:
        return min(1.0, max(-1.0, v))
    if code == 2:
        return v
    if code == 3:
        return np.tanh(v)
    if code == 5:
        return v / np.sqrt(1.0 + v * v)
    return min(1.0, max(-1.0, 2.0 * v))


@njit(cache=True)
def _between(places, levels, v):
    if v <= places[0]:
        return levels[0]
    for k in range(1, len(places)):
        if v <= places[k]:
            part = (v - places[k - 1]) / (places[k] - places[k - 1])
            return levels[k - 1] + part * (levels[k] - levels[k - 1])
    return levels[-1]


@njit(cache=True)
def _add(ends, places, weights, factor, y, total):
    for row in range(len(ends) - 1):
        value = 0.0
        for at in range(ends[row], ends[row + 1]):
            value += weights[at] * y[places[at]]
        total[row] += factor * value


@njit(cache=True)
def rate(code, limited, pace, rows, still, factors, drive, u, past, bends, taps, points, flat, out):
    """Set dx/dt of a flat state, frame by frame.

    The first matrix is that of all couplings, the second that of delayed ones, which see `past`.
    The others are parts of the first whose gain is other than 1, by `factors`.
    """
    ends, places, weights = rows
    n = len(pace)
    frames = len(flat) // n
    cells = u.shape[1]
    y, x, total = np.empty(n), np.empty(n), np.empty(n)
    for frame in range(frames):
        own = flat[frame * n : frame * n + n]
        for i in range(n):
            x[i] = min(1.0, max(-1.0, own[i])) if limited else own[i]
            y[i] = _respond(code, x[i])
            total[i] = drive[frame, i] - x[i] + still[0, i]
        _add(ends[0], places, weights, 1.0, y, total)
        if len(past):
            _add(ends[1], places, weights, 1.0, past[frame * n : frame * n + n], total)
            total += still[1]
        for g in range(len(factors)):
            _add(ends[2 + g], places, weights, factors[g], y, total)
            total += factors[g] * still[2 + g]
        for t in range(len(taps)):
            b = int(taps[t, 0])
            to, source = int(bends[b, 0]) * cells, int(bends[b, 1]) * cells
            kind, centre, times, edge = bends[b, 2], bends[b, 3], bends[b, 4], bends[b, 5]
            sign, first, last = bends[b, 6], int(bends[b, 7]), int(bends[b, 8])
            for i in range(cells):
                at = int(taps[t, 2 + i])
                if at == cells:
                    v = edge
                elif kind == 0:
                    v = x[source + at]
                elif kind == 1:
                    v = y[source + at]
                else:
                    v = u[frame, at]
                if centre >= 0:
                    here = x[i] if centre == 0 else (y[i] if centre == 1 else u[frame, i])
                    v = sign * (here - v)
                value = _between(points[0, first:last], points[1, first:last], v)
                total[to + i] += taps[t, 1] * (value * v if times else value)
        for i in range(n):
            value = total[i] * pace[i]
            if limited and ((x[i] >= 1.0 and value > 0.0) or (x[i] <= -1.0 and value < 0.0)):
                value = 0.0
            out[frame * n + i] = value


@njit(cache=True)
def _recalled(code, limited, seen, olds, parts, count, t, out):
    """Set outputs at an earlier time, by the dense output of the steps so far."""
    k = min(max(np.searchsorted(seen[: count + 1], t, side="right") - 1, 0), count - 1)
    share = (t - seen[k]) / (seen[k + 1] - seen[k])
    share = min(max(share, 0.0), 1.0)
    for i in range(len(out)):
        value = 0.0
        for row in range(7):
            value += parts[k, 6 - row, i]
            value *= share if row % 2 == 0 else 1.0 - share
        value += olds[k, i]
        out[i] = _respond(code, value)


@njit(cache=True)
def _set_factors(gains, gain_points, at, middle, factors):
    for g in range(len(gains)):
        low, high = int(gains[g, 1]), int(gains[g, 2])
        places, levels = gain_points[0, low:high], gain_points[1, low:high]
        if gains[g, 0] == 1:
            factors[g] = _between(places, levels, at) - 1.0
        else:
            passed = 0
            for place in places:
                passed += 1 if place < middle else 0
            factors[g] = levels[min(passed, len(levels) - 1)] - 1.0


@njit(cache=True)
def _slope(stage, weights, h, x, k, moved, at, middle, net, gains, factors, late, past):
    """Set the state of a stage, and the rate there."""
    code, limited, pace, rows, still, gain_points, drive, u, bends, taps, points = net
    for i in range(len(x)):
        value = 0.0
        for j in range(stage):
            value += weights[j] * k[j, i]
        moved[i] = x[i] + h * value
    _set_factors(gains, gain_points, at, middle, factors)
    seen, olds, parts, count, delay, first = late
    if delay > 0.0:
        if middle < delay or count == 0:
            past[:] = first
        else:
            _recalled(code, limited, seen, olds, parts, count, at - delay, past)
    rate(code, limited, pace, rows, still, factors, drive, u, past, bends, taps, points, moved,
         k[stage])  # fmt: skip


@njit(cache=True)
def _first_step(x, slope, atol, rtol, least, most):
    """Return a length as Hairer, Nørsett & Wanner choose it."""
    d0 = d1 = 0.0
    for i in range(len(x)):
        scale = atol + rtol * abs(x[i])
        d0 += (x[i] / scale) ** 2
        d1 += (slope[i] / scale) ** 2
    d0, d1 = np.sqrt(d0 / len(x)), np.sqrt(d1 / len(x))
    guess = 0.01 * d0 / d1 if d0 > 1e-5 and d1 > 1e-5 else least
    return min(max(guess, least), most)


@njit(cache=True)
def _off(k, h, x, moved, atol, rtol):
    """Return the error of a step over its tolerance."""
    five = three = 0.0
    for i in range(len(x)):
        scale = atol + rtol * max(abs(x[i]), abs(moved[i]))
        e5 = e3 = 0.0
        for j in range(STAGES + 1):
            e5 += E5[j] * k[j, i]
            e3 += E3[j] * k[j, i]
        five += (e5 / scale) ** 2
        three += (e3 / scale) ** 2
    if five == 0.0 and three == 0.0:
        return 0.0
    return abs(h) * five / np.sqrt((five + 0.01 * three) * len(x))


@njit(cache=True)
def _keep(k, h, x, end, old, part):
    """Keep the dense output of a step."""
    for i in range(len(x)):
        change = end[i] - x[i]
        old[i] = x[i]
        part[0, i], part[1, i] = change, h * k[0, i] - change
        part[2, i] = 2.0 * change - h * (k[STAGES, i] + k[0, i])
        for row in range(4):
            value = 0.0
            for j in range(MORE):
                value += D[row, j] * k[j, i]
            part[3 + row, i] = h * value


@njit(cache=True)
def follow(net, gains, delay, start, marks, tolerance, smooth, longest_bent):
    """Return the flat states at marks, and whether all were reached.

    Parameters
    ----------
    net : tuple
        The arguments of `rate` but factors, past and state, with the points of gains.
    gains : (gains, 3) float
        Whether it is linear; the first of its points, and the one after the last.
    delay : float
        0 without one.
    start : (n,) float
    marks : (m,) float
        Rising from 0; steps end at them. Gains jump nowhere else.
    tolerance : float
    smooth : bool
        Whether rates have no corners, so that steps may be long.
    longest_bent : float
        The longest step otherwise.
    """
    limited, n = net[1], len(start)
    found = np.zeros((len(marks), n))
    found[0] = start
    x, moved, k = start.copy(), np.empty(n), np.zeros((MORE, n))
    past = np.empty(n if delay > 0.0 else 0)
    first = np.array([_respond(net[0], v) for v in start])
    factors, count, size = np.zeros(len(gains)), 0, 256 if delay > 0.0 else 1
    seen, olds, parts = np.zeros(size + 1), np.zeros((size, n)), np.zeros((size, 7, n))
    for piece in range(len(marks) - 1):
        low, high = marks[piece], marks[piece + 1]
        middle, whole = 0.5 * (low + high), high - low
        longest = whole if smooth else min(whole, max(longest_bent, whole / 1000.0))
        atol, t, steps = tolerance * min(1.0, max(1e-6, np.abs(x).max())), low, 0
        late = (seen, olds, parts, count, delay, first)
        _slope(0, B, 0.0, x, k, moved, t, middle, net, gains, factors, late, past)
        h = _first_step(x, k[0], atol, tolerance, 1e-6 * whole, longest)
        while t < high:
            steps += 1
            h = min(h, longest)
            if t + h > high - 1e-10 * whole:
                h = high - t
            late = (seen, olds, parts, count, delay, first)
            for stage in range(1, STAGES + 1):
                weights = B if stage == STAGES else A[stage]
                at = t + h if stage == STAGES else t + C[stage] * h
                _slope(stage, weights, h, x, k, moved, at, middle, net, gains, factors, late, past)
            off = _off(k, h, x, moved, atol, tolerance)
            if not np.isfinite(off) or steps > MOST or h < 1e-13 * whole:
                return found, False
            if off >= 1.0:
                h *= max(0.2, 0.9 * off ** (-1.0 / 8.0))
                continue
            if delay > 0.0:
                if count == size:
                    seen = np.concatenate((seen, np.zeros(size)))
                    olds = np.concatenate((olds, np.zeros((size, n))))
                    parts = np.concatenate((parts, np.zeros((size, 7, n))))
                    size *= 2
                    late = (seen, olds, parts, count, delay, first)
                end = moved.copy()
                for stage in range(STAGES + 1, MORE):
                    at = t + C[stage] * h
                    _slope(stage, A[stage], h, x, k, moved, at, middle, net, gains, factors, late,
                           past)  # fmt: skip
                _keep(k, h, x, end, olds[count], parts[count])
                moved[:] = end
                seen[count], seen[count + 1] = t, t + h
                count += 1
            t = high if t + h >= high else t + h
            for i in range(n):
                x[i] = min(1.0, max(-1.0, moved[i])) if limited else moved[i]
            k[0] = k[STAGES]
            h *= 10.0 if off == 0.0 else min(10.0, 0.9 * off ** (-1.0 / 8.0))
        found[piece + 1] = x
    return found, True
