"""References of `slip`, `twist` and `tactile`: NumPy, on slides and turns."""

from dataclasses import replace

import numpy as np

from cnnum.arrays import Floats, Shape
from cnnum.templating.checks.program_records import Outputs, ProgramCase, ProgramForm
from cnnum.templating.checks.tactile.slip_and_twist_reference import OUTPUTS, Constants, played

SETTINGS = Constants(rate=100.0)

NOISE = 1e-4
"""RMS of a reading over the peak load of the patch."""

PRESS, PULL, GO = 45, 90, 110
"""Frames at which the patch is pressed, gets its shear, and moves on; rest is 40 frames."""

FRAMES = 135

SPEED = 0.03
"""Widths of the sliding patch by which it moves on in a frame."""

FLAGS = ("gross_slip", "twist", "twist_sense")

NUMBERS = ("slip_strength", "twist_strength")

DIRECTION, CENTRE = ("slip_x", "slip_y"), ("twist_row", "twist_column")

ROUNDED = 1e-5
"""Error of a number, and of a place in cells, in single precision: up to 2e-6 is seen."""


def _ramp(start: int, frames: int = 20) -> Floats:
    return np.asarray(np.clip((np.arange(FRAMES) - start + 1.0) / frames, 0.0, 1.0))


def patch(rng: np.random.Generator, shape: Shape, angle: float, sense: float) -> Floats:
    """Return a patch that is pressed and pulled, strain (frames, rows, cols, 3).

    With a `sense` it turns in place, else it slides along the angle, rad.
    """
    rows, cols = (np.arange(cells, dtype=float) - (cells - 1) / 2.0 for cells in shape)
    wide = min(shape) / 5.0
    gone = np.maximum(np.arange(FRAMES) - GO, 0.0) * SPEED * wide * (sense == 0.0)
    down = rows[:, None] - np.sin(angle) * gone[:, None, None]
    right = cols - np.cos(angle) * gone[:, None, None]
    load = np.exp(-(down**2 + right**2) / (2.0 * wide**2)) * _ramp(PRESS)[:, None, None]
    pull = (0.5 * _ramp(PULL))[:, None, None]
    x, y = np.cos(angle) + 0.0 * right, np.sin(angle) + 0.0 * down
    if sense:
        x, y = -sense * down / wide, sense * right / wide
    signals = np.stack([pull * x * load, pull * y * load, load], axis=-1)
    return np.asarray(SETTINGS.push * signals + NOISE * rng.normal(size=signals.shape))


def streams(rng: np.random.Generator, shape: Shape) -> Floats:
    """Return noise, a patch that slides, and two that turn, (frames, 4, rows, cols, 3)."""
    noise = NOISE * rng.normal(size=(FRAMES, *shape, 3))
    angle = float(rng.uniform(-np.pi, np.pi))
    turns = (patch(rng, shape, angle, sense) for sense in (0.0, 1.0, -1.0))
    return np.stack([noise, *turns], axis=1)


def _case(rng: np.random.Generator, shape: Shape) -> ProgramCase:
    frames = streams(rng, shape)
    each = [played(frames[:, number], SETTINGS) for number in range(frames.shape[1])]
    expected = {name: np.stack([one[name] for one in each], axis=1) for name in OUTPUTS}
    return ProgramCase(frames, expected, {"rate": SETTINGS.rate})


def _two_pads(rng: np.random.Generator, shape: Shape) -> ProgramCase:
    """Return the sliding patch on one pad and noise on the other, in half the columns each."""
    rows, cols = shape
    frames = streams(rng, (rows, cols // 2))
    joined = np.concatenate([frames[:, 1], frames[:, 0]], axis=-2)
    settings = replace(SETTINGS, pads=2)
    return ProgramCase(joined, played(joined, settings), {"rate": SETTINGS.rate, "pads": 2})


def _numbers_off(case: ProgramCase, outputs: Outputs) -> float:
    """Return the largest error of a strength, as a share of it from 1 up."""
    return max(
        float((np.abs(outputs[n] - e) / np.maximum(1.0, np.abs(e))).max())
        for n, e in case.expected.items()
        if n in NUMBERS and n in outputs
    )


def _reports_off(case: ProgramCase, outputs: Outputs) -> float:
    """Return the largest error of a flag, and under a shear of a direction and a centre.

    Noise has neither, and a turn in place no direction.
    """

    def off(names: tuple[str, ...], begin: int, some: slice) -> float:
        errors = (outputs[n] - case.expected[n] for n in names if n in outputs)
        return max((float(np.abs(each)[begin:, some].max()) for each in errors), default=0.0)

    sheared = PULL + 5
    slides, pressed = slice(1, 2), slice(1, None)
    return max(
        off(FLAGS, 0, slice(None)), off(DIRECTION, sheared, slides), off(CENTRE, sheared, pressed)
    )


SUMS = "sums of a patch over noise of 1e-4, in single precision; flags are right or wrong"
DIFFERENCES = "differences of maps of loads that nearly agree, in single precision"

FORMS = (
    ProgramForm(
        "slip-strength", "slip", ("slip_strength",), _case, _numbers_off, ROUNDED, DIFFERENCES,
        "strength of noise, a patch that slides and two that turn, by the definition in NumPy",
        compares="all",
    ),
    ProgramForm(
        "slip-report", "slip", ("gross_slip", *DIRECTION), _case, _reports_off, ROUNDED, SUMS,
        "flags and directions of the same streams",
        compares="all",
    ),
    ProgramForm(
        "slip-pads", "slip", ("slip_strength",), _two_pads, _numbers_off, ROUNDED, DIFFERENCES,
        "strength of a patch that slides on one of two pads",
        compares="all",
    ),
    ProgramForm(
        "twist-strength", "twist", ("twist_strength",), _case, _numbers_off, ROUNDED, DIFFERENCES,
        "strength of noise, a patch that slides and two that turn, by the definition in NumPy",
        compares="all",
    ),
    ProgramForm(
        "twist-report", "twist", ("twist", "twist_sense", *CENTRE), _case, _reports_off, ROUNDED,
        SUMS,
        "flags, senses and centres of the same streams",
        compares="all",
    ),
    ProgramForm(
        "slip-and-twist", "tactile", (*FLAGS, *NUMBERS), _case, _reports_off, ROUNDED, SUMS,
        "flags of the same streams: a slide is no twist, and a turn no slip",
        compares="all",
    ),
)  # fmt: skip
