"""A Numba stencil, written out for 3×3: ten minutes' work of a good programmer.

It is parallel where that pays; on a small array threads cost more than they bring.
"""

from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from cnnum.lab.bench.peers.work import Work

Array = NDArray[np.floating]


PARALLEL_CELLS = 128 * 128
"""Smallest array that is spread over the cores: there both ways take as long, on two cores."""


def _march(
    state: Any, outputs: Any, drive: Any, kernel: Any, h: Any, steps: int, linear: bool, rim: Any
) -> None:
    rows, cols = state.shape
    one = drive.dtype.type(1.0)
    a, b, c = kernel[0, 0], kernel[0, 1], kernel[0, 2]
    d, e, f = kernel[1, 0], kernel[1, 1], kernel[1, 2]
    g, i, j = kernel[2, 0], kernel[2, 1], kernel[2, 2]
    for step in range(steps):
        y, out = outputs[step % 2], outputs[(step + 1) % 2]
        for r in numba.prange(rows):
            for q in range(cols):
                total = (
                    a * y[r, q] + b * y[r, q + 1] + c * y[r, q + 2]
                    + d * y[r + 1, q] + e * y[r + 1, q + 1] + f * y[r + 1, q + 2]
                    + g * y[r + 2, q] + i * y[r + 2, q + 1] + j * y[r + 2, q + 2]
                )  # fmt: skip
                value = state[r, q] + h * (total + drive[r, q] - state[r, q])
                state[r, q] = value
                out[r + 1, q + 1] = value if linear else min(max(value, -one), one)
        if rim is None:
            out[0, 1:-1], out[-1, 1:-1] = out[1, 1:-1], out[-2, 1:-1]
            out[:, 0], out[:, -1] = out[:, 1], out[:, -2]


_serial: Any = numba.njit(fastmath=True, cache=False)(_march)
_parallel: Any = numba.njit(parallel=True, fastmath=True, cache=False)(_march)


def run(work: Work) -> Array:
    """Return the state at the end."""
    dtype = work.dtype
    padded = _padded(work.input, work)
    rows, cols = work.start.shape
    drive = np.full((rows, cols), work.bias, dtype)
    for (r, q), weight in np.ndenumerate(work.control):
        drive += dtype.type(weight) * padded[r : r + rows, q : q + cols]
    state = work.start.astype(dtype)
    first = _padded(work.output(state), work)
    outputs = np.stack([first, first])
    constant = None if work.mirrored else dtype.type(work.rim)
    kernel, step = work.feedback.astype(dtype), dtype.type(work.step)
    march = _parallel if state.size >= PARALLEL_CELLS else _serial
    march(state, outputs, drive, kernel, step, work.steps, work.linear, constant)
    return state


def _padded(maps: Array, work: Work) -> Array:
    if work.mirrored:
        return np.pad(maps, 1, mode="symmetric").astype(work.dtype)
    return np.pad(maps, 1, mode="constant", constant_values=work.rim).astype(work.dtype)
