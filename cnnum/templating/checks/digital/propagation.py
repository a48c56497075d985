"""Boolean answers that a wave brings from any distance: shadows, holes, marked objects, runs."""

from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from cnnum.arrays import Floats, Shape
from cnnum.templating.checks.digital.form import SETTLED, digital_form
from cnnum.templating.checks.digital.neighbourhood import Bools
from cnnum.templating.checks.parameters import choice
from cnnum.templating.checks.pictures import as_picture, binary, binary_input
from cnnum.templating.checks.records import Case
from cnnum.templating.template import Template

_FOUR = ndimage.generate_binary_structure(2, 1)
_EIGHT = ndimage.generate_binary_structure(2, 2)


def _each(operation: Callable[[Bools], Bools], pictures: Floats) -> Floats:
    return as_picture(np.stack([operation(cells) for cells in pictures > 0]))


def _each_pair(operation: Callable[[Bools, Bools], Bools], case: Case) -> Floats:
    pairs = zip(case.pictures > 0, case.states > 0, strict=True)
    return as_picture(np.stack([operation(cells, start) for cells, start in pairs]))


def _marked(template: Template, rng: np.random.Generator, shape: Shape) -> Case:
    """Return objects as the input and, as the state, a few of their own cells as markers."""
    objects = binary(rng, shape)
    markers = (objects > 0) & (rng.random(objects.shape) < 2 / min(shape[0] * shape[1], 32))
    return Case(input=objects, state=as_picture(markers))


def _punctured(template: Template, rng: np.random.Generator, shape: Shape) -> Case:
    """Return objects as the input and, as the state, the same with a few cells taken out."""
    case = _marked(template, rng, shape)
    kept = (case.pictures > 0) & ~(case.states > 0)
    return Case(input=case.pictures, state=as_picture(kept))


def _holes(template: Template, case: Case) -> Floats:
    return _each(lambda cells: ndimage.binary_fill_holes(cells, _FOUR), case.pictures)


def _reconstruction(template: Template, case: Case) -> Floats:
    return _each_pair(
        lambda objects, markers: ndimage.binary_propagation(markers, _EIGHT, mask=objects), case
    )


def _unmarked(template: Template, case: Case) -> Floats:
    return _each_pair(_drop_punctured, case)


def _drop_punctured(objects: Bools, left: Bools) -> Bools:
    holes = objects & ~left
    return objects & ~ndimage.binary_propagation(holes, _FOUR, mask=objects)


def _shadow_west(cells: Bools) -> Bools:
    return np.logical_or.accumulate(cells[:, ::-1], axis=1)[:, ::-1]


def _shadow_columns(cells: Bools) -> Bools:
    return np.broadcast_to(cells.any(axis=0), cells.shape)


def _shadow_south(cells: Bools) -> Bools:
    return np.logical_or.accumulate(cells, axis=0)


_SHADOWS = {"west": _shadow_west, "south": _shadow_south, "north-south": _shadow_columns}


def _shadow(template: Template, case: Case) -> Floats:
    return _each(choice(template, "direction", _SHADOWS), case.pictures)


def packed_runs(line: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return one black cell for each run of black ones, packed at the end, every second cell."""
    runs = int(line[0]) + int((line[1:] & ~line[:-1]).sum()) if line.size else 0
    packed = np.zeros_like(line)
    packed[::-1][: 2 * runs : 2] = True
    return packed


def _runs_east(cells: Bools) -> Bools:
    return np.stack([packed_runs(row) for row in cells])


def _runs_south(cells: Bools) -> Bools:
    return _runs_east(cells.T).T


def _runs_south_east(cells: Bools) -> Bools:
    packed = np.zeros_like(cells)
    rows, cols = np.indices(cells.shape)
    for offset in range(1 - cells.shape[0], cells.shape[1]):
        diagonal = cols - rows == offset
        packed[diagonal] = packed_runs(cells[diagonal])
    return packed


_RUNS = {"east": _runs_east, "south": _runs_south, "south-east": _runs_south_east}


def _components(template: Template, case: Case) -> Floats:
    return _each(choice(template, "direction", _RUNS), case.pictures)


_form = partial(digital_form, reason=SETTLED)

FORMS = (
    _form("holes", binary_input, _holes, "objects with their holes filled (4-connected white)"),
    _form("reconstruction", _marked, _reconstruction, "8-connected objects that hold a marker"),
    _form("unmarked", _punctured, _unmarked, "4-connected objects that no cell was taken from"),
    _form("shadow", binary_input, _shadow, "cells in the shadow of a black one", ("direction",)),
    _form(
        "runs",
        binary_input,
        _components,
        "one cell for each run of black ones on a line, packed at its end",
        ("direction",),
    ),
)
