"""Closed forms of the receptor channels: gain at a frequency, ramp and hold, latency of a spike.

A channel is a chain of leaky cells: `stages` high-passes with the time constant `slow`, then a
low-pass with `quick`. Its response is (s·slow / (1 + s·slow))^stages / (1 + s·quick).
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cnnum.arrays import Floats


def response(hertz: ArrayLike, *, stages: int, slow: float, quick: float) -> NDArray[np.complex128]:
    """Return the response to a sine: its magnitude is the gain, its angle the phase.

    Parameters
    ----------
    hertz : (...) float
    stages : int
        Number of high-passes.
    slow, quick : float, s
        Time constants of a high-pass and of the low-pass.
    """
    s = 2j * np.pi * np.asarray(hertz, dtype=np.float64)
    return np.asarray((s * slow / (1.0 + s * slow)) ** stages / (1.0 + s * quick))


def ramp(time: ArrayLike, *, stages: int, slow: float, quick: float) -> Floats:
    """Return the response to a ramp of slope 1 that begins at time 0, s; 0 before.

    The response to a ramp and hold is the difference of two such responses. With one high-pass, the
    response settles at `slow` (v · slow for a ramp of slope v); with two, it fades to 0.

    Parameters
    ----------
    time : (...) float, s
    stages : 0, 1 or 2
    slow, quick : float, s
        They must differ.
    """
    t = np.maximum(np.asarray(time, dtype=np.float64), 0.0)
    b, falls = 1.0 / quick, np.exp(-t / quick)
    if stages == 0:
        return np.asarray(t + quick * np.expm1(-b * t))
    a, fades = 1.0 / slow, np.exp(-t / slow)
    if stages == 1:
        return np.asarray(slow - (slow * fades - quick * falls) * b / (b - a))
    return np.asarray(b / (b - a) * (t * fades - (fades - falls) / (b - a)))


def held_plateau(speed: ArrayLike, time_step: float, time_constant: float) -> Floats:
    """Return how far a leaky cell lags behind a ramp given in steps: v dt q / (1 − q).

    Each step is held until the next one; q = exp(−dt/τ). If dt is far below τ, the lag is
    v τ − v dt/2.

    Parameters
    ----------
    speed : (...) float, 1/s
    time_step, time_constant : float, s
    """
    q = np.exp(-time_step / time_constant)
    return np.asarray(np.asarray(speed, dtype=np.float64) * time_step * q / (1.0 - q))


def first_spike(current: ArrayLike, threshold: float, membrane: float) -> Floats:
    """Return when a leaky integrate-and-fire cell without charge fires: τ ln(I / (I − θ)), s.

    Infinite where the current is not above the threshold.

    Parameters
    ----------
    current : (...) float
        Constant, in the unit of the threshold.
    threshold : float
    membrane : float, s
        Time constant.
    """
    given = np.asarray(current, dtype=np.float64)
    above = given > threshold
    strong = np.where(above, given, 2.0 * threshold)
    return np.asarray(np.where(above, membrane * np.log(strong / (strong - threshold)), np.inf))
