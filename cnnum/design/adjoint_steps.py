"""The loops of a run and of its adjoint, compiled; `adjoint.py` has the formulas.

Maps are (layers, rows, cols·pictures). Outputs and inputs are seen with a rim of virtual cells, as
wide as the kernel's radius. A row of `rim` is such a cell and the cell that it copies. Both are
counted row by row with the rim. Virtual cells that copy none are constant. Innermost loops run
along a row of all pictures, which lies in one piece.
"""

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba
import numpy as np

Function = TypeVar("Function", bound=Callable[..., Any])

STANDARD, LINEAR, TANH = range(3)


def _compiled(function: Function) -> Function:
    options: dict[str, Any] = {"cache": True, "nogil": True, "error_model": "numpy"}
    options["fastmath"] = {"reassoc", "nsz"}  # sums of a row in the lanes of a vector
    return cast(Function, numba.njit(**options)(function))


@_compiled
def fill(y: Any, value: float) -> None:
    """Write one number into maps."""
    flat = y.reshape(-1)
    for n in range(len(flat)):
        flat[n] = value


@_compiled
def outputs(kind: int, x: Any, count: int, y: Any) -> None:
    """Write f(x) of `count` pictures into all but the virtual cells."""
    layers, rows, width = x.shape
    radius = (y.shape[1] - rows) // 2
    for layer in range(layers):
        for row in range(rows):
            at = x[layer, row]
            to = y[layer, radius + row, radius * count : radius * count + width]
            for n in range(width):
                value = at[n]
                if kind == STANDARD:
                    value = min(max(value, -1.0), 1.0)
                elif kind == TANH:
                    value = np.tanh(value)
                to[n] = value


@_compiled
def add(total: Any, factor: float, other: Any) -> None:
    """Add factor · other to a row."""
    for n in range(len(total)):
        total[n] += factor * other[n]


@_compiled
def spread(rim: Any, count: int, y: Any) -> None:
    """Copy cells to the virtual ones."""
    for cells in y.reshape((len(y), -1, count)):
        for virtual, cell in rim:
            cells[virtual] = cells[cell]


@_compiled
def folded(rim: Any, count: int, y: Any) -> None:
    """Add virtual cells to those that they copy: the adjoint of `spread`."""
    for cells in y.reshape((len(y), -1, count)):
        for virtual, cell in rim:
            add(cells[cell], 1.0, cells[virtual])


@_compiled
def dot(one: Any, other: Any) -> float:
    """Return the sum of products of two rows."""
    found = 0.0
    for n in range(len(one)):
        found += one[n] * other[n]
    return found


@_compiled
def couple(kernels: Any, y: Any, count: int, sums: Any, back: bool) -> None:
    """Add to `sums` those over neighbours; or `back` to y, with virtual cells, the adjoint."""
    rows, width = sums.shape[1:]
    for layer, source, r, c in np.ndindex(kernels.shape):
        weight = kernels[layer, source, r, c]
        if weight != 0.0:
            for row in range(rows):
                near = y[source, row + r, c * count : c * count + width]
                if back:
                    add(near, weight, sums[layer, row])
                else:
                    add(sums[layer, row], weight, near)


@_compiled
def products(sums: Any, y: Any, count: int, total: Any) -> None:
    """Add to `total`, (layers, sources, k, k), the adjoints of the kernels of sums."""
    rows, width = sums.shape[1:]
    for layer, source, r, c in np.ndindex(total.shape):
        found = 0.0
        for row in range(rows):
            near = y[source, row + r, c * count : c * count + width]
            found += dot(sums[layer, row], near)
        total[layer, source, r, c] += found


@_compiled
def combined(x: Any, part: float, y: Any, factor: float) -> None:
    """Write part · x + factor · y into x, both (layers, rows, width)."""
    to, of = x.reshape(-1), y.reshape(-1)
    if part == 0.0:  # x may be anything then
        for n in range(len(to)):
            to[n] = factor * of[n]
    else:
        for n in range(len(to)):
            to[n] = part * to[n] + factor * of[n]


