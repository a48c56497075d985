"""An independent simulator of cell arrays: SciPy's correlate, shifted copies, and small steps.

It shares nothing with the engines: it pads through scipy's and numpy's own modes, once for all
steps, and looks tables up by counting. It takes fixed steps far below the stability bound:
Runge–Kutta's of fourth order or, where rates jump, Euler's. States are (pictures, layers, rows,
cols) inside.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import ndimage

from cnnum.arrays import Floats
from cnnum.templating.boundary import Boundary
from cnnum.templating.couplings import NonlinearCoupling
from cnnum.templating.functions import Table
from cnnum.templating.template import Duration, Template

SETTLED = 1e-7
JUMP_STEP = 0.005
MODES: dict[str, Any] = {"symmetric": "reflect", "wrap": "grid-wrap", "constant": "constant"}
Slope = Callable[[Floats, float], Floats]


@dataclass(frozen=True, slots=True)
class Run:
    output: Floats
    state: Floats
    time: float
    settled: bool
    method: str = "small steps"
    reason: str = "its steps are small against every rate"


@dataclass(frozen=True, slots=True)
class Maps:
    """The maps of a run, each (pictures, maps, rows, cols) but the mask."""

    input: Floats | None
    previous: Floats | None
    bias: Floats | float
    mask: Floats | None


MAPS = ("input", "previous", "state", "bias", "mask")


@dataclass(frozen=True, slots=True)
class Simulator:
    """The interface of an engine."""

    limit: float = 400.0
    name: str = "simulator"
    precision: str = "float64"

    def run(
        self,
        template: Template,
        *,
        duration: Duration | None = None,
        **given: Any,
    ) -> Run:
        """Run a template on the maps of an engine; accuracy is not asked for."""
        input, previous, state, bias, mask = (given.get(name) for name in MAPS)
        x = start(template, input, state)
        u, before = (layered(maps, template.inputs) for maps in (input, previous))
        offset = 0.0 if bias is None else layered(bias, template.layers)
        equation = Equation(template, Maps(u, before, offset, mask), x.shape[-2:])
        wanted = template.duration if duration is None else duration
        end = self.limit if wanted == "settle" else float(wanted)
        march = discrete if template.output.discrete else continuous
        x, time, settled = march(equation, x, end, settle=wanted == "settle")
        y = template.output.numpy(x)
        if template.layers == 1:
            x, y = x[:, 0], y[:, 0]
        return Run(y, x, time, settled)


def layered(maps: Floats | None, count: int) -> Floats | None:
    if maps is None or count == 0:
        return None
    return maps[:, np.newaxis] if maps.ndim == 3 else maps


def start(template: Template, given: Floats | None, state: Floats | None) -> Floats:
    if state is not None:
        return layered(state, template.layers)
    assert given is not None
    if template.initial == "input":
        return layered(given, template.layers)
    shape = (given.shape[0], template.layers, *given.shape[-2:])
    return np.full(shape, float(template.initial))


class Equation:
    """The rates of an array; outputs of a delay ago come from outside."""

    def __init__(self, template: Template, maps: Maps, shape: tuple[int, int]) -> None:
        self.template, self.maps = template, maps
        self.tau = template.tau[:, np.newaxis, np.newaxis]
        self.feedback = Linear(template.A, template.boundary, template.output.numpy, shape)
        self.neighbours = [
            Neighbours(
                coupling.weights,
                template.input_boundary if coupling.neighbour == "u" else template.boundary,
                shape,
            )
            for coupling in template.nonlinear
        ]
        self.fixed = template.z[:, np.newaxis, np.newaxis] + maps.bias
        if maps.input is not None:
            self.fixed = self.fixed + couple(template.B, maps.input, template.input_boundary)
        self.add_nonlinear(self.fixed, {"u": maps.input}, of_inputs=True)

    def late_inputs(self, time: float) -> Floats | float:
        delayed, maps = self.template.delayed, self.maps
        if delayed is None or maps.input is None:
            return 0.0
        earlier = maps.input if maps.previous is None else maps.previous
        seen = earlier if time < delayed.delay else maps.input
        return couple(delayed.B, seen, self.template.input_boundary)

    def __call__(self, x: Floats, time: float, late: Floats | float = 0.0) -> Floats:
        template = self.template
        y, factors = template.output.numpy(x), None
        if template.gains:
            factors = np.ones(template.A.shape[:2])
            for gain in template.gains:
                factors[gain.to, gain.source] *= float(look_up(gain.table, np.array(time)))
        rate = self.fixed + self.feedback(y, factors) - x
        if template.delayed is not None:
            rate = rate + late
        self.add_nonlinear(rate, {"x": x, "y": y, "u": self.maps.input}, of_inputs=False)
        return self.held(rate / self.tau)

    def add_nonlinear(
        self, total: Floats, maps: dict[str, Floats | None], *, of_inputs: bool
    ) -> None:
        """Add the couplings that read inputs alone, or all others."""
        for coupling, neighbours in zip(self.template.nonlinear, self.neighbours, strict=True):
            if reads_inputs(coupling) == of_inputs:
                total[:, coupling.to] += nonlinear(coupling, neighbours, maps)

    def held(self, rate: Floats) -> Floats:
        mask = self.maps.mask
        return rate if mask is None else np.where(mask[:, np.newaxis] > 0, 0.0, rate)


def continuous(
    equation: Equation, x: Floats, end: float, *, settle: bool
) -> tuple[Floats, float, bool]:
    template = equation.template
    step = euler if any(jumps(coupling) for coupling in template.nonlinear) else runge_kutta
    h = step_length(template)
    if template.delayed is None:
        h = min(h, end / 20.0) or h
    past = Past(template, x, equation)
    count = int(np.ceil(end / h - 1e-9))
    for n in range(count):
        slope = past.slope(n * h)
        if settle and n % 16 == 0 and np.abs(slope(x, n * h)).max() < SETTLED:
            return x, n * h, True
        length = min(h, end - n * h)
        if template.delayed is not None:
            past.keep(x, slope(x, n * h))
        x = step(slope, x, n * h, length)
    return x, end, False


def discrete(
    equation: Equation, x: Floats, end: float, *, settle: bool
) -> tuple[Floats, float, bool]:
    for n in range(round(end)):
        x = x + equation(x, float(n))
    return x, end, False


def step_length(template: Template) -> float:
    """Return steps that resolve the fastest rate; 60 a time constant do for slow modes."""
    if any(jumps(coupling) for coupling in template.nonlinear):
        return JUMP_STEP
    rate = 1.0 + np.abs(template.A).sum() / template.layers
    for coupling in template.nonlinear:
        if reads_inputs(coupling):
            continue
        table = np.array(coupling.function.points)
        steep = np.abs(np.diff(table[:, 1]) / np.diff(table[:, 0])).max()
        rate += np.abs(coupling.weights).sum() * steep
    h = 1.0 / max(min(3.0 * rate, 60.0), 0.75 * rate, 1.0)
    if template.delayed is None:
        return h
    return template.delayed.delay / np.ceil(template.delayed.delay / min(h, 0.05))


def reads_inputs(coupling: NonlinearCoupling) -> bool:
    return coupling.neighbour == "u" and coupling.centre in ("u", None)


def jumps(coupling: NonlinearCoupling) -> bool:
    return coupling.function.interpolation == "constant" and not reads_inputs(coupling)


class Past:
    """States of earlier steps, and between them the cubic that fits their rates."""

    def __init__(self, template: Template, x: Floats, equation: Equation) -> None:
        self.template, self.first, self.equation = template, x, equation
        self.states: list[Floats] = []
        self.rates: list[Floats] = []

    def keep(self, x: Floats, rate: Floats) -> None:
        self.states.append(x)
        self.rates.append(rate)

    def slope(self, begin: float) -> Slope:
        delayed = self.template.delayed
        if delayed is None:
            return self.equation
        inputs = self.equation.late_inputs(begin + 1e-9)

        def rate(x: Floats, time: float) -> Floats:
            seen = self.template.output.numpy(self.at(time - delayed.delay))
            outputs = couple(delayed.A, seen, self.template.boundary, self.template.output.numpy)
            return self.equation(x, time, inputs + outputs)

        return rate

    def at(self, time: float) -> Floats:
        place = time / step_length(self.template)
        n = int(np.floor(place + 1e-6))
        if n < 0 or not self.states:
            return self.first
        s = max(place - n, 0.0)
        if s < 1e-6:
            return self.states[n]
        h = step_length(self.template)
        x0, x1, k0, k1 = self.states[n], self.states[n + 1], self.rates[n], self.rates[n + 1]
        eased = s * s * (3.0 - 2.0 * s)
        bent = h * s * (1.0 - s) * ((1.0 - s) * k0 - s * k1)
        return x0 + eased * (x1 - x0) + bent


def couple(
    kernels: Floats, maps: Floats, boundary: Boundary, f: Callable[[Floats], Floats] = np.asarray
) -> Floats:
    """Sum the correlations of all sources, (to, from, k, k) with (pictures, from, rows, cols)."""
    edge = 0.0 if boundary.constant is None else float(f(np.array(boundary.constant)))
    total = np.zeros((len(maps), len(kernels), *maps.shape[-2:]))
    for to, source in np.argwhere(kernels.any(axis=(-2, -1))):
        kernel = kernels[to, source][np.newaxis]
        mode = MODES[boundary.pad_mode]
        total[:, to] += ndimage.correlate(maps[:, source], kernel, mode=mode, cval=edge)
    return total


class Linear:
    """The same sum for the maps of all steps: SciPy's sum for each cell, and for none."""

    def __init__(
        self,
        kernels: Floats,
        boundary: Boundary,
        f: Callable[[Floats], Floats],
        shape: tuple[int, int],
    ) -> None:
        layers, count = len(kernels), shape[0] * shape[1]
        cells = np.concatenate([np.zeros((1, count)), np.eye(count)]).reshape(-1, 1, *shape)
        self.parts = list[tuple[int, int, Floats, Floats]]()
        for to, source in np.argwhere(kernels.any(axis=(-2, -1))).tolist():
            kernel = kernels[to : to + 1, source : source + 1]
            none, *each = couple(kernel, cells, boundary, f).reshape(-1, count)
            self.parts.append((to, source, none, np.array(each) - none))
        self.shape = (layers, *shape)

    def __call__(self, maps: Floats, factors: Floats | None) -> Floats:
        total = np.zeros((len(maps), self.shape[0], self.shape[1] * self.shape[2]))
        for to, source, none, each in self.parts:
            seen = maps[:, source].reshape(len(maps), -1)
            added = seen @ each + none
            total[:, to] += added if factors is None else factors[to, source] * added
        return total.reshape(len(maps), *self.shape)


