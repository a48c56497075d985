"""Symmetric starts: the part of an error that breaks a symmetry shows in the state itself.

If a mirror, a turn or a shift g of the array changes neither the template nor the maps of a run, it
does not change the exact state x* at any time either. Roundings do not keep it: terms of mirrored
cells are added in another order. Where a mode that breaks the symmetry grows while the state does
not, neither the rates nor a finer run need show it. For an error e = x − x* of a state x,

    e − ge = x − gx,

so that the part of e without the symmetry, e less its mean over the group of all such g, is at most
the largest |x − gx|. This is added to the estimate of the other part. Modes act on each other where
an array is not linear: of a state much of which breaks its symmetry, nothing is known.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from cnnum.arrays import Floats, Shape
from cnnum.integrators.estimate import error_growth
from cnnum.integrators.solver import Exact, Solver
from cnnum.runs.request import Request
from cnnum.runs.result import Result
from cnnum.templating.boundary import PERIODIC
from cnnum.templating.network import reads_inputs
from cnnum.templating.template import Template

Maps = NDArray[np.floating]
Move = Callable[[Maps], Maps]
"""Moves the cells of maps, (..., rows, cols)."""

MIRRORS: tuple[Move, ...] = (
    lambda maps: maps[..., ::-1],
    lambda maps: maps[..., ::-1, :],
    lambda maps: maps[..., ::-1, ::-1],
    lambda maps: maps.swapaxes(-1, -2),
    lambda maps: maps.swapaxes(-1, -2)[..., ::-1, ::-1],
    lambda maps: maps.swapaxes(-1, -2)[..., ::-1],
)
"""The symmetries of a square but for the turn that is the last one backwards."""

OF_RECTANGLES = 3
"""So many of them map a rectangle onto itself."""

VISIBLE = 0.01
"""Share of an error below which a difference of mirrored cells does not change it."""

LARGE = 0.1
"""Share of a state beyond which the modes that break its symmetry act on the others."""


def moves_of(template: Template, solver: Solver, shape: Shape) -> tuple[Move, ...]:
    """Return the moves that a template does not see, if the error of its runs may miss some.

    Parameters
    ----------
    template : Template
    solver : Solver
    shape : (rows, cols)
    """
    exact = isinstance(solver.scheme, Exact) or template.output.discrete
    if exact or error_growth(template) <= 0.0:
        return ()
    kernels = [template.A, template.B, *(coupling.weights for coupling in template.nonlinear)]
    if template.delayed is not None:
        kernels += [template.delayed.A, template.delayed.B]
    mirrors = MIRRORS if shape[0] == shape[1] else MIRRORS[:OF_RECTANGLES]
    moves = [move for move in mirrors if all(map(keeps(move), kernels))]
    inside = not reads_inputs(template) or template.input_boundary == PERIODIC
    if template.boundary == PERIODIC and inside:
        moves += [
            partial(np.roll, shift=(down, right), axis=(-2, -1))
            for down in _divisors(shape[0])
            for right in _divisors(shape[1])
            if (down, right) != shape
        ]
    return tuple(moves)


def _divisors(count: int) -> list[int]:
    return [number for number in range(1, count + 1) if count % number == 0]


def keeps(move: Move) -> Callable[[Maps], bool]:
    """Return a function that says whether a move changes nothing in maps."""
    return lambda maps: np.array_equal(move(maps), maps)


def broken(
    template: Template,
    moves: Sequence[Move],
    given: Mapping[str, Maps],
    lead: tuple[int, ...],
    state: Maps,
) -> Floats:
    """Return by how much the states of a run have lost the symmetries of their start.

    Parameters
    ----------
    template : Template
    moves : sequence of callable
        Those that the template does not see.
    given : mapping of str to (..., maps, rows, cols) float
        The run's maps, by role.
    lead : tuple of int
        Leading axes of the batch.
    state : (..., *lead, rows, cols) or (..., *lead, layers, rows, cols) float
        States at the end, or at several times.

    Returns
    -------
    (..., *lead) float
        The largest |x − gx| over all cells and the moves g that leave a frame's start as it is.
    """
    reads = reads_inputs(template) or ("state" not in given and template.initial == "input")
    maps = [each for role, each in given.items() if role != "input" or reads]
    times = state.ndim - len(lead) - (2 if template.layers == 1 else 3)
    inner = tuple(range(times + len(lead), state.ndim))
    largest = np.zeros(state.shape[: times + len(lead)])
    for move in moves:
        alike = np.ones(lead, dtype=bool)
        for each in maps:
            alike &= (move(each) == each).all(axis=(-3, -2, -1))
            if not alike.any():
                break
        else:
            apart = np.abs(move(state) - state).max(axis=inner, initial=0.0)
            largest = np.maximum(largest, np.where(alike, apart, 0.0))
    return largest


def with_broken(result: Result, request: Request) -> Result:
    """Return a result whose error contains what its states have lost of their start's symmetry."""
    template = request.ran
    moves = moves_of(template, request.solver, request.shape)
    finite = np.isfinite(result.error)
    if not (moves and finite.any()):
        return result
    apart = broken(template, moves, request.given, request.lead, result.state)
    if not (apart > VISIBLE * result.error).any():
        return result
    inner = tuple(range(apart.ndim, result.state.ndim))
    size = np.abs(result.state).max(axis=inner, initial=0.0)
    lost = (apart > LARGE * size) & (not template.output.linear)
    return replace(result, error=np.where(lost, math.inf, result.error + apart))


def may_break(request: Request) -> bool:
    """Return whether a run may begin with a symmetry that its error does not show to be lost."""
    return not request.engine.whole


def unbroken(request: Request, down: Callable[[Request], Result]) -> Result:
    """Take a run whose error contains what its state has lost of its start's symmetry."""
    return with_broken(down(request), request)
