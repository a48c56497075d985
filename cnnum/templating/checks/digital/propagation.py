"""Answers that travel or repeat: propagation, lines, motion, and the game of Life."""

from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from cnnum.arrays import Floats, Shape
from cnnum.templating.checks.digital.neighbourhood import DISCRETE, SETTLED, Bools, digital_form
from cnnum.templating.checks.pictures import as_picture, binary, binary_input, every_neighbourhood
from cnnum.templating.checks.records import Case, ClosedForm, choice, number, time_constant
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

PROPAGATION_FORMS = (
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
    result = [[_packed(*pair) for pair in zip(*both, strict=True)] for both in lines]
    return as_picture(np.array(result)[..., ::step])


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


LINES_FORMS = (
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


_NINE = np.ones((1, 3, 3), dtype=np.int64)
_MOTION_RING = np.array([[[1, 1, 1], [1, 0, 1], [1, 1, 1]]])
_CROSS = ndimage.generate_binary_structure(2, 1)[np.newaxis]


def _shifted_east(pictures: Floats) -> Floats:
    moved = np.full_like(pictures, -1.0)
    moved[..., 1:] = pictures[..., :-1]
    return moved


def _moving(template: Template, rng: np.random.Generator, shape: Shape) -> Case:
    """Draw objects on every second row; most move one cell east.

    Lines on their own have few black neighbours; in wide objects the outputs would be gray.
    """
    lines = np.arange(shape[0])[:, np.newaxis] % 2 == 0
    before = np.where(lines, binary(rng, shape), -1.0)
    other = np.where(lines, rng.permutation(before), -1.0)
    kept = rng.random(before.shape) < 0.7
    return Case(input=np.where(kept, _shifted_east(before), other), previous=before)


def _moved(template: Template, case: Case) -> Floats:
    """Return the states: present plus past, less the inhibition by the answer's neighbours."""
    both = case.pictures + _shifted_east(case.before)
    answer = as_picture(both > 0)
    around = ndimage.correlate(answer, _MOTION_RING.astype(np.float64), mode="constant", cval=-1.0)
    weight, taken = number(template, "weight"), number(template, "inhibition")
    return np.asarray(weight * both + number(template, "bias") - taken * around, dtype=np.float64)


def _overlapping(template: Template, rng: np.random.Generator, shape: Shape) -> Case:
    """Draw the picture of a delay ago as the state, and a picture that partly keeps it."""
    before = binary(rng, shape)
    kept = rng.random(before.shape) < 0.6
    return Case(input=np.where(kept, before, rng.permutation(before)), state=before)


def _kept(template: Template, case: Case) -> Floats:
    around = ndimage.correlate((case.states > 0).astype(np.int64), _NINE, mode="constant")
    return as_picture((case.pictures > 0) & (around >= number(template, "least")))


def _appearing(template: Template, rng: np.random.Generator, shape: Shape) -> Case:
    before = binary(rng, shape)
    kept = rng.random(before.shape) < 0.4
    after = rng.permutation(binary(rng, shape))
    return Case(input=np.where(kept, before, after), previous=before)


def _appeared(template: Template, case: Case) -> Floats:
    now, before = case.pictures > 0, case.before > 0
    gained = now.astype(np.int64) - before.astype(np.int64)
    around = ndimage.correlate(gained, _MOTION_RING, mode="constant")
    return as_picture((gained > 0) & (around >= number(template, "least")))


def _seeds(template: Template, rng: np.random.Generator, shape: Shape) -> Case:
    """Draw a few black cells each, and none in the last picture."""
    chances = np.array([0.03, 0.06, 0.12, 0.0])[:, np.newaxis, np.newaxis]
    return Case(input=as_picture(rng.random((4, *shape)) < chances))


def _grown(template: Template, case: Case) -> Floats:
    times = int(number(template, "steps"))
    return as_picture(ndimage.binary_dilation(case.pictures > 0, _CROSS, iterations=times))


def _travelling(template: Template, rng: np.random.Generator, shape: Shape) -> Case:
    """Draw the present picture as the input and in the first layer, and a path in the second."""
    now = binary(rng, shape)
    return Case(input=now, state=np.stack([now, rng.permutation(now)], axis=1))


def _path(template: Template, case: Case) -> Floats:
    now = case.pictures > 0
    return np.stack([as_picture(now), as_picture(now | (case.states[:, 1] > 0))], axis=1)


MOTION_FORMS = (
    digital_form(
        "moved-east",
        _moving,
        _moved,
        "above 0 where a cell is black and its western neighbour was",
        ("weight", "inhibition", "bias"),
        compares="state",
    ),
    digital_form(
        "kept",
        _overlapping,
        _kept,
        "black cells with a number of black ones in their 3×3 neighbourhood a delay ago",
        ("least",),
    ),
    digital_form(
        "appeared",
        _appearing,
        _appeared,
        "cells that turned black while around them a number more appeared than vanished",
        ("least",),
    ),
    digital_form(
        "path", _travelling, _path, "the picture, and all that it or the path up to now covers"
    ),
    digital_form(
        "delayed-wave",
        _seeds,
        _grown,
        "black regions grown by one cell for each delay that began",
        ("steps",),
    ),
)


_LIFE_RING = np.array([[[1, 1, 1], [1, 0, 1], [1, 1, 1]]])


def next_generation(alive: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return who lives next: who has three living neighbours, or lives and has two.

    Parameters
    ----------
    alive : (pictures, rows, cols) bool
    """
    around = _living_neighbours(alive)
    return np.asarray((around == 3) | (alive & (around == 2)), dtype=np.bool_)


def _living_neighbours(alive: NDArray[np.bool_]) -> NDArray[np.int64]:
    return ndimage.correlate(alive.astype(np.int64), _LIFE_RING, mode="constant")


def _game_case(template: Template, rng: np.random.Generator, shape: Shape) -> Case:
    """Put the game into the third layer, and white into those that count."""
    game = binary(rng, shape)
    white = np.full_like(game, -1.0)
    steps = 2.0 * number(template, "generations")
    return Case(state=np.stack([white, white, game], axis=1), duration=steps)


def _game(template: Template, case: Case) -> Floats:
    """Return all three layers; the counters see an empty array at the end of every even step."""
    alive = case.states[:, 2] > 0
    for _ in range(int(number(template, "generations"))):
        alive = next_generation(alive)
    white = np.full(alive.shape, -1.0)
    return np.stack([white, -white, as_picture(alive)], axis=1)


def _counts(template: Template, case: Case) -> Floats:
    alive = case.pictures > 0
    around = _living_neighbours(alive)
    return np.stack([as_picture(around <= 3), as_picture(around + alive <= 2)], axis=1)


LIFE_FORMS = (
    digital_form(
        "life",
        _game_case,
        _game,
        "generations of the game of life, two steps each",
        ("generations",),
        reason=DISCRETE,
    ),
    digital_form(
        "life-counts",
        every_neighbourhood,
        _counts,
        "at most three living neighbours; at most two living with oneself",
    ),
)

FORMS = (*PROPAGATION_FORMS, *LINES_FORMS, *MOTION_FORMS, *LIFE_FORMS)
