"""Prepared runs of one small array: repeated runs check only their numbers.

A run on 8×8 cells takes a few microseconds; checking every argument takes ten times as long.
"""

import math
from collections.abc import Callable, Hashable, Mapping, Sequence
from numbers import Real
from threading import RLock
from typing import cast

import numpy as np

from cnnum.arrays import all_finite
from cnnum.engines.backend import OneFrame
from cnnum.errors import MethodError
from cnnum.plan import Plan
from cnnum.runs.growth import hides_errors, looks_again, may_grow, scale
from cnnum.runs.linear_range import may_stay_linear
from cnnum.runs.request import LEAST_SQUARES, ROLES, Ask, Form, Request, refuse_grey_levels
from cnnum.runs.result import Result, result_of, with_fallback, with_proof
from cnnum.runs.settling import saturated
from cnnum.runs.symmetry import VISIBLE, Move, may_break, moves_of
from cnnum.runs.wavefront import begins_saturated, monotone
from cnnum.templating.template import Template

EXACT_TYPES = "df?"
"""Codes of number types whose values a frame holds as they are, if they are in its range."""

MASK = 4
"""Place of the fixed-state mask among the arrays of a run."""

PICTURE_TYPES = "df"
"""The same of a picture, which is no array of flags."""


def form_of(
    template: Template, arrays: Sequence[object], options: tuple[Hashable, ...]
) -> Form | None:
    """Return the form of a run on one array with one layer.

    Parameters
    ----------
    template : Template
    arrays : sequence of array-like or None
        The run's maps, in the order of their roles.
    options : tuple
        Duration, method, tolerances and so on.

    Returns
    -------
    Form or None
        None if an argument needs full checking: a list, a batch, several layers, or an option that
        cannot be compared.
    """
    for option in options[:2]:  # not compared before their types are known
        if not (option is None or isinstance(option, str | Real)):
            raise MethodError(
                "A duration must be a number or 'settle', and a method must be a name, got "
                f"{type(option).__name__}."
            )
    shapes: list[tuple[int, ...] | None] = []
    for place, array in enumerate(arrays):
        types = PICTURE_TYPES if place < len(ROLES) else EXACT_TYPES
        if array is None:
            shapes.append(None)
        elif place == MASK and getattr(array, "dtype", None) != np.bool_:
            return None  # numbers may be below 0
        elif type(array) is np.ndarray and array.ndim == 2 and array.dtype.char in types:
            shapes.append(array.shape)
        else:
            return None
    form = (id(template), options, *shapes)
    try:
        hash(form)
    except TypeError:
        return None
    return form


MOST_PREPARED = 64
"""Runs kept ready; each holds a template and a frame's arrays, so the oldest goes first."""


