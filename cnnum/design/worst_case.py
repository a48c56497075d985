"""How far all weights of an uncoupled template may be off at once, exactly.

A cell that no neighbour's output reaches obeys τ dx/dt = −x + a f(x) + w from x₀, with the drive
w = Σ B u + z. Each of the numbers a, B and z may be off by itself, by the share δ of its size. Then
the cell is judged after the template's duration: it is right while its output lies within half a
colour of the right one, as in all counts of flips.

Where the right colour is black, let c be the output that is just right. From x₀ < c the cell is
right if it comes to c in time, that is if ∫ dx / (−x + a f(x) + w) from x₀ to c is no longer than
the duration. The integrand is convex in (a, w), so the right numbers are a convex set, and a box of
numbers lies in it if its corners do. From x₀ ≥ c the cell stays positive until it is wrong, so that
less of a and of w is worse. In both cases the worst of all mismatches is one of two corners: every
B and z against the colour, and `a` at one end or the other. Inputs are ±1, so every neighbourhood
loses δ (Σ |B| + |z|) of its drive, and only the narrowest one of each colour and start counts.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cnnum.arrays import Floats
from cnnum.design.local_rules import LOCAL, table_of
from cnnum.errors import CnnumError
from cnnum.templating.checks.digital.neighbourhood import MARGIN
from cnnum.templating.checks.records import has, number, text
from cnnum.templating.checks.registry import form_of
from cnnum.templating.checks.rules import (
    BEFORE,
    CELLS,
    MIDDLE,
    colour_weights,
    decided,
    is_wide,
    narrowest,
)
from cnnum.templating.checks.running import WRONG
from cnnum.templating.template import Template

MOST = 1.0
"""Largest share that is considered, at which a weight may vanish."""

_HALVINGS = 60


@dataclass(frozen=True, slots=True)
class Decision:
    """A cell with its decision: the one with the smallest margin for its colour and initial state.

    Attributes
    ----------
    colour : float
        Correct colour, ±1.
    start : float
        Initial state.
    drive : float
        Σ B u + z.
    signs : (rows, cols) float
        Inputs that the cell reads; empty if it reads none.
    """

    colour: float
    start: float
    drive: float
    signs: Floats


@dataclass(frozen=True, slots=True)
class WorstCase:
    """Smallest simultaneous change of all weights that makes a cell wrong.

    Attributes
    ----------
    share : float
        Relative change. No smaller mismatch of the individual weights makes a cell wrong. If the
        share is below `MOST`, `changes` of slightly more than that do.
    changes : dict of str to array
        For "A", "B" and "z", the direction in which the magnitude of each number changes in the
        worst case: ±1, or 0 for no change. Each number is multiplied by 1 + share · change.
    decision : Decision
        The cell that becomes wrong.
    """

    share: float
    changes: dict[str, Floats]
    decision: Decision

    @property
    def words(self) -> str:
        """The weights that break it, as in "A[1, 1] larger, B[0, 1] and z smaller in size"."""
        changes = dict[str, list[str]]()
        for part, signs in self.changes.items():
            for index in np.argwhere(signs).tolist():
                label = part if part == "z" else f"{part}{index[-2:]}"
                way = "larger" if signs[tuple(index)] > 0 else "smaller"
                changes.setdefault(way, []).append(label)
        ways = ", ".join(f"{' and '.join(names)} {way}" for way, names in sorted(changes.items()))
        return f"{ways} in size" if ways else ""


def worst_case(template: Template) -> WorstCase | None:
    """Return the largest independent relative error of all weights without a wrong cell.

    Parameters
    ----------
    template : Template
        A template with a check.

    Returns
    -------
    WorstCase or None
        None if no bound is known: cells are coupled, there are several layers or inputs, the
        correct output is grey, or it is not a rule on the cells that are read. Also None if a cell
        is already wrong with the exact weights.
    """
    if not _fits(template):
        return None
    try:
        cells = tuple(_decisions(template))
    except CnnumError:  # no local rule, and what was found of it before is no bound
        return None
    if not cells or not all(_right(template, cell, 0.0) for cell in cells):
        return None
    bounds = [_share(template, cell) for cell in cells]
    (share, beyond), cell = min(zip(bounds, cells, strict=True), key=lambda pair: pair[0])
    return WorstCase(share, _changes(template, cell, beyond), cell)


def state_after(own: float, drive: float, start: float, time: float) -> float:
    """Return the state of a cell dx/dt = −x + own·f(x) + drive, f cut at ±1, after a time.

    Each of the three pieces of f has an exponential solution; a cell passes each at most once.
    """
    state, left = start, time
    for _ in range(4):
        rate = -state + own * min(max(state, -1.0), 1.0) + drive
        if rate == 0.0:
            return state
        up = rate > 0.0
        if state < -1.0 or (state == -1.0 and not up):
            slope, end = -1.0, -1.0 if up else -math.inf
        elif state > 1.0 or (state == 1.0 and up):
            slope, end = -1.0, math.inf if up else 1.0
        else:
            slope, end = own - 1.0, 1.0 if up else -1.0
        passed = _time_to(end, state, rate, slope)
        if passed >= left:
            return state + rate * _grown(slope, left)
        state, left = end, left - passed
    return state


def _time_to(end: float, state: float, rate: float, slope: float) -> float:
    """Return when a cell of a linear rate comes to a state, infinite where it never does."""
    if math.isinf(end):
        return math.inf
    if slope == 0.0:
        return (end - state) / rate
    ratio = 1.0 + slope * (end - state) / rate
    return math.log(ratio) / slope if ratio > 0.0 else math.inf


def _grown(slope: float, time: float) -> float:
    """Return ∫ e^(slope·t) dt."""
    if slope == 0.0:
        return time
    if math.isinf(time):
        return -1.0 / slope if slope < 0.0 else math.inf
    return math.expm1(min(slope * time, 700.0)) / slope


def _fits(template: Template) -> bool:
    """Return whether the cells of a template decide each for itself, by black and white inputs."""
    if template.check is None or not form_of(template).digital:
        return False
    others = template.A.copy()
    middle = template.A.shape[-1] // 2
    others[0, 0, middle, middle] = 0.0
    edge = template.input_boundary.constant
    around = template.B.copy() if template.inputs else np.zeros((1, 1, 1, 1))
    around[..., around.shape[-2] // 2, around.shape[-1] // 2] = 0.0
    return (
        template.layers == 1
        and template.inputs <= 1
        and template.plain
        and template.output.name == "standard"
        and not others.any()
        # beyond the rim, too, there are black and white cells alone
        and (edge in (None, -1.0, 1.0) or not around.any())
    )


def _own(template: Template) -> float:
    middle = template.A.shape[-1] // 2
    return float(template.A[0, 0, middle, middle])


def _time(template: Template) -> float:
    """Return the run time in time constants."""
    if template.duration == "settle":
        return math.inf
    return float(template.duration) / float(template.tau[0])


def _size(template: Template) -> float:
    """Return the sum of the sizes of all numbers of the drive."""
    return float(np.abs(template.B).sum() if template.inputs else 0.0) + abs(float(template.z[0]))


def _right(template: Template, cell: Decision, share: float) -> bool:
    """Return whether a cell is right in both corners of a mismatch."""
    return all(_end(template, cell, share, way) >= 1.0 - WRONG for way in (-1.0, 1.0))


def _end(template: Template, cell: Decision, share: float, way: float) -> float:
    """Return the end state of a cell towards its colour, with its own feedback off one way."""
    own = _own(template)
    drive = cell.colour * cell.drive - share * _size(template)
    start = cell.colour * cell.start
    return state_after(own + way * share * abs(own), drive, start, _time(template))


def _share(template: Template, cell: Decision) -> tuple[float, float]:
    """Return the largest share at which a cell is right, as are smaller ones, and the next one."""
    low, high = 0.0, MOST
    if _right(template, cell, high):
        return high, high
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if _right(template, cell, middle) else (low, middle)
    return low, high


def _changes(template: Template, cell: Decision, share: float) -> dict[str, Floats]:
    """Return the directions of the corner that makes a cell wrong at a share."""
    way = min((-1.0, 1.0), key=lambda sign: _end(template, cell, share, sign))
    own = np.zeros(template.A.shape)
    middle = template.A.shape[-1] // 2
    own[0, 0, middle, middle] = way * math.copysign(1.0, _own(template)) if _own(template) else 0.0
    result: dict[str, Floats] = {"A": own}
    if template.inputs:
        result["B"] = -cell.colour * np.sign(template.B) * cell.signs
    return result | {"z": -cell.colour * np.sign(template.z)}


def _decisions(template: Template) -> Iterator[Decision]:
    """Yield the narrowest decision of each colour and start.

    Raises
    ------
    CnnumError
        If the rule is none of the cells that one sees, or too tangled to look through.
    """
    form = form_of(template)
    if form.name == "threshold":
        yield from _thresholds(template)
    elif form.name == "rule" and is_wide(template):
        yield from _of_25(template)
    elif form.name in LOCAL and form.name != "rule-until-still" and template.radius <= 1:
        yield from _of_nine(template)


def _thresholds(template: Template) -> Iterator[Decision]:
    """Yield the gray values next to the threshold: others start further on their own side."""
    if template.inputs or template.initial != "input":
        return
    level = number(template, "threshold")
    for colour in (-1.0, 1.0):
        yield Decision(colour, level + colour * MARGIN, float(template.z[0]), np.zeros((0, 0)))


def _of_nine(template: Template) -> Iterator[Decision]:
    table = table_of(template, whole=True)
    kernel = np.zeros((3, 3))
    if template.inputs:
        off = 1 - template.B.shape[-1] // 2
        kernel[off : 3 - off, off : 3 - off] = template.B[0, 0]
    drives = table.signs[:, :9] @ kernel.ravel() + template.z[0]
    own, before = table.signs[:, 4], table.signs[:, 9]
    possible = _possible(template, own, before)
    for colour in (-1.0, 1.0):
        for state in (-1.0, 1.0):
            # a rule that does not give the state starts from the template's own
            of_it = (own if _from_input(template) else before) == state
            rows = np.flatnonzero((table.colours == colour) & of_it & possible)
            if len(rows):
                row = rows[np.argmin(colour * drives[rows])]
                off = 1 - template.B.shape[-1] // 2 if template.inputs else 3
                signs = table.signs[row, :9].reshape(3, 3)[off : 3 - off, off : 3 - off]
                yield Decision(colour, _start(template, state), float(drives[row]), signs)


def _of_25(template: Template) -> Iterator[Decision]:
    if not template.inputs:  # the rule is one of the input
        return
    weights = colour_weights(template)
    given, side = _given(template), template.B.shape[-1]
    off = (5 - side) // 2
    for colour in (-1.0, 1.0):
        cases = decided(template, holds=colour > 0.0)
        for own in (False, True):
            for before in (False, True) if given else (own,):
                signs = np.array([2.0 * own - 1.0]), np.array([2.0 * before - 1.0])
                if not _possible(template, *signs)[0]:
                    continue
                fixed = {MIDDLE: own, BEFORE: before}
                narrow = [narrowest(case, colour * weights, fixed) for case in cases]
                rows = [decision for decision in narrow if decision is not None]
                if rows:
                    cells = min(rows, key=lambda row: colour * float(weights @ row))
                    inputs = (2.0 * cells[:CELLS] - 1.0).reshape(5, 5)[off : 5 - off, off : 5 - off]
                    drive = float((template.B[0, 0] * inputs).sum() + template.z[0])
                    state = float(signs[1 if given else 0][0])
                    yield Decision(colour, _start(template, state), drive, inputs)


def _given(template: Template) -> bool:
    """Return whether the check gives the initial state."""
    return form_of(template).name == "logic" or has(template, "state")


def _from_input(template: Template) -> bool:
    return template.initial == "input" and not _given(template)


def _start(template: Template, state: float) -> float:
    if _given(template) or template.initial == "input":
        return state
    return float(template.initial)


def _possible(template: Template, own: Floats, before: Floats) -> NDArray[np.bool_]:
    """Return which pairs of input and state the check has."""
    kind = text(template, "state") if has(template, "state") else "other"
    if kind in ("part", "changed"):
        return np.asarray((before < 0.0) | (own > 0.0))
    if kind == "outside":
        return np.asarray((before < 0.0) | (own < 0.0))
    if not _given(template):
        return np.asarray(before == own)
    return np.ones(own.shape, dtype=np.bool_)
