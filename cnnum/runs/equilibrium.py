"""Whether a state at which an array seems to rest is an equilibrium that it keeps.

Small rates are no proof: a state may pass a bottleneck, or leave a saddle, as slowly as one likes.
Where the output is piecewise linear the array is linear around the state: dx/dt = −M (x − x*), with
M = 1 − A over the cells that are not saturated. There is one:

* No eigenvalue of M has a real part below 0, so that the array does not leave the equilibrium.
* x* lies where the same cells are saturated, so that it exists. How far it is off is known then.

Diagonal dominance shows both for most arrays at once; a factorisation does for the others.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cnnum.arrays import Floats
from cnnum.templating.boundary import Boundary
from cnnum.templating.network import taps
from cnnum.templating.template import Template

Flags = NDArray[np.bool_]

NEAR = 0.01
"""Cells so near to saturation count as linear. An equilibrium that is shown to be nearer than this
leaves all others saturated."""

MOST_LINEAR = 5000
"""Cells in the linear range up to which a factorisation takes less than a second."""

MOST_DENSE = 300
"""Of them where A is not symmetric and all eigenvalues are looked at."""

ROUNDINGS = 8.0
"""Of a rate: those of its terms, as parts of their sum."""


@dataclass(frozen=True, slots=True, eq=False)
class Verdict:
    """The findings on the frames of a batch.

    Attributes
    ----------
    rests : (batch,) bool
        The state is an equilibrium, or one lies within the tolerance or was gone to.
    state : (batch, layers, rows, cols) float
        Where the equilibrium is further away than the tolerance, that one.
    off : (batch,) float
        How far the equilibrium is from that state at most, where there is one.
    """

    rests: Flags
    state: Floats
    off: Floats


def has_certificate(template: Template) -> bool:
    """Return whether equilibria of a template are looked at: its rates are piecewise linear."""
    return template.plain and template.output.name in ("standard", "linear")


def verdict(
    template: Template,
    given: Mapping[str, Floats],
    state: Floats,
    *,
    rtol: float,
    atol: float,
    precision: str,
) -> Verdict:
    """Return whether states are equilibria.

    Parameters
    ----------
    template : Template
        See `has_certificate`.
    given : mapping of str to (batch or 1, maps, rows, cols) float
        Input, bias and mask, as far as the run is given them.
    state : (batch, layers, rows, cols) float
    rtol, atol : float
    precision : str
        In which the engine holds the state.
    """
    tolerance = atol + rtol * np.abs(state)
    rests = _saturated(template, given, state, tolerance)
    off = tolerance.max(axis=(1, 2, 3), initial=0.0)
    if rests.all():
        return Verdict(rests, state, off)
    state = state.copy()
    rest = np.flatnonzero(~rests)
    some = {role: maps if len(maps) == 1 else maps[rest] for role, maps in given.items()}
    array = RatedArray(template, some, state[rest])
    known = array.rounded(float(np.finfo(precision).eps)) | array.dominated(tolerance[rest])
    for number, frame in enumerate(rest):
        found = state[frame] if known[number] else array.equilibrium(number, tolerance[frame])
        if found is not None:
            state[frame], rests[frame] = found, True
    return Verdict(rests, state, off)


def _saturated(
    template: Template, given: Mapping[str, Floats], state: Floats, tolerance: Floats
) -> Flags:
    """Return the frames whose cells are all saturated, and would be by small rates further on."""
    if template.output.linear:
        return np.zeros(len(state), dtype=bool)
    beyond = np.abs(state) >= 1.0 + np.maximum(tolerance, NEAR)
    return _all(beyond | (given["mask"] != 0.0) if "mask" in given else beyond)


class RatedArray:
    """States of an array with their rates."""

    def __init__(self, template: Template, given: Mapping[str, Floats], state: Floats) -> None:
        self.template, self.x = template, state
        self.y = np.asarray(template.output.numpy(state), dtype=np.float64)
        moving = np.ones(state.shape, dtype=bool)
        if "mask" in given:
            moving &= given["mask"] == 0.0
        self.moving = moving
        drive = np.reshape(template.z, (-1, 1, 1)) + given.get("bias", 0.0)
        size = np.abs(drive)
        if template.inputs:
            drive = drive + _sums(template.B, given["input"], template.input_boundary)
            size = size + _sums(np.abs(template.B), np.abs(given["input"]), template.input_boundary)
        self.drive = np.broadcast_to(drive, state.shape)
        rates = self.drive + _sums(template.A, self.y, template.boundary) - state
        self.rates = np.where(moving, rates, 0.0)
        seen = _sums(np.abs(template.A), np.abs(self.y), template.boundary)
        self.sizes = np.abs(state) + seen + size

    def _output(self, state: Floats) -> Floats:
        return state if self.template.output.linear else np.clip(state, -1.0, 1.0)

    def _within(self, limit: float) -> Flags:
        """Return the cells that move within a linear range that is so wide."""
        if self.template.output.linear:
            return self.moving
        return self.moving & (np.abs(self.x) <= limit)

    def rounded(self, epsilon: float) -> Flags:
        """Return the frames whose rates are no more than roundings, so that nothing moves."""
        return _all(np.abs(self.rates) <= ROUNDINGS * epsilon * self.sizes)

    def dominated(self, tolerance: Floats) -> Flags:
        """Return the frames that are sure to come nearer to an equilibrium within the tolerance."""
        A, linear = self.template.A, self._within(1.0 + NEAR)
        middle = A.shape[-1] // 2
        own = np.einsum("llkk->lk", A)[:, middle].reshape(-1, 1, 1)
        others = np.abs(A)
        for layer in range(len(A)):
            others[layer, layer, middle, middle] = 0.0
        seen = _sums(others, linear.astype(np.float64), self.template.boundary, 0.0)
        room = np.where(linear, 1.0 - own - seen, 1.0)
        least = room.min(axis=(1, 2, 3))
        with np.errstate(divide="ignore", invalid="ignore"):  # with no room nothing is known
            off = np.abs(self.rates).max(axis=(1, 2, 3)) / np.maximum(least, 0.0)
        # a cell that is saturated follows those that are not
        follows = np.where(linear, 0.0, 1.0 + seen).max(axis=(1, 2, 3))
        off = np.where(np.isfinite(off), off * np.maximum(1.0, follows), np.inf)
        near = off[:, np.newaxis, np.newaxis, np.newaxis] <= np.minimum(tolerance, NEAR)
        return np.asarray((least > 0.0) & _all(near | ~self.moving), dtype=np.bool_)

    def equilibrium(self, frame: int, tolerance: Floats) -> Floats | None:
        """Return the equilibrium that a frame comes to from here, None where that is not known."""
        linear = self._within(1.0)[frame]
        at = np.flatnonzero(linear)
        if len(at) > MOST_LINEAR:
            return self._state(frame)  # too large to look at: small rates must do
        step = np.zeros(linear.size)
        if len(at):
            matrix = _sparse().identity(len(at), format="csc") - self.weights()[at][:, at].tocsc()
            even = bool(abs(matrix - matrix.T).max() <= 1e-12 * abs(matrix).max())
            if not even and len(at) > MOST_DENSE:
                return self._state(frame)
            tau = np.repeat(self.template.tau, linear[0].size)[at]
            solve = _stable_solve(matrix, tau, even=even)
            if solve is None:
                return None
            step[at] = solve(self.rates[frame].ravel()[at])
        x: Floats = np.asarray(self.x[frame] + step.reshape(linear.shape), dtype=np.float64)
        y = self._output(np.where(linear, x, self.x[frame]))
        held = self.drive[frame] + _sums(self.template.A, y[np.newaxis], self.template.boundary)[0]
        x = np.asarray(np.where(self.moving[frame] & ~linear, held, x), dtype=np.float64)
        moved = np.abs(x - self.x[frame])
        same = self._same_range(frame, linear, x, 2.0 * float(moved.max(initial=0.0)))
        if bool((moved <= tolerance).all()):
            return self.x[frame] if same or self._same_range(frame, linear, x, 0.0) else None
        return x if same else None

    def _state(self, frame: int) -> Floats:
        return np.asarray(self.x[frame], dtype=np.float64)

    def _same_range(self, frame: int, linear: Flags, x: Floats, spare: float) -> bool:
        """Return whether the same cells are saturated, and stay so this far around."""
        if self.template.output.linear:
            return True
        before, fixed = self.x[frame], ~self.moving[frame]
        inside = np.abs(x) + spare <= 1.0
        outside = (np.abs(x) - spare >= 1.0) & (np.sign(x) == np.sign(before))
        return bool((np.where(linear, inside, outside) | fixed).all())

    def weights(self) -> Any:
        """Return A cell by cell, as a sparse matrix."""
        sparse = _sparse()
        layers, rows, cols = self.x.shape[1:]
        cells, radius = rows * cols, self.template.A.shape[-1] // 2
        numbers = np.arange(cells, dtype=np.float64).reshape(1, 1, rows, cols)
        around = _padded(numbers, radius, self.template.boundary, -1.0)[0, 0].astype(np.intp)
        entries: list[tuple[NDArray[np.intp], NDArray[np.intp], Floats]] = []
        for layer in range(layers):
            for tap in taps(self.template.A, layer):
                top, left = radius + tap.row, radius + tap.col
                seen = around[top : top + rows, left : left + cols].ravel()
                inside = np.flatnonzero(seen >= 0)
                weight = np.full(len(inside), tap.weight)
                entries.append((inside + layer * cells, seen[inside] + tap.source * cells, weight))
        size = layers * cells
        if not entries:
            return sparse.csr_matrix((size, size))
        to, of, weights = (np.concatenate(part) for part in zip(*entries, strict=True))
        return sparse.csr_matrix((weights, (to, of)), shape=(size, size))


def _sparse() -> Any:
    """Return SciPy's sparse matrices; imported late, as few runs need them."""
    from scipy import sparse

    return sparse