class PreparedRun:
    """A plan with its arrays on the device, for one frame after the other.

    Parameters
    ----------
    template : Template
        Kept, so that no other template gets its identity.
    plan : Plan
    one : OneFrame
        The plan's fast path for single frames.
    roles : sequence of str
        Roles of the channels.
    """

    __slots__ = (
        *("_frame", "_one", "_plan", "_roles", "_solver", "_square", "_turn"),
        *("_moves", "monotone", "template"),
    )

    def __init__(
        self, template: Template, plan: Plan, frame_runner: OneFrame, roles: Sequence[str]
    ) -> None:
        self.template, self._plan, self._one = template, plan, frame_runner
        self.monotone = monotone(template) is not None
        (self._solver,) = plan.solvers.values()
        self._roles = tuple(roles) if may_grow(template, self._solver) else ()
        schedule = plan.schedule
        may = may_break(template, self._solver)
        self._moves = moves_of(template, schedule.shape) if may else None
        self._frame = np.empty((*schedule.shape, len(schedule.channels_read)))
        largest = float(np.finfo(plan.precision).max)
        self._square = largest**2 if largest < 1e100 else math.inf
        self._turn = RLock()

    def run(self, arrays: Sequence[object]) -> Result | None:
        """Run arrays of the prepared form, or None if a number is not finite in the precision.

        Also None if the state or its error has grown so far that it needs full checking.

        Parameters
        ----------
        arrays : sequence of (rows, cols) array or None

        Raises
        ------
        ArrayError
            If a result is not finite.
        MethodError
            If the transient does not finish.
        """
        with self._turn:
            at = 0
            for array in arrays:
                if isinstance(array, np.ndarray):
                    self._frame[..., at] = array
                    at += 1
            squares = np.vdot(self._frame, self._frame)
            # below: every number is finite, and none is too large for the precision
            if not squares < self._square:
                return None
            if squares > LEAST_SQUARES:
                for role, array in zip(ROLES, arrays, strict=False):
                    if isinstance(array, np.ndarray):
                        refuse_grey_levels(self.template, role, np.asarray(array, np.float64))
            outputs = self._one.run(self._frame, first=True)
            packed = self._one.packed
            begun = self._begun() if self._roles else 0.0
            kept = self._kept()
        if not all_finite(packed):
            self._plan.refuse_infinite(outputs)
        result = result_of(outputs, 1, self._solver.method, self._solver.reason)
        error = VISIBLE * float(np.max(result.error))
        if any(np.abs(move(result.state) - result.state).max() > error for move in kept):
            return None
        if self._roles:
            ended, error = float(np.abs(result.state).max()), float(np.max(result.error))
            if looks_again(self._solver, begun, ended, error):
                return None
        return with_fallback(result, self._plan)

    def _kept(self) -> list[Move]:
        """Return the moves that change nothing in the frame."""
        if self._moves is None:
            return []
        return [move for move, _ in self._moves.keeping([self._frame.transpose(2, 0, 1)])]

    def _begun(self) -> float:
        """Return a bound on the size of all that the run began with."""
        largest = np.abs(self._frame).max(axis=(0, 1))
        sizes = {role: largest[at : at + 1] for at, role in enumerate(self._roles)}
        return float(scale(self.template, sizes))


def is_prepared(ask: Ask) -> bool:
    """Return whether a run of the same form is kept ready; the ask learns its form."""
    ask.form = form_of(ask.template, ask.arrays, ask.options)
    if ask.form is None:
        return False
    ask.kept = ask.engine.prepared.get(ask.form)
    if ask.kept is None:
        return False
    # another start may need no way
    return not (ask.kept.monotone and begins_saturated(ask.template, ask.arrays))


def as_prepared(ask: Ask, down: Callable[[Ask], Result]) -> Result:
    """Take a run of a form that is kept ready; what needs a closer look goes on below."""
    assert ask.kept is not None
    try:
        result = ask.kept.run(ask.arrays)
    except MethodError:  # its steps are too many: below, others are looked for
        result = None
    done, duration, (rtol, atol) = result, ask.duration, ask.options[2:4]
    if result is not None and duration == "settle":
        done = saturated(result, ask.template, rtol, atol, ask.engine.precision)
    if done is None:
        ask.form, ask.ready = None, result
        return down(ask)
    if ask.engine.whole:
        return done
    # their caller may change the arrays before a proof is read
    own = [None if array is None else cast(np.ndarray, array).copy() for array in ask.arrays]
    return with_proof(done, ask.template, own, duration, (rtol, atol))


def keep(request: Request) -> None:
    """Keep a run ready for others of its form; the oldest goes where they are too many."""
    run = prepared_run(request.template, request.plan, request.given, exact=request.exact)
    if run is None or request.form is None:
        return
    kept = request.engine.prepared
    with request.engine.turn:
        while len(kept) >= MOST_PREPARED:
            kept.pop(next(iter(kept)))
        kept[request.form] = run


def prepared_run(
    template: Template, plan: Plan, given: Mapping[str, np.ndarray], *, exact: bool
) -> PreparedRun | None:
    """Return a plan's prepared run, None if runs of this form differ by more than numbers.

    Parameters
    ----------
    template : Template
    plan : Plan
        Plan of this template as it is, not of the linear one that it may be.
    given : mapping of str to (maps, rows, cols) float
        Maps by role.
    exact : bool
        Whether the run is exact where no cell leaves the linear range.
    """
    (solver,) = plan.solvers.values()
    reads_all = plan.schedule.channels_read == plan.schedule.channels
    if solver.forced or not reads_all or (exact and may_stay_linear(template, given)):
        return None
    if may_grow(template, solver) and hides_errors(template, solver):
        return None  # it is compared with another run
    frame_runner = plan.executable.one(plan.executable.new_memory(1))
    return None if frame_runner is None else PreparedRun(template, plan, frame_runner, tuple(given))
