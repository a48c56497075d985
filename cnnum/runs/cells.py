"""The rates of an array on the host in double precision, cell by cell, and bounds on their slopes.

τ dx/dt = w + A y − x + Σ g, with y = f(x) and the nonlinear couplings g. States lie in one row of
n numbers, layer after layer, row-major; so a coupling is a sparse matrix. A delayed coupling counts
as one that sees the present: at rest both are the same.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from cnnum.arrays import Floats, Shape
from cnnum.templating.boundary import Boundary, halo_sources
from cnnum.templating.couplings import NonlinearCoupling
from cnnum.templating.functions import OUTPUT_FUNCTIONS, Table
from cnnum.templating.network import cells_seen
from cnnum.templating.template import Template

Flags = NDArray[np.bool_]
Places = NDArray[np.intp]
Bounds = tuple[Floats, Floats]
"""Lower and upper bounds, elementwise."""

EPSILON = float(np.finfo(np.float64).eps)

SPARE_TERMS = 6
"""Rounding errors of a rate besides those of its sum over neighbours."""


@dataclass(frozen=True, slots=True, eq=False)
class Slopes:
    """Bounds on the Jacobian of τ dx/dt + x over a box of states.

    Attributes
    ----------
    own : (n,) float
        The largest entry on the diagonal.
    others : (n, n) sparse float
        Magnitudes of the off-diagonal entries.
    """

    own: Floats
    others: Any


@dataclass(frozen=True, slots=True, eq=False)
class Pairs:
    """A nonlinear coupling, as one number for each pair of a cell and a neighbour.

    Attributes
    ----------
    coupling : NonlinearCoupling
    to : (m,) int
        The cell that each acts on.
    weights : (m,) float
    near, centre : (m,) int
        Places of both quantities among the n cells of the layers, or the inputs; −1 for a virtual
        cell of a fixed boundary.
    edge : float
        The quantity of virtual cells.
    """

    coupling: NonlinearCoupling
    to: Places
    weights: Floats
    near: Places
    centre: Places
    edge: float

    def quantities(self, maps: Mapping[str, Floats]) -> tuple[Floats, Floats]:
        """Return those of centre and neighbour of every pair."""
        near = np.append(maps[self.coupling.neighbour], self.edge)[self.near]
        centre = maps[self.coupling.centre or self.coupling.neighbour]
        return np.append(centre, self.edge)[self.centre], near

    def values(self, maps: Mapping[str, Floats]) -> Floats:
        """Return the function of every pair, times its weight."""
        return np.asarray(self.weights * self.coupling.value(*self.quantities(maps)))

    def argument(self, maps: Mapping[str, Floats], *, moving: bool = False) -> Floats:
        """Return the argument of every pair's table, or its change if `moving`."""
        edge = 0.0 if moving else self.edge
        near = np.asarray(np.append(maps[self.coupling.neighbour], edge)[self.near])
        if self.coupling.centre is None:
            return near
        centre = np.append(maps[self.coupling.centre], edge)[self.centre]
        return np.asarray(self.coupling.sign * (centre - near))

    def argument_sizes(self, maps: Mapping[str, Floats], edge: float) -> Floats:
        """Return the size of what is added up in every argument, of sizes of the quantities."""
        near = np.asarray(np.append(maps[self.coupling.neighbour], edge)[self.near])
        if self.coupling.centre is None:
            return near
        return np.asarray(near + np.append(maps[self.coupling.centre], edge)[self.centre])

    def argument_bounds(self, low: Mapping[str, Floats], high: Mapping[str, Floats]) -> Bounds:
        """Return bounds on the functions' arguments where quantities are within bounds."""
        (centre_low, near_low), (centre_high, near_high) = (
            self.quantities(low), self.quantities(high))  # fmt: skip
        if self.coupling.centre is None:
            return near_low, near_high
        least, most = centre_low - near_high, centre_high - near_low
        return (least, most) if self.coupling.sign > 0.0 else (-most, -least)

    def slope_bounds(self, low: Mapping[str, Floats], high: Mapping[str, Floats]) -> Bounds:
        """Return bounds on the derivative of the function by its argument, or by both of a pair."""
        function = self.coupling.function
        if not isinstance(function, Table):
            most = np.full(len(self.to), function.slope)
            return -most, most
        least, most = self.argument_bounds(low, high)
        return table_slopes(function, least, most, times=self.coupling.times_argument)

    def entries(self) -> list[tuple[str, Places, float]]:
        """Return the quantity, the place and the factor of each part of the arguments."""
        coupling, sign = self.coupling, self.coupling.sign
        if not isinstance(coupling.function, Table):
            assert coupling.centre is not None
            return [(coupling.neighbour, self.near, 1.0), (coupling.centre, self.centre, 1.0)]
        if coupling.centre is None:
            return [(coupling.neighbour, self.near, 1.0)]
        return [(coupling.neighbour, self.near, -sign), (coupling.centre, self.centre, sign)]