def _all(flags: NDArray[np.bool_]) -> Flags:
    return np.asarray(flags.all(axis=(1, 2, 3)), dtype=np.bool_)


def _stable_solve(matrix: Any, tau: Floats, *, even: bool) -> Callable[[Floats], Floats] | None:
    """Return a solver of M x = b if the array with dx/dt = −M x / τ goes to rest, else None."""
    from scipy.sparse import linalg  # imported late, too

    factorise: Any = linalg.splu
    try:
        if even:
            # without exchanges of rows the signs of U are those of the eigenvalues (Sylvester)
            options = {"SymmetricMode": True}
            order = "MMD_AT_PLUS_A"
            factors = factorise(matrix, permc_spec=order, diag_pivot_thresh=0.0, options=options)
            least = float(factors.U.diagonal().min())
        else:
            factors = factorise(matrix)
            dense: Floats = matrix.toarray()
            rates = np.linalg.eigvals(dense / tau[:, np.newaxis])
            least = float(np.real(rates).min())
    except RuntimeError:  # a factor is singular: the array is on the edge of growth
        return None
    return factors.solve if least > 0.0 else None


def _padded(maps: Floats, radius: int, boundary: Boundary, constant: float) -> Floats:
    around = ((0, 0), (0, 0), (radius, radius), (radius, radius))
    if boundary.constant is not None:
        return np.pad(maps, around, constant_values=constant)
    return np.pad(maps, around, mode="symmetric" if boundary.pad_mode == "symmetric" else "wrap")


def _sums(
    kernels: Floats, maps: Floats, boundary: Boundary, constant: float | None = None
) -> Floats:
    """Return the sum that maps add to each layer, (batch, layers, rows, cols)."""
    radius, shape = kernels.shape[-1] // 2, maps.shape[-2:]
    edge = (boundary.constant or 0.0) if constant is None else constant
    around = _padded(maps, radius, boundary, edge)
    total = np.zeros((len(maps), len(kernels), *shape))
    for layer in range(len(kernels)):
        for tap in taps(kernels, layer):
            top, left = radius + tap.row, radius + tap.col
            part = around[:, tap.source, top : top + shape[0], left : left + shape[1]]
            total[:, layer] += tap.weight * part
    return total
