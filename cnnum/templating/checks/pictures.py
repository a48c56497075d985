"""Random pictures that checks run on: +1 black, −1 white, or gray between."""

import numpy as np
from scipy import ndimage

from cnnum.arrays import Floats, Shape
from cnnum.templating.checks.neighbourhoods import covering
from cnnum.templating.checks.records import Case
from cnnum.templating.template import Template

DENSITIES = (0.0, 0.15, 0.35, 0.5, 0.7, 1.0)
"""Shares of black cells; the empty and the full picture are among them."""


def binary(rng: np.random.Generator, shape: Shape) -> Floats:
    """Return black-and-white pictures, speckled and blobby ones, of several densities.

    Nothing keeps the objects away from the frame, and many of them touch it.

    Returns
    -------
    (2·densities, rows, cols) float, ±1
    """
    noise = rng.random((len(DENSITIES), *shape))
    smooth = ndimage.gaussian_filter(noise, (0.0, 1.2, 1.2), mode="reflect")
    blobs = np.stack(
        [field < np.quantile(field, share) for field, share in zip(smooth, DENSITIES, strict=True)]
    )
    speckles = noise < np.reshape(DENSITIES, (-1, 1, 1))
    return as_picture(np.concatenate([speckles, blobs]))


def gray(rng: np.random.Generator, shape: Shape, amplitude: float = 0.95) -> Floats:
    """Return gray pictures within ±amplitude: noise, two smooth ones, a single cell, an empty one.

    Returns
    -------
    (5, rows, cols) float
    """
    noise = rng.uniform(-1.0, 1.0, (3, *shape))
    smooth = ndimage.gaussian_filter(noise[1:], (0.0, 1.0, 1.0), mode="reflect")
    point = np.zeros((1, *shape))
    point[0, rng.integers(shape[0]), rng.integers(shape[1])] = 1.0
    pictures = np.concatenate([noise[:1], smooth, point])
    peaks = np.max(np.abs(pictures), axis=(-2, -1), keepdims=True)
    drawn = np.asarray(amplitude * pictures / peaks, dtype=np.float64)
    return with_even(drawn, -amplitude)


def with_even(pictures: Floats, level: float) -> Floats:
    """Return pictures (pictures, ..., rows, cols) and one more, with that level in every cell."""
    return np.concatenate([pictures, np.full_like(pictures[:1], level)])


def as_picture(cells: np.ndarray[tuple[int, ...], np.dtype[np.bool_]]) -> Floats:
    """Return +1 where a cell is set and −1 elsewhere."""
    return np.where(cells, 1.0, -1.0)


def binary_input(template: Template, rng: np.random.Generator, shape: Shape) -> Case:
    """Return a case of black-and-white pictures as the input."""
    return Case(input=binary(rng, shape))


def every_neighbourhood(template: Template, rng: np.random.Generator, shape: Shape) -> Case:
    """Return a case whose input shows every 3×3 neighbourhood, also at the rim."""
    return Case(input=covering(rng, shape, template.input_boundary))


def every_pair(template: Template, rng: np.random.Generator, shape: Shape) -> Case:
    """Return a case with every neighbourhood in the input, under a white and a black state."""
    pictures = covering(rng, shape, template.input_boundary)
    state = as_picture(rng.random(pictures.shape) < 0.5)
    return Case(input=np.concatenate([pictures, pictures]), state=np.concatenate([state, -state]))


def binary_case(template: Template, rng: np.random.Generator, shape: Shape) -> Case:
    """Return black-and-white pictures for all that a template reads: its inputs, or its state."""

    def drawn(count: int) -> Floats:
        maps = [rng.permutation(binary(rng, shape)) for _ in range(count)]
        return maps[0] if count == 1 else np.stack(maps, axis=1)

    given = drawn(template.inputs) if template.inputs else None
    late = given if template.delayed is not None else None
    return Case(
        input=given, previous=late, state=None if template.inputs else drawn(template.layers)
    )
