"""How fast the arrays of a batch of templates are, and how fast their errors grow."""

import math
from dataclasses import replace

import numpy as np

from cnnum.arrays import Floats
from cnnum.templating.batch import TemplateBatch
from cnnum.templating.batch_parts import LADDER, Parts
from cnnum.templating.template import Template

ANGLES = 16
"""Of waves on a torus, along each axis."""


def fastest(batch: TemplateBatch, dt: float | None) -> float:
    """Return the fastest rate of any template, 1/time: a rung of a ladder, or the bound of dt."""
    numbers = batch.flat(batch.lead)
    exact = float((_rates(batch.template, numbers) / numbers["tau"]).max())
    rung = LADDER ** math.ceil(math.log(exact, LADDER) - 1e-9)
    if dt is not None and exact * dt <= 2.0:
        return min(rung, 2.0 / dt)
    return rung


def _rates(template: Template, numbers: Parts) -> Floats:
    """Return bounds on the rates of layers, times τ: on a torus, whose cells are in their range.

    Rates of arrays with other boundaries, or with saturated cells, are within the same disc.

    Returns
    -------
    (frames, layers) float
    """
    kernels = numbers["A"]
    if template.layers > 1:
        linear = np.abs(kernels).sum(axis=(2, 3, 4)) + 1.0
    else:
        count = kernels.shape[-1]
        places: Floats = np.arange(count, dtype=np.float64) - count // 2
        angles: Floats = np.arange(ANGLES, dtype=np.float64) * (2.0 * np.pi / ANGLES)
        waves = np.exp(1j * angles[:, np.newaxis] * places)
        modes = np.einsum("ar,nrc,bc->nab", waves, kernels[:, 0, 0], waves) - 1.0
        sizes = np.where(modes.real < 0.0, np.abs(modes), 1.0)
        linear = sizes.reshape(len(kernels), -1).max(axis=1)[:, np.newaxis]
    extra = _widened(template, numbers)
    if "delayed A" in numbers:
        extra = extra + np.abs(numbers["delayed A"]).sum(axis=(2, 3, 4))
    return np.asarray(linear + extra, dtype=np.float64)


def _widened(template: Template, numbers: Parts) -> Floats:
    """Return by how much |dx/dt|·τ of each layer may change more than by A, (frames, layers)."""
    total = np.zeros(numbers["tau"].shape)
    for k, gain in enumerate(template.gains, 1):
        most = np.abs(numbers[f"gain {k}"]).max(axis=-1)
        weights = np.abs(numbers["A"][:, gain.to, gain.source]).sum(axis=(1, 2))
        total[:, gain.to] += np.maximum(most - 1.0, 0.0) * weights * template.output.steepest
    for k, one in enumerate(template.nonlinear, 1):
        each = replace(one, weights=np.ones((1, 1))).stiffness
        total[:, one.to] += each * np.abs(numbers[f"coupling {k}"]).sum(axis=(1, 2))
    return total


def growth(template: Template, numbers: Parts) -> Floats:
    """Return the bound on the growth of errors of every frame, 1/time (`error_growth`)."""
    a = numbers["A"]
    own = np.einsum("nllkk->nlk", a)[..., a.shape[-1] // 2]
    low, high = template.output.slope
    others = template.output.steepest * (np.abs(a).sum(axis=(2, 3, 4)) - np.abs(own))
    rows = np.maximum(low * own, high * own) + others + _widened(template, numbers) - 1.0
    return np.asarray((rows / numbers["tau"]).max(axis=1), dtype=np.float64)
