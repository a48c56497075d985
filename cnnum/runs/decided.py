"""The output of a run in one pass over its input, for uncoupled cells.

**Signs.** Let a be a cell's own weight, m = a − 1, x₀ its start with |x₀| ≤ 1, and w = B ∗ u + z
its drive, which is constant. Within [−1, 1] the state obeys x' = m x + w in time constants. The
solution of that equation alone, X(t) = x₀ e^{mt} + w (e^{mt} − 1)/m, goes one way. If X(T) ≥ 1, the
cell has come to 1 by then, at a rate of 0 or more; it goes on to a rest at a + w ≥ 1, and never
returns. So its output is 1 from T on if

    w + c x₀ ≥ θ,    c = m / (1 − e^{−mT}),    θ = m / (e^{mT} − 1),

with c = θ = 1/T for m = 0, and −1 if that sum is −θ or less. To equilibrium T is infinite. Sums
that are as close to ±θ as roundings are, and all between, show nothing: such runs go on to the
exact state of each cell.

**Ranks.** Let a = 1, and let each of n neighbours pull a cell by a step, up below its own level
t_k = u_k + δ and down above it. Within [−1, 1] own weight and decay cancel. The rate P_j depends
only on the number j of levels below the state, and falls with j. The state rises while P_j > 0, up
to the level at which that ends, and falls while P_j < 0, so it comes to its start, kept between two
ranks of the levels. It has at most 2 to go, at no less than the smallest |P_j| that is not 0. The
pulls are added as fractions, so that their signs are exact. Where a level lies beyond 1, the state
leaves [−1, 1] and its output is 1.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import lru_cache
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from cnnum.arrays import Floats
from cnnum.errors import MethodError
from cnnum.integrators.schemes import DECISION
from cnnum.runs.request import Ask, look_at_pictures
from cnnum.runs.result import Decided, Later, Result
from cnnum.runs.wavefront import SPARE, rim_of
from cnnum.templating.functions import Table
from cnnum.templating.network import taps
from cnnum.templating.template import Template

LEAST_CELLS = 4096
"""Minimum number of cells in all frames: fewer run in full in the time of this check."""

TYPES = (np.dtype(np.float32), np.dtype(np.float64))
"""Number types of maps that are taken as they are."""

Begins = Literal["own", "first", "apart"]

EXACTLY = "of cells that see no other cell the output is known without their states"
BY_RANK = "the pull on a cell changes its sign at a neighbour's level, which is found by its rank"


@dataclass(frozen=True, slots=True, eq=False)
class Signs:
    """Decision rule of cells that see only their own output.

    Attributes
    ----------
    places : (couplings, 2) int
    weights : (couplings + 1,) float
        Weights of the inputs around a cell, and of a separately given state.
    level : float
        θ.
    constant : float
        Constant term of every sum.
    """

    places: NDArray[np.int64]
    weights: Floats
    level: float
    constant: float


@dataclass(frozen=True, slots=True, eq=False)
class Ranks:
    """Between which levels a cell is kept whose neighbours pull it by steps.

    Attributes
    ----------
    places : (neighbours, 2) int
    between : (lower, upper)
        Ranks from 0 on, −1 where there is no bound.
    shift : float
        δ.
    time : float
        Time constants after which every cell is there.
    """

    places: NDArray[np.int64]
    between: tuple[int, int]
    shift: float
    time: float


@lru_cache(maxsize=256)
def signs_of(template: Template, duration: float, begins: Begins) -> Signs | None:
    """Return the decision rule of a template's cells, or None if they are coupled.

    Parameters
    ----------
    template : Template
    duration : float
        In the unit of τ, above 0; infinite to equilibrium.
    begins : "own", "first" or "apart"
        Where cells begin: in the template's own number, in the map whose neighbourhoods are
        weighed, or in a map apart from it.
    """
    if template.layers != 1 or template.inputs > 1 or not template.plain:
        return None
    if template.output.name != "standard":
        return None
    middle = template.A.shape[-1] // 2
    own = float(template.A[0, 0, middle, middle])
    if np.count_nonzero(template.A) != (own != 0.0):
        return None
    slope, time = own - 1.0, duration / float(template.tau[0])
    with np.errstate(all="ignore"):
        grown, left = np.expm1([slope * time, -slope * time]) if slope else (0.0, 0.0)
        level = float(slope / grown) if slope else 1.0 / time
        begun = float(-slope / left) if slope else 1.0 / time
    if not math.isfinite(level + begun):
        return None
    control = taps(template.B, 0) if template.inputs else ()
    weights = {(tap.row, tap.col): tap.weight for tap in control}
    constant = float(template.z[0])
    if begins == "first":
        weights[0, 0] = weights.get((0, 0), 0.0) + begun
    elif begins == "own":
        if abs(float(template.initial)) > 1.0:
            return None
        constant += begun * float(template.initial)
    places = np.array(list(weights), np.int64).reshape(-1, 2)
    return Signs(places, np.array([*weights.values(), begun]), level, constant)


@lru_cache(maxsize=256)
def ranks_of(template: Template) -> Ranks | None:
    """Return between which levels the cells of a template are kept; None of another kind."""
    alike = template.layers == 1 and template.inputs <= 1 and template.delayed is None
    alike = alike and not template.gains and template.output.name == "standard"
    if not (alike and len(template.nonlinear) == 1):
        return None
    middle = template.A.shape[-1] // 2
    alone = np.count_nonzero(template.A) == 1 and template.A[0, 0, middle, middle] == 1.0
    begins = template.initial == "input" or abs(float(template.initial)) <= 1.0
    (pull,) = template.nonlinear
    pulls = (pull.neighbour, pull.centre) == ("u", "x") and not pull.times_argument
    if not (alone and begins and pulls) or template.B.any() or not pull.weights.any():
        return None
    weight, table = float(pull.weights.max()), pull.function
    places = np.argwhere(pull.weights) - pull.weights.shape[0] // 2
    if not isinstance(table, Table) or table.interpolation != "constant" or len(table.points) != 2:
        return None
    if np.count_nonzero(pull.weights == weight) != len(places):
        return None
    (edge, first), (_, second) = table.points
    # below its level a neighbour pulls with one value, above it with the other
    before, after = (first, second) if pull.sign > 0.0 else (second, first)
    up, down = (Fraction(weight) * Fraction(value) for value in (before, after))
    count = len(places)
    rates = [Fraction(float(template.z[0])) + (count - j) * up + j * down for j in range(count + 1)]
    if up <= down or rates[0] < 0 or rates[-1] > 0 or not any(rates):
        return None
    rising, falling = sum(rate > 0 for rate in rates), sum(rate < 0 for rate in rates)
    between = (rising - 1, count - falling if falling else -1)
    slowest = float(min(abs(rate) for rate in rates if rate))
    return Ranks(places, between, pull.sign * edge, 2.0 / slowest * (1.0 + 1e-9))


def _where(template: Template, has_input: bool, has_state: bool) -> Begins:
    """Return where the cells of a run begin."""
    if has_state:
        return "apart" if has_input else "first"
    return "first" if template.initial == "input" else "own"


def decides(ask: Ask) -> bool:
    """Return whether a run may be decided in one pass, before its numbers are looked at."""
    _, method, _, _, dt, force, estimate = ask.options
    if method == DECISION:
        return True
    if method != "auto" or dt is not None or force or estimate:
        return False
    # an engine that solves finely is what others are held against
    if ask.engine.whole or not ask.engine.record.takes_steps:
        return False
    first = ask.arrays[2] if ask.arrays[0] is None else ask.arrays[0]
    if type(first) is not np.ndarray or first.size < LEAST_CELLS:
        return False
    return _refusal(ask) == ""


def _duration(ask: Ask) -> float | None:
    """Return the time that a run takes, None if it is none or of no length."""
    duration: Any = ask.duration
    if duration == "settle":
        return math.inf
    if type(duration) not in (int, float) or not 0.0 < duration < math.inf:
        return None
    return float(duration)


def _refusal(ask: Ask) -> str:
    """Return why a run cannot be decided in one pass, or nothing."""
    template, duration = ask.template, _duration(ask)
    if ask.options[4] is not None or ask.options[5] or ask.options[6] or ask.engine.whole:
        return "it takes no steps and no whole numbers"
    if duration is None:
        return "it takes a duration above 0"
    _, previous, state, bias, mask = ask.arrays
    if previous is not None or bias is not None or mask is not None:
        return "it takes an input and a state, and no other map"
    ranks = ranks_of(template)
    if ranks is not None:
        if state is not None:
            return "cells that neighbours pull by steps begin in a state of their own"
        late = duration < ranks.time * float(template.tau[0])
        return f"its outputs may change until {ranks.time:.4g} τ" if late else ""
    begins = _where(template, ask.arrays[0] is not None, state is not None)
    if signs_of(template, duration, begins) is None:
        return (
            "it takes one layer with the standard output and one input at most, whose cells see no "
            "other cell, or a rank template, in which all neighbours pull with the same step"
        )
    return ""


def in_one_pass(ask: Ask, down: Callable[[Ask], Result]) -> Result:
    """Take a run by the output that is known from the input; others go below."""
    why = _refusal(ask) or _trouble(ask)
    decided = None if why else _found(ask)
    if decided is None:
        if ask.options[1] != DECISION:
            return down(ask)
        why = why or "the output of a cell lies between −1 and 1, or too close to tell"
        raise MethodError(
            f"The method '{DECISION}' cannot run template '{ask.template.name}': {why}."
        )
    output, arrays, reason = decided
    options = (ask.options[0], "auto", *ask.options[2:])
    shape = np.shape(output)

    def made() -> Result:
        # as they were when the output was found
        maps = tuple(None if array is None else np.reshape(array, shape) for array in arrays)
        rest = Ask(ask.engine, ask.template, maps, options)
        result = down(rest)
        if reason == EXACTLY:
            return result
        # steps chatter about a level; within the range of the output the state is the output
        state = np.where(np.abs(output) < 1.0, output, result.state)
        return replace(result, state=state)

    later = Later(made)
    return Result.of_output(output, DECISION, reason, later, Decided(output, later))


def _trouble(ask: Ask) -> str:
    """Return why the maps of a run are not looked at in one pass, or nothing."""
    given, _, state, _, _ = ask.arrays
    maps = [values for values in (given, state) if values is not None]
    if not maps or (given is not None) < ask.template.inputs:
        return "it needs an input"
    kinds = [(getattr(values, "dtype", None), np.shape(values)) for values in maps]
    dtype, shape = kinds[0]
    if dtype is None or dtype not in TYPES or len(set(kinds)) > 1:
        return "its maps must be arrays of float32 or float64, of one type and shape"
    radius = max(ask.template.radius, 1)
    if len(shape) < 2 or 0 in shape or radius > min(shape[-2:]):
        return f"its neighbourhood is wider than the array of {shape}"
    starts = ask.template.initial == "input" and state is None
    if given is not None and not (ask.template.inputs or starts):
        return "it has no control template"
    return ""


def _found(ask: Ask) -> tuple[Floats, tuple[Any, ...], str] | None:
    """Return the output of a run, its maps as they were read, and why it is the output."""
    given, _, state, _, _ = ask.arrays
    duration = _duration(ask)
    assert duration is not None
    result = _read(ask.template, duration, given, state)
    if result is None:
        return None
    output, seen, start, reason = result
    maps: dict[str, Any] = {"input": given, "state": state}
    if not ask.template.inputs:
        maps = {"state": seen.inner}
    look_at_pictures(ask.template, {role: x for role, x in maps.items() if x is not None})
    return output, _as_read(ask, seen, start), reason


def output_of(
    template: Template, duration: float, maps: Mapping[str, NDArray[np.floating]]
) -> Floats | None:
    """Return the proven outputs of uncoupled cells or of ranks; None where they are not known.

    Parameters
    ----------
    template : Template
        One that `is_decided` takes, with a radius within the array.
    duration : float
        In the unit of τ.
    maps : mapping of str to (..., rows, cols) float
        Input, and a separately given state, by role.
    """
    result = _read(template, duration, maps.get("input"), maps.get("state"))
    return None if result is None else np.asarray(result[0], np.float64)


def is_decided(template: Template, duration: float, *, has_input: bool, has_state: bool) -> bool:
    """Return whether outputs after a time may be known from maps, before these are looked at."""
    if not (has_input or has_state) or (has_input and not template.inputs):
        return False
    ranks = ranks_of(template)
    if ranks is not None:
        return not has_state and duration >= ranks.time * float(template.tau[0])
    return signs_of(template, duration, _where(template, has_input, has_state)) is not None


def _read(
    template: Template, duration: float, given: Any, state: Any
) -> tuple[Floats, Any, Any, str] | None:
    """Return the output of a run, the maps as they were read, and why it is the output."""
    from cnnum.engines.numba import one_pass  # Numba takes its time

    first: Any = state if given is None else given
    shape = np.shape(first)
    u = np.ascontiguousarray(first).reshape(-1, *shape[-2:])
    rim, ranks = rim_of(template.input_boundary), ranks_of(template)
    if rim[0] == 0 and not template.inputs:
        rim = (0, 0.0)
    if ranks is not None:
        begun = None if template.initial == "input" else float(template.initial)
        result = one_pass.ranks(u, begun, ranks.places, ranks.between, ranks.shift, rim)
        return None if result is None else (result[0].reshape(shape), result[1], None, BY_RANK)
    begins = _where(template, given is not None, state is not None)
    signs, apart = signs_of(template, duration, begins), begins == "apart"
    assert signs is not None
    start: NDArray[Any] = np.zeros((0, 0, 0), u.dtype)
    if apart:
        start = np.array(state).reshape(u.shape)  # its caller may change it later
    size = float(np.abs(signs.weights).sum()) * max(1.0, abs(rim[1]))
    size += abs(signs.constant) + signs.level
    numbers = np.finfo(u.dtype)
    margin = SPARE * (len(signs.weights) + 4) * float(numbers.eps) * size
    levels = (signs.constant, signs.level + margin, -signs.level - margin)
    # sums of nothing, or of less than the type has, are no signs
    if not (margin > float(numbers.tiny) and size < float(numbers.max) / 4.0):
        return None
    result = one_pass.signs(u, start, signs.places, signs.weights.astype(u.dtype), levels, rim)
    if result is None:
        return None
    return result[0].reshape(shape), result[1], start if apart else None, EXACTLY


def _as_read(ask: Ask, seen: Any, start: Any = None) -> tuple[Any, ...]:
    """Return the maps of a run in the order of their roles, as they were read."""
    if ask.arrays[0] is None:
        return (None, None, seen.inner, None, None)
    return (seen.inner, None, start, None, None)
