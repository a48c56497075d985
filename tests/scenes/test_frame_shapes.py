"""Frames of another shape than the array's are refused in one sentence, and never stretched."""

import numpy as np
import pytest

import cnnum
from cnnum.errors import ArrayError
from cnnum.scenes.conversion import ByCalibration
from cnnum.scenes.events import EventDetector
from cnnum.scenes.frame_path import FramePath
from cnnum.tactile.taxel import SIDES, Calibration

ENGINES = ("numba", "opencl", "reference")
WRONG = [(1, 8, 1), (8, 1, 1), (4, 4, 1), (8, 8, 2), (8, 8), (1, 8, 8, 1)]


@cnnum.program
def total(frame):
    return {"sum": frame.normal.sum()}


@pytest.fixture(params=ENGINES)
def plan(request):
    return cnnum.Engine(request.param).compile(total, (8, 8), channels=("normal",))


@pytest.mark.parametrize("shape", WRONG, ids=str)
def test_a_stream_of_what_is_read_takes_one_shape(plan, shape):
    stream = plan.stream()
    with pytest.raises(ArrayError, match=r"\(8, 8, 1\) with the channels normal, got") as caught:
        stream.push_read(np.ones(shape))
    assert str(shape) in str(caught.value)
    assert stream.push_read(np.ones((8, 8, 1)))["sum"] == 64.0


@pytest.mark.parametrize("shape", [(1, 8), (4, 4), *WRONG[:4]], ids=str)
@pytest.mark.parametrize(
    "run",
    [
        lambda plan, frame: plan(frame),
        lambda plan, frame: plan.run_finite(frame),
        lambda plan, frame: plan.stream().push(frame),
        lambda plan, frame: list(plan.trace(frame)),
    ],
    ids=["call", "run_finite", "push", "trace"],
)
def test_a_plan_takes_one_shape(plan, run, shape):
    with pytest.raises(ArrayError, match=r"\(\.\.\., 8, 8, 1\) with the channels normal, got"):
        run(plan, np.ones(shape))


def test_a_row_is_not_stretched_to_an_array_by_its_calibration():
    """Offsets of 8×8 taxels would make 8×8 strains of 1×8 voltages."""
    plan = cnnum.Engine("reference").compile(total, (8, 8), channels=("normal",))
    calibration = Calibration(1.0, 1.0, offsets=np.zeros((8, 8, 4)))
    way = FramePath(
        ByCalibration(calibration).reader(("normal",)), plan.stream(), EventDetector(())
    )

    def frame(rows):
        return cnnum.Frame(np.ones((rows, 8, 4)), SIDES, "V", 7, 0.0)

    assert way.step(0, frame(8)).outputs
    with pytest.raises(ArrayError, match="8×8 taxels, got 1×8 in frame 7"):
        way.step(1, frame(1))


@pytest.mark.parametrize("name", ENGINES)
def test_a_run_takes_rows_of_one_length_and_one_array_at_least(name):
    engine, edge = cnnum.Engine(name), cnnum.get_template("EDGE")
    with pytest.raises(
        ArrayError,
        match=r"'input' .* got a list of rows",
    ):
        engine.run(edge, input=[[1.0, 2.0], [3.0]])
    with pytest.raises(ArrayError, match="at least one array"):
        engine.run(edge, input=np.zeros((0, 8, 8)))
    with pytest.raises(ArrayError, match="share their rows and columns"):
        engine.run(edge, input=np.ones((8, 8)), state=np.ones((1, 8)))


@pytest.mark.parametrize("name", ENGINES)
def test_a_chain_of_cells_is_one_row_and_a_volume_is_a_batch(name):
    engine, edge = cnnum.Engine(name), cnnum.get_template("EDGE")
    black = np.array([-1.0, 1.0, 1.0, 1.0, -1.0, 1.0])
    with pytest.raises(ArrayError, match=r"shape \(6,\): a chain of N cells is an array of 1×N"):
        engine.run(edge, input=black)
    # the rim is its own neighbour above and below: the middle of three black cells is no edge
    ends = np.array([-1.0, 1.0, -1.0, 1.0, -1.0, 1.0])
    np.testing.assert_array_equal(engine.run(edge, input=[black]).output, [ends])
    square = -np.ones((5, 5))
    square[1:4, 1:4] = 1.0
    rim = square.copy()
    rim[2, 2] = -1.0
    # in a volume, the outer two would be faces of a cube, and all edge
    volume = np.stack([square, square, square])
    np.testing.assert_array_equal(engine.run(edge, input=volume).output, [rim, rim, rim])


def test_a_frame_takes_rows_of_one_length():
    plan = cnnum.Engine("reference").compile(total, (2, 2), channels=("normal",))
    with pytest.raises(
        ArrayError,
        match=r"'frame' .* got a list of rows",
    ):
        plan([[1.0, 2.0], [3.0]])
