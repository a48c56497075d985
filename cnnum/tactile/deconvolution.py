"""The small filter that takes the cover's blur off: from readings to the load above each.

It is the least-squares inverse of Love's solution for a load as wide as a taxel's pitch. Under a
cover no thicker than the pitch, 7×7 weights give the pressure's cell averages to a few per cent.
That holds for stress and for strain.
"""

from functools import cache

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from cnnum.errors import PhysicsError
from cnnum.tactile.checks import Array, positive
from cnnum.tactile.indenters import Reads, Rectangle

RADIUS = 3
"""Cells to each side: beyond, Love's load under a cover of one pitch leaves below 1 %."""

ROUGH = 1e-3
"""Noise power, in powers of the reading of a load on one cell: 3 % of it. Less lets noise through,
more rounds edges."""

WAVES = 48
"""Wave numbers to each axis at which the inverse is fitted."""

LEFT = 6
"""Cells to each side of the filter's residual of a load: the ground of contacts up to 12 wide."""

DEEPEST = 2.0
"""Pitches of cover from which an edge is lost in the noise."""


@cache
def unblur_kernel(depth: float, reads: Reads) -> Array:
    """Return the weights that turn a map of readings into the surface load.

    Parameters
    ----------
    depth : float
        Cover above the taxels, in pitches.
    reads : "strain" or "stress"
        The measured quantity, as in `cnnum.tactile.indenters`.

    Returns
    -------
    (7, 7) float
        For stress of sum 1; for strain, which has no mean, as near as 7×7 weights come.

    Raises
    ------
    PhysicsError
        If the depth is not between 0 and 2 pitches.
    """
    positive("depth", depth)
    if depth > DEEPEST:
        raise PhysicsError(f"'depth': expected up to {DEEPEST:g} pitches of cover, got {depth:g}.")
    passes = _love(depth, reads)
    shapes, places = _shapes()
    weights = np.ones(passes.size)
    weights[0] = 1e4 if reads == "stress" else 0.0
    root = np.sqrt(weights)[:, None]
    rows = np.concatenate([root * passes[:, None] * shapes, np.sqrt(ROUGH) * shapes])
    wanted = np.concatenate([root[:, 0], np.zeros(passes.size)])
    found = np.linalg.lstsq(rows, wanted, rcond=None)[0]
    kernel = np.asarray(found[places], dtype=np.float64)
    kernel.setflags(write=False)
    return kernel


@cache
def left_kernel(depth: float, reads: Reads) -> Array:
    """Return the filter's residual of a load on one cell, around it.

    Parameters and errors are those of `unblur_kernel`.

    Returns
    -------
    (13, 13) float
        The load less its filtered reading.
    """
    weights = unblur_kernel(depth, reads)
    reach = np.arange(-LEFT - RADIUS, LEFT + RADIUS + 1.0)
    x, y = np.meshgrid(reach, reach)
    seen = sliding_window_view(Rectangle(1.0, 1.0).normal(x, y, depth, reads), weights.shape)
    # by NumPy, in microseconds: to import the convolution of SciPy takes half a second
    left: Array = -np.einsum("yxij,ij->yx", seen, weights[::-1, ::-1])
    left[LEFT, LEFT] += 1.0
    left.setflags(write=False)
    return left


def _love(depth: float, reads: Reads) -> Array:
    """Return readings of a load on one cell, in waves along both axes, (waves²,)."""
    axis = np.arange(WAVES) - WAVES // 2
    x, y = np.meshgrid(axis.astype(np.float64), axis.astype(np.float64))
    seen = Rectangle(1.0, 1.0).normal(x, y, depth, reads)
    return np.asarray(np.fft.fft2(np.fft.ifftshift(seen)).real.ravel())


def _shapes() -> tuple[Array, NDArray[np.intp]]:
    """Return the waves of each set of weights that mirroring makes equal, and whose is whose."""
    sides = np.abs(np.arange(-RADIUS, RADIUS + 1))
    low, high = np.minimum.outer(sides, sides), np.maximum.outer(sides, sides)
    kinds, which = np.unique(low * (RADIUS + 1) + high, return_inverse=True)
    places = np.asarray(which, dtype=np.intp).reshape(low.shape)
    turn = 2 * np.pi * np.fft.fftfreq(WAVES)
    wave = np.exp(1j * np.outer(turn, np.arange(-RADIUS, RADIUS + 1)))
    flat = [
        np.einsum("ai,bj,ij->ab", wave, wave, places == kind).real.ravel()
        for kind in range(kinds.size)
    ]
    return np.stack(flat, axis=-1), places
