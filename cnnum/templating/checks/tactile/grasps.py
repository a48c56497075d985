"""What `grasp_slip` is checked against: its score where pull, rearranging and noise are known."""

import numpy as np

from cnnum.arrays import Floats, Shape
from cnnum.templating.checks.program_records import Outputs, ProgramCase, ProgramForm

RATE, WINDOW, THRESHOLD = 60.0, 0.2, 6.0

STILL, PULLED = 40, 30
"""Frames in which nothing moves but noise, and of the pull after them; half a second is learned."""

OFFSET = 1000.0
"""Counts of a taxel without load."""

QUIET, LOOSE = 2.0, 6.0
"""RMS change of the taxels from frame to frame, counts: at rest, and as the object rearranges."""

STEPS = (0.8, 1.6)
"""Counts by which the mean shear grows in a frame."""

ROUNDED = 5e-4
"""Error of a score, as a share of the threshold, and of a direction, rad, in single precision."""


def _swing(frames: int) -> Floats:
    """Return a number a frame that changes by QUIET at rest and by LOOSE then, up and down."""
    change = np.where(np.arange(frames) < STILL, QUIET, LOOSE)
    return np.asarray(np.cumsum(np.where(np.arange(frames) % 2, -change, change)) - QUIET / 2)


def _pattern(rng: np.random.Generator, shape: Shape) -> Floats:
    """Draw counts whose mean is 0 in every axis, and whose square length is 1 on average."""
    pattern = rng.normal(size=(*shape, 3))
    pattern -= pattern.mean(axis=(0, 1))
    return np.asarray(pattern / np.sqrt((pattern**2).sum(axis=-1).mean()))


def _grasp_case(rng: np.random.Generator, shape: Shape) -> ProgramCase:
    """Draw eight grasps whose taxels shift alike by a ramp, and swing among themselves.

    The mean shear has moved by `step` n after n frames of the pull; the swing's change is QUIET at
    rest, and LOOSE from then on, of which the program's average has 1 − (1 − 2/(window rate))ⁿ.
    """
    count = 8
    steps, angles = rng.uniform(*STEPS, count), rng.uniform(-np.pi, np.pi, count)
    along = np.maximum(np.arange(STILL + PULLED) - STILL + 1.0, 0.0)
    patterns = np.stack([_pattern(rng, shape) for _ in range(count)])
    frames = OFFSET + np.multiply.outer(_swing(len(along)), patterns)
    pull = along[:, None] * steps
    frames[..., 0] += (pull * np.cos(angles))[..., None, None]
    frames[..., 1] += (pull * np.sin(angles))[..., None, None]
    seen = LOOSE - (LOOSE - QUIET) * (1.0 - 2.0 / (WINDOW * RATE)) ** along
    score = np.sqrt(pull * seen[:, None]) / QUIET
    expected = {"score": score, "angle": angles}
    parameters = {"rate": RATE, "window": WINDOW, "threshold": THRESHOLD}
    return ProgramCase(frames, expected, parameters)


def _score_off(case: ProgramCase, outputs: Outputs) -> float:
    """Return the largest error of a score, as a share of the threshold."""
    off = np.abs(np.asarray(outputs["slip_strength"]) - case.expected["score"])
    return float(off[STILL:].max()) / THRESHOLD


def _report_off(case: ProgramCase, outputs: Outputs) -> float:
    """Return the frames in which a report is not what the score says, or its direction not the
    ramp's; a score that rounding may put on the other side is either.
    """
    slips = np.asarray(outputs["gross_slip"]) > 0
    above = case.expected["score"] / THRESHOLD - 1.0
    wrong = (slips != (above > 0.0)) & (np.abs(above) > ROUNDED)
    angle = np.arctan2(outputs["slip_y"], outputs["slip_x"])
    turned = np.abs(np.angle(np.exp(1j * (angle - case.expected["angle"])))) > ROUNDED
    return float(np.count_nonzero(wrong | (slips & turned)))


FORMS = (
    ProgramForm(
        "score", "grasp_slip", ("slip_strength",), _grasp_case, _score_off, ROUNDED,
        "means of counts of 1000 in single precision, over noise of 2: up to 1.7e-4",
        "score over its threshold, of a ramp of all taxels and a swing of each",
        compares="all",
    ),
    ProgramForm(
        "report", "grasp_slip", ("gross_slip", "slip_x", "slip_y"), _grasp_case, _report_off, 0.0,
        "a frame is right or wrong",
        "frames in which the report is not that of the score's closed form",
        compares="all",
    ),
)  # fmt: skip
