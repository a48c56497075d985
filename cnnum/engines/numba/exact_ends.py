"""Ends that are known without a step, of a whole batch in NumPy.

A frame gives the same bits alone and in any batch: products are summed in one order.
"""

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from typing import Any, Literal

import numpy as np

from cnnum.arrays import Floats, Shape
from cnnum.engines.numba.cells import add
from cnnum.engines.numba.compiling import ROOM, kept
from cnnum.engines.numba.records import Real, Reals
from cnnum.integrators.exact_ends import (
    Circulant,
    Decay,
    Propagator,
    Separate,
    Spectral,
    evaluate,
    passes_in_fours,
    rounded_gain,
    roundings,
)
from cnnum.integrators.solver import Exact
from cnnum.templating.template import Template


@dataclass(frozen=True, slots=True, eq=False)
class ExactEnd:
    """A scheme without steps in the numbers of the engine.

    Attributes
    ----------
    scheme : Exact
    rounding : float
        Its rounding error, as a part of the largest number in it.
    """

    scheme: Exact
    rounding: float

    @classmethod
    def of(cls, template: Template, shape: Shape, scheme: Exact, dtype: Real) -> "ExactEnd":
        """Return the end of a scheme."""
        rounding = float(np.finfo(dtype).eps) * _roundings(template, shape, scheme)
        rounding += scheme.rounding
        if isinstance(scheme, Separate):  # evaluated in float64
            return cls(scheme, rounding)
        # of a dense product column after column
        order: Literal["F", "C"] = "F" if isinstance(scheme, Propagator) else "C"
        parts: dict[str, Any] = {
            field.name: np.array(getattr(scheme, field.name), dtype, order=order)
            for field in fields(scheme)
        }
        return cls(replace(scheme, **parts), rounding)

    def reach(self, state: Reals, drive: Reals, held: Reals) -> Reals:
        """Set states to those at the end; return the error that rounding leaves, (batch,).

        Parameters
        ----------
        state, drive : (batch, layers, rows, cols) float
        held : (batch or 1, layers, rows, cols) bool
            Cells that stay as they are.
        """
        scheme = self.scheme
        largest = np.maximum(_largest(state), _largest(drive))
        if isinstance(scheme, Separate):
            numbers = state.astype(np.float64), drive.astype(np.float64)
            ends, rounded = evaluate(scheme, *numbers, self.rounding)
            end: Reals = ends
            largest = _largest(np.where(held, np.abs(state), rounded))
        else:
            end = _ENDS[type(scheme)](scheme, state, drive)
        if isinstance(scheme, Propagator) and scheme.constant.any():
            largest = np.maximum(largest, 1.0)  # the sum of a rim counts in units of 1
        state[...] = np.where(held, state, end)
        return np.asarray(self.rounding * largest)


def _largest(maps: Reals) -> Floats:
    return np.asarray(np.abs(maps).max(axis=(1, 2, 3)), dtype=np.float64)


def _decayed(scheme: Any, start: Reals, drive: Reals) -> Reals:
    return np.asarray(scheme.reach(start, drive))


def _propagated(scheme: Propagator, start: Reals, drive: Reals) -> Reals:
    batch = len(start)
    ends = np.tile(scheme.constant, (batch, 1))
    for matrix, maps in ((scheme.state, start), (scheme.drive, drive)):
        add_products(np.ascontiguousarray(maps).reshape(batch, -1), matrix.T, ends)
    return ends.reshape(start.shape)


def _through_modes(scheme: Spectral, start: Reals, drive: Reals) -> Reals:
    modes, back = np.zeros_like(start), np.ascontiguousarray(scheme.rows.T)
    into = np.ascontiguousarray(scheme.cols.T)
    for factors, maps in ((scheme.state, start), (scheme.drive, drive)):
        for source in range(maps.shape[1]):
            if factors[:, source].any():
                seen = _both_sides(scheme.rows, maps[:, source], into)
                for to in range(maps.shape[1]):
                    modes[:, to] += factors[to, source] * seen
    ends = [_both_sides(back, modes[:, to], scheme.cols) for to in range(modes.shape[1])]
    return np.stack(ends, axis=1) + scheme.constant