@_compiled
def divided(x: Any, tau: Any) -> None:
    """Divide layers by their time constants."""
    for layer in range(len(x)):
        own = x[layer].reshape(-1)
        for n in range(len(own)):
            own[n] /= tau[layer]


@_compiled
def march(
    kind: int, h: float, a: Any, b: Any, kernels: Any, rim: Any, count: int, edge: float, w: Any,
    tau: Any, states: Any, rates: Any, x: Any,
) -> None:  # fmt: skip
    """Run all steps from x, keep states and rates of stages, and leave the end in x."""
    steps, stages, layers, rows, width = states.shape
    halo = kernels.shape[-1] - 1
    y = np.empty((layers, rows + halo, width + halo * count))
    fill(y, edge)
    for step in range(steps):
        for i in range(stages):
            at, rate = states[step, i], rates[step, i]
            combined(at, 0.0, x, 1.0)
            for j in range(i):
                if a[i, j] != 0.0:
                    combined(at, 1.0, rates[step, j], h * a[i, j])
            outputs(kind, at, count, y)
            spread(rim, count, y)
            combined(rate, 0.0, w, 1.0)
            combined(rate, 1.0, at, -1.0)
            couple(kernels, y, count, rate, False)
            divided(rate, tau)
        for i in range(stages):
            combined(x, 1.0, rates[step, i], h * b[i])


@_compiled
def slope(kind: int, x: float, y: float) -> float:
    """Return f'(x), of y = f(x)."""
    if kind == TANH:
        return 1.0 - y * y
    return 1.0 if kind == LINEAR or (x > -1.0 and x < 1.0) else 0.0


@_compiled
def step_back(kind: int, at: Any, y: Any, fed: Any, v: Any, count: int, pulled: Any) -> None:
    """Write μ = f'(x) Aᵀv − v."""
    layers, rows, width = v.shape
    radius = (y.shape[1] - rows) // 2
    begin = radius * count
    for layer in range(layers):
        for row in range(rows):
            x, own, to = at[layer, row], v[layer, row], pulled[layer, row]
            out = y[layer, radius + row, begin : begin + width]
            back = fed[layer, radius + row, begin : begin + width]
            for n in range(width):
                to[n] = slope(kind, x[n], out[n]) * back[n] - own[n]


@_compiled
def by_time(v: Any, rate: Any, total: Any) -> None:
    """Add a stage's adjoint of the time constants."""
    for layer in range(len(v)):
        total[layer] -= dot(v[layer].reshape(-1), rate[layer].reshape(-1))


@_compiled
def back(
    kind: int, h: float, a: Any, b: Any, kernels: Any, rim: Any, count: int, edge: float, tau: Any,
    states: Any, rates: Any, lam: Any, by_kernels: Any, by_tau: Any, by_drive: Any,
) -> None:  # fmt: skip
    """Leave λ of the start in `lam`, and add the gradients to the last three."""
    steps, stages, layers, rows, width = states.shape
    halo = kernels.shape[-1] - 1
    y = np.empty((layers, rows + halo, width + halo * count))
    fill(y, edge)
    fed, v = np.empty(y.shape), np.empty((layers, rows, width))
    pulled = np.empty((stages, layers, rows, width))
    for step in range(steps - 1, -1, -1):
        for i in range(stages - 1, -1, -1):
            combined(v, 0.0, lam, h * b[i])
            for j in range(i + 1, stages):
                if a[j, i] != 0.0:
                    combined(v, 1.0, pulled[j], h * a[j, i])
            divided(v, tau)
            by_time(v, rates[step, i], by_tau)
            outputs(kind, states[step, i], count, y)
            spread(rim, count, y)
            products(v, y, count, by_kernels)
            combined(by_drive, 1.0, v, 1.0)
            fill(fed, 0.0)
            couple(kernels, fed, count, v, True)
            folded(rim, count, fed)
            step_back(kind, states[step, i], y, fed, v, count, pulled[i])
        for i in range(stages):
            combined(lam, 1.0, pulled[i], 1.0)