def table_slopes(table: Table, low: Floats, high: Floats, *, times: bool = False) -> Bounds:
    """Return the least and the largest slope of a table's function between two arguments.

    Parameters
    ----------
    table : Table
        Where it jumps, its slope there is infinite.
    low, high : (m,) float
    times : bool
        The function is the table's times the argument.
    """
    places, values = np.array(table.points).T
    if table.interpolation == "constant":
        cuts = places[:-1]
        jumps = np.searchsorted(cuts, low, side="left") != np.searchsorted(cuts, high, side="left")
        most = np.where(jumps, np.inf, 0.0)
        least = -most
        slopes = np.zeros(len(values) + 1)
    else:
        slopes = np.concatenate([[0.0], np.diff(values) / np.diff(places), [0.0]])
        first = np.searchsorted(places, low, side="right")
        last = np.maximum(np.searchsorted(places, high, side="left"), first)
        least, most = np.full(len(low), np.inf), np.full(len(low), -np.inf)
        for piece, slope in enumerate(slopes):
            inside = (first <= piece) & (piece <= last)
            least = np.where(inside, np.minimum(least, slope), least)
            most = np.where(inside, np.maximum(most, slope), most)
    if not times:
        return least, most
    # (g a)' = g' a + g: both factors of both terms are within bounds
    with np.errstate(invalid="ignore"):
        ends = [table(low), table(high)]
        inner = [
            np.where((low <= place) & (place <= high), value, np.nan)
            for place, value in zip(places, values, strict=True)
        ]
        seen = np.stack([*ends, *inner])
        if table.interpolation == "constant":
            beyond = [
                np.where((low <= place) & (place <= high), value, np.nan)
                for place, value in zip(places[:-1], values[1:], strict=True)
            ]
            seen = np.stack([*seen, *beyond]) if beyond else seen
        products = np.stack([least * low, least * high, most * low, most * high])
    products = np.nan_to_num(products, nan=0.0, posinf=np.inf, neginf=-np.inf)
    return products.min(axis=0) + np.nanmin(seen, axis=0), products.max(axis=0) + np.nanmax(
        seen, axis=0
    )


def matrix_of(kernels: Floats, boundary: Boundary, shape: Shape) -> tuple[Any, Floats]:
    """Return kernels cell by cell, (layers · cells, sources · cells), and those of virtual cells.

    Returns
    -------
    matrix : sparse float
    rim : (layers · cells,) float
        The sum of each cell's weights of virtual cells of a fixed boundary.
    """
    layers, sources = kernels.shape[:2]
    cells = shape[0] * shape[1]
    rim = np.zeros(layers * cells)
    to, of, weights = [np.zeros(0, np.intp)], [np.zeros(0, np.intp)], [np.zeros(0)]
    for layer, tap, seen in cells_seen(kernels, boundary, shape):
        inside = np.flatnonzero(seen >= 0)
        rim[layer * cells : (layer + 1) * cells] += np.where(seen < 0, tap.weight, 0.0)
        to.append(inside + layer * cells)
        of.append(seen[inside] + tap.source * cells)
        weights.append(np.full(len(inside), tap.weight))
    places = (np.concatenate(to), np.concatenate(of))
    size = (layers * cells, sources * cells)
    return sparse.csr_matrix((np.concatenate(weights), places), shape=size), rim


def own_output(template: Template) -> bool:
    """Return whether the output function is user-defined, with slopes as declared."""
    return OUTPUT_FUNCTIONS.get(template.output.name) is not template.output


