"""Answers along lines of cells: masked packing, long runs, sorted rows, cumulated sums."""

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from cnnum.arrays import Floats, Shape
from cnnum.templating.checks.digital.form import DISCRETE, SETTLED, digital_form
from cnnum.templating.checks.digital.neighbourhood import Bools
from cnnum.templating.checks.digital.propagation import packed_runs
from cnnum.templating.checks.parameters import choice, number
from cnnum.templating.checks.pictures import as_picture, binary, binary_input
from cnnum.templating.checks.records import Case, ClosedForm, time_constant
from cnnum.templating.template import Template

_AXES = {"east": 1, "south": 0}


def _walled(template: Template, rng: np.random.Generator, shape: Shape) -> Case:
    """Return walls as the input and, as the state, pictures that are white on them."""
    walls = rng.random((12, *shape)) < 0.15
    return Case(input=as_picture(walls), state=as_picture((binary(rng, shape) > 0) & ~walls))


def _packed(line: NDArray[np.bool_], walls: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Pack the runs of every stretch between walls at its end."""
    packed, stretch = np.zeros_like(line), np.cumsum(walls)
    for number_of in np.unique(stretch):
        cells = np.flatnonzero((stretch == number_of) & ~walls)
        packed[cells] = packed_runs(line[cells])
    return packed


def _masked_runs(template: Template, case: Case) -> Floats:
    mirrored = {"east": 1, "west": -1}
    step = choice(template, "direction", mirrored)
    lines = zip((case.states > 0)[..., ::step], (case.pictures > 0)[..., ::step], strict=True)
    found = [[_packed(*pair) for pair in zip(*both, strict=True)] for both in lines]
    return as_picture(np.array(found)[..., ::step])


def _long_runs(template: Template, case: Case) -> Floats:
    axis = choice(template, "direction", _AXES)
    least, trim = int(number(template, "least")), int(number(template, "trimmed"))
    element = np.ones((1, 1 + 2 * trim) if axis else (1 + 2 * trim, 1), dtype=bool)
    whole = np.ones((1, least) if axis else (least, 1), dtype=bool)

    def kept(cells: Bools) -> Bools:
        rim = np.pad(cells, max(least, trim))
        long = ndimage.binary_opening(rim, whole)
        short = ndimage.binary_erosion(long, element)
        return np.asarray(short[max(least, trim) :, max(least, trim) :], dtype=np.bool_)

    rows, cols = case.pictures.shape[-2:]
    return as_picture(np.stack([kept(cells)[:rows, :cols] for cells in case.pictures > 0]))


def _rows_sorted(template: Template, case: Case) -> Floats:
    """Return the black cells of each row, all at its west end."""
    return -np.sort(-case.pictures, axis=-1)


def _sort_case(template: Template, rng: np.random.Generator, shape: Shape) -> Case:
    return Case(input=binary(rng, shape), duration=2.0 * shape[1] * time_constant(template))


def _cumulated(template: Template, case: Case) -> Floats:
    """Return the sum of all inputs from the west end to the cell, times the gain."""
    return number(template, "gain") * np.cumsum(case.pictures, axis=-1)


FORMS = (
    digital_form(
        "masked-runs",
        _walled,
        _masked_runs,
        "one cell for each run of black ones between walls, packed at the end of the stretch",
        needs=("direction",),
        reason=SETTLED,
    ),
    digital_form(
        "long-runs",
        binary_input,
        _long_runs,
        "runs of at least a number of black cells, trimmed at both ends",
        needs=("direction", "least", "trimmed"),
        reason=SETTLED,
    ),
    digital_form(
        "sorted-rows",
        _sort_case,
        _rows_sorted,
        "the black cells of each row, all at its west end",
        reason=DISCRETE,
    ),
    ClosedForm(
        "cumulated",
        binary_input,
        _cumulated,
        2e-3,
        "a run settles where rates are below 5e-5, and a row of up to 32 cells hands them on",
        "the sum of a row up to the cell, times the gain",
        needs=("gain",),
        compares="state",
    ),
)
