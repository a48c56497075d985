"""The state equation of one frame in NumPy, written from the equation alone.

Shares no neighbourhood code with the other engines (`scipy.ndimage.correlate` and shifted copies
here), so that agreement means something.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from scipy.ndimage import correlate

from cnnum.arrays import Floats
from cnnum.templating.boundary import Boundary
from cnnum.templating.couplings import NonlinearCoupling
from cnnum.templating.template import Template

_Places = NDArray[np.int64]
"""Of every neighbour that a coupling sees and every cell: (neighbours, rows, cols)."""

Feedback = Callable[[Floats], Floats]
"""Outputs, (layers, rows, cols), to their sum in the rates."""

MOST_STATES = 256
"""Cells of all layers up to which the neighbours of all are read at once: this takes some
microseconds, a correlation sixty, however small its map."""

_Mode = Literal["constant", "reflect", "grid-wrap"]
_NDIMAGE_MODES: dict[str, _Mode] = {
    "constant": "constant",
    "symmetric": "reflect",
    "wrap": "grid-wrap",
}


@dataclass(frozen=True, slots=True, eq=False)
class Given:
    """The maps of one frame for a transient.

    Attributes
    ----------
    inputs, previous, state, bias : (maps, rows, cols) float or None
    held : (rows, cols) bool or None
        Fixed-state mask.
    feedback : callable or None
        Sum of A over outputs where its weights differ from cell to cell; the template's else.
    """

    inputs: Floats | None
    previous: Floats | None
    state: Floats | None
    bias: Floats | None
    held: NDArray[np.bool_] | None
    feedback: Feedback | None = None


@dataclass(frozen=True, slots=True, eq=False)
class StateEquation:
    """dx/dt of one frame; states and outputs are (layers, rows, cols), solvers see them flat."""

    template: Template
    shape: tuple[int, int]
    given: Given
    _tau: Floats = field(init=False)
    _neighbours: tuple[_Places, ...] = field(init=False)
    _feedback: Feedback = field(init=False)
    _gained: tuple[Feedback, ...] = field(init=False)
    _delayed: Feedback | None = field(init=False)

    def __post_init__(self) -> None:
        template = self.template
        places = (_shifted(template, c, self.shape) for c in template.nonlinear)
        gained = (self._through(_alone(template.A, g.to, g.source)) for g in template.gains)
        delayed = None if template.delayed is None else self._through(template.delayed.A)
        object.__setattr__(self, "_tau", template.tau[:, np.newaxis, np.newaxis])
        object.__setattr__(self, "_neighbours", tuple(places))
        uneven = self.given.feedback
        object.__setattr__(self, "_feedback", uneven or self._through(template.A))
        object.__setattr__(self, "_gained", tuple(gained))
        object.__setattr__(self, "_delayed", delayed)

    def start(self) -> Floats:
        """Return the initial state."""
        template = self.template
        if self.given.state is not None:
            return np.array(self.given.state)
        if template.initial == "input":
            assert self.given.inputs is not None
            return np.array(self.given.inputs)
        return np.full((template.layers, *self.shape), float(template.initial))

    def drive(self) -> Floats:
        """Return the constant part of the rates during the transient, without delays."""
        template, given = self.template, self.given
        total = np.zeros((template.layers, *self.shape)) + template.z[:, np.newaxis, np.newaxis]
        if given.inputs is not None:
            total += self._inputs_through(template.B, given.inputs)
            for coupling, shifted in zip(template.nonlinear, self._neighbours, strict=True):
                if coupling.static:
                    total[coupling.to] += self._nonlinear(coupling, shifted, total, total)
        return total if given.bias is None else total + given.bias

    def delayed_drive(self, *, before: bool) -> Floats | float:
        """Return the sum of delayed inputs, before the start or after it."""
        delayed, given = self.template.delayed, self.given
        if delayed is None or given.inputs is None:
            return 0.0
        seen = given.previous if before and given.previous is not None else given.inputs
        return self._inputs_through(delayed.B, seen)

    def outputs(self, x: Floats) -> Floats:
        """Return y = f(x)."""
        return self.template.output.numpy(x)

    def rate(
        self,
        drive: Floats,
        x: Floats,
        past: Floats | None,
        time: float,
        middle: float | None = None,
        within: float = 0.0,
        *,
        outwards: bool = False,
    ) -> Floats:
        """Return dx/dt of the states `x`; `past` are the outputs a delay ago.

        Gains in time that jump are those of the `middle` of a step, whose ends may be at a jump.
        `within` is the length of a step that may hold jumps: then gains count by their means. At a
        limit of the state, rates that lead outwards are 0 unless `outwards` is set.
        """
        template = self.template
        y = self.outputs(x)
        rate = drive - x + self._feedback(y)
        for gain, through in zip(template.gains, self._gained, strict=True):
            if within and middle is not None:
                factor = gain.table.mean(middle - 0.5 * within, middle + 0.5 * within) - 1.0
            else:
                jumps = gain.table.interpolation == "constant" and middle is not None
                factor = float(gain.table(np.asarray(middle if jumps else time))) - 1.0
            rate = rate + factor * through(y)
        for coupling, shifted in zip(template.nonlinear, self._neighbours, strict=True):
            if not coupling.static:
                rate[coupling.to] += self._nonlinear(coupling, shifted, x, y)
        if self._delayed is not None and past is not None:
            rate = rate + self._delayed(past)
        rate = rate / self._tau
        if template.output.limited and not outwards:
            outward = ((x >= 1.0) & (rate > 0.0)) | ((x <= -1.0) & (rate < 0.0))
            rate = np.where(outward, 0.0, rate)
        return rate if self.given.held is None else np.where(self.given.held, 0.0, rate)

    def _inputs_through(self, kernels: Floats, inputs: Floats) -> Floats:
        boundary = self.template.input_boundary
        return _correlated(kernels, inputs, boundary, boundary.constant)

    def _through(self, kernels: Floats) -> Feedback:
        """Return the sum of kernels over outputs, all neighbours at once if the array is small.

        The terms of every cell are added in the same order, as those of a correlation are: cells
        that are alike stay so, even if an array would let the least difference between them grow.
        """
        boundary, edge = self.template.boundary, self._edge("y")
        layers, cells = kernels.shape[1], self.shape[0] * self.shape[1]
        if layers * cells > MOST_STATES:
            return lambda y: _correlated(kernels, y, boundary, edge)
        seen = np.asarray(kernels.any(axis=0))
        places: list[NDArray[np.intp]] = [
            np.where(near < cells, near + source * cells, layers * cells)
            for source in range(layers)
            for near in _near(seen[source], boundary, self.shape)
        ]
        neighbours = np.array(places, dtype=np.intp).reshape(len(places), *self.shape)
        weights = kernels[:, seen][:, :, np.newaxis, np.newaxis]
        beyond = None if boundary.constant is None else np.full(1, edge or 0.0)

        def through(y: Floats) -> Floats:
            cells = y if beyond is None else np.concatenate([y.ravel(), beyond])
            total: Floats = (weights * cells.take(neighbours)).sum(axis=1)
            return total

        return through

    def _edge(self, quantity: str) -> float | None:
        """Return the outputs of virtual cells of a fixed boundary."""
        if quantity == "u":
            return self.template.input_boundary.constant
        state = self.template.boundary.constant
        if state is None or quantity == "x":
            return state
        return float(self.template.output.numpy(np.asarray(state)))

    def _nonlinear(
        self, coupling: NonlinearCoupling, shifted: _Places, x: Floats, y: Floats
    ) -> Floats:
        maps = {"x": x, "y": y, "u": self.given.inputs}
        neighbours, centres = maps[coupling.neighbour], maps[coupling.centre or coupling.neighbour]
        assert neighbours is not None
        assert centres is not None
        cells = np.append(neighbours[coupling.source], self._edge(coupling.neighbour) or 0.0)
        centre = centres[coupling.centre_source if coupling.centre else coupling.source]
        weights = coupling.weights[coupling.weights.nonzero()][:, np.newaxis, np.newaxis]
        total: Floats = (weights * coupling.value(centre, cells[shifted])).sum(axis=0)
        return total


def _shifted(template: Template, coupling: NonlinearCoupling, shape: tuple[int, int]) -> _Places:
    """Return the places that a nonlinear coupling reads."""
    boundary = template.input_boundary if coupling.neighbour == "u" else template.boundary
    return _near(coupling.weights, boundary, shape)


def _near(
    weights: Floats | NDArray[np.bool_], boundary: Boundary, shape: tuple[int, int]
) -> _Places:
    """Return which cell each neighbour is, row by row; virtual ones are the one after the last."""
    radius = weights.shape[0] // 2
    cells = np.arange(shape[0] * shape[1]).reshape(shape)
    if boundary.pad_mode == "constant":
        padded = np.pad(cells, radius, mode="constant", constant_values=cells.size)
    else:
        padded = np.pad(cells, radius, mode=boundary.pad_mode)
    return sliding_window_view(padded, shape)[weights.nonzero()]


def _alone(kernels: Floats, to: int, source: int) -> Floats:
    """Return kernels with only those from one layer to one left."""
    alone = np.zeros_like(kernels)
    alone[to, source] = kernels[to, source]
    return alone


def _correlated(kernels: Floats, maps: Floats, boundary: Boundary, edge: float | None) -> Floats:
    mode = _NDIMAGE_MODES[boundary.pad_mode]
    total = np.zeros((kernels.shape[0], *maps.shape[1:]))
    for to in range(kernels.shape[0]):
        for source in range(kernels.shape[1]):
            if kernels[to, source].any():
                # SciPy spells the type out by its name unless it is given
                total[to] += correlate(
                    maps[source], kernels[to, source], np.float64, mode=mode, cval=edge or 0.0
                )
    return total
