"""Symmetric starts: the part of an error that breaks a symmetry shows in the state itself.

If a mirror, a turn or a shift g of the array changes neither the template nor the maps of a run, it
does not change the exact state x* at any time either. Roundings do not keep it: terms of mirrored
cells are added in another order. Where a mode that breaks the symmetry grows while the state does
not, neither the rates nor a finer run need show it. For an error e = x − x* of a state x,

    e − ge = x − gx,

so that the part of e without the symmetry, e less its mean over the group of all such g, is at most
the largest |x − gx|. This is added to the estimate of the other part. Modes act on each other where
an array is not linear: of a state much of which breaks its symmetry, nothing is known.

Where opposite maps have opposite states, g may change their sign, too. A mask has none to change.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from itertools import product

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


PROBES = 16
"""Cells that are compared first: in most maps that a move changes, it changes one of these."""

SAMPLES = np.linspace(0.0, 4.0, 257)
"""Where an output function is looked at: one that only seems to be odd adds to errors."""

KEPT = 64
"""Templates and shapes whose moves are kept."""


def _least(maps: Maps) -> Maps:
    """Return the least number of each map: what changes it nowhere is alike in all cells.

    This is no move, but if all cells of an array and of its maps are alike, so are its states.
    """
    least: Maps = maps.min(axis=(-2, -1), keepdims=True)
    return least


def _opposite(move: Move, maps: Maps) -> Maps:
    return -move(maps)


@dataclass(frozen=True, slots=True, eq=False)
class Moves:
    """Moves that a template does not see.

    Attributes
    ----------
    each : tuple of callable
        `_least` comes first where cells that begin alike stay so.
    probes : (moves, PROBES) int
        Which cell stands at each probed one after a move, in row-major order.
    probed : (PROBES,) int
    signs : (moves, 1) int
        −1 for those that change the sign of all numbers.
    """

    each: tuple[Move, ...]
    probes: NDArray[np.intp]
    probed: NDArray[np.intp]
    signs: NDArray[np.intp]

    def keeping(
        self, maps: Sequence[Maps], lead: tuple[int, ...] = ()
    ) -> Iterator[tuple[Move, NDArray[np.bool_]]]:
        """Yield the moves that change nothing in the maps of some frames, and which frames.

        Parameters
        ----------
        maps : sequence of (..., maps, rows, cols) float
        lead : tuple of int
            Axes of the batch, to which the leading axes of all maps broadcast.
        """
        likely = np.ones(len(self.each), dtype=bool)
        for own in maps:
            flat = own.reshape(*own.shape[:-2], -1)
            same = flat[..., self.probes] == self.signs * flat[..., np.newaxis, self.probed]
            likely &= same.all(axis=(-3, -1)).reshape(-1, len(likely)).any(axis=0)
        for place in np.flatnonzero(likely).tolist():
            move, alike = self.each[place], np.ones(lead, dtype=bool)
            for own in maps:
                alike = alike & (move(own) == own).all(axis=(-3, -2, -1))
                if not alike.any():
                    break
            else:
                yield move, alike
                if move is _least and alike.all():
                    return  # what is alike in all cells keeps its mirrors and shifts


@lru_cache(maxsize=KEPT)
def moves_of(template: Template, shape: Shape) -> Moves:
    """Return the moves that a template does not see.

    Parameters
    ----------
    template : Template
    shape : (rows, cols)
    """
    kernels = [template.A, template.B, *(coupling.weights for coupling in template.nonlinear)]
    if template.delayed is not None:
        kernels += [template.delayed.A, template.delayed.B]
    mirrors = MIRRORS if shape[0] == shape[1] else MIRRORS[:OF_RECTANGLES]
    moves = [move for move in mirrors if all(np.array_equal(move(k), k) for k in kernels)]
    edges = {template.boundary, *([template.input_boundary] if reads_inputs(template) else [])}
    if edges == {PERIODIC}:
        both = product(_divisors(shape[0]), _divisors(shape[1]))
        moves += [partial(np.roll, shift=shift, axis=(-2, -1)) for shift in both if shift != shape]
    signs = np.ones(len(moves), dtype=np.intp)
    if _is_odd(template) and not any(edge.constant for edge in edges):
        moves += [partial(_opposite, move) for move in moves]
        signs = np.append(signs, -signs)
    cells = np.arange(float(math.prod(shape))).reshape(shape)
    probed = np.linspace(0, cells.size - 1, PROBES).astype(np.intp)
    if all(edge.constant is None for edge in edges):
        moves.insert(0, _least)
        signs = np.insert(signs, 0, 1)
    rows = [np.abs(np.broadcast_to(move(cells), shape).ravel()[probed]) for move in moves]
    probes = np.array(rows, np.intp).reshape(-1, PROBES)
    return Moves(tuple(moves), probes, probed, signs[:, np.newaxis])


def _is_odd(template: Template) -> bool:
    """Return whether opposite maps have opposite states, but for fixed virtual cells."""
    response = template.output.numpy
    still = not (template.z.any() or template.nonlinear) and template.initial in (0.0, "input")
    return still and np.allclose(response(-SAMPLES), -response(SAMPLES), rtol=1e-12, atol=0.0)


def _divisors(count: int) -> list[int]:
    return [number for number in range(1, count + 1) if count % number == 0]


def may_break(template: Template, solver: Solver) -> bool:
    """Return whether roundings of a run may grow into what its error does not show."""
    exact = isinstance(solver.scheme, Exact) or template.output.discrete
    return not exact and error_growth(template) > 0.0


def broken(
    template: Template,
    moves: Moves,
    given: Mapping[str, Maps],
    lead: tuple[int, ...],
    state: Maps,
) -> Floats:
    """Return by how much the states of a run have lost the symmetries of their start.

    Parameters
    ----------
    template : Template
    moves : Moves
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
    for move, alike in moves.keeping(maps, lead):
        apart = np.abs(move(state) - state).max(axis=inner, initial=0.0)
        largest = np.maximum(largest, np.where(alike, apart, 0.0))
    return largest


def with_broken(result: Result, request: Request) -> Result:
    """Return a result whose error contains what its states have lost of their start's symmetry."""
    template = request.ran
    moves = moves_of(template, request.shape)
    if not (moves.each and np.isfinite(result.error).any()):
        return result
    apart = broken(template, moves, request.given, request.lead, result.state)
    if not (apart > VISIBLE * result.error).any():
        return result
    inner = tuple(range(apart.ndim, result.state.ndim))
    size = np.abs(result.state).max(axis=inner, initial=0.0)
    lost = (apart > LARGE * size) & (not template.output.linear)
    return replace(result, error=np.where(lost, math.inf, result.error + apart))


def breaks(request: Request) -> bool:
    """Return whether a run may begin with a symmetry that its error does not show to be lost."""
    return not request.engine.whole and may_break(request.ran, request.solver)


def unbroken(request: Request, down: Callable[[Request], Result]) -> Result:
    """Take a run whose error contains what its state has lost of its start's symmetry."""
    return with_broken(down(request), request)
