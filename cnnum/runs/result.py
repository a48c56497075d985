"""The result of a template's run."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from cnnum.arrays import Floats
from cnnum.integrators.estimate import LOST


@dataclass(frozen=True, slots=True, eq=False)
class Result:
    """What a template made of its maps.

    Attributes
    ----------
    output, state : (..., rows, cols) or (..., layers, rows, cols) float
    time : (...) float
        Time constants reached.
    steps : (...) int
        Steps taken, rejected ones counted; 0 where none were needed.
    settled : (...) bool
        Whether |dx/dt|·τ is below the tolerance in every cell.
    error : (...) float
        Estimated error of the state: the sum of the steps' local errors and roundings, times a
        safety factor; of an exact answer, its roundings. Infinity means that nothing is known of
        it: so it is of steps of a fixed length, or in discrete time, which are not followed unless
        `estimate=True`; of steps that were forced; and where an estimate grew beyond 1e30.
    method : str
    reason : str
        Why this method: what makes the array exact, or about how many evaluations of the rates it
        takes beside others. The `reference` engine solves far below the tolerance instead, unless
        it is exact or the steps were asked for.
    """

    output: Floats
    state: Floats
    time: Floats
    steps: np.ndarray
    settled: np.ndarray
    error: Floats
    method: str
    reason: str


def result_of(outputs: Mapping[str, Floats], layers: int, method: str, reason: str) -> Result:
    """Return the result in the outputs of a run's plan.

    Parameters
    ----------
    outputs : mapping of str to (..., rows, cols) or (...) float
        "output N" and "state N" of every layer, and the run's figures.
    layers : int
    method, reason : str
    """

    def of_layers(what: str) -> Floats:
        planes = [outputs[f"{what} {layer}"] for layer in range(layers)]
        return planes[0] if layers == 1 else np.stack(planes, axis=-3)

    error = outputs["error"]
    if error.ndim or not error < LOST:  # one number is looked at in a tenth of the time
        error = np.where(error < LOST, error, math.inf)
    return Result(
        output=of_layers("output"),
        state=of_layers("state"),
        time=outputs["time"],
        steps=outputs["steps"].astype(np.int64),
        settled=outputs["settled"].astype(bool),
        error=error,
        method=method,
        reason=reason,
    )
