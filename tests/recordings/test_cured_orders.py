"""Every order of the numbers of a press: what `check` prints makes it silent, and one is right."""

from itertools import permutations, product

import numpy as np
import pytest
from foreign_files import press

import cnnum
from cnnum.drivers.geometry import Reading
from cnnum.recordings.checking import checked

AXES = "xyz"
ORDERS = list(
    product(
        permutations((1, 2, 3)),  # of rows, columns and channels in memory
        product((1, -1), repeat=2),  # rows and columns from the other end
        permutations((0, 1, 2)),  # of the channels
        product((1, -1), repeat=2),  # signs of both shears
    )
)


def spoilt(values, order):
    memory, (down, right), channels, signs = order
    moved = (values * [*signs, 1])[..., list(channels)][:, ::down, ::right]
    return np.ascontiguousarray(moved.transpose(0, *memory)).reshape(values.shape)


def cured(values, keys):
    names = keys.get("channels", ["x", "y", "z"])
    reading = Reading(tuple(names), keys.get("order", ""), tuple(keys.get("flip", ())))
    places = [[name.lstrip("-") for name in names].index(axis) for axis in AXES]
    return np.stack([reading.of(frame)[..., places] for frame in values])


def remark(values):
    (found,) = (one for one in checked(cnnum.Recording(values, rate=100.0)) if one.what == "order")
    return found


@pytest.mark.one_in(6)
@pytest.mark.parametrize("shape", [(6, 5), (4, 4)])
@pytest.mark.parametrize("part", range(12))
def test_what_check_prints_makes_it_silent_and_one_cure_is_right(shape, part):
    values = press(*shape, offset=16_000)[::6]
    values = np.concatenate([values[:16], values[-12:]])
    for order in ORDERS[part::145]:
        wrong = spoilt(values, order)
        found = remark(wrong)
        keys = [cure for cure in (found.cure, *found.others) if cure]
        if not keys:
            # the pad is mirrored or turned, axes and all: another frame of the same press
            assert "are right" in found.sentence, order
            turns = [values[:, ::a, ::b] * [b, a, 1] for a, b in product((1, -1), repeat=2)]
            turns += [t.swapaxes(1, 2)[..., [1, 0, 2]] for t in turns if shape[0] == shape[1]]
            assert any(np.array_equal(wrong, turn) for turn in turns), order
            continue
        assert found.wrong or "turned by a quarter" in found.sentence
        frames = [cured(wrong, one) for one in keys]
        again = [remark(one) for one in frames]
        for one, then in zip(list(frames), again, strict=True):  # memory first, then the turn
            assert "are right" in then.sentence or "by a quarter" in then.sentence, order
            frames += [cured(one, cure) for cure in (then.cure, *then.others) if cure]
        assert not any(one.wrong for one in again), order
        assert any(np.array_equal(one, values) for one in frames), order
