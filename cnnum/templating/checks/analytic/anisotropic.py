"""Diffusion that stops at steps, on dominoes: two cells that exchange, steps all around them.

Let d(v) = −r(1 − |v|/w) within |v| < w, and 0 beyond. The difference v of the two cells follows v'
= 2d(v)v, the logistic equation in |v|/w; their sum stays.
"""

import numpy as np

from cnnum.arrays import Floats, Shape
from cnnum.templating.checks.analytic.linear import ANALOG_REASON, ANALOG_TOLERANCE
from cnnum.templating.checks.parameters import number
from cnnum.templating.checks.pictures import with_even
from cnnum.templating.checks.records import Case, ClosedForm
from cnnum.templating.template import Template

_STEP = 1.0
"""Between neighbouring dominoes; the differences inside them stay within 0.7 of it."""


def _dominoes(rng: np.random.Generator, rows: int, cols: int, width: float) -> Floats:
    """Return pictures of east-west dominoes, some of them with a difference above the width."""
    row, col = np.indices((rows, cols))
    level = np.where((row + col // 2) % 2, 0.5 * _STEP, -0.5 * _STEP)
    # near the width, errors would grow as e^{2rt}
    share = rng.uniform(0.05, 0.8, (3, rows, (cols + 1) // 2))
    share = np.where(rng.random(share.shape) < 0.2, 1.3, share) * rng.choice([-1, 1], share.shape)
    half = 0.5 * width * np.repeat(share, 2, axis=2)[:, :, :cols]
    return np.asarray(level + np.where(col % 2, half, -half), dtype=np.float64)


def _case(template: Template, rng: np.random.Generator, shape: Shape) -> Case:
    width = number(template, "width")
    flat = with_even(_dominoes(rng, shape[0], shape[1], width), 0.0)
    upright = _dominoes(rng, shape[1], shape[0], width).swapaxes(1, 2)
    return Case(input=np.concatenate([flat, upright]))


def _exchange(pictures: Floats, width: float, decay: float) -> Floats:
    """Return east-west dominoes once the odds |v|/(w − |v|) have decayed by that factor."""
    answer = pictures.copy()
    paired = 2 * (pictures.shape[-1] // 2)
    west, east = pictures[..., 0:paired:2], pictures[..., 1:paired:2]
    share = np.abs(east - west) / width
    kept = np.where(share < 1.0, decay / (1.0 - share + share * decay), 1.0)
    middle, half = 0.5 * (west + east), 0.5 * (east - west) * kept
    answer[..., 0:paired:2], answer[..., 1:paired:2] = middle - half, middle + half
    return answer


def _expected(template: Template, case: Case) -> Floats:
    width = number(template, "width")
    decay = float(np.exp(-2.0 * number(template, "rate") * case.time(template)))
    flat, upright = case.pictures[:4], case.pictures[4:].swapaxes(1, 2)
    answers = [_exchange(flat, width, decay), _exchange(upright, width, decay).swapaxes(1, 2)]
    return np.concatenate(answers)


FORMS = (
    ClosedForm(
        "dominoes",
        _case,
        _expected,
        ANALOG_TOLERANCE,
        ANALOG_REASON,
        "logistic decay of the difference of two cells that steps part from all others",
        needs=("width", "rate"),
    ),
)
