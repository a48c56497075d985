"""Euler's steps as an image person writes them with scipy.ndimage."""

from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import correlate

from cnnum.lab.bench.peers.work import Work


def run(work: Work) -> NDArray[np.floating]:
    """Return the state at the end."""
    kernel = work.feedback.astype(work.dtype)
    drive = _couple(work.input.astype(work.dtype), work.control.astype(work.dtype), work)
    drive = drive + work.dtype.type(work.bias)
    state, step = work.start.astype(work.dtype), work.dtype.type(work.step)
    coupled = np.empty_like(state)
    for _ in range(work.steps):
        _couple(work.output(state), kernel, work, coupled)
        state += step * (coupled + drive - state)
    return state


def _couple(
    maps: NDArray[np.floating],
    kernel: NDArray[np.floating],
    work: Work,
    out: NDArray[np.floating] | None = None,
) -> NDArray[np.floating]:
    mode: Literal["reflect", "constant"] = "reflect" if work.mirrored else "constant"
    return np.asarray(correlate(maps, kernel, output=out, mode=mode, cval=work.rim))