class Neighbours:
    """Where each tap of a coupling finds its neighbours: NumPy's padding of the cells' numbers."""

    def __init__(self, weights: Floats, boundary: Boundary, shape: tuple[int, int]) -> None:
        rows, cols = shape
        numbers, radius = np.arange(rows * cols).reshape(shape), weights.shape[0] // 2
        if boundary.constant is None:
            self.edge, padded = 0.0, np.pad(numbers, radius, mode=boundary.pad_mode)
        else:  # the number after the last is the boundary's own
            self.edge = boundary.constant
            padded = np.pad(numbers, radius, constant_values=rows * cols)
        self.places = np.stack(
            [padded[d : d + rows, e : e + cols] for d, e in np.argwhere(weights).tolist()]
        )

    def __call__(self, maps: Floats) -> Floats:
        """Return (taps, pictures, rows, cols) of maps, (pictures, rows, cols)."""
        flat = np.concatenate([maps.reshape(len(maps), -1), np.full((len(maps), 1), self.edge)], 1)
        return flat[:, self.places].swapaxes(0, 1)


def nonlinear(
    coupling: NonlinearCoupling, neighbours: Neighbours, maps: dict[str, Floats | None]
) -> Floats:
    seen = maps[coupling.neighbour]
    assert seen is not None
    argument = neighbours(seen[:, coupling.source])
    if coupling.centre is not None:
        own = maps[coupling.centre]
        assert own is not None
        argument = own[:, coupling.centre_source] - argument
        argument = -argument if coupling.reversed_sign else argument
    value = look_up(coupling.function, argument)
    value = value * argument if coupling.times_argument else value
    weights = coupling.weights[coupling.weights != 0.0]
    return (weights @ value.reshape(len(weights), -1)).reshape(value.shape[1:])


def look_up(table: Table, v: Floats) -> Floats:
    """Return a table's values: the sum of its steps, or of its straight pieces."""
    value = np.full(v.shape, table.points[0][1])
    for (v0, f0), (v1, f1) in zip(table.points, table.points[1:], strict=False):
        if table.interpolation == "constant":
            value = np.where(v > v0, f1, value)
        else:
            value = value + (f1 - f0) * np.clip((v - v0) / (v1 - v0), 0.0, 1.0)
    return value


def euler(slope: Slope, x: Floats, time: float, h: float) -> Floats:
    return x + h * slope(x, time)


def runge_kutta(slope: Slope, x: Floats, time: float, h: float) -> Floats:
    k1 = slope(x, time)
    k2 = slope(x + h / 2 * k1, time + h / 2)
    k3 = slope(x + h / 2 * k2, time + h / 2)
    k4 = slope(x + h * k3, time + h)
    return x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
