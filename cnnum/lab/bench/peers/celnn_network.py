"""celnn's own network, run by its own Euler solver."""

import numpy as np
from celnn import CellularNetwork, SimulationConfig
from numpy.typing import NDArray

from cnnum.lab.bench.peers.work import Work


def run(work: Work) -> NDArray[np.floating]:
    """Return the state at the end."""
    network = CellularNetwork(
        work.input,
        initial_state=work.start,
        feedback=work.feedback,
        control=work.control,
        bias=work.bias,
        activation="identity" if work.linear else "piecewise_linear",
        boundary="mirror" if work.mirrored else "constant",
        boundary_value=work.rim,
        dtype=work.dtype,
    )
    config = SimulationConfig(t_end=work.duration, dt=work.step, solver="euler")
    return np.asarray(network.run(config).state)
