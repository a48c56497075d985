"""Check whether a saturating array stays in the linear range, in which its solution is exact.

Let every cell lie within [−1, 1]. Let a₀₀ be a cell's own weight, aⱼ its neighbours', and w its
drive B∗u + z. A cell at the upper edge moves by −1 + a₀₀ + Σ aⱼ yⱼ + w at most. If that is not
above 0 for any cell, and alike at the lower edge, none ever leaves (Nagumo 1942: the flow points
into the box), and the array is the same with the output y = x.
"""

from collections.abc import Container, Mapping

import numpy as np
from numpy.typing import NDArray

from cnnum.arrays import Floats
from cnnum.templating.template import Template


def room(template: Template) -> Floats:
    """Return the largest drive under which cells within [−1, 1] stay there.

    Parameters
    ----------
    template : Template

    Returns
    -------
    (layers,) float
        Negative if no drive is small enough.
    """
    A, centre = template.A, template.A.shape[-1] // 2
    own = np.diagonal(A[:, :, centre, centre])
    others = np.abs(A).sum(axis=(1, 2, 3)) - np.abs(own)
    return np.asarray(1.0 - own - others, dtype=np.float64)


def stays_linear(template: Template, given: Mapping[str, NDArray[np.floating]]) -> bool:
    """Return whether no cell of a run ever leaves the linear range of the standard output.

    Parameters
    ----------
    template : Template
    given : mapping of str to (..., maps, rows, cols) float
        Input, state and bias of the run, as far as they are given.
    """
    left = room(template)
    if (left < 0.0).any() or not _linear_within(template, given):
        return False
    starts = np.abs(_start(template, given)).max() <= 1.0
    return bool(starts and (_drive(template, given) <= left).all())


def may_stay_linear(template: Template, given: Container[str]) -> bool:
    """Return whether there are numbers with which no cell of a run leaves the linear range.

    Parameters
    ----------
    template : Template
    given : container of str
        Roles of the maps that the run is given.
    """
    return _linear_within(template, given) and bool((np.abs(template.z) <= room(template)).all())


def _linear_within(template: Template, given: Container[str]) -> bool:
    """Return whether the array is linear as long as its cells are within the linear range."""
    if template.output.name != "standard" or not template.plain or "mask" in given:
        return False
    return abs(template.boundary.constant or 0.0) <= 1.0


def as_linear(template: Template) -> Template:
    """Return the same template with the output y = x."""
    return Template(
        template.name,
        template.A,
        template.B,
        template.z.tolist(),
        tau=template.tau.tolist(),
        boundary=template.boundary,
        input_boundary=template.input_boundary,
        initial=template.initial,
        duration=template.duration,
        output="linear",
    )


def _start(template: Template, given: Mapping[str, NDArray[np.floating]]) -> NDArray[np.floating]:
    if "state" in given:
        return given["state"]
    return given["input"] if template.initial == "input" else np.array(template.initial)


def _drive(template: Template, given: Mapping[str, NDArray[np.floating]]) -> Floats:
    """Return the largest drive of any cell that such inputs and biases can make, (layers,)."""
    drive = np.abs(template.z)
    if "bias" in given:
        drive = drive + _largest(given["bias"])
    if "input" in given and template.inputs:
        seen = np.maximum(_largest(given["input"]), abs(template.input_boundary.constant or 0.0))
        with np.errstate(invalid="ignore"):  # infinite numbers are refused later
            drive = drive + np.abs(template.B).sum(axis=(2, 3)) @ seen
    return np.asarray(drive, dtype=np.float64)


def _largest(maps: NDArray[np.floating]) -> Floats:
    """Return the largest size in each map, (maps,)."""
    axes = tuple(axis for axis in range(maps.ndim) if axis != maps.ndim - 3)
    return np.asarray(np.abs(maps).max(axis=axes), dtype=np.float64)
