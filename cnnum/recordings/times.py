"""Times of frames: their rate, and the scans missing in pauses."""

import numpy as np
from numpy.typing import NDArray

from cnnum.arrays import Floats

FASTEST = 1e6
"""Hz, above the rate of any array."""

USUAL = 1.5
"""Times the median step up to which a step holds no other scan: half a step to either side."""

DIGITS = 6
"""Decimals of a second in which the clock of a log may count: from 1 s down to 1 µs."""

FEW = 4
"""Scans between two frames up to which a step counts for the rate: a longer one is a pause."""

MOST = 2**52
"""Scans that a pause can leave out."""

ENOUGH = 8
"""Long steps of a coarse clock that show that they are even: fewer may be lost scans."""

NEAR, CAUGHT_UP = 64, 4096
"""Least and most frames after a long step that are looked at: a host that was late hands them on in
a burst."""


def rate_of(times: Floats) -> float:
    """Return the rate of frames from their times, Hz; 0 if it cannot be determined.

    It is the rate of the usual steps. Pauses are ignored, however long they are, and a step in
    which scans were lost counts as that many steps.

    Parameters
    ----------
    times : (frames,) float, s
    """
    times = _whole_ticks(times)
    steps = np.diff(times)
    first = _first_rate(times)
    if not 0.0 < first < FASTEST:
        return 0.0
    ahead = np.diff(_numbers(times, first))
    counted = (steps >= 0.0) & (ahead <= FEW)
    span = float(steps[counted].sum())
    rate = float(ahead[counted].sum()) / span if span > 0.0 else 0.0
    return rate if rate < FASTEST else 0.0


def _whole_ticks(times: Floats) -> Floats:
    """Return times from one tick of a coarse clock to another, where several frames have one."""
    ticks = np.flatnonzero(np.diff(times) > 0.0)
    coarse = len(ticks) > 2 and len(ticks) < len(times) - 1
    return times[ticks[0] + 1 : ticks[-1] + 2] if coarse else times


def _first_rate(times: Floats) -> float:
    """Return the rate of the median step, Hz, or that of all usual steps of a coarse clock."""
    steps = np.diff(times)
    ahead = steps[steps > 0.0]
    if not len(ahead) or not np.isfinite(times).all():
        return 0.0
    forward = steps[steps >= 0.0]
    median = float(np.median(ahead))
    usual = forward[forward <= USUAL * median]
    counted = forward[forward <= max(USUAL * median, median + 1.01 * _digit(times))]
    if len(counted) >= len(usual) + ENOUGH and _even(counted):
        return len(counted) / float(counted.sum())
    middle = float(np.median(forward))
    return 1.0 / middle if middle > 0.0 else len(usual) / float(usual.sum())


def _digit(times: Floats) -> float:
    """Return the last digit of a clock that counts in decimals of a second; 0 if there is none."""
    since = times - times[0]
    for digits in range(DIGITS + 1):
        scaled = since * 10.0**digits
        if np.abs(scaled - np.rint(scaled)).max() < 1e-3:
            return float(10.0**-digits)
    return 0.0


def _even(steps: Floats) -> bool:
    """Return whether steps differ because the clock is coarse, and not because scans were lost.

    Times of even scans that are cut to a digit stay within that digit of a line; steps of two that
    lost scans leave behind walk away from it.
    """
    at, place = np.cumsum(steps), np.arange(len(steps)) - (len(steps) - 1) / 2
    off = at - place * float(place @ at / (place @ place))
    return bool(np.ptp(off) <= 1.2 * float(np.ptp(steps)))


def numbered(
    times: Floats, rate: float, repeated: NDArray[np.bool_] | None = None
) -> NDArray[np.int64]:
    """Return numbers of scans by their times: they jump where scans are missing.

    Parameters
    ----------
    times : (frames,) float, s
        None earlier than the one before.
    rate : float, Hz
        Where the times give none.
    repeated : (frames,) bool, optional
        Frames that repeat the previous scan.

    Returns
    -------
    (frames,) int
        From 0.
    """
    new = np.ones(len(times), np.bool_) if repeated is None else ~repeated
    new[:1] = True
    places = np.flatnonzero(new)
    seen = times[places]
    advance = np.zeros(len(times), np.int64)
    advance[places[1:]] = np.diff(_numbers(seen, rate_of(seen) or rate))
    return np.cumsum(advance)


def _numbers(times: Floats, rate: float) -> NDArray[np.int64]:
    """Return the numbers of new scans."""
    ahead = np.ones(len(times), np.int64)
    ahead[:1] = 0
    bursts = bool((np.diff(times) == 0.0).any())
    for n in np.flatnonzero(np.diff(times) * rate > USUAL).tolist():
        # a host that was late catches up at once; after a loss the frames stay behind
        late = min(CAUGHT_UP, NEAR + round((times[n + 1] - times[n]) * rate))
        after = np.rint((times[n + 1 : n + 2 + late] - times[n]) * rate)
        if bursts and len(after) <= late:
            continue  # the rest of the burst is cut off
        ahead[n + 1] += max(0, int(min((after - np.arange(1, len(after) + 1)).min(), MOST)))
    return np.cumsum(ahead)
