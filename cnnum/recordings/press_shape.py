"""Rows and columns inferred from presses, if only the number of taxels is known.

Under a press with one peak, the load falls with the distance from it. In the right rows and columns
the loads of a frame therefore rank like the distances; in wrong ones, where rows wrap into each
other, they do not.
"""

from collections.abc import Sequence

import numpy as np

from cnnum.arrays import Floats, Shape
from cnnum.recordings.checking import TOUCH, rest_and_noise
from cnnum.recordings.recording import Recording

AHEAD = 0.15
"""Lead in rank correlation that a shape needs over the next one. Of 28 shapes of up to 64 taxels
under Gaussian and Lorentzian presses it took no wrong one, under domes and ellipses 1 % after one
press and 0.7 % after three."""

LEAST = 0.6
"""Rank correlation from which a shape is shown."""

LIKER, BOTH_WAYS, ONE_WAY = 0.8, 0.1, 0.02
"""Part of other steps between numbers below which these are clearly alike, and parts of the
changes under a press that go the other way, above and below which they do so or not."""

SEEN, FLOOR = 32, 4.0
"""Frames to examine, and the multiple of the noise below which a taxel bears no load."""

MOST = 4096
"""Maximum number of taxels for which presses are examined."""


def shapes_of(taxels: int) -> list[Shape]:
    """Return the possible rows and columns for a number of taxels; one line counts as a row."""
    return [(taxels // cols, cols) for cols in range(taxels, 1, -1) if taxels % cols == 0]


def shape_shown(recording: Recording, shapes: Sequence[Shape]) -> Shape | None:
    """Return the rows and columns that the presses of a recording show, or None if they show none.

    Parameters
    ----------
    recording : Recording
        Its taxels follow each other row by row, in whatever shape.
    shapes : sequence of (rows, cols)
        Those that its taxels may have.
    """
    if len(shapes) < 2:
        return None
    values = recording.values
    best = _best_shapes(recording, values.reshape(len(values), -1, values.shape[3]), shapes)
    shown = bool(best) and best[0][0] >= LEAST and best[0][0] - best[1][0] >= AHEAD
    return best[0][1] if shown else None


READINGS = "channels last", "channels first", "one channel"
"""What a frame of numbers may be: three channels of each taxel in turn, all taxels of a channel in
turn, or one channel."""


def reading_shown(recording: Recording) -> str:
    """Return which of `READINGS` the presses of a recording show; "" where they show none.

    A press moves one channel one way, and nearly alike in neighbours. It moves shears both ways
    around its centre; then the numbers that follow each other are three of a taxel if those three
    apart are more alike, and neighbours in one channel otherwise.

    Parameters
    ----------
    recording : Recording
        Its numbers follow each other in whatever shape; their count is a multiple of three.
    """
    flat = recording.values.reshape(len(recording), -1, 1)
    away = _pressed(recording, flat)[..., 0]
    away = np.where(np.abs(away) > FLOOR, away, 0.0)
    if not away.any():
        return ""
    back = float(np.abs(away[away < 0.0]).sum() / np.abs(away).sum())
    back = min(back, 1.0 - back)
    apart = [float(np.abs(away[:, n:] - away[:, :-n]).sum()) for n in (1, 3)]
    if apart[1] < LIKER * apart[0]:
        return READINGS[0] if back > BOTH_WAYS else ""
    if apart[0] < LIKER * apart[1]:
        return READINGS[1] if back > BOTH_WAYS else READINGS[2] if back < ONE_WAY else ""
    return ""


def _best_shapes(
    recording: Recording, numbers: Floats, shapes: Sequence[Shape]
) -> list[tuple[float, Shape]]:
    """Return shapes and how well they fit (frames, taxels, channels), best first."""
    loads = np.sqrt(np.square(_pressed(recording, numbers)).mean(axis=2))
    fits = [float(np.mean([_fit(load, s) for load in loads])) for s in shapes] if len(loads) else []
    order = sorted(range(len(fits)), key=lambda n: -fits[n])
    return [(fits[n], shapes[n]) for n in order]


def _pressed(recording: Recording, numbers: Floats) -> Floats:
    """Return frames of (frames, taxels, channels) under presses, in times the noise."""
    good = np.isfinite(numbers).all(axis=(1, 2))
    values, taxels = numbers[good], numbers.shape[1]
    if len(values) < 10 or taxels > MOST:
        return numbers[:0]
    rest, noise, _ = rest_and_noise(values[:, None], recording.times[good])
    away = (values - rest[0]) / noise[0]
    loads = np.sqrt(np.square(away).mean(axis=2))
    tops = loads.max(axis=1)
    # a load on most taxels has no peak that all others lie around
    pressed = np.flatnonzero(
        (tops > max(TOUCH, 0.3 * float(tops.max()))) & (np.median(loads, axis=1) < 0.5 * tops)
    )
    chosen = np.linspace(0, len(pressed) - 1, min(SEEN, len(pressed))).astype(int)
    return np.asarray(away[pressed[chosen]])


def _fit(load: Floats, shape: Shape) -> float:
    """Return the rank correlation of loads with their nearness to the largest."""
    places = np.stack(np.divmod(np.arange(len(load)), shape[1]))
    peak = int(load.argmax())
    others = np.arange(len(load)) != peak
    away = np.hypot(*(places - places[:, [peak]]))[others]
    low, near = np.where(load > FLOOR, load, 0.0)[others], -away
    first, second = (_ranks(part) for part in (low, near))
    size = float(np.sqrt((first @ first) * (second @ second)))
    return float(first @ second) / size if size > 0.0 else 0.0


def _ranks(values: Floats) -> Floats:
    """Return ranks less their mean; equal values share theirs."""
    _, which, counts = np.unique(values, return_inverse=True, return_counts=True)
    ranks: Floats = (np.cumsum(counts) - 0.5 * counts)[which]
    return np.asarray(ranks - ranks.mean())