def output_slopes(template: Template, low: Floats, high: Floats) -> Bounds:
    """Return the least and the largest f' of states within bounds."""
    output = template.output
    if own_output(template):
        return np.full_like(low, output.slope[0]), np.full_like(low, output.slope[1])
    if output.name == "standard":
        inside = (low > -1.0) & (high < 1.0)
        touches = (low < 1.0) & (high > -1.0)
        return inside.astype(np.float64), touches.astype(np.float64)
    if output.name == "tanh":
        far = np.minimum(np.maximum(np.abs(low), np.abs(high)), 300.0)
        near = np.where(low * high <= 0.0, 0.0, np.minimum(np.abs(low), np.abs(high)))
        spare = 1e-14  # of roundings
        least, most = np.cosh(far) ** -2.0, np.cosh(np.minimum(near, 300.0)) ** -2.0
        return least * (1.0 - spare), np.minimum(most * (1.0 + spare), 1.0)
    return np.ones_like(low), np.ones_like(low)


class Cells:
    """The couplings of a template on an array, cell by cell.

    Parameters
    ----------
    template : Template
        Its outputs are functions of real numbers: it runs in continuous time.
    shape : (rows, cols)
    """

    def __init__(self, template: Template, shape: Shape) -> None:
        self.template, self.shape = template, shape
        self.count = template.layers * shape[0] * shape[1]
        self.tau = np.repeat(template.tau, shape[0] * shape[1])
        edge = template.boundary.constant
        self._virtual = 0.0 if edge is None else float(template.output.numpy(np.asarray(edge)))
        matrix, rim = matrix_of(template.A, template.boundary, shape)
        self.rim, self.rim_size = self._virtual * rim, np.abs(self._virtual * rim)
        sizes = abs(matrix)
        self.delays = template.delayed is not None and bool(template.delayed.A.any())
        self.late: Any = None
        if self.delays:
            assert template.delayed is not None
            late, more = matrix_of(template.delayed.A, template.boundary, shape)
            matrix, sizes = (matrix + late).tocsr(), sizes + abs(late)
            self.rim = self.rim + self._virtual * more
            self.late = late
        self.matrix, self.sizes = matrix, sizes
        self.diagonal = matrix.diagonal()
        off = sizes.tocoo()
        beside = off.row != off.col
        places = (off.row[beside], off.col[beside])
        self.beside = sparse.csr_matrix((off.data[beside], places), shape=matrix.shape)
        self.pairs = tuple(
            self.pairs_of(coupling) for coupling in template.nonlinear if not coupling.static
        )
        per_row = int(np.diff(sizes.tocsr().indptr).max(initial=0))
        per_row += sum(int(np.bincount(pair.to).max(initial=0)) for pair in self.pairs)
        self.roundings = (per_row + int(np.count_nonzero(template.B)) + SPARE_TERMS) * EPSILON

    def pairs_of(self, coupling: NonlinearCoupling) -> Pairs:
        """Return a nonlinear coupling as pairs of cells."""
        template, (rows, cols) = self.template, self.shape
        cells, radius = rows * cols, coupling.weights.shape[0] // 2
        boundary = template.input_boundary if coupling.neighbour == "u" else template.boundary
        around = halo_sources(boundary, self.shape, radius)
        here = np.arange(cells)
        to: list[NDArray[np.intp]] = []
        near: list[NDArray[np.intp]] = []
        weights: list[Floats] = []
        for row, col in np.argwhere(coupling.weights):
            seen = around[row : row + rows, col : col + cols].ravel()
            to.append(here + coupling.to * cells)
            near.append(np.where(seen >= 0, seen + coupling.source * cells, -1))
            weights.append(np.full(cells, coupling.weights[row, col]))
        source = coupling.centre_source if coupling.centre else coupling.source
        empty = np.zeros(0, np.intp)
        centre = np.tile(here + source * cells, len(to)) if to else empty
        edge = self._virtual if coupling.neighbour == "y" else boundary.constant or 0.0
        return Pairs(
            coupling,
            np.concatenate(to) if to else empty,
            np.concatenate(weights) if weights else np.zeros(0),
            np.concatenate(near) if near else empty,
            centre,
            edge,
        )


