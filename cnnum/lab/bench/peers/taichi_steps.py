"""Euler's steps as Taichi runs them, compiled for the processor, written out for 3×3.

Large arrays take two parallel loops per step. Small ones take all steps in one launch of one
thread, because a launch takes longer than their steps.
"""

import contextlib
import io
import os
import warnings
from collections.abc import Callable
from functools import cache
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cnnum.lab.bench.peers.work import Work

os.environ.setdefault("ENABLE_TAICHI_HEADER_PRINT", "0")  # a banner would spoil --json
with warnings.catch_warnings():
    warnings.simplefilter("ignore", DeprecationWarning)  # of its own calls
    ti: Any = import_module("taichi")

PARALLEL_CELLS = 64 * 64


# Taichi reads these functions as they stand: it takes no return type, not even None
def _step(  # type: ignore[no-untyped-def]
    x: Any, y: Any, drive: Any, kernel: Any, h: Any, linear: Any, mirrored: Any
):
    for r in range(x.shape[0]):
        for c in range(x.shape[1]):
            total = drive[r, c]
            for i, j in ti.static(ti.ndrange(3, 3)):
                total += kernel[i, j] * y[r + i, c + j]
            x[r, c] += h[0] * (total - x[r, c])
    for r in range(x.shape[0]):
        for c in range(x.shape[1]):
            value = x[r, c]
            y[r + 1, c + 1] = value if linear == 1 else ti.min(ti.max(value, -1.0), 1.0)
    for k in range(ti.max(x.shape[0], x.shape[1]) + 2):
        if mirrored == 1 and k <= x.shape[0] + 1:
            p = ti.min(ti.max(k, 1), x.shape[0])
            y[k, 0], y[k, x.shape[1] + 1] = y[p, 1], y[p, x.shape[1]]
        if mirrored == 1 and k <= x.shape[1] + 1:
            q = ti.min(ti.max(k, 1), x.shape[1])
            y[0, k], y[x.shape[0] + 1, k] = y[1, q], y[x.shape[0], q]


_step.__annotations__ = dict.fromkeys(_step.__annotations__, ti.template())
_inlined = ti.func(_step)


def _steps(  # type: ignore[no-untyped-def]
    x: Any, y: Any, drive: Any, kernel: Any, h: Any, linear: Any, mirrored: Any, steps: Any
):
    ti.loop_config(serialize=True)
    for _ in range(steps):
        _inlined(x, y, drive, kernel, h, linear, mirrored)


@cache
def _kernels() -> tuple[Callable[..., None], Callable[..., None]]:
    """Return the compiled loops of one step and of all; Taichi has one state a process."""
    with contextlib.redirect_stdout(io.StringIO()):  # a line of its own would spoil --json, too
        ti.init(arch=ti.cpu, log_level=ti.ERROR)
    types = dict.fromkeys(("x", "y", "drive", "kernel"), ti.types.ndarray(ndim=2))
    types |= {"h": ti.types.ndarray(ndim=1), "linear": ti.i32, "mirrored": ti.i32}
    _step.__annotations__ = types
    _steps.__annotations__ = types | {"steps": ti.i32}
    return ti.kernel(_step), ti.kernel(_steps)


def run(work: Work) -> NDArray[np.floating]:
    """Return the state at the end."""
    dtype, (rows, cols) = work.dtype, work.start.shape
    one_step, all_steps = _kernels()
    given = _padded(work.input, work)
    drive = np.full((rows, cols), work.bias, dtype)
    for (r, c), weight in np.ndenumerate(work.control):
        drive += dtype.type(weight) * given[r : r + rows, c : c + cols]
    state = work.start.astype(dtype)
    y = _padded(work.output(state), work)
    form = (
        work.feedback.astype(dtype),
        np.array([work.step], dtype),
        int(work.linear),
        int(work.mirrored),
    )
    if state.size < PARALLEL_CELLS:
        all_steps(state, y, drive, *form, work.steps)
    else:
        for _ in range(work.steps):
            one_step(state, y, drive, *form)
    return state


def _padded(maps: NDArray[np.floating], work: Work) -> NDArray[np.floating]:
    if work.mirrored:
        return np.pad(maps, 1, mode="symmetric").astype(work.dtype)
    return np.pad(maps, 1, mode="constant", constant_values=work.rim).astype(work.dtype)
