"""Adaptive implicit steps, with sparse solves for the array.

A run is solved three times: to ten times the tolerance, to the tolerance, and to a tenth of it. The
stated error of the last is its difference from the second; the first guards against the two being
wrong alike by chance. Steps are limited by the growth rate of the array, since an implicit method
damps unstable modes that it steps over and would hold an array on a saddle. Finer runs take shorter
steps there, too.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from scipy.sparse import csc_array, eye_array
from scipy.sparse.linalg import splu

from cnnum.arrays import Floats
from cnnum.engines.notices import refuse_unfinished
from cnnum.engines.reference.equation import StateEquation
from cnnum.integrators.rosenbrock import MOST_STEPS, ImplicitSteps
from cnnum.integrators.solver import Solver
from cnnum.templating.network import cells_seen
from cnnum.templating.template import Template

FINER = 0.1
"""Fraction of the tolerance to which the last run is solved."""

ROUNDINGS = 8.0
"""Of the end: those of its last steps, as parts of the largest state."""

MOST_LINEAR = 300
"""Cells in the linear range up to which eigenvalues are looked at: some 50 ms."""

LOOKED_AT = 5000
"""Steps after which a run gives up whose end would take more than `MOST_STEPS` at that pace."""

NO_TIME = 1e-200
"""Shorter steps are refused: there are no others where a state leaves the range of numbers."""

NEARBY = 1e-6
"""Half the interval of the difference quotient for the slope of an output."""


@dataclass(frozen=True, slots=True, eq=False)
class _Array:
    """The couplings of an array as a sparse matrix, and its Jacobian at a state."""

    equation: StateEquation
    coupling: csc_array[np.float64]
    rates: Floats
    moving: Floats
    growths: dict[bytes, float] = field(default_factory=dict[bytes, float])

    @classmethod
    def of(cls, equation: StateEquation) -> "_Array":
        template, cells = equation.template, math.prod(equation.shape)
        rates = np.repeat(1.0 / template.tau, cells)
        held = equation.given.held
        moving = np.ones(cells) if held is None else (~held).astype(np.float64).ravel()
        coupling = _coupling(template, equation.shape)
        return cls(equation, coupling, rates, np.tile(moving, template.layers))

    def slopes(self, x: Floats) -> Floats:
        """Return f' of every cell, (layers, rows, cols)."""
        apart = NEARBY * np.maximum(1.0, np.abs(x))
        outputs = self.equation.outputs
        # without the noise of the difference, so that saturated arrays look alike
        return np.round((outputs(x + apart) - outputs(x - apart)) / (2.0 * apart), 8)

    def solver(self, slopes: Floats, h: float, gamma: float) -> Any:
        """Return the factors of 1/(hγ) − J."""
        coupling = self.coupling.copy()
        coupling.data = coupling.data * np.repeat(slopes.ravel(), np.diff(coupling.indptr))
        size = len(self.rates)
        fast = self.rates * self.moving
        scaled = coupling - eye_array(size, format="csc")
        scaled.data = scaled.data * fast[scaled.indices]
        return splu(csc_array(eye_array(size, format="csc") / (h * gamma) - scaled))

    def longest(self, slopes: Floats, h: float, share: float) -> float:
        """Return h, or a share of the time constant of the fastest growth where that is shorter."""
        bound = self._bound(slopes)
        if bound * h <= share:
            return h
        linear = np.flatnonzero(slopes.ravel() * self.moving)
        if len(linear) > MOST_LINEAR:
            return share / bound
        # the others see themselves decay alone, with any couplings to other layers
        known = self.growths.get(key := slopes.tobytes())
        if known is None:
            part = self.coupling[linear][:, linear].toarray() * slopes.ravel()[linear]
            part = (part - np.eye(len(linear))) * self.rates[linear, np.newaxis]
            self.growths.clear()
            values = np.asarray(np.linalg.eigvals(part), dtype=np.complex128)
            known = self.growths[key] = float(values.real.max(initial=0.0))
        return min(h, share / known) if known > 0.0 else h

    def _bound(self, slopes: Floats) -> float:
        """Return a bound on the real parts of J: Gershgorin's, every layer scaled at its best.

        The matrix of layers has in each place the largest sum of |J| over a row. Its own largest
        eigenvalue is that of the best scaling (Perron).
        """
        template, centre = self.equation.template, self.equation.template.A.shape[-1] // 2
        low, high = slopes.min(axis=(1, 2)), slopes.max(axis=(1, 2))
        largest = np.abs(template.A).sum(axis=(2, 3)) * np.maximum(np.abs(low), np.abs(high))
        for layer in range(template.layers):
            own = float(template.A[layer, layer, centre, centre])
            others = float(np.abs(template.A[layer, layer]).sum()) - abs(own)
            most = max(abs(float(low[layer])), abs(float(high[layer])))
            ends = own * float(low[layer]), own * float(high[layer])
            largest[layer, layer] = others * most + max(ends) - 1.0
        values = np.linalg.eigvals(np.asarray(largest / template.tau[:, np.newaxis]))
        return float(np.asarray(values, dtype=np.complex128).real.max())


def _coupling(template: Template, shape: tuple[int, int]) -> csc_array[np.float64]:
    """Return A over the array, (states, states)."""
    cells = math.prod(shape)
    nothing = np.zeros(0, dtype=np.int64)
    rows, columns, weights = [nothing], [nothing], [np.zeros(0)]
    for layer, tap, seen in cells_seen(template.A, template.boundary, shape):
        inside = np.flatnonzero(seen >= 0)
        rows.append(layer * cells + inside)
        columns.append(tap.source * cells + seen[inside])
        weights.append(np.full(len(inside), tap.weight))
    size = template.layers * cells
    places = (np.concatenate(rows), np.concatenate(columns))
    return csc_array((np.concatenate(weights), places), shape=(size, size))