@dataclass(slots=True, eq=False)
class Frame:
    """One frame of an array: its drive, and which cells move.

    Parameters
    ----------
    cells : Cells
    given : mapping of str to (maps, rows, cols) float
        Input, bias and mask, as far as the run is given them.
    """

    cells: Cells
    given: Mapping[str, Floats]
    drive: Floats = field(init=False)
    drive_size: Floats = field(init=False)
    moving: Flags = field(init=False)
    inputs: Floats = field(init=False)

    def __post_init__(self) -> None:
        cells, template, given = self.cells, self.cells.template, self.given
        size = template.layers, cells.shape[0] * cells.shape[1]
        drive = np.repeat(template.z, size[1]) + cells.rim
        drive_size = np.abs(np.repeat(template.z, size[1])) + cells.rim_size
        self.inputs = np.asarray(given["input"], np.float64).ravel() if "input" in given else (
            np.zeros(0))  # fmt: skip
        if template.inputs and "input" in given:
            kernels = [template.B] + ([template.delayed.B] if template.delayed else [])
            edge = template.input_boundary.constant or 0.0
            for kernel in kernels:
                matrix, rim = matrix_of(kernel, template.input_boundary, cells.shape)
                drive = drive + matrix @ self.inputs + edge * rim
                drive_size = drive_size + abs(matrix) @ np.abs(self.inputs) + np.abs(edge * rim)
        if "bias" in given:
            bias = np.broadcast_to(given["bias"], (size[0], *cells.shape)).ravel()
            drive, drive_size = drive + bias, drive_size + np.abs(bias)
        maps = {"u": self.inputs}
        for coupling in template.nonlinear:
            if coupling.static:
                pairs = cells.pairs_of(coupling)
                values = pairs.values(maps)
                drive = drive + np.bincount(pairs.to, values, cells.count)
                drive_size = drive_size + np.bincount(pairs.to, np.abs(values), cells.count)
        moving = np.ones(cells.count, dtype=bool)
        if "mask" in given:
            held = np.broadcast_to(given["mask"] != 0.0, (size[0], *cells.shape))
            moving &= ~held.ravel()
        self.drive, self.moving = drive, moving
        self.drive_size = np.asarray(drive_size, dtype=np.float64)

    def start(self) -> Floats:
        """Return the states at the start, at which masked cells stay."""
        cells, template, given = self.cells, self.cells.template, self.given
        if "state" in given:
            start = np.asarray(given["state"], np.float64).ravel()
        elif template.initial == "input":
            start = np.asarray(given["input"], np.float64).ravel()
        else:
            start = np.full(cells.count, float(template.initial))
        return np.clip(start, -1.0, 1.0) if template.output.limited else np.array(start)

    def maps(self, x: Floats) -> dict[str, Floats]:
        """Return states, outputs and inputs, as nonlinear couplings read them."""
        y = np.asarray(self.cells.template.output.numpy(x), dtype=np.float64)
        return {"x": x, "y": y, "u": self.inputs}

    def rates(self, x: Floats) -> tuple[Floats, Floats]:
        """Return τ dx/dt at states, and a bound on its rounding errors; 0 in cells held fixed."""
        cells, maps = self.cells, self.maps(x)
        rate = self.drive + cells.matrix @ maps["y"] - x
        size = self.drive_size + cells.sizes @ np.abs(maps["y"]) + np.abs(x)
        for pairs in cells.pairs:
            values = pairs.values(maps)
            rate = rate + np.bincount(pairs.to, values, cells.count)
            size = size + np.bincount(pairs.to, np.abs(values), cells.count)
        rate = np.where(self.moving, rate, 0.0)
        return rate, np.where(self.moving, cells.roundings * size, 0.0)

    def pushed(self, x: Floats, reach: Floats) -> Flags:
        """Return the cells of a limited state that stay at a limit throughout a box."""
        if not self.cells.template.output.limited:
            return np.zeros(len(x), dtype=bool)
        rate, rounded = self.rates(x)
        slopes = self.slopes(x - reach, x + reach)
        with np.errstate(invalid="ignore"):
            # the rates hold, whatever a limited cell's own state
            away = slopes.others @ reach + np.maximum(slopes.own, 1.0) * reach + rounded
            return np.asarray((np.abs(x) >= 1.0) & (rate * np.sign(x) > away) & self.moving)

    def slopes(self, low: Floats, high: Floats) -> Slopes:
        """Return bounds on the Jacobian of the couplings where states are within bounds."""
        cells, template = self.cells, self.cells.template
        if template.output.limited:
            low, high = np.clip(low, -1.0, 1.0), np.clip(high, -1.0, 1.0)
        least, most = output_slopes(template, low, high)
        steepest = np.maximum(np.abs(least), np.abs(most))
        own = np.maximum(cells.diagonal * least, cells.diagonal * most)
        if cells.delays:  # the delayed state differs from the current one
            late = cells.late.diagonal()
            now = cells.diagonal - late
            own = np.maximum(now * least, now * most) + np.abs(late) * steepest
        others: Any = cells.beside.multiply(steepest)
        others = others.tocsr()
        if not cells.pairs:
            return Slopes(own, others)
        below, above = self.maps(low), self.maps(high)
        if own_output(template) and template.output.slope[0] < 0.0:
            middle, half = 0.5 * (low + high), 0.5 * (high - low)
            y = np.asarray(template.output.numpy(middle), dtype=np.float64)
            below["y"], above["y"] = y - steepest * half, y + steepest * half
        for pairs in cells.pairs:
            slow, fast = pairs.slope_bounds(below, above)
            scaled = np.stack([pairs.weights * slow, pairs.weights * fast])
            scaled = np.nan_to_num(scaled, nan=0.0, posinf=np.inf, neginf=-np.inf)
            table = isinstance(pairs.coupling.function, Table)
            same = pairs.coupling.centre == pairs.coupling.neighbour
            moot = table & same & (pairs.near == pairs.centre)
            for quantity, place, factor in pairs.entries():
                if quantity == "u":
                    continue
                there = np.flatnonzero((place >= 0) & ~moot)
                to, of = pairs.to[there], place[there]
                part = factor * scaled[:, there]
                if quantity == "y":
                    part = np.concatenate([part * least[of], part * most[of]])
                    part = np.nan_to_num(part, nan=0.0, posinf=np.inf, neginf=-np.inf)
                mine = to == of
                np.add.at(own, to[mine], part.max(axis=0)[mine])
                sizes = np.abs(part).max(axis=0)[~mine]
                add = sparse.csr_matrix((sizes, (to[~mine], of[~mine])), shape=others.shape)
                others = (others + add).tocsr()
        return Slopes(own, others)

    def jacobian(self, x: Floats) -> Any:
        """Return the Jacobian of τ dx/dt at states, as a sparse matrix."""
        cells, template = self.cells, self.cells.template
        least, most = output_slopes(template, x, x)
        slope = 0.5 * (least + most)
        if own_output(template):
            step = 1e-6
            f = template.output.numpy
            slope = np.asarray((f(x + step) - f(x - step)) / (2.0 * step), dtype=np.float64)
        result: Any = cells.matrix.multiply(slope)
        result = result.tocsr() - sparse.identity(cells.count, format="csr")
        for pairs in cells.pairs:
            maps = self.maps(x)
            centre, near = pairs.quantities(maps)
            step = 1e-7
            if pairs.coupling.centre is None:
                parts = [(pairs.coupling.neighbour, pairs.near, (
                    pairs.coupling.value(centre, near + step)
                    - pairs.coupling.value(centre, near - step)) / (2.0 * step))]  # fmt: skip
            else:
                value = pairs.coupling.value
                by_near = (value(centre, near + step) - value(centre, near - step)) / (2.0 * step)
                by_own = (value(centre + step, near) - value(centre - step, near)) / (2.0 * step)
                parts = [
                    (pairs.coupling.neighbour, pairs.near, by_near),
                    (pairs.coupling.centre, pairs.centre, by_own),
                ]
            for quantity, place, steep in parts:
                if quantity == "u":
                    continue
                there = np.flatnonzero(place >= 0)
                to, of = pairs.to[there], place[there]
                part = pairs.weights[there] * steep[there]
                if quantity == "y":
                    part = part * slope[of]
                result = result + sparse.csr_matrix((part, (to, of)), shape=result.shape)
        return result.tocsr()
