"""How much the weights of a template may be off before a cell of its check is wrong."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from cnnum.arrays import Floats
from cnnum.errors import ArrayError, CnnumError, MethodError
from cnnum.templating.batch import TemplateBatch
from cnnum.templating.checks.records import Case, ClosedForm
from cnnum.templating.checks.registry import form_of, posed
from cnnum.templating.checks.running import SHAPE, WRONG, Engine, run_case
from cnnum.templating.numbers import numbers_of, weights_of, with_numbers
from cnnum.templating.template import Template

DEVIATIONS = 1.959963984540054
"""Standard deviations on both sides of the mean of a normal number that hold 95 % of it."""


def wilson(hits: int, draws: int) -> tuple[float, float]:
    """Return the 95 % interval of a share (Wilson 1927), which holds for 0 hits and for all too.

    Parameters
    ----------
    hits, draws : int
        How often it was so, of how many.
    """
    squared = DEVIATIONS**2 / draws
    share = hits / draws
    middle = (share + squared / 2.0) / (1.0 + squared)
    half = math.sqrt(squared * (share * (1.0 - share) + squared / 4.0)) / (1.0 + squared)
    return max(0.0, middle - half), min(1.0, middle + half)


MISMATCHES = (0.01, 0.02, 0.05, 0.10)
BITS = (8, 7, 6)
STEPS = (0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0)
"""Relative changes of one weight that are tried."""

DRAWS = 10

_BY_LAYER = ("A", "B", "z", "delayed A", "delayed B")


@dataclass(frozen=True, slots=True)
class Flips:
    """How a changed template does on its check.

    Attributes
    ----------
    change : str
        "mismatch 5 %" or "7 bits".
    flipped : float
        Share of the drawn templates with a wrong cell; NaN where no run came to an end.
    wrong : float
        Share of wrong cells over all of them.
    draws : int
        Templates whose runs came to an end.
    low, high : float
        Confidence interval of `flipped` (95 %). A coarse template is a single, exact case.
    failed : int
        Templates that no method ran, which says nothing of their cells.
    reason : str
        Why the first of them was not run.
    """

    change: str
    flipped: float
    wrong: float
    draws: int = 1
    low: float = 0.0
    high: float = 1.0
    failed: int = 0
    reason: str = ""


@dataclass(frozen=True, slots=True)
class Tolerance:
    """How far one weight may go with no wrong cell.

    Attributes
    ----------
    weight : str
        As in "B[0, 2]", "z", "coupling 1[0, 2]" of a nonlinear one, "table 1[3]" of its values;
        rows and columns from the north-west.
    value : float
    down, up : float
        Largest relative changes of those tried, 0 where the smallest flips a cell already.
    """

    weight: str
    value: float
    down: float
    up: float


def flips(
    template: Template,
    engine: Engine,
    *,
    seed: int = 0,
    mismatches: Sequence[float] = MISMATCHES,
    bits: Sequence[int] = BITS,
    draws: int = DRAWS,
) -> tuple[Flips, ...]:
    """Return how often random mismatch and coarse weights make cells wrong.

    Mismatch multiplies every weight and bias by 1 plus a normal number of that width. It does so
    for nonlinear and delayed couplings too. A number of b bits is a whole multiple of the largest
    of its part over 2^(b−1) − 1. So are the numbers of a function table.
    """
    job = Judge(template, engine)
    rng = np.random.default_rng(seed)
    result = list[Flips]()
    for width in mismatches:
        shares = job.shares([mismatched(template, rng, width) for _ in range(draws)])
        result.append(_flips(f"mismatch {100.0 * width:g} %", shares, job))
    for bit in bits:
        result.append(_flips(f"{bit} bits", [job.wrong(coarse(template, bit))], job))
    return tuple(result)


def tolerances(template: Template, engine: Engine) -> Iterator[Tolerance]:
    """Yield for every number that is not 0 how far it may go."""
    job = Judge(template, engine)
    for part, array in numbers_of(template).items():
        for index in [tuple(place) for place in np.argwhere(array).tolist()]:
            down, up = (_reach(job, part, array, index, sign) for sign in (-1.0, 1.0))
            label = part if part == "z" else f"{part}{list(index[-2:])}"
            if template.layers > 1 and part in _BY_LAYER:
                label += f" of {list(index[: max(1, array.ndim - 2)])}"
            yield Tolerance(label, float(array[index]), down, up)


class Judge:
    """The check of a template, on changed ones, 8×8 cells of seed 0.

    Attributes
    ----------
    reasons : list of str
        Why runs failed, since it was last emptied.
    """

    def __init__(self, template: Template, engine: Engine) -> None:
        self.template, self.engine = template, engine
        self.form: ClosedForm = form_of(template)
        self.case: Case
        self.case, self.expected = posed(template, 0, SHAPE)
        self.reasons: list[str] = []

    def wrong(self, changed: Template) -> float:
        """Return the share of cells that are wrong: off by half a colour, or the tolerance.

        All are where the states diverge. It is NaN where no method runs the template.
        """
        allowed = WRONG if self.form.digital else self.form.tolerance
        try:
            result = run_case(changed, self.engine, self.case, self.form.rtol)
        except ArrayError:
            return 1.0  # it diverges
        except MethodError as error:
            self.reasons.append(str(error))
            return math.nan
        answer = np.asarray(getattr(result, self.form.compares), dtype=np.float64)
        return float(np.mean(~(np.abs(answer - self.expected) <= allowed)))

    def shares(self, changed: Sequence[Template]) -> list[float]:
        """Return the share of wrong cells of many templates, in one run where that can be."""
        if self.form.compares != "output":
            return [self.wrong(cells) for cells in changed]
        batch = TemplateBatch.of(changed).spread()  # an axis for the pictures of the case
        try:
            result = run_case(batch, self.engine, self.case, self.form.rtol)
        except CnnumError:
            return [self.wrong(cells) for cells in changed]  # one of them diverges, or fails
        allowed = WRONG if self.form.digital else self.form.tolerance
        outputs = np.asarray(result.output, dtype=np.float64)
        wrong = ~(np.abs(outputs - self.expected) <= allowed)
        return [float(cells.mean()) for cells in wrong]


def _reach(job: Judge, part: str, array: Floats, index: tuple[int, ...], sign: float) -> float:
    reached = 0.0
    for step in STEPS:
        moved = array.copy()
        moved[index] *= 1.0 + sign * step
        if job.wrong(with_numbers(job.template, {part: moved})) != 0.0:
            break
        reached = step
    return reached


def mismatched(template: Template, rng: np.random.Generator, width: float) -> Template:
    """Return a template whose every weight is off by a normal share of itself."""
    weights = weights_of(template)
    off = {part: 1.0 + width * rng.normal(size=array.shape) for part, array in weights.items()}
    return with_numbers(template, {part: off[part] * array for part, array in weights.items()})


def coarse(template: Template, bits: int) -> Template:
    """Return a template whose numbers have a count of bits, as `flips` says."""

    def rounded(array: Floats) -> Floats:
        step = max(float(np.abs(array).max(initial=0.0)), 1e-30) / (2 ** (bits - 1) - 1)
        return np.asarray(step * np.rint(array / step), dtype=np.float64)

    numbers = numbers_of(template)
    return with_numbers(template, {part: rounded(array) for part, array in numbers.items()})


def _flips(change: str, shares: list[float], job: Judge) -> Flips:
    ran = [share for share in shares if not math.isnan(share)]
    failed, reason = len(shares) - len(ran), next(iter(job.reasons), "")
    job.reasons.clear()
    if not ran:
        return Flips(change, math.nan, math.nan, 0, failed=failed, reason=reason)
    flipped = sum(share > 0.0 for share in ran)
    low, high = wilson(flipped, len(ran))
    share, wrong = flipped / len(ran), float(np.mean(ran))
    return Flips(change, share, wrong, len(ran), low, high, failed, reason)
