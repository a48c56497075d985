"""From readings under a cover back to the loads on it: cell by cell, and bump by bump.

The small filter that takes the cover's blur off: from readings to the load above each.

It is the least-squares inverse of Love's solution for a load as wide as a taxel's pitch. Under a
cover no thicker than the pitch, 7×7 weights give the pressure's cell averages to a few per cent.
That holds for stress and for strain.

From readings of taxels under a bumpy cover to the load on every bump, by finite elements.

Each bump's load reaches the taxels of its neighbours too. The readings of all bumps are the loads
filtered by the cover's 3×3 influence from bump to bump. This is that filter's inverse.
"""

from functools import cache
from typing import Literal

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from cnnum.errors import PhysicsError
from cnnum.tactile.checks import Array, positive
from cnnum.tactile.cover.bump import BumpCover
from cnnum.tactile.indenters import Reads, Rectangle
from cnnum.tactile.pad import Pad

DECONVOLUTION_RADIUS = 3
"""Cells to each side: beyond, Love's load under a cover of one pitch leaves below 1 %."""

ROUGH = 1e-3
"""Noise power, in powers of the reading of a load on one cell: 3 % of it. Less lets noise through,
more blurs edges."""

DECONVOLUTION_WAVES = 48
"""Wave numbers to each axis at which the inverse is fitted."""

DECONVOLUTION_LEFT = 6
"""Cells to each side of the filter's residual of a load: the ground of contacts up to 12 wide."""

DEEPEST = 2.0
"""Pitches of cover from which nothing narrow is left above the noise."""

SHARP_UP_TO = 1.4
"""Pitches of cover up to which flat bodies are told from smooth ones: with 1 % of noise, `edges`
finds 90 to 100 % of an outline up to 1.3 pitches, and a third of it at 1.7."""


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
    solution = np.linalg.lstsq(rows, wanted, rcond=None)[0]
    kernel = np.asarray(solution[places], dtype=np.float64)
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
    reach = np.arange(
        -DECONVOLUTION_LEFT - DECONVOLUTION_RADIUS, DECONVOLUTION_LEFT + DECONVOLUTION_RADIUS + 1.0
    )
    x, y = np.meshgrid(reach, reach)
    seen = sliding_window_view(Rectangle(1.0, 1.0).normal(x, y, depth, reads), weights.shape)
    # by NumPy, in microseconds: to import the convolution of SciPy takes half a second
    left: Array = -np.einsum("yxij,ij->yx", seen, weights[::-1, ::-1])
    left[DECONVOLUTION_LEFT, DECONVOLUTION_LEFT] += 1.0
    left.setflags(write=False)
    return left


def _love(depth: float, reads: Reads) -> Array:
    """Return readings of a load on one cell, in waves along both axes, (waves²,)."""
    axis = np.arange(DECONVOLUTION_WAVES) - DECONVOLUTION_WAVES // 2
    x, y = np.meshgrid(axis.astype(np.float64), axis.astype(np.float64))
    seen = Rectangle(1.0, 1.0).normal(x, y, depth, reads)
    return np.asarray(np.fft.fft2(np.fft.ifftshift(seen)).real.ravel())


def _shapes() -> tuple[Array, NDArray[np.intp]]:
    """Return the waves of each set of weights that mirroring makes equal, and whose is whose."""
    sides = np.abs(np.arange(-DECONVOLUTION_RADIUS, DECONVOLUTION_RADIUS + 1))
    low, high = np.minimum.outer(sides, sides), np.maximum.outer(sides, sides)
    kinds, which = np.unique(low * (DECONVOLUTION_RADIUS + 1) + high, return_inverse=True)
    places = np.asarray(which, dtype=np.intp).reshape(low.shape)
    turn = 2 * np.pi * np.fft.fftfreq(DECONVOLUTION_WAVES)
    wave = np.exp(1j * np.outer(turn, np.arange(-DECONVOLUTION_RADIUS, DECONVOLUTION_RADIUS + 1)))
    flat = [
        np.einsum("ai,bj,ij->ab", wave, wave, places == kind).real.ravel()
        for kind in range(kinds.size)
    ]
    return np.stack(flat, axis=-1), places


RADIUS = 3
"""Bumps to each side that the inverse reaches."""

WAVES = 24
"""Wave numbers to each axis at which the influence is inverted."""

LEFT = 0.02
"""Most of a load that the inverse may leave at another bump, or misjudge of its own."""

Taxels = Literal["strain", "stress", "pad"]


