"""The programs for pictures against SciPy and digital references, on every engine."""

from typing import Any

import numpy as np
import pytest
from scipy import ndimage

from cnnum.engine import Engine
from cnnum.engines.registry import backend_names
from cnnum.errors import NotSupportedError
from cnnum.programs import Program
from cnnum.templates.pictures.components import components
from cnnum.templates.pictures.holes import holes
from cnnum.templates.pictures.life import life
from cnnum.templates.pictures.skeleton import skeleton
from cnnum.templating.checks.digital.propagation import next_generation

EIGHT = np.ones((3, 3), dtype=int)
SHAPE = (7, 9)
# corners and sides, clockwise from the north-west: black, white, and of two cells at least one
PEELS = [
    *(("oo./o##/.#.",), ("ooo/.#./##.", "ooo/.#./.##")),
    *((".oo/##o/.#.",), ("#.o/##o/..o", "..o/##o/#.o")),
    *((".#./##o/.oo",), ("##./.#./ooo", ".##/.#./ooo")),
    *((".#./o##/oo.",), ("o.#/o##/o..", "o../o##/o.#")),
]


@pytest.fixture(scope="module", params=backend_names())
def engine(request: pytest.FixtureRequest) -> Engine:
    return Engine(request.param)


def run(engine: Engine, program: Program, cells: np.ndarray) -> dict[str, Any]:
    try:
        plan = engine.compile(program, cells.shape[1:], channels=("picture",))
    except NotSupportedError as reason:
        pytest.skip(str(reason))
    return plan(np.where(cells, 1.0, -1.0)[..., np.newaxis])


def pictures(count: int, seed: int) -> np.ndarray:
    """Return random pictures; the empty and the full one are among them."""
    rng = np.random.default_rng(seed)
    shares = np.linspace(0.0, 1.0, count)[:, np.newaxis, np.newaxis]
    return rng.random((count, *SHAPE)) < shares


def test_life_is_the_digital_game(engine: Engine) -> None:
    alive = pictures(12, 1)
    got = run(engine, life.bind(generations=12), alive)
    generations = [alive]
    for _ in range(12):
        generations.append(next_generation(generations[-1]))
    np.testing.assert_array_equal(got["picture"].astype(bool), generations[12])
    still = (generations[11] == generations[12]).all(axis=(1, 2))
    np.testing.assert_array_equal(got["still"].astype(bool), still)
    assert still.any()
    assert not still.all()


def test_components_are_those_of_ndimage(engine: Engine) -> None:
    cells = pictures(12, 2)
    got = run(engine, components, cells)
    labels = [ndimage.label(picture, EIGHT) for picture in cells]
    np.testing.assert_array_equal(got["count"], [count for _, count in labels])
    largest = [max([0, *np.bincount(found.ravel())[1:]]) for found, _ in labels]
    np.testing.assert_array_equal(got["largest"], largest)


def test_holes_are_those_of_ndimage(engine: Engine) -> None:
    cells = pictures(12, 3)
    got = run(engine, holes, cells)
    filled = np.stack([ndimage.binary_fill_holes(picture) for picture in cells])
    np.testing.assert_array_equal(got["filled"].astype(bool), filled)
    np.testing.assert_array_equal(got["holes"].astype(bool), filled & ~cells)
    np.testing.assert_array_equal(got["area"], (filled & ~cells).sum(axis=(1, 2)))
    assert got["area"].any()


def peeled(picture: np.ndarray) -> np.ndarray:
    """Return the picture after one round of the eight peels, white beyond the frame."""
    for patterns in PEELS:
        hits = np.zeros_like(picture)
        for text in patterns:
            wanted = np.array([list(row) for row in text.split("/")])
            hits |= ndimage.binary_hit_or_miss(np.pad(picture, 1), wanted == "#", wanted == "o")[
                1:-1, 1:-1
            ]
        picture = picture & ~hits
    return picture


@pytest.mark.one_in(2)
def test_skeleton_is_what_digital_peeling_leaves(engine: Engine) -> None:
    # the reference solves eight transients a round, frame by frame
    cells = pictures(3 if engine.name == "reference" else 12, 4)
    got = run(engine, skeleton, cells)
    for picture, thin, rounds in zip(cells, got["picture"], got["rounds"], strict=True):
        before, expected, count = picture, peeled(picture), 1
        while (expected != before).any():
            before, expected, count = expected, peeled(expected), count + 1
        np.testing.assert_array_equal(thin.astype(bool), expected)
        assert rounds == count
        # peeling neither parts objects nor makes them vanish
        assert ndimage.label(expected, EIGHT)[1] == ndimage.label(picture, EIGHT)[1]
