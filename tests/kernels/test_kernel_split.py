"""Plans of large arrays are split at their sweeps: kernels, launches, and the scopes of names."""

import pytest

from cnnum import kernels as ir
from cnnum.kernels.kernel_split import split_kernels
from cnnum.kernels.launch_plan import Launch, Rounds
from cnnum.kernels.number_types import FLOAT64
from cnnum.kernels.printer import OpenCLPrinter

A, B, N, X, TOTAL = ir.names("a b n x total")


def texts(kernels):
    """The lines of each kernel's body."""
    return [OpenCLPrinter(FLOAT64).lines(kernel.body) for kernel in kernels]


def test_statements_are_split_at_their_sweeps():
    """A sum is gathered in the order of its pieces; the host repeats rounds."""
    summed = ir.sweep(ir.ROW, 7, [ir.Accumulate(TOTAL, "+", X[ir.ROW])])
    rounds = ir.Counted(N, 0, 5, None, (summed,))
    body = [ir.Array(X, 7, ir.Name("mine") + 0), ir.declare(TOTAL, ir.ZERO), rounds]
    plan, kernels = split_kernels(body, 7)
    begin, repeated = plan.parts
    assert isinstance(begin, Launch)
    assert isinstance(repeated, Rounds)
    assert repeated.count == 5
    assert [part.pieces for part in repeated.parts] == [7, 1]
    assert plan.partials == 7
    assert [kernel.name for kernel in kernels] == ["part_0", "part_1", "part_2"]
    assert "total_0 = piece == 0 ? total_0 : ZERO;" in texts(kernels)[1]


def test_a_sweep_may_not_change_what_pieces_share():
    body = [ir.declare(TOTAL, ir.ZERO), ir.sweep(ir.CELL, 9, [ir.Assign(TOTAL, ir.Number(2.0))])]
    with pytest.raises(ValueError, match="cannot be split"):
        split_kernels(body, 3)


def test_names_end_with_their_block():
    """Two blocks' variables of one name are two registers."""
    inner = ir.block(ir.declare(A, ir.ONE), ir.Assign(B, A))
    plan, _ = split_kernels([ir.declare(B, ir.ZERO), inner, ir.Branch(B > ir.ZERO, (inner,))], 3)
    assert plan.registers == 4  # b, both a, and the branch's condition


def test_a_number_that_is_always_the_same_takes_no_register():
    """It stands where its name stood; a note goes with the next kernel alone."""
    half = ir.fixed(A, ir.Number(0.5))
    body = [half, ir.Note("// halves"), ir.sweep(ir.ROW, 3, [ir.Assign(X[ir.ROW], A)])]
    plan, (kernel,) = split_kernels([ir.Array(X, 3, ir.Name("mine") + 0), *body], 3)
    assert plan.registers == 0
    assert kernel.note == "// halves"
    assert "    x_0[r] = (R(0.5));" in texts([kernel])[0]


def test_rounds_that_frames_end_are_asked_of_a_register():
    """Statements of a round are for the frames that still run, and so is its sweep."""
    running = ir.declare(B, ir.ONE)
    body = (ir.sweep(ir.ROW, 3, [ir.Assign(X[ir.ROW], ir.ONE)]), ir.Assign(B, ir.ZERO))
    rounds = ir.Counted(N, 0, 9, B, body)
    plan, kernels = split_kernels([ir.Array(X, 3, ir.Name("mine") + 0), running, rounds], 3)
    repeated = plan.parts[-1]
    assert isinstance(repeated, Rounds)
    assert repeated.flag == 2  # after those of `b` and of the count
    _, swept, after = texts(kernels)
    assert swept[:2] == ["if (registers[2 * batch + frame] == 0) {", "    return;"]
    assert "if (go_2 != 0) {" in after
