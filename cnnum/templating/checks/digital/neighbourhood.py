"""Boolean answers that depend on a cell's neighbourhood only, through scipy.ndimage."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from cnnum.arrays import Floats
from cnnum.errors import TemplateError
from cnnum.templating.boundary import Boundary
from cnnum.templating.checks.digital.form import digital_form
from cnnum.templating.checks.parameters import has, number, text
from cnnum.templating.checks.pictures import as_picture, every_neighbourhood
from cnnum.templating.checks.records import Case
from cnnum.templating.template import Template

Bools = NDArray[np.bool_]

_SQUARE = np.ones((3, 3), dtype=bool)
_RING = np.array([[1, 1, 1], [1, 0, 1], [1, 1, 1]])
_SYMBOLS = {"#": "black", "o": "white", ".": "any"}


def pattern(template: Template, name: str) -> NDArray[np.str_]:
    """Return a 3×3 pattern of '#' (black), 'o' (white) and '.' (any), rows parted by '/'.

    Raises
    ------
    TemplateError
        If the parameter is something else.
    """
    rows = text(template, name).split("/")
    cells = [list(row) for row in rows]
    if [len(row) for row in cells] != [3, 3, 3] or {*"".join(rows)} - _SYMBOLS.keys():
        raise TemplateError(
            f"Template '{template.name}': the parameter '{name}' of its check must be three rows "
            f"of '#', 'o' and '.', parted by '/', got '{text(template, name)}'."
        )
    return np.array(cells)


def local(operation: Callable[[Bools], Bools], picture: Floats, boundary: Boundary) -> Bools:
    """Apply an operation of radius 1 to pictures whose rim of virtual cells is as the boundary's.

    Raises
    ------
    TemplateError
        If a fixed boundary is neither black nor white.
    """
    if boundary.constant not in (None, -1.0, 1.0):
        raise TemplateError(
            f"A black-and-white check needs a boundary of -1, 1, 'zero-flux' or 'periodic', "
            f"got {boundary}."
        )
    rim = [(0, 0), (1, 1), (1, 1)]
    if boundary.constant is None:
        padded = np.pad(picture, rim, mode=boundary.pad_mode)
    else:
        padded = np.pad(picture, rim, constant_values=boundary.constant)
    answers = [operation(cells)[1:-1, 1:-1] for cells in padded > 0]
    return np.stack(answers)


def _local_answer(template: Template, case: Case, operation: Callable[[Bools], Bools]) -> Floats:
    return as_picture(local(operation, case.pictures, template.input_boundary))


def _erosion(template: Template, case: Case) -> Floats:
    element = pattern(template, "element") == "#"
    return _local_answer(template, case, lambda p: ndimage.binary_erosion(p, element))


def _dilation(template: Template, case: Case) -> Floats:
    # A cell turns black if the element, laid on it, hits; scipy lays the reflected one.
    element = (pattern(template, "element") == "#")[::-1, ::-1]
    return _local_answer(template, case, lambda p: ndimage.binary_dilation(p, element))


def _edge(template: Template, case: Case) -> Floats:
    return _local_answer(template, case, lambda p: p & ~ndimage.binary_erosion(p, _SQUARE))


def _hit_or_miss(template: Template, case: Case) -> Floats:
    wanted = pattern(template, "pattern")
    return _local_answer(
        template, case, lambda p: ndimage.binary_hit_or_miss(p, wanted == "#", wanted == "o")
    )


def _thinning(template: Template, case: Case) -> Floats:
    patterns = [pattern(template, name) for name in ("pattern", "or") if has(template, name)]

    def operation(cells: Bools) -> Bools:
        hits = [ndimage.binary_hit_or_miss(cells, p == "#", p == "o") for p in patterns]
        return np.asarray(cells & ~np.any(hits, axis=0), dtype=np.bool_)

    return _local_answer(template, case, operation)


def _black_with_neighbours(template: Template, case: Case) -> Floats:
    least, most = number(template, "least", 0), number(template, "most", 8)

    def operation(cells: Bools) -> Bools:
        black = ndimage.correlate(cells.astype(np.int64), _RING, mode="constant")
        return cells & (black >= least) & (black <= most)

    return _local_answer(template, case, operation)


FORMS = (
    digital_form(
        "edge", every_neighbourhood, _edge, "black cells that the erosion by a 3×3 square removes"
    ),
    digital_form(
        "erosion", every_neighbourhood, _erosion, "binary erosion by the element", ("element",)
    ),
    digital_form(
        "dilation",
        every_neighbourhood,
        _dilation,
        "binary dilation by the reflected element",
        ("element",),
    ),
    digital_form(
        "thinning",
        every_neighbourhood,
        _thinning,
        "black cells but for those whose neighbourhood is the one pattern or the other",
        ("pattern",),
        ("or",),
    ),
    digital_form(
        "hit-or-miss",
        every_neighbourhood,
        _hit_or_miss,
        "cells whose neighbourhood is the pattern",
        ("pattern",),
    ),
    digital_form(
        "neighbour-count",
        every_neighbourhood,
        _black_with_neighbours,
        "black cells with a number of black ones among their eight neighbours",
        takes=("least", "most"),
    ),
)
