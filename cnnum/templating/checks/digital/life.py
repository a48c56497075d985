"""Conway's game of life, digitally: dead beyond the frame."""

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from cnnum.arrays import Floats, Shape
from cnnum.templating.checks.digital.form import DISCRETE, digital_form
from cnnum.templating.checks.parameters import number
from cnnum.templating.checks.pictures import as_picture, binary, every_neighbourhood
from cnnum.templating.checks.records import Case
from cnnum.templating.template import Template

_RING = np.array([[[1, 1, 1], [1, 0, 1], [1, 1, 1]]])


def next_generation(alive: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return who lives next: who has three living neighbours, or lives and has two.

    Parameters
    ----------
    alive : (pictures, rows, cols) bool
    """
    around = _living_neighbours(alive)
    return np.asarray((around == 3) | (alive & (around == 2)), dtype=np.bool_)


def _living_neighbours(alive: NDArray[np.bool_]) -> NDArray[np.int64]:
    return ndimage.correlate(alive.astype(np.int64), _RING, mode="constant")


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


FORMS = (
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
