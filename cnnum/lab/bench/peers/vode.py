"""PyCNN's way: scipy.signal.convolve2d and SciPy's vode, written anew for any boundary."""

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import ode
from scipy.signal import convolve2d

from cnnum.arrays import Floats
from cnnum.lab.bench.peers.work import Work


def run(work: Work) -> NDArray[np.floating]:
    """Return the state at the end."""
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


def _convolved(maps: Floats, kernel: Floats, work: Work) -> Floats:
    if work.mirrored:
        return np.asarray(convolve2d(maps, kernel, mode="same", boundary="symm"))
    return np.asarray(convolve2d(maps, kernel, "same", "fill", work.rim))