def _around_torus(scheme: Circulant, start: Reals, drive: Reals) -> Reals:
    (batch, layers), cells = drive.shape[:2], drive.shape[2:]
    ends = np.zeros((layers, drive[:, 0].size), drive.dtype)
    by_layer = np.moveaxis(drive, 1, 0)
    for shift in np.ndindex(*cells):
        seen = np.roll(by_layer, shift, axis=(2, 3)).reshape(layers, -1)
        add_products(np.ascontiguousarray(scheme.drive[:, :, *shift]), seen, ends)
    return np.moveaxis(ends.reshape(layers, batch, *cells), 0, 1)


_ENDS: dict[type, Callable[[Any, Reals, Reals], Reals]] = {
    Decay: _decayed,
    Propagator: _propagated,
    Spectral: _through_modes,
    Circulant: _around_torus,
}


def _both_sides(left: Reals, maps: Reals, right: Reals) -> Reals:
    """Return left · map · right of maps (batch, rows, cols); 0 of maps that are."""
    found = np.zeros(maps.shape, maps.dtype)
    for frame, values in enumerate(maps):
        if values.any():
            halfway = np.zeros(values.shape, values.dtype)
            add_products(left, np.ascontiguousarray(values), halfway)
            add_products(halfway, right, found[frame])
    return found


@kept
def add_products(left: Reals, right: Reals, totals: Reals, room: int = ROOM) -> None:
    """Add left · right to totals, (n, m) · (m, k) to (n, k), in one order on every machine.

    Libraries add up in an order that depends on the number of their threads.
    """
    whole = len(right) - len(right) % 4
    for row in range(len(left)):
        total, weights = totals[row], left[row]
        for at in range(0, whole, 4):
            a, b, c, d = weights[at], weights[at + 1], weights[at + 2], weights[at + 3]
            first, second, third, fourth = right[at], right[at + 1], right[at + 2], right[at + 3]
            for i in range(total.size):
                total[i] += (a * first[i] + b * second[i]) + (c * third[i] + d * fourth[i])
        for at in range(whole, len(right)):
            add(weights[at], right[at], total)


def _roundings(template: Template, shape: Shape, scheme: Exact) -> float:
    """Return how many roundings of the largest number an end holds at most.

    A sum of n rounded products is off by at most n roundings of its largest value.
    """
    if isinstance(scheme, Separate):
        return roundings(template)
    if isinstance(scheme, Decay):
        return float(np.count_nonzero(template.B)) + 4.0
    if isinstance(scheme, Propagator):
        return _of_products(template, scheme)
    if isinstance(scheme, Circulant):
        sums = shape[0] * shape[1] * float(passes_in_fours(template.layers).max())
        # a weight as it is held, its product, its sum of four, and a cell's drive
        return (
            0.5 * max(scheme.gain(range(template.layers)), 1.0) * (sums + 5.0 + _control(template))
        )
    gains = (float(np.abs(part).sum(axis=1).max()) for part in (scheme.state, scheme.drive))
    # modes keep lengths, so that they spread roundings over the cells and do not add them up
    return (2.0 * sum(shape) + 2.0) * max(sum(gains), 1.0)


def _of_products(template: Template, scheme: Propagator) -> float:
    """Return the same of products that are added up as `add_products` does it."""
    sums = passes_in_fours(len(scheme.constant))
    added = float(sums.max(initial=0.0))
    own = 1.0 + 2.0 + 2.0  # the product, its sum of four, and matrix and state as they are held
    control = _control(template)
    later = own + sums
    parts, times = [scheme.drive], [later + control]
    if scheme.state.any():
        parts, times = [scheme.state, *parts], [later + added, *times]
    rim = np.abs(scheme.constant).max(initial=0.0) * (2.0 * added + 2.0)
    return 0.5 * (max(rounded_gain(parts, times), 1.0) + float(rim))


def _control(template: Template) -> float:
    """Return how often the drive of a cell is rounded, about."""
    return float(np.count_nonzero(template.B) / template.layers) + 2.0
