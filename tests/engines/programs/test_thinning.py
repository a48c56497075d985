"""Families of templates in sequence, against the digital definition of their elements."""

import numpy as np
import pytest
from scipy import ndimage

from cnnum.engine import Engine
from cnnum.errors import UnknownNameError
from cnnum.templates.pictures.center import center
from cnnum.templates.pictures.thinning import thinning

SHAPE = (7, 9)
NORTH = {
    "SKL": "###/.#./.o.",
    "SKLHV": "###/.#./ooo",
}
CENTRE = ("o../o##/o..", "ooo/o#./o.#")


def turned(pattern, times):
    rows = np.array([list(row) for row in pattern.split("/")])
    return np.rot90(rows, -times)


def diagonal(pattern):
    """The element turned by 45 degrees: its ring moved on by one cell."""
    ring = [(0, 0), (0, 1), (0, 2), (1, 2), (2, 2), (2, 1), (2, 0), (1, 0)]
    moved = pattern.copy()
    for here, there in zip(ring, ring[1:] + ring[:1], strict=True):
        moved[there] = pattern[here]
    return moved


def until_still(cells, elements):
    """Take away the cells whose neighbourhood is an element, one element after the other."""
    while True:
        before = cells
        for wanted in elements:
            hit = ndimage.binary_hit_or_miss(np.pad(cells, 1), wanted == "#", wanted == "o")
            cells = cells & ~hit[1:-1, 1:-1]
        if (cells == before).all():
            return cells


def pictures(seed):
    rng = np.random.default_rng(seed)
    shares = np.linspace(0.0, 1.0, 8)[:, np.newaxis, np.newaxis]
    smooth = ndimage.gaussian_filter(rng.random((4, *SHAPE)), (0, 1, 1)) < 0.5
    return np.concatenate([rng.random((8, *SHAPE)) < shares, smooth])


def run(engine, program, cells):
    plan = engine.compile(program, SHAPE, channels=("picture",))
    return plan(np.where(cells, 1.0, -1.0)[..., np.newaxis])["picture"].astype(bool)


def test_centre_points_are_those_of_the_peels(fast):
    elements = [turned(CENTRE[n % 2], n // 2) for n in range(8)]
    cells = pictures(4)
    wanted = np.stack([until_still(picture, elements) for picture in cells])
    np.testing.assert_array_equal(run(fast, center, cells), wanted)


def test_a_block_shrinks_to_one_cell(fast):
    cells = np.zeros((1, *SHAPE), dtype=bool)
    cells[0, 1:6, 2:8] = True
    assert run(fast, center, cells).sum() == 1


@pytest.mark.one_in(2)
@pytest.mark.parametrize("family", ["SKL", "SKLHV"])
def test_thinning_is_that_of_its_elements(fast, family):
    north = turned(NORTH[family], 0)
    # the first of the family points to the north-west, the others follow clockwise
    corner = diagonal(diagonal(diagonal(diagonal(diagonal(diagonal(diagonal(north)))))))
    elements = [np.rot90(e, -k) for k in range(4) for e in (corner, north)]
    cells = pictures(5)
    wanted = np.stack([until_still(picture, elements) for picture in cells])
    np.testing.assert_array_equal(run(fast, thinning.bind(family=family), cells), wanted)


@pytest.mark.one_in(2)
@pytest.mark.parametrize(("family", "turns"), [("HORSKEL", (3, 1)), ("VERSKEL", (0, 2))])
def test_two_sides_are_peeled_until_nothing_changes(fast, family, turns):
    elements = [turned("ooo/.#./.#.", turn) for turn in turns]
    cells = pictures(8)
    wanted = np.stack([until_still(picture, elements) for picture in cells])
    assert wanted.sum() < cells.sum()
    np.testing.assert_array_equal(run(fast, thinning.bind(family=family), cells), wanted)


def peeled(cells):
    """MatCNN's eight steps by the rule of their words, the picture turned for each: until still.

    A corner goes if the three neighbours around it are white and the two opposite sides black. A
    side goes if its three neighbours are white and the one ahead is black. One next to that must be
    black, too.
    """
    while True:
        before = cells
        for step in range(8):
            picture = np.pad(np.rot90(cells, step // 2), 1)
            middle = slice(1, -1)
            up, down, left, right = slice(0, -2), slice(2, None), slice(0, -2), slice(2, None)
            nw, n, ne = (picture[up, c] for c in (left, middle, right))
            sw, s, se = (picture[down, c] for c in (left, middle, right))
            w, e = picture[middle, left], picture[middle, right]
            corner = ~(nw | n | w) & e & s
            side = ~(nw | n | ne) & s & (sw | se)
            cells = np.rot90(
                np.rot90(cells, step // 2) & ~(side if step % 2 else corner), -(step // 2)
            )
        if (cells == before).all():
            return cells


def test_matcnns_skeleton_is_that_of_corners_and_sides(fast):
    cells = pictures(6)
    wanted = np.stack([peeled(picture) for picture in cells])
    np.testing.assert_array_equal(run(fast, thinning.bind(family="SKELE"), cells), wanted)


def test_matcnns_skeleton_keeps_objects_and_holes(fast):
    cells = pictures(7)
    thinned = run(fast, thinning.bind(family="SKELE"), cells)
    assert thinned.sum() < cells.sum()
    for before, after in zip(cells, thinned, strict=True):
        for black, around in ((True, np.ones((3, 3))), (False, None)):
            count = [ndimage.label(np.pad(p, 1) == black, around)[1] for p in (before, after)]
            assert count[0] == count[1]


def test_an_unknown_family_is_named():
    with pytest.raises(UnknownNameError, match="family of templates 'SKELETON'"):
        Engine("reference").compile(thinning.bind(family="SKELETON"), SHAPE, channels=("picture",))
