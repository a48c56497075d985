"""Answers of `active_contour`: which of two bodies it keeps to."""

import numpy as np

from cnnum.arrays import Shape
from cnnum.templating.checks.program_records import Outputs, ProgramCase, ProgramForm

REST, RATE, NOISE = 20, 100.0, 1e-4


def _two_bodies(rng: np.random.Generator, shape: Shape) -> ProgramCase:
    """Draw a body with the largest load, and one apart from it that touches, too."""
    rows, cols = shape
    cut = int(rng.integers(cols // 2 - 1, cols // 2 + 1))
    body, other = np.zeros((2, *shape))
    body[rng.integers(0, 2) : rows - 1, :cut], other[1:, cut + 1 :] = 1.0, 0.8
    body[rows // 2, 0] = 1.2
    frames = NOISE * rng.normal(size=(REST + 40, *shape, 3))
    frames[REST:, ..., 2] += body + other
    settings = {"rate": RATE, "reads": "force", "push": 1.0, "speed": 60.0}
    return ProgramCase(frames, {"inside": np.sign(body)}, settings)


def _wrong_cells(case: ProgramCase, outputs: Outputs) -> float:
    wrong = (np.asarray(outputs["contour_inside"]) > 0) != (case.expected["inside"] > 0)
    return float(np.count_nonzero(wrong) + (float(outputs["contour_rests"]) == 0.0))


FORMS = (
    ProgramForm(
        name="one-of-two-bodies",
        program="active_contour",
        needs=("contour_inside", "contour_rests"),
        cases=_two_bodies,
        error=_wrong_cells,
        tolerance=0.0,
        tolerance_reason="a cell is inside or not",
        summary="the body with the peak, all of it and nothing of another one",
    ),
)
