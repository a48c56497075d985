"""Euler's steps as JAX runs them: shifted sums in one compiled loop (XLA)."""

from functools import cache
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cnnum.lab.bench.peers.work import Work

jax: Any = import_module("jax")
jnp: Any = import_module("jax.numpy")


@cache
def _march(radius: int, mirrored: bool, rim: float, linear: bool) -> Any:
    """Return the compiled loop of a form; JAX keeps one for each size of arrays."""

    def march(state: Any, kernel: Any, drive: Any, h: Any, steps: Any) -> Any:
        def step(_: Any, x: Any) -> Any:
            y = x if linear else jnp.clip(x, -1.0, 1.0)
            return x + h * (coupled(y, kernel, radius, mirrored, rim) + drive - x)

        return jax.lax.fori_loop(0, steps, step, state)

    return jax.jit(march)


def coupled(maps: Any, kernel: Any, radius: int, mirrored: bool, rim: float) -> Any:
    """Return the sums over neighbours."""
    rows, cols = maps.shape
    how: dict[str, Any] = {"mode": "symmetric"} if mirrored else {"constant_values": rim}
    padded = jnp.pad(maps, radius, **how)
    size = 2 * radius + 1
    parts = [
        kernel[r, c] * padded[r : r + rows, c : c + cols] for r in range(size) for c in range(size)
    ]
    return sum(parts[1:], parts[0])


def run(work: Work) -> NDArray[np.floating]:
    """Return the state at the end."""
    double = work.dtype == np.dtype(np.float64)
    with jax.enable_x64(double):
        arrays = (work.start, work.feedback, work.control, work.input)
        start, kernel, control, given = (jnp.asarray(array, work.dtype) for array in arrays)
        form = (work.feedback.shape[0] // 2, work.mirrored, work.rim)
        drive = coupled(given, control, *form) + work.dtype.type(work.bias)
        march = _march(*form, work.linear)
        return np.asarray(march(start, kernel, drive, work.dtype.type(work.step), work.steps))
