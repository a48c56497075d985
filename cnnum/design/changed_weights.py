"""Weights of a run: set, scaled, rounded and mismatched, in that order."""

from collections.abc import Mapping

import numpy as np

from cnnum.arrays import Floats, largest
from cnnum.design.experiment import WEIGHT, Value
from cnnum.templating.numbers import on_grid
from cnnum.templating.template import Template

Parts = dict[str, Floats]


def weights_of(template: Template, place: Mapping[str, Value], rng: np.random.Generator) -> Parts:
    """Return A, B and z of a run; the order of the axes changes nothing.

    Mismatch multiplies every number by 1 plus a normal number of that width. Of b bits, a number
    is a whole multiple of the largest of its matrix over 2^(b−1) − 1.
    """
    parts: Parts = {"A": template.A.copy(), "B": template.B.copy(), "z": template.z.copy()}
    for name, value in place.items():
        if WEIGHT.fullmatch(name):
            row, col = (int(n) for n in name[2:-1].split(","))
            parts[name[0]][..., row, col] = float(value)
    for name in ("A", "B"):
        if name in place:
            parts[name] *= float(place[name])
    if "z" in place:
        parts["z"][:] = float(place["z"])
    if "bits" in place:
        parts = {key: rounded(part, int(place["bits"])) for key, part in parts.items()}
    width = float(place.get("mismatch", 0.0))
    if width:
        parts = {
            key: part * (1.0 + width * rng.normal(size=part.shape)) for key, part in parts.items()
        }
    return parts


def rounded(part: Floats, bits: int) -> Floats:
    """Return numbers as whole multiples of the largest one over 2^(bits − 1) − 1."""
    return on_grid(part, largest(part), bits)


def biases_of(
    shape: tuple[int, int], place: Mapping[str, Value], rng: np.random.Generator
) -> Floats:
    """Return the bias map of a run: of each cell its own, and one that drifts across the array.

    Parameters
    ----------
    shape : (rows, cols)
    place : mapping
        "offset", a standard deviation, and "drift", that of the slope times the half diagonal.
    rng : Generator
    """
    found = np.zeros(shape)
    if offset := float(place.get("offset", 0.0)):
        found += offset * rng.normal(size=shape)
    if drift := float(place.get("drift", 0.0)):
        rows, cols = (np.arange(n) - (n - 1) / 2.0 for n in shape)
        half = max(float(np.hypot(rows[-1], cols[-1])), 1.0)
        down, east = drift * rng.normal(size=2) / half
        found += down * rows[:, np.newaxis] + east * cols
    return found
