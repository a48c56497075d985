"""Cubic splines through tables; importing those of SciPy takes longer than a scene to begin."""

from dataclasses import dataclass

import numpy as np

from cnnum.arrays import Floats


@dataclass(frozen=True, slots=True, eq=False)
class Spline:
    """A cubic spline whose end pieces go on over the knots next to the ends ("not a knot").

    Attributes
    ----------
    knots : (n,) float
        Rising.
    pieces : (4, n − 1, ...) float
        Of each piece the values, slopes, and coefficients of the square and the cube.
    """

    knots: Floats
    pieces: Floats

    def __call__(self, places: Floats) -> Floats:
        """Return the values at places, (places, ...); beyond the ends the end pieces go on."""
        at = np.asarray(places, dtype=float)
        piece = np.clip(np.searchsorted(self.knots, at, side="right") - 1, 0, len(self.knots) - 2)
        value, slope, square, cube = self.pieces[:, piece]
        away = (at - self.knots[piece]).reshape(at.shape + (1,) * (value.ndim - at.ndim))
        return np.asarray(value + away * (slope + away * (square + away * cube)))


def spline(knots: Floats, values: Floats) -> Spline:
    """Return the spline through values, (n, ...), at knots: a line at two, a parabola at three.

    The slopes solve the usual system: the curvature has no step at the inner knots. The third
    derivative has none at the second knot and the last but one. The source is de Boor, A Practical
    Guide to Splines (1978), chapter IV.
    """
    gaps = np.diff(knots)
    gap = gaps.reshape(-1, *(1,) * (values.ndim - 1))
    rise = np.diff(values, axis=0) / gap
    if len(knots) < 4:
        curvature = np.diff(rise, axis=0).sum(axis=0) / gaps.sum()
        slopes = np.concatenate([rise[:1] - gap[:1] * curvature, rise + gap * curvature])
    else:
        slopes = _slopes(gaps, gap, rise)
    bend = slopes[:-1] + slopes[1:] - 2.0 * rise
    square = (rise - slopes[:-1] - bend) / gap
    return Spline(knots, np.stack([values[:-1], slopes[:-1], square, bend / gap**2]))


def _slopes(gaps: Floats, gap: Floats, rise: Floats) -> Floats:
    """Return the slopes at four knots or more; `gap` are the gaps in the shape of `rise`."""
    count = len(gaps) + 1
    system, wanted = np.zeros((count, count)), np.empty((count, *rise.shape[1:]))
    inner = np.arange(1, count - 1)
    system[inner, inner - 1], system[inner, inner + 1] = gaps[1:], gaps[:-1]
    system[inner, inner] = 2.0 * (gaps[1:] + gaps[:-1])
    wanted[1:-1] = 3.0 * (gap[1:] * rise[:-1] + gap[:-1] * rise[1:])
    for end, (near, far) in ((0, (0, 1)), (-1, (-1, -2))):  # the gap at the end, and the next one
        both = gaps[near] + gaps[far]
        system[end, near], system[end, far] = gaps[far], both
        first = (gaps[near] + 2.0 * both) * gaps[far] * rise[near]
        wanted[end] = (first + gaps[near] ** 2 * rise[far]) / both
    solved = np.linalg.solve(system, wanted.reshape(count, -1))
    return np.asarray(solved.reshape(wanted.shape), dtype=np.float64)
