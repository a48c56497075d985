"""The end of a run without the way there, where the order of events cannot change it.

It holds for one layer with the standard output where every cell holds itself (its own weight in A
is above 1), all weights to other cells are 0 or more, and every state begins at or beyond 1 or −1.
Such an array is monotone (cooperative): more output anywhere means no less anywhere later.

Let cells fall, one after the other, where what they see now leaves no state at or above 1 to rest
in. A cell that is left then sees enough to stay at 1 even after all these falls, and at the start
no cell at −1 sees enough to rise. So the outputs stay between those of the start and those of the
end, and each cell on the list does fall: above 1 it decays to a value below 1, and between 1 and −1
its rate is negative. Outputs are then constant, and the states decay to A ∗ y + B ∗ u + z. The same
holds with all signs reversed, for arrays that rise. Where a sum is as close to the edge as
roundings are, nothing is said, and the run takes its way.

Where some cells rise and others fall, the array is bounded by two that go one way each: one that
begins with all that may fall having fallen, and one with all that may rise having risen. If both
end alike, so does the array between them.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cnnum.arrays import Floats, Shape
from cnnum.errors import MethodError
from cnnum.graph.nodes import RunSpec
from cnnum.integrators.schemes import WAVEFRONT
from cnnum.runs.request import Request
from cnnum.runs.result import ROLES, Proven, Result
from cnnum.templating.boundary import Boundary
from cnnum.templating.network import Tap, taps
from cnnum.templating.template import Template

Given = Mapping[str, NDArray[np.floating]]

Couplings = tuple[NDArray[np.int64], NDArray[np.int64], Floats]
"""Rows and columns from a cell, and weights."""

NONE: Floats = np.empty((0, 0))
"""In place of a map that is not there."""

REASON = "the order of events cannot change where the array ends, so the way there is left out"

SPARE = 4.0
"""Roundings are taken to be so many times what the terms of a sum give."""

FINEST, LARGEST = 2.0**12, 2.0**10
"""Multiples of 1/4096 up to 1024: products of two, and sums of a thousand, have 53 bits."""

EPSILON = float(np.finfo(np.float64).eps)


@dataclass(frozen=True, slots=True, eq=False)
class Monotone:
    """What a monotone template does: weights of A and B apart, as they are added up.

    Attributes
    ----------
    centre : float
        Weight of a cell's own output.
    feedback : (rows, columns, weights), each (couplings,)
        Offsets and weights of the couplings to other cells.
    control : (rows, columns, weights), each (couplings,)
        The same of the input.
    rim : (kind, value)
        Boundary of the state, in the form for `cnnum.engines.numba.wavefront.front`.
    """

    centre: float
    feedback: Couplings
    control: Couplings
    rim: tuple[int, float]


@lru_cache(maxsize=64)
def monotone(template: object) -> Monotone | None:
    """Return a template of the kind whose end needs no way, from a saturated start; else None."""
    if not isinstance(template, Template) or template.layers != 1 or template.inputs > 1:
        return None
    plain = not (template.nonlinear or template.delayed or template.gains)
    if not plain or template.output.name != "standard":
        return None
    others = [tap for tap in taps(template.A, 0) if tap.row or tap.col]
    centre = float(template.A[0, 0].flat[template.A[0, 0].size // 2])
    if not others or centre <= 1.0 + 16.0 * EPSILON or min(tap.weight for tap in others) < 0.0:
        return None
    control = taps(template.B, 0) if template.inputs else ()
    kind, value = rim_of(template.boundary)
    # cells see outputs
    rim = (kind, min(max(value, -1.0), 1.0))
    return Monotone(centre, _apart(others), _apart(control), rim)


def _apart(couplings: Sequence[Tap]) -> Couplings:
    """Return offsets and weights of couplings as compiled loops take them."""
    places = np.array([(tap.row, tap.col) for tap in couplings], np.int64).reshape(-1, 2)
    rows, cols = np.ascontiguousarray(places.T)
    return rows, cols, np.array([tap.weight for tap in couplings], np.float64)


def begins_saturated(template: Template, arrays: Sequence[object]) -> bool:
    """Return whether every cell begins at or beyond 1 or −1; maps are those of a run, unchecked."""
    start = arrays[ROLES.index("state")]
    if start is None:
        start = arrays[0] if template.initial == "input" else template.initial
    return start is not None and bool((np.abs(np.asarray(start)) >= 1.0).all())


def skips(request: Request) -> bool:
    """Return whether the way of a run may be left out, before its numbers are looked at."""
    spec, engine = request.spec, request.engine
    if spec.method == WAVEFRONT:
        return True
    explicit = spec.method != "auto" or spec.dt is not None or spec.force or spec.estimate
    # an engine that solves finely is what others are held against
    if explicit or engine.whole or not engine.record.takes_steps:
        return False
    return monotone(request.template) is not None


def without_way(request: Request, down: Callable[[Request], Result]) -> Result:
    """Take a run by the cells that fall, or rise, alone; frames without that proof go below."""
    template, lead = request.template, request.lead
    known, why = monotone(template), _refusal(request)
    ends: list[_End | str] = [why]
    if known is not None and not why:
        ends = (
            [_End.of(request, known, frame) for frame in np.ndindex(lead)]
            if lead
            else [_End.of(request, known, ())]
        )
    if not lead and isinstance(ends[0], _End):
        return _one(ends[0])
    reasons = [end for end in ends if isinstance(end, str)]
    if reasons and request.spec.method == WAVEFRONT:
        raise MethodError(
            f"The method '{WAVEFRONT}' cannot run template '{template.name}': {reasons[0]}."
        )
    if len(reasons) == len(ends):
        return down(request)
    way = np.array([isinstance(end, str) for end in ends])
    below = None
    if reasons:
        below = down(request.by(request.spec, request.frames(np.flatnonzero(way))))
    reached = [end for end in ends if isinstance(end, _End)]

    def together(of_ends: Sequence[Any], of_below: str) -> NDArray[Any]:
        """Return a part of all frames; their own axes come last."""
        known = np.stack([np.asarray(values) for values in of_ends])
        if below is None:
            return known.reshape((*lead, *known.shape[1:]))
        parts = np.empty((len(ends), *known.shape[1:]), known.dtype)
        parts[~way], parts[way] = known, getattr(below, of_below)
        return parts.reshape((*lead, *known.shape[1:]))

    state = together([end.state for end in reached], "state")
    result = Result(
        output=np.clip(state, -1.0, 1.0),
        state=state,
        time=together([end.time for end in reached], "time"),
        steps=together([0] * len(reached), "steps"),
        settled=together([end.keeps for end in reached], "settled"),
        error=together([end.error for end in reached], "error"),
        method=WAVEFRONT if below is None else below.method,
        reason=REASON if below is None else f"{below.reason}; of {len(reached)} frames, {REASON}",
    )
    if below is None:
        object.__setattr__(result, "proof", Proven(result.state, result.error, result.settled))
    return result


def _one(end: "_End") -> Result:
    """Return the result of one array, in a third of the time that a batch takes."""
    state, error, keeps = end.state, np.array(end.error), np.array(end.keeps)
    result = Result(
        output=np.minimum(np.maximum(state, -1.0), 1.0),
        state=state,
        time=np.array(end.time),
        steps=np.array(0),
        settled=keeps,
        error=error,
        method=WAVEFRONT,
        reason=REASON,
    )
    object.__setattr__(result, "proof", Proven(state, error, keeps))
    return result


def _refusal(request: Request) -> str:
    """Return why no run like this can go without its way, or nothing."""
    if monotone(request.template) is None:
        return (
            "it takes one layer with one input at most and the standard output, no nonlinear or "
            "delayed coupling or gain, a centre of A above 1, and other weights of A from 0 up"
        )
    spec = request.spec
    if spec.dt is not None or spec.force or spec.estimate or request.engine.whole:
        return "it takes no steps and no whole numbers"
    if request.template.radius > min(request.shape):
        return f"its neighbourhood is wider than the array of {request.shape}"
    return ""


@dataclass(frozen=True, slots=True, eq=False)
class _End:
    """The end of one array: its state, the time when that is reached, and how far it is off.

    A cell at just 1 or −1 is only just held: the array comes there, and the least push moves it on.
    """

    state: Floats
    time: float
    error: float
    keeps: bool

    @classmethod
    def of(cls, request: Request, known: Monotone, frame: tuple[int, ...]) -> "_End | str":
        """Return the end of a frame; why there is none, where there is none."""
        lead = request.lead
        maps = {
            role: (np.broadcast_to(array, (*lead, *array.shape[-3:]))[frame] if lead else array)[0]
            for role, array in request.given.items()
        }
        return cls.of_maps(request.template, known, request.spec, maps, request.shape)

    @classmethod
    def of_maps(
        cls, template: Template, known: Monotone, spec: RunSpec, maps: Given, shape: Shape
    ) -> "_End | str":
        """Return the end of an array with (rows, cols) maps by role; else why there is none."""
        end = _rest(template, known, maps, shape)
        if isinstance(end, str):
            return end
        state, time, error, largest, keeps = end
        duration = template.duration if spec.duration is None else spec.duration
        if duration == "settle":
            return cls(state, time, error, keeps)
        left = float(duration) - time
        if left < 0.0:
            return f"its outputs may change until {time:.4g}"
        error += 2.0 * largest * float(np.exp(-left / float(template.tau[0])))
        if spec.method != WAVEFRONT and error > spec.atol + spec.rtol:  # all states are beyond 1
            return "its states still move at that time"
        return cls(state, float(duration), error, keeps)


def end_of(template: Template, spec: RunSpec, shape: Shape, maps: Given) -> Floats | None:
    """Return the proven outputs of a monotone array at the end of a run; else None.

    Parameters
    ----------
    template : Template
        One that `monotone` knows, with a radius within the array.
    spec : RunSpec
    shape : (rows, cols)
    maps : mapping of str to (rows, cols) float
        By role, finite.
    """
    known = monotone(template)
    assert known is not None
    end = _End.of_maps(template, known, spec, maps, shape)
    return None if isinstance(end, str) else np.clip(end.state, -1.0, 1.0)


def _rest(
    template: Template, known: Monotone, maps: Given, shape: Shape
) -> tuple[Floats, float, float, float, bool] | str:
    """Return the equilibrium, the time to it, its error, the size of states, and whether it keeps.

    A string says why there is none.
    """
    from cnnum.engines.numba.wavefront import END, GREY, front  # Numba takes its time

    start = maps.get("state", maps.get("input") if template.initial == "input" else None)
    if start is None:
        start = _everywhere(float(template.initial), shape)
    mask: NDArray[np.floating] = maps.get("mask", NONE)
    held = mask != 0.0
    drive, size, terms = _drive(template, known, maps, shape)
    weights = known.feedback[2]
    size += known.centre + float(weights.sum())
    largest = max(float(np.abs(start).max()), size)
    # maps of many cells are not looked at before
    if not (np.isfinite(largest + size) and np.isfinite(mask).all()):
        return "its maps are not finite"
    rounding = SPARE * (terms + 2 * weights.size) * EPSILON * size

    def gone(
        begun: NDArray[np.floating], sign: float, margin: float, *, alone: bool = False
    ) -> tuple[int, float, Floats]:
        numbers = (known.feedback, known.centre, known.rim, sign, margin)
        return front(begun, held, drive.copy(), *numbers, alone=alone)

    def end_within(margin: float) -> tuple[int, float, Floats]:
        """Return the end of cells that go one way, else the one that bounds of both ways share."""
        # the other way where the first is none; which is first saves time where all begin alike
        first = 1.0 if start[0, 0] > 0.0 else -1.0
        result = gone(start, first, margin)
        if result[0] in (END, GREY):
            return result
        result = gone(start, -first, margin)
        if result[0] == END:
            return result
        ends = list[tuple[int, float, Floats]]()
        for sign, bound in ((1.0, np.minimum), (-1.0, np.maximum)):
            # from a state below (above): all that may fall (rise) has done so at once
            outcome, _, reached = gone(start, sign, margin, alone=True)
            if outcome != END:
                return result
            ends.append(gone(bound(start, np.sign(reached)), -sign, margin))
        (below, early, low), (above, late, high) = ends
        if below != END or above != END or not bool((low == high).all()):
            return result
        return END, max(early, late), low

    outcome, time, state = end_within(rounding)
    if outcome not in (END, GREY) and _sums_exactly(template, known, maps):
        outcome, time, state = end_within(0.0)
    if outcome == GREY:
        return "a cell begins between −1 and 1"
    if outcome != END:
        return (
            "cells that rise may race others that fall, or a sum is too close to the edge to tell"
        )
    own = rounding + EPSILON * largest
    free = np.abs(state[~held]) if held.size else np.abs(state)
    keeps = bool((free > 1.0).all())
    return state, time * float(template.tau[0]), own, largest, keeps


@lru_cache(maxsize=16)
def _everywhere(value: float, shape: Shape) -> Floats:
    return np.broadcast_to(np.float64(value), shape)


def rim_of(boundary: Boundary) -> tuple[int, float]:
    """Return a boundary as compiled loops take it: kind and constant, as the boundary has it."""
    if boundary.constant is not None:
        return 0, float(boundary.constant)
    return (1, 0.0) if boundary.pad_mode == "symmetric" else (2, 0.0)


def _sums_exactly(template: Template, known: Monotone, maps: Given) -> bool:
    """Return whether no sum of the run is rounded: all numbers are multiples of a power of two."""
    numbers = [template.z, template.A, template.B, np.float64(known.rim[1])]
    numbers += [maps[role] for role in ("input", "bias") if role in maps]
    if template.input_boundary.constant is not None:
        numbers.append(np.float64(template.input_boundary.constant))
    scaled = (np.asarray(number, dtype=np.float64) * FINEST for number in numbers)
    return all(
        bool((np.abs(number) < FINEST * LARGEST).all() and (number == np.rint(number)).all())
        for number in scaled
    )


def _drive(
    template: Template, known: Monotone, maps: Given, shape: Shape
) -> tuple[Floats, float, int]:
    """Return B ∗ u + z with the bias map, a bound on the sum of the sizes in it, and its terms."""
    from cnnum.engines.numba.wavefront import drive_of  # Numba takes its time

    weights, constant = known.control[2], float(template.z[0])
    u = maps["input"] if weights.size else NONE
    rim = rim_of(template.input_boundary)
    drive, largest, most = drive_of(u, maps.get("bias", NONE), shape, known.control, constant, rim)
    # a constant rim counts as an input
    size = abs(constant) + most + max(largest, abs(rim[1])) * float(np.abs(weights).sum())
    return drive, size, weights.size + 2
