"""The equilibrium of a linear array on a torus: every drive, weighed by its distance."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cnnum.arrays import Floats, Shape
from cnnum.integrators.exact_ends.propagator import DECAYS
from cnnum.safety.memory import refuse_on_host
from cnnum.templating.network import Network

Waves = NDArray[np.complexfloating]
"""(rows, cols, to, from): a matrix of layers for each wave."""

SHIFTS = "the array is linear on a torus: its equilibrium is a product of shifts"

MOST_WEIGHTS = 1 << 20
"""Weights above which it is not offered: as many as the largest dense product has."""

MOST_CELLS = 1024
"""Cells of a layer above which it is not offered: each cell is a sum over all of them."""

WAVE_BYTES = 80
"""Held at once for a wave of one pair of layers: complex numbers, their inverse and copies."""


@dataclass(frozen=True, slots=True, eq=False)
class Circulant:
    """x = drive ∗ w on a torus: the equilibrium of a linear array there, from any start.

    A coupling on a torus is a convolution, so that it is a factor of each wave, even or not. Of a
    wave the equilibrium is (1 − Â)⁻¹ of its drive, with Â the layers × layers matrix of A.

    Attributes
    ----------
    drive : (layers, layers, rows, cols) float
        As [to, from]: the answer to a drive of 1 of the cell (0, 0).
    rounding : float
        By how much it may be off itself, as a part of the largest number in a drive.
    """

    drive: Floats
    rounding: float = 0.0

    def reach(self, start: Floats, drive: Floats) -> Floats:
        """Return the equilibrium of (..., layers, rows, cols) drives; the start does not count."""
        del start
        waves = np.fft.fft2(self.drive), np.fft.fft2(drive)
        return np.asarray(np.fft.ifft2(np.einsum("tfrc,...frc->...trc", *waves)).real)

    def flops(self, states: int, shape: Shape) -> int:
        """Return the arithmetic from the drive of that many states to their end."""
        del states
        return 2 * int(np.count_nonzero(self.drive.any(axis=(2, 3)))) * (shape[0] * shape[1]) ** 2

    def still(self) -> "Circulant":
        """Return the same without the part of a fixed boundary: a torus has none."""
        return self

    def gain(self, driven: Sequence[int]) -> float:
        """Return the largest state that drives up to 1 of these layers lead to."""
        return float(np.abs(self.drive[:, driven]).sum(axis=(1, 2, 3)).max(initial=0.0))


def shifts_fit(network: Network) -> bool:
    """Whether an array is small enough for a product of all of its cells."""
    rows, cols = network.shape
    cells = rows * cols
    return cells <= MOST_CELLS and network.template.layers**2 * cells <= MOST_WEIGHTS


def circulant(network: Network) -> Circulant | None:
    """Return the equilibrium of an array on a torus, None where there is none.

    There is none where the array is not linear, its boundary is another, or not every wave decays.

    Raises
    ------
    SizeError
        If its waves do not fit into memory.
    """
    template = network.template
    if not (template.plain and template.output.linear) or template.boundary.pad_mode != "wrap":
        return None
    refuse_on_host("The waves of an array", network.shape, WAVE_BYTES * template.layers**2)
    left = np.eye(template.layers) - _waves(network)
    if np.linalg.eigvals(-left / template.tau[:, np.newaxis]).real.max() >= -DECAYS:
        return None
    answers = np.linalg.inv(left)
    drive = np.fft.ifft2(np.moveaxis(answers, (2, 3), (0, 1))).real.copy()
    return Circulant(drive, _rounding(left, answers, network.states))


def _rounding(left: Waves, answers: Waves, states: int) -> float:
    """Return by how much the answer to drives up to 1 may be off.

    Of each wave by the answer to the residual of the inverse. Waves keep lengths: that of a state
    is √states times its largest number at most.
    """
    residual = left @ answers - np.eye(left.shape[-1])
    off = [np.linalg.norm(matrices, 2, axis=(2, 3)) for matrices in (answers, residual)]
    return float(np.sqrt(states) * (off[0] * off[1]).max())


def _waves(network: Network) -> Waves:
    """Return the factors of A for every wave, (rows, cols, layers, layers) complex."""
    A = network.template.A
    radius = int(A.shape[-1]) // 2
    offsets = np.arange(-radius, radius + 1)
    along = [np.exp(2j * np.pi / n * np.outer(np.arange(n), offsets)) for n in network.shape]
    found = np.einsum("ri,tfij,cj->rctf", along[0], A, along[1], optimize=True)
    return np.asarray(found)
