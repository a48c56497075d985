"""Sums over equal blocks of an array."""

import numpy as np
import pytest

import cnnum
from cnnum.errors import ProgramError
from cnnum.programs.machine import blocks, root_sum


@pytest.mark.parametrize(("rows", "columns"), [(1, 1), (1, 2), (2, 3)])
def test_blocks_are_summed_one_by_one(fast, rows, columns):
    """Against NumPy's slices; cells that touch another block are those next to a cut."""

    @cnnum.program
    def summed(frame):
        p, found = frame.picture, {}
        for n, block in enumerate(blocks(frame, rows, columns)):
            found |= {
                f"total {n}": block.total(p),
                f"inner {n}": block.inner(p),
                f"root {n}": root_sum(block.total, [p, 2.0 * p]),
            }
            assert block.cells == block.share.sum() == 24 // (rows * columns)
        return found

    picture = np.random.default_rng(1).integers(-9, 10, (4, 6)).astype(float)
    got = fast.compile(summed, (4, 6), channels=("picture",))(picture)
    high, wide = 4 // rows, 6 // columns
    for n in range(rows * columns):
        row, column = n // columns, n % columns
        part = picture[high * row : high * (row + 1), wide * column : wide * (column + 1)]
        inner = part[row > 0 : high - (row < rows - 1), column > 0 : wide - (column < columns - 1)]
        assert got[f"total {n}"] == part.sum()
        assert got[f"inner {n}"] == inner.sum()
        # single precision, of roots up to 100
        assert got[f"root {n}"] == pytest.approx(np.sqrt(5.0 * (part**2).sum()), rel=1e-6)


@pytest.mark.parametrize(("rows", "columns"), [(3, 1), (1, 4), (0, 1), (1, -2)])
def test_an_array_that_does_not_divide_is_refused(rows, columns):
    @cnnum.program
    def summed(frame):
        return {"a": blocks(frame, rows, columns)[0].total(frame.picture)}

    with pytest.raises(ProgramError, match=rf"4×6 cells does not divide into {rows}×{columns} "):
        summed.trace((4, 6), ("picture",))
