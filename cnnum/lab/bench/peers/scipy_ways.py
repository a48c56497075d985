"""The array by SciPy: Euler's steps with `ndimage`, and convolve2d with vode as in PyCNN, anew."""

from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import ode
from scipy.ndimage import correlate
from scipy.signal import convolve2d

from cnnum.arrays import Floats
from cnnum.lab.bench.peers.work import Work


def by_ndimage(work: Work) -> NDArray[np.floating]:
    """Return the state at the end of Euler's steps, as an image person writes them."""
    kernel = work.feedback.astype(work.dtype)
    drive = _couple(work.input.astype(work.dtype), work.control.astype(work.dtype), work)
    drive = drive + work.dtype.type(work.bias)
    state, step = work.start.astype(work.dtype), work.dtype.type(work.step)
    coupled = np.empty_like(state)
    for _ in range(work.steps):
        _couple(work.output(state), kernel, work, coupled)
        state += step * (coupled + drive - state)
    return state


def by_vode(work: Work) -> NDArray[np.floating]:
    """Return the state at the end by PyCNN's way: convolve2d and vode, for any boundary."""
    shape = work.start.shape
    # convolve2d turns its kernel round
    kernel, control = work.feedback[::-1, ::-1], work.control[::-1, ::-1]
    drive = work.bias + _convolved(work.input, control, work)

    def slope(_time: float, flat: Floats) -> Floats:
        output = np.asarray(work.output(flat.reshape(shape)), dtype=np.float64)
        return (_convolved(output, kernel, work) + drive).ravel() - flat

    solver = ode(slope).set_integrator(
        "vode", method="adams", rtol=work.tolerance, atol=work.tolerance, nsteps=100_000
    )
    solver.set_initial_value(np.asarray(work.start, dtype=np.float64).ravel(), 0.0)
    return np.asarray(solver.integrate(work.duration)).reshape(shape)


def _couple(
    maps: NDArray[np.floating],
    kernel: NDArray[np.floating],
    work: Work,
    out: NDArray[np.floating] | None = None,
) -> NDArray[np.floating]:
    mode: Literal["reflect", "constant"] = "reflect" if work.mirrored else "constant"
    return np.asarray(correlate(maps, kernel, output=out, mode=mode, cval=work.rim))


def _convolved(maps: Floats, kernel: Floats, work: Work) -> Floats:
    if work.mirrored:
        return np.asarray(convolve2d(maps, kernel, mode="same", boundary="symm"))
    return np.asarray(convolve2d(maps, kernel, "same", "fill", work.rim))
