"""A template on an array of given size: its couplings cell by cell, and the bounds that follow."""

from dataclasses import dataclass

import numpy as np

from cnnum.arrays import Floats, Shape
from cnnum.templating.boundary import halo_sources
from cnnum.templating.reads import widened
from cnnum.templating.template import Template


@dataclass(frozen=True, slots=True)
class Tap:
    """One non-zero weight: from a layer (or input), at an offset, into a layer."""

    source: int
    row: int
    col: int
    weight: float


def taps(kernels: Floats, layer: int) -> tuple[Tap, ...]:
    """Return the non-zero weights of A or B into a layer, row by row.

    Parameters
    ----------
    kernels : (layers, sources, k, k) float
    layer : int
    """
    radius = kernels.shape[-1] // 2
    return tuple(
        Tap(
            int(source),
            int(row) - radius,
            int(col) - radius,
            float(kernels[layer, source, row, col]),
        )
        for source, row, col in np.argwhere(kernels[layer])
    )


@dataclass(frozen=True, slots=True, eq=False)
class LinearSystem:
    """dx/dt = M x + S (w + g) of an array in its linear range, layers stacked, cells row-major.

    Attributes
    ----------
    matrix : (n, n) float
        M = S (A − 1) with the state's boundary folded in.
    rates : (n,) float
        Diagonal of S: 1/τ of every cell's layer.
    rim : (n,) float
        g: the sum of virtual cells of a fixed boundary through A.
    """

    matrix: Floats
    rates: Floats
    rim: Floats


@dataclass(frozen=True, slots=True, eq=False)
class Network:
    """A template on an array of rows × cols cells."""

    template: Template
    shape: Shape

    @property
    def cells(self) -> int:
        """Cells of one layer."""
        return self.shape[0] * self.shape[1]

    @property
    def states(self) -> int:
        """Cells of all layers."""
        return self.cells * self.template.layers

    def linear_system(self) -> LinearSystem:
        """Return the array's equations while every output is its state (f(x) = x)."""
        template, n = self.template, self.cells
        matrix = np.zeros((self.states, self.states))
        rim = np.zeros(self.states)
        radius = template.A.shape[-1] // 2
        halo = halo_sources(template.boundary, self.shape, radius)
        edge = template.boundary.constant or 0.0
        for layer in range(template.layers):
            rows = slice(layer * n, (layer + 1) * n)
            for tap in taps(template.A, layer):
                columns = slice(tap.source * n, (tap.source + 1) * n)
                top, left = radius + tap.row, radius + tap.col
                seen = halo[top : top + self.shape[0], left : left + self.shape[1]].ravel()
                inside = np.flatnonzero(seen >= 0)
                matrix[rows, columns][inside, seen[inside]] += tap.weight
                rim[rows] += np.where(seen < 0, tap.weight * edge, 0.0)
        rates = np.repeat(1.0 / template.tau, n)
        return LinearSystem((matrix - np.eye(self.states)) * rates[:, None], rates, rim)

    def rim(self) -> Floats:
        """Return the sum of virtual cells of a fixed boundary through A, (layers, rows, cols)."""
        template, (rows, cols) = self.template, self.shape
        radius = template.A.shape[-1] // 2
        value = template.boundary.constant or 0.0
        ring = np.pad(np.zeros(self.shape), radius, constant_values=value)
        total = np.zeros((template.layers, rows, cols))
        for layer in range(template.layers):
            for tap in taps(template.A, layer):
                top, left = radius + tap.row, radius + tap.col
                total[layer] += tap.weight * ring[top : top + rows, left : left + cols]
        return total

    def fastest_rate(self) -> float:
        """Return a bound on |λ| of the array's Jacobian, in 1/time, whatever cells saturate.

        Gershgorin: row sums of |A| times the largest |f'|, plus the decay.
        """
        template = self.template
        off = template.output.steepest * np.abs(template.A).sum(axis=(1, 2, 3))
        off += widened(template)
        return float(((1.0 + off) / template.tau).max())
