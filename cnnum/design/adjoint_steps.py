"""The loops of a run and of its adjoint, compiled; `adjoint.py` has the formulas.

Maps are (layers, cells, pictures); outputs have one virtual cell after the last. Kernels are
(layers, sources, k²), and `seen` is (k², cells): the cell that each sees through each weight.
"""

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba
import numpy as np

Function = TypeVar("Function", bound=Callable[..., Any])

STANDARD, LINEAR, TANH = range(3)


def _compiled(function: Function) -> Function:
    options: dict[str, Any] = {"cache": True, "nogil": True, "error_model": "numpy"}
    return cast(Function, numba.njit(**options)(function))


@_compiled
def outputs(kind: int, x: Any, y: Any) -> None:
    """Write f(x) into all but the virtual cells."""
    layers, cells, count = x.shape
    for layer in range(layers):
        for cell in range(cells):
            for n in range(count):
                value = x[layer, cell, n]
                if kind == STANDARD:
                    value = min(max(value, -1.0), 1.0)
                elif kind == TANH:
                    value = np.tanh(value)
                y[layer, cell, n] = value


@_compiled
def slope(kind: int, x: float, y: float) -> float:
    """Return f'(x), of y = f(x)."""
    if kind == TANH:
        return 1.0 - y * y
    return 1.0 if kind == LINEAR or (x > -1.0 and x < 1.0) else 0.0


@_compiled
def apply(kernels: Any, seen: Any, y: Any, total: Any) -> None:
    """Add the sums over neighbours to `total`."""
    layers, sources, taps = kernels.shape
    cells, count = total.shape[1:]
    for layer in range(layers):
        for source in range(sources):
            for tap in range(taps):
                weight = kernels[layer, source, tap]
                if weight != 0.0:
                    for cell in range(cells):
                        near = seen[tap, cell]
                        for n in range(count):
                            total[layer, cell, n] += weight * y[source, near, n]


@_compiled
def transposed(kernels: Any, seen: Any, sums: Any, total: Any) -> None:
    """Add to `total`, with virtual cells, the adjoints of the sources of sums."""
    layers, sources, taps = kernels.shape
    cells, count = sums.shape[1:]
    for layer in range(layers):
        for source in range(sources):
            for tap in range(taps):
                weight = kernels[layer, source, tap]
                if weight != 0.0:
                    for cell in range(cells):
                        near = seen[tap, cell]
                        for n in range(count):
                            total[source, near, n] += weight * sums[layer, cell, n]


@_compiled
def products(sums: Any, seen: Any, y: Any, total: Any) -> None:
    """Add to `total`, (layers, sources, k²), the adjoints of the kernels of sums."""
    layers, sources, taps = total.shape
    cells, count = sums.shape[1:]
    for layer in range(layers):
        for source in range(sources):
            for tap in range(taps):
                found = 0.0
                for cell in range(cells):
                    near = seen[tap, cell]
                    for n in range(count):
                        found += sums[layer, cell, n] * y[source, near, n]
                total[layer, source, tap] += found


@_compiled
def fill(y: Any, value: float) -> None:
    """Write one number into (layers, cells, pictures)."""
    for layer in range(y.shape[0]):
        for cell in range(y.shape[1]):
            for n in range(y.shape[2]):
                y[layer, cell, n] = value


@_compiled
def combined(x: Any, part: float, y: Any, factor: float) -> None:
    """Write part · x + factor · y into x, both (layers, cells, pictures)."""
    for layer in range(x.shape[0]):
        for cell in range(x.shape[1]):
            for n in range(x.shape[2]):
                kept = part * x[layer, cell, n] if part != 0.0 else 0.0  # x may be anything then
                x[layer, cell, n] = kept + factor * y[layer, cell, n]


@_compiled
def divided(x: Any, tau: Any) -> None:
    """Divide layers by their time constants."""
    for layer in range(x.shape[0]):
        for cell in range(x.shape[1]):
            for n in range(x.shape[2]):
                x[layer, cell, n] /= tau[layer]


@_compiled
def march(
    kind: int, h: float, a: Any, b: Any, kernels: Any, seen: Any, edge: float, w: Any, tau: Any,
    states: Any, rates: Any, x: Any,
) -> None:  # fmt: skip
    """Run all steps from x, keep states and rates of stages, and leave the end in x."""
    steps, stages, layers, cells, count = states.shape
    y = np.empty((layers, cells + 1, count))
    fill(y, edge)
    for step in range(steps):
        for i in range(stages):
            at, rate = states[step, i], rates[step, i]
            combined(at, 0.0, x, 1.0)
            for j in range(i):
                if a[i, j] != 0.0:
                    combined(at, 1.0, rates[step, j], h * a[i, j])
            outputs(kind, at, y)
            combined(rate, 0.0, w, 1.0)
            combined(rate, 1.0, at, -1.0)
            apply(kernels, seen, y, rate)
            divided(rate, tau)
        for i in range(stages):
            combined(x, 1.0, rates[step, i], h * b[i])


@_compiled
def step_back(kind: int, at: Any, y: Any, fed: Any, v: Any, pulled: Any) -> None:
    """Write μ = f'(x) Aᵀv − v."""
    for layer in range(v.shape[0]):
        for cell in range(v.shape[1]):
            for n in range(v.shape[2]):
                way = slope(kind, at[layer, cell, n], y[layer, cell, n])
                pulled[layer, cell, n] = way * fed[layer, cell, n] - v[layer, cell, n]


@_compiled
def by_time(v: Any, rate: Any, total: Any) -> None:
    """Add a stage's adjoint of the time constants."""
    for layer in range(v.shape[0]):
        found = 0.0
        for cell in range(v.shape[1]):
            for n in range(v.shape[2]):
                found += v[layer, cell, n] * rate[layer, cell, n]
        total[layer] -= found


@_compiled
def back(
    kind: int, h: float, a: Any, b: Any, kernels: Any, seen: Any, edge: float, tau: Any,
    states: Any, rates: Any, lam: Any, by_kernels: Any, by_tau: Any, by_drive: Any,
) -> None:  # fmt: skip
    """Leave λ of the start in `lam`, and add the gradients to the last three."""
    steps, stages, layers, cells, count = states.shape
    y = np.empty((layers, cells + 1, count))
    fed = np.empty((layers, cells + 1, count))
    pulled = np.empty((stages, layers, cells, count))
    v = np.empty((layers, cells, count))
    fill(y, edge)
    for step in range(steps - 1, -1, -1):
        for i in range(stages - 1, -1, -1):
            fill(v, 0.0)
            combined(v, 1.0, lam, h * b[i])
            for j in range(i + 1, stages):
                if a[j, i] != 0.0:
                    combined(v, 1.0, pulled[j], h * a[j, i])
            divided(v, tau)
            by_time(v, rates[step, i], by_tau)
            outputs(kind, states[step, i], y)
            products(v, seen, y, by_kernels)
            combined(by_drive, 1.0, v, 1.0)
            fill(fed, 0.0)
            transposed(kernels, seen, v, fed)
            step_back(kind, states[step, i], y, fed, v, pulled[i])
        for i in range(stages):
            combined(lam, 1.0, pulled[i], 1.0)
