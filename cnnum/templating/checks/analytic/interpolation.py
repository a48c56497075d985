"""Surfaces through given points, by a linear system: the least bent one between held cells."""

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage, sparse
from scipy.sparse.linalg import spsolve

from cnnum.arrays import Floats, Shape
from cnnum.templating.checks.pictures import with_even
from cnnum.templating.checks.records import Case, ClosedForm
from cnnum.templating.template import Template

_RIM = 2
_SHARE = 0.2


def _case(template: Template, rng: np.random.Generator, shape: Shape) -> Case:
    """Hold a fifth of the cells of smooth pictures, start the others from 0; and nothing."""
    smooth = ndimage.gaussian_filter(rng.normal(size=(3, *shape)), (0.0, 1.5, 1.5))
    held = rng.random(smooth.shape) < _SHARE
    held[:, shape[0] // 2, shape[1] // 2] = True
    wanted = 0.4 * smooth / np.abs(smooth).max(axis=(-2, -1), keepdims=True)
    mask = np.concatenate([held, held[:1]]).astype(np.float64)
    return Case(input=with_even(np.where(held, wanted, 0.0), 0.0), mask=mask)


def bending(shape: Shape) -> sparse.csr_matrix:
    """Return the 13-point bi-Laplacian of an array with zeros beyond, cells row-major."""
    sides = [_second_difference(n + 2 * _RIM) for n in shape]
    laplacian = sparse.kronsum(sides[1], sides[0])
    inside = np.pad(np.ones(shape, dtype=bool), _RIM).ravel()
    return sparse.csr_matrix(laplacian @ laplacian)[inside][:, inside]


def _second_difference(cells: int) -> sparse.spmatrix:
    return sparse.diags([1.0, -2.0, 1.0], [-1, 0, 1], shape=(cells, cells), format="csr")


def _surface(matrix: sparse.csr_matrix, held: NDArray[np.bool_], values: Floats) -> Floats:
    surface = values.copy()
    if not held.all():
        free = ~held
        surface[free] = spsolve(
            matrix[free][:, free].tocsc(), -(matrix[free][:, held] @ values[held])
        )
    return surface


def _expected(template: Template, case: Case) -> Floats:
    assert case.mask is not None
    shape = case.pictures.shape[-2], case.pictures.shape[-1]
    matrix = bending(shape)
    pairs = zip(case.mask.astype(bool), case.pictures, strict=True)
    surfaces = [_surface(matrix, held.ravel(), values.ravel()) for held, values in pairs]
    return np.stack([surface.reshape(shape) for surface in surfaces])


FORMS = (
    ClosedForm(
        "interpolation",
        _case,
        _expected,
        1e-3,
        "a run settles where every rate is below 5e-5; the slowest mode decays at 0.9 or faster "
        "with a fifth of the cells held. So 144 rates add up to 7e-4 of its state",
        "the surface of least bending through the held cells, by a sparse linear system",
    ),
)