@dataclass(frozen=True, slots=True, eq=False)
class Passed:
    """A state on the way of a run.

    Attributes
    ----------
    state : (layers, rows, cols) float
    steps : int
    error : float
        Estimate of the error; of a single march, that of its last step alone.
    """

    state: Floats
    steps: int
    error: float


def march_implicit(
    equation: StateEquation, solver: Solver, scheme: ImplicitSteps, moments: Sequence[float] = ()
) -> tuple[float, list[Passed]]:
    """Return the time at the end, and the states at moments on the way and at the end.

    Raises
    ------
    MethodError
        If the end is not reached within `MOST_STEPS`.
    """
    array, order, time = _Array.of(equation), scheme.rosenbrock.order, 0.0
    ways: list[list[Passed]] = []
    for part in (1.0 / FINER, 1.0, FINER):
        own = replace(solver, rtol=part * solver.rtol, atol=part * solver.atol)
        # where growth sets the steps, a finer run would take the same ones, and be off alike
        time, way = _march(array, own, scheme, (FINER * part) ** (1.0 / order), moments)
        ways.append(way)
    rough, coarse, fine = ways
    judged = [_judged(*passed, solver, order) for passed in zip(rough, coarse, fine, strict=True)]
    return time, judged


def _judged(rough: Passed, coarse: Passed, fine: Passed, solver: Solver, order: int) -> Passed:
    """Return the finest state, and how far it is off."""
    x = fine.state
    apart = _distance(x, rough.state) * FINER ** ((order - 1) / order)
    apart = max(_distance(x, coarse.state), apart)
    size = float(np.abs(x).max(initial=0.0))
    # where all end in one long step they may be off alike, by less than it may add
    last = max(FINER * (solver.atol + solver.rtol * size), fine.error)
    last += ROUNDINGS * float(np.finfo(np.float64).eps) * size
    return Passed(x, rough.steps + coarse.steps + fine.steps, apart + last)


def _distance(values: Floats, other: Floats) -> float:
    return float(np.abs(values - other).max(initial=0.0))


def _march(
    array: _Array,
    solver: Solver,
    scheme: ImplicitSteps,
    share: float,
    moments: Sequence[float],
) -> tuple[float, list[Passed]]:
    """Return time and states of a run whose steps are a share of the growth's, at most.

    Each moment takes the part of a step up to it.
    """
    equation, control = array.equation, scheme.control
    drive, slowest = equation.drive(), float(equation.template.tau.max())
    x, time, h, end, taken = equation.start(), 0.0, share * scheme.first_step, solver.duration, 0
    seen: list[Passed] = []
    while time < end * (1.0 - 1e-12):
        late = taken >= LOOKED_AT and time * MOST_STEPS < end * taken
        refuse_unfinished(np.array([late or taken == MOST_STEPS or h < NO_TIME]))
        slopes, rate = array.slopes(x), equation.rate(drive, x, None, time)
        h, taken = min(array.longest(slopes, h, share), end - time), taken + 1
        new, off = _step(array, scheme, drive, x, rate, slopes, h)
        size = np.maximum(np.abs(x), np.abs(new))
        worst = float((np.abs(off) / (solver.atol + solver.rtol * size)).max())
        worst = worst if math.isfinite(worst) else math.inf
        if worst <= 1.0:
            while len(seen) < len(moments) and moments[len(seen)] < time + h:
                state, less = x, np.zeros(1)
                part = moments[len(seen)] - time
                if part > 0.0:
                    state, less = _step(array, scheme, drive, x, rate, slopes, part)
                seen.append(Passed(state, taken - (part <= 0.0), float(np.abs(less).max())))
            x, time = new, time + h
            change = np.abs(slowest * equation.rate(drive, x, None, time))
            if solver.settle and (change <= solver.atol + solver.rtol * np.abs(x)).all():
                break
        longer = control.caution * max(worst, 1e-10) ** (-1.0 / control.order)
        h *= min(max(longer, control.least), 5.0)
    return time, seen + [Passed(x, taken, 0.0)] * (1 + len(moments) - len(seen))


def _step(
    array: _Array,
    scheme: ImplicitSteps,
    drive: Floats,
    x: Floats,
    rate: Floats,
    slopes: Floats,
    h: float,
) -> tuple[Floats, Floats]:
    """Return the state after a step, and the estimate of its error."""
    method, shape = scheme.rosenbrock, x.shape
    factors = array.solver(slopes, h, float(method.gamma))
    stages: list[Floats] = []
    for a, c in zip(method.a, method.c, strict=True):
        right = rate
        if any(a):
            right = array.equation.rate(drive, _added(x, a, stages), None, 0.0)
        right = _added(right, c, stages, 1.0 / h)
        stages.append(np.asarray(factors.solve(right.ravel())).reshape(shape))
    return _added(x, method.m, stages), _added(np.zeros(shape), method.error, stages)


def _added(start: Floats, row: Any, stages: list[Floats], scale: float = 1.0) -> Floats:
    total = start
    for weight, stage in zip(row, stages, strict=True):
        if weight:
            total = total + (scale * float(weight)) * stage
    return total
