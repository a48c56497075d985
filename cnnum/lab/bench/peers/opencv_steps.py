"""Euler's steps with OpenCV's filter2D and its in-place arithmetic."""

import cv2
import numpy as np
from numpy.typing import NDArray

from cnnum.lab.bench.peers.work import Work


def run(work: Work) -> NDArray[np.floating]:
    """Return the state at the end."""
    dtype, radius = work.dtype, work.feedback.shape[0] // 2
    kernel, control = work.feedback.astype(dtype), work.control.astype(dtype)
    drive = _filtered(work.input.astype(dtype), control, work) + dtype.type(work.bias)
    state = work.start.astype(dtype)
    output = np.empty_like(state)
    for _ in range(work.steps):
        if work.linear:
            np.copyto(output, state)
        else:
            np.clip(state, -1.0, 1.0, out=output)
        coupled = _filtered(output, kernel, work) if radius else kernel[0, 0] * output
        cv2.add(coupled, drive, coupled)
        # x⁺ = (1 − h) x + h (A ∗ y + w)
        cv2.addWeighted(state, 1.0 - work.step, coupled, work.step, 0.0, state)
    return state


def _filtered(
    maps: NDArray[np.floating], kernel: NDArray[np.floating], work: Work
) -> NDArray[np.floating]:
    if work.mirrored or work.rim == 0.0:
        border = cv2.BORDER_REFLECT if work.mirrored else cv2.BORDER_CONSTANT
        return np.asarray(cv2.filter2D(maps, -1, kernel, borderType=border), dtype=work.dtype)
    # filter2D knows no constant but 0
    radius = kernel.shape[0] // 2
    padded = cv2.copyMakeBorder(
        maps, radius, radius, radius, radius, cv2.BORDER_CONSTANT, value=work.rim
    )
    filtered = cv2.filter2D(padded, -1, kernel)[radius:-radius, radius:-radius]
    return np.asarray(filtered, dtype=work.dtype)
