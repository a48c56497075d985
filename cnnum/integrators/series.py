"""States of a linear array soon after a known one: the Taylor series of its equation.

x(t + s) = x(t) + s x'(t) + s²/2 x''(t) + …, where x' = M x + S (w + g), and every further
derivative is M times the one before. With θ = ‖M‖s the remainder after K terms is below
θᴷ e^θ/K! of x'/‖M‖, and the roundings of all terms together grow as e^θ. So times that are no more
than 2/‖M‖ after one whose exponential is known take a few sums over neighbours, and one pass over
the cells for each of them, where an exponential of its own takes n³ operations.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cnnum.arrays import Floats
from cnnum.integrators.solver import Exact
from cnnum.templating.network import Network, taps
from cnnum.templating.template import Template

FARTHEST = 2.0
"""‖M‖s of the last time of a series: its roundings are e² times those of the state then."""

MOST_SERIES = 16
"""One after the other, before the next exponential: together they take about as long as that."""

PARTED = 1.0
"""Differences of states grow no further than to e of that within a stretch."""

EPS = float(np.finfo(np.float64).eps)


@dataclass(frozen=True, slots=True, eq=False)
class Stretch:
    """A state that is known without steps, and later times that a Taylor series reaches.

    Attributes
    ----------
    scheme : Exact
    later : tuple of float
        Times since that state.
    """

    scheme: Exact
    later: tuple[float, ...] = ()


def bounds(template: Template) -> tuple[float, float]:
    """Return bounds on ‖M‖ and on the growth rate of state differences, 1/time (∞ norms)."""
    sizes, middle = np.abs(template.A).sum(axis=(1, 2, 3)), template.A.shape[-1] // 2
    own = np.array([template.A[n, n, middle, middle] for n in range(template.layers)])
    grows = (sizes - np.abs(own) + own - 1.0) / template.tau
    return float(((sizes + 1.0) / template.tau).max()), float(grows.max())


def in_stretches(template: Template, times: Sequence[float]) -> list[tuple[float, ...]]:
    """Return increasing times in groups that a series reaches from their first time."""
    reach, gap = 0.0, 0.0
    if template.output.linear and template.A.any():
        norm, grows = bounds(template)
        gap = FARTHEST / norm
        reach = min(MOST_SERIES * gap, PARTED / grows if grows > 0.0 else math.inf)
    groups: list[list[float]] = []
    for time in times:
        if groups and time - groups[-1][0] <= reach and time - groups[-1][-1] <= gap:
            groups[-1].append(time)
        else:
            groups.append([time])
    return [tuple(group) for group in groups]


def grown(rate: float, since: Floats) -> tuple[Floats, Floats]:
    """Return an error bound at times, given errors of the initial state and of the rates."""
    after = np.expm1(rate * since) / rate if rate else since
    return np.exp(rate * since), np.asarray(after, dtype=np.float64)


def followed(
    network: Network, start: Floats, drive: Floats, later: Sequence[float]
) -> tuple[Floats, Floats]:
    """Return the states of a linear array at times after a start, and a bound on rounding errors.

    Parameters
    ----------
    network : Network
    start, drive : (batch, layers, rows, cols) float
    later : sequence of float
        Increasing, at most `FARTHEST` / ‖M‖ apart.

    Returns
    -------
    (times, batch, layers, rows, cols) float
    (times, batch) float
        Error bound, assuming an exact initial state and drive.
    """
    norm, rate = bounds(network.template)
    states, errors = np.empty((len(later), *start.shape)), np.empty((len(later), len(start)))
    begun, error, since, at = start, np.zeros(len(start)), 0.0, 0
    while at < len(later):
        stop = int(np.searchsorted(later, since + FARTHEST / norm * (1.0 + 1e-9)))
        own: Floats = np.asarray(later[at:stop], dtype=np.float64) - since
        states[at:stop], added = _one_series(network, begun, drive, own)
        errors[at:stop] = grown(rate, own[:, np.newaxis])[0] * error + added
        begun, error, since, at = states[stop - 1], errors[stop - 1], later[stop - 1], stop
    return states, errors


def _one_series(
    network: Network, start: Floats, drive: Floats, later: Floats
) -> tuple[Floats, Floats]:
    """Return the same of times that one series reaches."""
    template = network.template
    norm, _ = bounds(template)
    tau = template.tau[:, np.newaxis, np.newaxis]
    slopes = [(_moved(network, start) + drive + network.rim() - start) / tau]
    for _ in range(_count(norm * float(later[-1])) - 1):
        slopes.append((_moved(network, slopes[-1]) - slopes[-1]) / tau)
    since = later.reshape(-1, *(1,) * start.ndim)
    state = np.zeros((len(later), *start.shape))
    for number in range(len(slopes), 0, -1):
        state *= since
        state += slopes[number - 1]
        state /= number
    state *= since
    state += start
    largest = np.abs(start).max(axis=(1, 2, 3)) + np.abs(slopes[0]).max(axis=(1, 2, 3)) / norm
    sums = float(np.count_nonzero(template.A)) + 4.0
    shares = norm * later * np.exp(norm * later) * sums + 2.0
    return state, EPS * shares[:, np.newaxis] * largest


def _count(turned: float) -> int:
    """Return how many terms leave less than a rounding."""
    count, left = 1, turned * math.exp(turned)
    while left > 0.25 * EPS:
        count += 1
        left *= turned / count
    return count


def _moved(network: Network, maps: Floats) -> Floats:
    """Return A over maps, (batch, layers, rows, cols), whose virtual cells are 0 where fixed."""
    template, (rows, cols) = network.template, network.shape
    radius = template.A.shape[-1] // 2
    around = ((0, 0), (0, 0), (radius, radius), (radius, radius))
    padded = np.pad(maps, around, mode=template.boundary.pad_mode)
    total = np.zeros(maps.shape)
    for layer in range(template.layers):
        for tap in taps(template.A, layer):
            top, left = radius + tap.row, radius + tap.col
            seen = padded[:, tap.source, top : top + rows, left : left + cols]
            total[:, layer] += tap.weight * seen
    return total
