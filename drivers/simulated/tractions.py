"""From the springs of a contact to the traction on every cell of the surface."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cnnum.arrays import Floats
from cnnum.drivers.simulated.springs import Springs, State
from cnnum.tactile.contact import hertz
from cnnum.tactile.grid import Grid

SUBCELLS = 3
"""Points a side in which a cell's traction is averaged."""


@dataclass(frozen=True, slots=True)
class Window:
    """The cells that some contacts reach: everywhere else there is no traction."""

    rows: slice
    cols: slice


class Tractions:
    """Maps of surface traction, for many scans at once.

    Parameters
    ----------
    springs : Springs
    grid : Grid
        Cells of the surface.
    """

    def __init__(self, springs: Springs, grid: Grid) -> None:
        self._springs = springs
        self._grid = grid
        self._rho, self._transform = abel(springs.s)

    def window(self, states: Sequence[State]) -> Window:
        """Return the cells within reach of the contacts."""
        centres = np.array([s.position for s in states])
        reach = np.array([s.contact_radius for s in states])
        return Window(
            _span(centres[:, 1], reach, self._grid.y_edges),
            _span(centres[:, 0], reach, self._grid.x_edges),
        )

    def __call__(self, states: Sequence[State], window: Window) -> Floats:
        """Return (states, rows, cols, 3) float, Pa: q_x, q_y and the pressure, cell averages."""
        rows = _points(self._grid.y[window.rows], self._grid.dy)
        cols = _points(self._grid.x[window.cols], self._grid.dx)
        centres = np.array([s.position for s in states])
        y = rows[None, :, None] - centres[:, 1, None, None]
        x = cols[None, None, :] - centres[:, 0, None, None]
        points = self._at(states, x, y)
        count, high, wide, _ = points.shape
        cells = (count, high // SUBCELLS, SUBCELLS, wide // SUBCELLS, SUBCELLS, 3)
        return self._balanced(states, points.reshape(cells).mean(axis=(2, 4)))

    def _at(self, states: Sequence[State], x: Floats, y: Floats) -> Floats:
        """Return the tractions at points relative to the contacts' centres."""
        rho = np.hypot(x, y)
        shear, twist = self._profiles(states)
        # the circumferential traction is τ/ρ times (-y, x): no direction is lost at the centre
        q_x, q_y, spin = (self._look_up(table, rho) for table in (*shear, twist))
        return np.stack([q_x - spin * y, q_y + spin * x, self._pressure(states, rho)], axis=-1)

    def _profiles(self, states: Sequence[State]) -> tuple[Floats, Floats]:
        """Return q_x, q_y (2, states, ρ), Pa, and τ/ρ (states, ρ), Pa/m."""
        pair = self._springs.pair
        shear = np.stack([s.shear for s in states], axis=1)
        twist = np.stack([s.twist for s in states])
        return (
            pair.tangential_modulus * shear @ self._transform,
            4 * pair.shear_modulus * twist @ self._transform,
        )

    def _look_up(self, table: Floats, rho: Floats) -> Floats:
        """Interpolate each state's profile linearly in ρ."""
        place = rho / self._springs.spacing - 0.5
        left = np.clip(place.astype(np.intp), 0, table.shape[1] - 2)
        share = np.clip(place - left, 0.0, 1.0)
        flat = left.reshape(len(table), -1)
        low = np.take_along_axis(table, flat, 1).reshape(rho.shape)
        high = np.take_along_axis(table, flat + 1, 1).reshape(rho.shape)
        return np.asarray(low + share * (high - low))

    def _pressure(self, states: Sequence[State], rho: Floats) -> Floats:
        pair = self._springs.pair
        loads = np.array([s.load for s in states])[:, None, None]
        return hertz(loads, pair.radius, pair.normal_modulus).pressure(rho)

    def _balanced(self, states: Sequence[State], cells: Floats) -> Floats:
        """Scale each map so that its pressure adds up to the load in spite of the cells."""
        total = cells[..., 2].sum(axis=(1, 2)) * self._grid.cell_area
        loads = np.array([s.load for s in states])
        scale = np.divide(loads, total, out=np.ones_like(loads), where=total > 0)
        return np.asarray(cells * scale[:, None, None, None])


def abel(s: Floats) -> tuple[Floats, Floats]:
    """Return the points ρ and the matrix of f ↦ -(1/π) ∫ f'(s) / √(s² - ρ²) ds from ρ on.

    f is linear between the springs, so every piece is a difference of inverse hyperbolic cosines.
    The points lie midway between the springs.

    Parameters
    ----------
    s : (n,) float
        Distances of the springs, from 0, equally spaced.

    Returns
    -------
    rho : (n - 1,) float
    matrix : (n, n - 1) float
        To be multiplied from the right.
    """
    rho = (s[1:] + s[:-1]) / 2
    ends: Floats = np.asarray(np.arccosh(np.maximum(s[:, None] / rho, 1.0)), dtype=np.float64)
    pieces: Floats = (ends[1:] - ends[:-1]) / (np.pi * (s[1] - s[0]))
    matrix = np.zeros((s.size, rho.size))
    matrix[:-1] += pieces
    matrix[1:] -= pieces
    return rho, matrix


def _span(centres: Floats, reach: Floats, edges: Floats) -> slice:
    """Return the cells between the outermost rims, at least one."""
    low = int((edges <= np.min(centres - reach)).sum()) - 1
    high = int((edges < np.max(centres + reach)).sum())
    low = min(max(low, 0), edges.size - 2)
    return slice(low, max(high, low + 1))


def _points(middles: Floats, size: float) -> Floats:
    offsets = ((np.arange(SUBCELLS) + 0.5) / SUBCELLS - 0.5) * size
    return np.asarray((middles[:, None] + offsets).reshape(-1))
