"""Rows and columns that presses show, where only the number of the taxels is known.

Under a press with one peak the load falls with the distance from it. So the loads of a frame rank
as the distances do in the right rows and columns, and not in wrong ones, where a row goes on within
the next.
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

SEEN, FLOOR = 32, 4.0
"""Frames that are looked at, and times the noise below which a taxel bears no load."""

MOST = 4096
"""Taxels up to which presses are looked at."""


def shapes_of(taxels: int) -> list[Shape]:
    """Return the rows and columns that a number of taxels can have; one line is a row."""
    return [(taxels // cols, cols) for cols in range(taxels, 1, -1) if taxels % cols == 0]


def shape_shown(recording: Recording, shapes: Sequence[Shape]) -> Shape | None:
    """Return the rows and columns that the presses of a recording show; None where they show none.

    Parameters
    ----------
    recording : Recording
        Its taxels follow each other row by row, in whatever shape.
    shapes : sequence of (rows, cols)
        Those that its taxels may have.
    """
    good = np.isfinite(recording.values).all(axis=(1, 2, 3))
    values = recording.values[good]
    taxels = values.shape[1] * values.shape[2]
    if len(values) < 10 or taxels > MOST or len(shapes) < 2:
        return None
    rest, noise, _ = rest_and_noise(values, recording.times[good])
    away = ((values - rest) / noise).reshape(len(values), taxels, -1)
    loads = np.sqrt(np.square(away).mean(axis=2))
    tops = loads.max(axis=1)
    # a load on most taxels has no peak that all others lie around
    pressed = np.flatnonzero(
        (tops > max(TOUCH, 0.3 * float(tops.max()))) & (np.median(loads, axis=1) < 0.5 * tops)
    )
    if not len(pressed):
        return None
    chosen = pressed[np.linspace(0, len(pressed) - 1, min(SEEN, len(pressed))).astype(int)]
    fits = [float(np.mean([_fit(loads[n], s) for n in chosen.tolist()])) for s in shapes]
    second, best = sorted(range(len(fits)), key=lambda n: fits[n])[-2:]
    shown = fits[best] >= LEAST and fits[best] - fits[second] >= AHEAD
    return shapes[best] if shown else None


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
