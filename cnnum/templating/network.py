"""A template on an array of given size: its couplings cell by cell, and the bounds that follow.

Also the maps that the couplings of a template read, and how much they may change a rate. Engines
and integrators query these functions, so a new kind of coupling is described only here.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cnnum.arrays import Floats, Shape
from cnnum.templating.boundary import Boundary, halo_sources
from cnnum.templating.couplings import NonlinearCoupling, Quantity
from cnnum.templating.template import Template


def _read_by(coupling: NonlinearCoupling, quantity: Quantity) -> bool:
    return quantity in (coupling.neighbour, coupling.centre)


def reads_states(template: Template) -> bool:
    """Return whether a coupling reads the states (not outputs) of cells."""
    return any(_read_by(coupling, "x") for coupling in template.nonlinear)


def reads_outputs(template: Template) -> bool:
    """Return whether a coupling reads the outputs of cells."""
    return bool(template.A.any()) or any(_read_by(c, "y") for c in template.nonlinear)


def reads_inputs(template: Template) -> bool:
    """Return whether a coupling reads inputs."""
    return bool(template.B.any()) or reads_inputs_around(template)


def reads_inputs_around(template: Template) -> bool:
    """Return whether any cell is driven by its neighbours' inputs."""
    radius = template.B.shape[-1] // 2
    around = template.B.copy()
    around[..., radius, radius] = 0.0
    couples = any(_read_by(coupling, "u") for coupling in template.nonlinear)
    return bool(around.any()) or delays_inputs(template) or couples


def moving_inputs(template: Template) -> list[int]:
    """Return the inputs that the cells keep reading during the transient."""
    moving = [coupling for coupling in template.nonlinear if not coupling.static]
    result = {coupling.source for coupling in moving if coupling.neighbour == "u"}
    return sorted(result | {c.centre_source for c in moving if c.centre == "u"})


def delays_outputs(template: Template) -> bool:
    """Return whether the template has a delayed A."""
    return template.delayed is not None and bool(template.delayed.A.any())


def delays_inputs(template: Template) -> bool:
    """Return whether the template has a delayed B."""
    return template.delayed is not None and bool(template.delayed.B.any())


def lag(template: Template, step: float) -> int:
    """Return the delay in steps, 0 if there is none."""
    return 0 if template.delayed is None else round(template.delayed.delay / step)


def jumps(template: Template) -> bool:
    """Return whether rates are discontinuous in the states, which no error estimate covers."""
    return any(coupling.jumps for coupling in template.nonlinear)


def bends(template: Template) -> bool:
    """Return whether rates may have kinks as functions of the state, as with tables."""
    return not template.output.smooth or any(not c.static for c in template.nonlinear)


def autonomous(template: Template) -> bool:
    """Return whether a run may be restarted at any time: nothing is delayed or varies in time."""
    return template.delayed is None and not template.gains


def turning_points(template: Template, duration: float) -> tuple[float, ...]:
    """Return the times at which a gain has a jump or a kink, which no step may cross."""
    places = {place for gain in template.gains for place, _ in gain.table.points}
    return tuple(sorted(place for place in places if 0.0 < place < duration))


def last_change(template: Template) -> float:
    """Return the time from which on no gain changes."""
    last = 0.0
    for gain in template.gains:
        places = [place for place, _ in gain.table.points]
        if gain.table.interpolation == "constant":
            places = places[:-1]  # its last value begins at the point before
        last = max(last, *places[-1:], 0.0)
    return last


def gains_jump(template: Template) -> bool:
    """Return whether a gain in time is piecewise constant, so that it jumps."""
    return any(gain.table.interpolation == "constant" for gain in template.gains)


def widened(template: Template) -> Floats:
    """Return how much |dx/dt|·τ of each layer may change in addition to A, (layers,)."""
    total = np.zeros(template.layers)
    for gain in template.gains:
        weights = float(np.abs(template.A[gain.to, gain.source]).sum())
        total[gain.to] += max(gain.table.largest - 1.0, 0.0) * weights
    total *= template.output.steepest
    for coupling in template.nonlinear:
        total[coupling.to] += coupling.stiffness
    return total


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


def cells_seen(
    kernels: Floats, boundary: Boundary, shape: Shape
) -> Iterator[tuple[int, Tap, NDArray[np.int64]]]:
    """Yield every non-zero weight of A or B with the cell that it reads for each cell.

    Parameters
    ----------
    kernels : (layers, sources, k, k) float
    boundary : Boundary
        Boundary of the map that the weights read.
    shape : (rows, cols)

    Yields
    ------
    layer : int
    tap : Tap
    seen : (cells,) int
        Row-major index of a cell; −1 for a virtual cell of a fixed boundary.
    """
    radius = kernels.shape[-1] // 2
    halo = halo_sources(boundary, shape, radius)
    for layer in range(len(kernels)):
        for tap in taps(kernels, layer):
            top, left = radius + tap.row, radius + tap.col
            yield layer, tap, halo[top : top + shape[0], left : left + shape[1]].ravel()


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
        edge = template.boundary.constant or 0.0
        for layer, tap, seen in cells_seen(template.A, template.boundary, self.shape):
            rows = slice(layer * n, (layer + 1) * n)
            columns = slice(tap.source * n, (tap.source + 1) * n)
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
