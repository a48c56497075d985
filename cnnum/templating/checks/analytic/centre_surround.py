"""Receptors, a slower and wider surround, and cells that adapt to their difference: wave by wave.

A linear array without ends parts into waves, and each wave is a chain of three leaky cells behind a
signal that rises steadily. Its course is the exponential of a matrix of 5×5.
"""

from collections.abc import Sequence

import numpy as np
from scipy.linalg import expm

from cnnum.arrays import Floats, Shape
from cnnum.templating.boundary import Boundary
from cnnum.templating.checks.analytic.modes import modes
from cnnum.templating.checks.parameters import number
from cnnum.templating.checks.pictures import with_even
from cnnum.templating.checks.records import Case, ClosedForm
from cnnum.templating.template import Template

LAYERS = 4


def wave_after(
    eigenvalue: float, time: float, widths: Sequence[float], taus: Sequence[float]
) -> Floats:
    """Return the layers of one wave under a ramp of slope 1 that began at rest.

    Parameters
    ----------
    eigenvalue : float
        Eigenvalue of the five-point Laplacian, 0 or below, 1/cells².
    time : float
    widths : (near, far), cells²
        Coupling of receptors and of the surround.
    taus : (receptor, surround, adapting)

    Returns
    -------
    (4,) float
        Signal, receptors, surround, and what has adapted.
    """
    near, far = (1.0 - width * eigenvalue for width in widths)
    rates = np.zeros((LAYERS + 1, LAYERS + 1))
    rates[0, LAYERS] = 1.0
    rates[1, [0, 1]] = 1.0 / taus[0], -near / taus[0]
    rates[2, [1, 2]] = 1.0 / taus[1], -far / taus[1]
    rates[3, [1, 2, 3]] = np.array([1.0, -1.0, -1.0]) / taus[2]
    return np.asarray(expm(rates * time)[:LAYERS, LAYERS], dtype=np.float64)


def layers_after(
    slope: Floats, boundary: Boundary, time: float, widths: Sequence[float], taus: Sequence[float]
) -> Floats:
    """Return all layers under ramps of a slope a cell, (..., 4, rows, cols)."""
    found = modes(boundary, (slope.shape[-2], slope.shape[-1]))
    values = np.asarray(found.laplacian)
    waves = np.array([wave_after(float(value), time, widths, taus) for value in values.ravel()])
    parts = [found.apply(slope, waves[:, k].reshape(values.shape)) for k in range(LAYERS)]
    return np.asarray(np.stack(parts, axis=-3))


def _ramp(template: Template, rng: np.random.Generator, shape: Shape) -> Case:
    longest = number(template, "adapting")
    slope = with_even(rng.uniform(-1.0, 1.0, (2, *shape)), 0.5) / longest
    state = np.zeros((len(slope), LAYERS, *shape))
    return Case(input=slope, state=state, duration=0.7 * longest)


def _risen(template: Template, case: Case) -> Floats:
    widths = [number(template, name) for name in ("near", "far")]
    taus = [number(template, name) for name in ("receptor", "surround", "adapting")]
    slope = case.pictures / template.tau[0]  # of the layer that is the signal
    return layers_after(slope, template.boundary, case.length(template), widths, taus)


FORMS = (
    ClosedForm(
        "centre-surround",
        _ramp,
        _risen,
        1e-5,
        "layers are differences of signals of order 1, in single precision",
        "receptors, surround and adaptation behind ramps, an exponential of 5×5 a wave",
        needs=("near", "far", "receptor", "surround", "adapting"),
        compares="state",
    ),
)
