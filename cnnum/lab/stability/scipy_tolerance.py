"""How often SciPy's methods miss the tolerance of a run, on the networks of `stated_error`.

    python -m cnnum.lab.stability.scipy_tolerance 60

A yardstick for `auto`, which is judged by the same measure: the largest error of a frame at its
end, over atol + rtol·|x|, at the default tolerances. The truth is a pair's run at 1e-11.
"""

import sys
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

from cnnum.arrays import Floats
from cnnum.engine import Engine
from cnnum.engines.reference.equation import Given, StateEquation
from cnnum.lab.bench.followed_steps import Known, sample
from cnnum.lab.stability.stated_error import ATOL, BATCH, RTOL

METHODS = ("LSODA", "DOP853", "RK45", "RK23")


def missed(method: str, known: Known, frame: int) -> float:
    """Return the error of a frame by a SciPy method, over the tolerance."""
    template, truth = known.template, known.truth.state[frame]
    shape = truth.shape[-2:]
    input = known.maps["input"][frame].reshape(-1, *shape)
    state = known.maps["state"][frame].reshape(-1, *shape)
    equation = StateEquation(template, shape, Given(input, None, state, None, None))
    drive, start = equation.drive(), equation.start()

    def rates(time: float, flat: Floats) -> Floats:
        return equation.rate(drive, flat.reshape(start.shape), None, time).ravel()

    span = (0.0, float(known.truth.time[frame]))
    run: Any = solve_ivp  # SciPy's types know no name of a method
    end = run(rates, span, start.ravel(), method=method, rtol=RTOL, atol=ATOL).y[:, -1]
    off = np.abs(end - truth.ravel()) / (ATOL + RTOL * np.abs(truth.ravel()))
    return float(off.max())


def main(count: int) -> None:
    """Print the share of frames that miss their tolerance, method by method."""
    engine = Engine("numba", precision="float64")
    networks = list[Known]()
    for known in sample(count, BATCH):
        ours = engine.run(known.template, input=known.maps["input"], state=known.maps["state"])
        if ours.method != "propagator":
            networks.append(known)
    for method in METHODS:
        parts = np.array([missed(method, network, b) for network in networks for b in range(BATCH)])
        share = np.mean(parts > 1.0)
        print(f"{method}: {parts.size} frames, {share:.0%} missed, by {parts.max():.0f} at most")


if __name__ == "__main__":
    main(int(sys.argv[1]))