@cache
def bump_inverse(
    taxels: Taxels, pitch: float, depth: float, spacing: float = 1.5, *, shear: bool = True
) -> Array:
    """Return the weights that turn readings into loads.

    Parameters
    ----------
    taxels : "strain", "stress" or "pad"
        Three-axial taxels under each bump, or pressure taxels read by `Pad`.
    pitch, depth : float
        From bump to bump, and of the taxels below their feet, in bump radii.
    spacing : float
        Spacing of a pad's taxels, in bump radii.
    shear : bool
        Whether the shear is read, too. Without it the loads are taken to be pushes alone.

    Returns
    -------
    (3, 3, 7, 7) float, or (1, 1, 7, 7) without shear
        [load, reading, row, column], of (Q_x, Q_y, P) over E r² for strain and over r² for stress
        and pads. Readings are pushes: −ε or −σ of the three-axial taxels, and the outputs of `Pad`.

    Raises
    ------
    PhysicsError
        If the bumps stand too close for 7×7 weights to separate them to 2 %.
    """
    axis = np.arange(WAVES) - WAVES // 2
    influence = _influence(taxels, pitch, depth, spacing, axis)
    influence = influence if shear else influence[2:, 2:]
    waves = np.fft.fft2(np.fft.ifftshift(influence, axes=(2, 3)))
    matrix = np.moveaxis(waves, (0, 1), (-2, -1))
    undone = np.moveaxis(np.linalg.inv(matrix), (-2, -1), (0, 1))
    whole = np.fft.fftshift(np.fft.ifft2(undone).real, axes=(2, 3))
    middle = slice(WAVES // 2 - RADIUS, WAVES // 2 + RADIUS + 1)
    cut = np.zeros_like(whole)
    cut[..., middle, middle] = whole[..., middle, middle]
    left = np.fft.ifft2(np.einsum("ijab,jkab->ikab", _waves(cut), waves)).real
    left[:, :, 0, 0] -= np.eye(len(left))
    if np.abs(left).max() > LEFT:
        raise PhysicsError(
            f"Bumps {pitch:g} radii apart over taxels {depth:g} radii deep cannot be separated: "
            f"{np.abs(left).max():.0%} of a load would remain, expected at most {LEFT:.0%}."
        )
    # templates correlate, and a filter's weights are met from the other side
    kernel = np.ascontiguousarray(whole[..., middle, middle][..., ::-1, ::-1])
    kernel.setflags(write=False)
    return kernel


def bump_readings(
    loads: Array, taxels: Taxels, pitch: float, depth: float, spacing: float = 1.5
) -> Array:
    """Return the readings of the taxels of all bumps, by summing over the bumps one by one.

    Parameters
    ----------
    loads : (..., rows, cols, 3) float
        (Q_x, Q_y, P) on each bump, in the units of `bump_inverse`.
    taxels, pitch, depth, spacing
        As in `bump_inverse`.

    Returns
    -------
    (..., rows, cols, 3) float
    """
    rows, cols = loads.shape[-3:-1]
    reach = max(rows, cols) - 1
    influence = _influence(
        taxels, pitch, depth, spacing, np.arange(-reach, reach + 1, dtype=np.intp)
    )
    seen = np.zeros(loads.shape)
    for row in range(rows):
        for col in range(cols):
            part = influence[
                :, :, reach - row : reach - row + rows, reach - col : reach - col + cols
            ]
            seen += np.tensordot(loads[..., row, col, :], part.transpose(1, 2, 3, 0), axes=1)
    return seen


def shear_over_normal(reads: Reads, depth: float) -> float:
    """Return what the taxel below a bump reads of a shear force, over an equal normal force.

    It is the cover's own finite elements': |ε_xz/ε_zz| or |σ_xz/σ_zz| of the forces alone. They
    stick to the patch that a rigid plate touches when it presses a quarter of the bump's radius. A
    narrower patch reads more shear, a wider one less: from patches of 0.2 to 0.63 radii the ratio
    of strains one radius deep falls from 0.60 to 0.10, and is 0.33 at the 0.47 of the tables.

    Parameters
    ----------
    reads : "strain" or "stress"
    depth : float
        Depth of the taxel below the bump's foot, in bump radii, 0.5 to 5.

    Returns
    -------
    float

    Raises
    ------
    PhysicsError
        If the depth is out of range.
    """
    cover = BumpCover(depth, 1.0, 1.0)
    of = cover.strain if reads == "strain" else cover.stress
    read = of([0.0, 0.0], [0.0, 0.0], np.eye(3))
    return float(abs(read[0, 0] / read[2, 2]))


def _waves(cut: Array) -> NDArray[np.complex128]:
    return np.fft.fft2(np.fft.ifftshift(cut, axes=(2, 3)))


def _influence(
    taxels: Taxels, pitch: float, depth: float, spacing: float, axis: NDArray[np.intp]
) -> Array:
    """Return [reading, load, row, column] of a bump's load at the others' taxels."""
    x, y = np.meshgrid(pitch * axis, pitch * axis)
    at, force = np.stack([x, y], axis=-1)[:, :, None, :], np.eye(3)
    cover = BumpCover(depth, 1.0, 1.0)
    if taxels == "pad":
        half = spacing / 2
        corners = [(-half, half), (half, half), (-half, -half), (half, -half)]
        four = [-cover.stress([0.0, 0.0], at + corner, force)[..., 2] for corner in corners]
        square = np.stack([four[2], four[3], four[0], four[1]], axis=-1)
        frames = square.reshape(*square.shape[:-1], 2, 2)
        read = Pad.regular((2, 2)).to_three_axial(frames)[..., 0, 0, :]
    else:
        reads: Reads = taxels
        of = cover.strain if reads == "strain" else cover.stress
        read = -of([0.0, 0.0], at, force)
    return np.asarray(np.moveaxis(read, (3, 2), (0, 1)))
