"""The stability class of a template on an array, its theorem, and the box of its states.

The box of states that an array never leaves, whatever inputs within [−1, 1] it is given.

A cell moves by τ dx/dt = −x + s with |s| ≤ K(R) while all states lie within [−R, R], where K sums
the weights times the largest output there. So a box with K(R) ≤ R holds every transient that starts
in it (Chua & Yang 1988, theorem 1, is the case |f| ≤ 1).

A theorem is named only if each of its conditions is checked: the couplings of the array with its
boundary, the slopes of the output, and a box that no state leaves. Time constants may differ
between layers: no proof here assumes that they are equal.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cnnum.arrays import Floats, Shape
from cnnum.templating.functions import OUTPUT_FUNCTIONS, OutputFunction
from cnnum.templating.network import autonomous, cells_seen
from cnnum.templating.template import Template

INTERVALS = 4096
"""Number of intervals in which a user-defined output function is sampled."""

WIDER = 1.001
"""Factor between a box that is too small and the next that is tried, so that one is reached."""

MOST = 200
"""Maximum number of boxes to try: if none holds by then, outputs grow about as fast as states."""

FARTHEST = 1e12
"""Largest box to try."""

BEYOND = 64.0
"""Largest |x| at which an output is sampled if no box is known."""

ROUNDINGS = 1e-9
"""Part of the steepest slope by which the slope between two samples may be off: they are some
1/1000 apart, and each is rounded to 1e-16 of its own size or so; float32 forms are not sampled."""


def state_bound(template: Template) -> float:
    """Return a bound on |x|, infinite if none is known.

    Parameters
    ----------
    template : Template
        Inputs within [−1, 1], starts within [−1, 1] or at the template's own initial state.

    Notes
    -----
    For a user-defined output function, |f| between samples is bounded by its declared slopes.
    """
    output = template.output
    if not template.plain:
        return math.inf
    if output.limited:
        return 1.0
    start = max(1.0, 0.0 if template.initial == "input" else abs(template.initial))
    seen = max(1.0, abs(template.input_boundary.constant or 0.0))
    weights: Floats = np.abs(template.A).sum(axis=(1, 2, 3))
    drive: Floats = np.abs(template.B).sum(axis=(1, 2, 3)) * seen + np.abs(template.z)
    rim = template.boundary.constant
    virtual = 0.0 if rim is None else _size(output, [rim])
    if not output.discrete and (pull := weights * output.steepest).max() < 1.0:
        # |f(x)| ≤ |f(0)| + d |x|, and R = K(R)
        known = weights * max(_size(output, [0.0]), virtual) + drive
        return max(start, float((known / (1.0 - pull)).max()))
    if output.linear:
        return math.inf

    def needed(reach: float) -> float:
        return float((weights * max(_largest(output, reach), virtual) + drive).max())

    for _ in range(MOST):
        if (wider := needed(start)) <= start:
            return start
        if not wider < FARTHEST:
            break
        if needed(wider) <= wider:
            return wider
        start = wider * WIDER
    return math.inf


def _largest(output: OutputFunction, reach: float) -> float:
    """Return a bound on |f| for |x| ≤ reach."""
    if OUTPUT_FUNCTIONS.get(output.name) is output:
        return 1.0
    half = reach / INTERVALS
    return _size(output, np.linspace(-reach, reach, INTERVALS + 1)) + output.steepest * half


def _size(output: OutputFunction, x: Floats | list[float]) -> float:
    return float(np.abs(output.numpy(np.asarray(x, dtype=np.float64))).max())


def sampled_slopes(output: OutputFunction, reach: float) -> tuple[float, float]:
    """Return the least and the largest slope between neighbouring samples of an output function.

    Parameters
    ----------
    output : OutputFunction
    reach : float
        Largest |x|; values above `BEYOND` are reduced to it.

    Returns
    -------
    (float, float)
        Each the mean slope of an interval, so that the function's own slopes reach as far at least.
        Those of the package are known and not sampled.
    """
    if OUTPUT_FUNCTIONS.get(output.name) is output:
        return output.slope
    ends = {min(reach, BEYOND), min(reach, 4.0)}
    slopes: list[Floats] = []
    for end in ends:
        x = np.linspace(-end, end, INTERVALS + 1)
        slopes.append(np.diff(np.asarray(output.numpy(x), dtype=np.float64)) / np.diff(x))
    result = np.concatenate(slopes)
    return float(result.min()), float(result.max())


def refuted(output: OutputFunction, sampled: tuple[float, float]) -> bool:
    """Return whether samples show slopes beyond those that an output function declares."""
    allowed = ROUNDINGS * max(output.steepest, 1.0)
    # written so that a function that is not a number somewhere is refuted, too
    within = sampled[0] >= output.slope[0] - allowed and sampled[1] <= output.slope[1] + allowed
    return not within


BOX = "for inputs and starts within [-1, 1]"


@dataclass(frozen=True, slots=True)
class StabilityClass:
    """The class of a template's transients.

    Attributes
    ----------
    name : str
        "linear and stable", "contracting", "monostable cells", "bistable cells", "symmetric A",
        "feed-forward", "positive cell-linking" or "unknown".
    why : str
        A sentence.
    """

    name: str
    why: str


def stability_class(template: Template, shape: Shape = (8, 8)) -> StabilityClass:
    """Return the first class that a template on an array belongs to, trying the simplest first.

    Parameters
    ----------
    template : Template
    shape : (rows, cols)
        Shape of the array: on a torus, or with mirrors at the rim, couplings depend on it.

    Notes
    -----
    Slopes of a user-defined output function are those that it declares. They are checked against
    samples, and a declaration that samples refute proves nothing.
    """
    output = template.output
    if output.discrete:
        return StabilityClass("unknown", "It runs in discrete time, in which cells may alternate.")
    if not autonomous(template):
        return StabilityClass("unknown", "No theorem here covers delays or gains in time.")
    if not all(coupling.static for coupling in template.nonlinear):
        return StabilityClass("unknown", "No theorem here covers couplings nonlinear in the state.")
    sampled = sampled_slopes(output, bound := state_bound(template))
    if refuted(output, sampled):
        low, high = output.slope
        return StabilityClass(
            "unknown",
            f"Its output '{output.name}' declares slopes from {low:g} to {high:g}, but samples of "
            f"it show {sampled[0]:.4g} to {sampled[1]:.4g}: declare slopes that hold.",
        )
    if (contracting := _contracting(template)) is not None:
        return contracting
    if output.linear:
        return StabilityClass(
            "unknown", "Its output is linear: it rests if every mode decays, which its rates say."
        )
    bounded = math.isfinite(bound) or OUTPUT_FUNCTIONS.get(output.name) is output
    if (alone := _uncoupled(template, bounded)) is not None:
        return alone
    if not bounded:
        return StabilityClass("unknown", "No bound is known on its states, which rest needs.")
    return (
        _symmetric(template)
        or _feed_forward(template, shape)
        or _positive(template, shape, sampled[0])
        or StabilityClass(
            "unknown",
            "On this array cells act on each other both ways, A is not symmetric with the array's "
            "boundary, and no other theorem here covers its weights and its output.",
        )
    )


def _contracting(template: Template) -> StabilityClass | None:
    """In the largest difference of two states, whatever time constants the layers have."""
    if not template.A.any():
        return StabilityClass("linear and stable", "A is 0, so that every cell decays on its own.")
    pull = float(np.abs(template.A).sum(axis=(1, 2, 3)).max()) * template.output.steepest
    if pull >= 1.0:
        return None
    steep = template.output.steepest
    times = "" if steep == 1.0 else f" times the output's slope of up to {steep:g}"
    return StabilityClass(
        "linear and stable" if template.output.linear else "contracting",
        f"The sizes of A's weights{times} sum to {pull:.3g}, below 1, so that differences decay.",
    )


def _uncoupled(template: Template, bounded: bool) -> StabilityClass | None:
    """A cell of its own is an equation of one state, which rests wherever it is bounded."""
    middle = template.A.shape[-1] // 2
    others = template.A.copy()
    others[range(template.layers), range(template.layers), middle, middle] = 0.0
    if others.any() or template.layers > 1:
        return None
    own, output = float(template.A[0, 0, middle, middle]), template.output
    cells = f"Cells act on themselves alone, with a00 = {own:g}"
    steepest = max(own * slope for slope in output.slope)
    if steepest < 1.0 or (steepest == 1.0 and bounded):
        # −x + a f(x) never rises, and is flat where the product is 1
        exactly = ", or stays where its drive is exactly in balance" if own > 0.0 else ""
        limit = "at most 1" if output.slope == (0.0, 1.0) else "too small for two ends"
        return StabilityClass("monostable cells", f"{cells}, {limit}: each has one end{exactly}.")
    if OUTPUT_FUNCTIONS.get(output.name) is not output:
        return None
    ends = "comes to one of two ends" if output.smooth else "ends black or white"
    return StabilityClass(
        "bistable cells",
        f"{cells}, above 1: each {ends}, unless it starts exactly between them.",
    )


def _symmetric(template: Template) -> StabilityClass | None:
    """The energy falls at the rate Σ τ f' (dx/dt)², so that f must not fall (Hopfield 1984)."""
    if template.output.slope[0] < 0.0:
        return None
    mirrored = template.A.transpose(1, 0, 2, 3)[:, :, ::-1, ::-1]
    # a mirror at the rim keeps couplings symmetric only if they are even along each axis
    even = all(np.array_equal(template.A, np.flip(template.A, axis)) for axis in (2, 3))
    mirror = template.boundary.pad_mode == "symmetric"
    if not np.array_equal(template.A, mirrored) or (mirror and not even):
        return None
    own = OUTPUT_FUNCTIONS.get(template.output.name) is not template.output
    holds = f", {BOX}" if own else ""
    return StabilityClass(
        "symmetric A",
        "A is symmetric and its output never falls, so that an energy falls until rest (Chua & "
        f"Yang 1988; Hopfield 1984){holds}.",
    )


def _feed_forward(template: Template, shape: Shape) -> StabilityClass | None:
    """Each cell is an equation of one state, driven by cells that have come to rest."""
    if not (_one_sided(template) or _loops(template, shape) == math.prod(shape) * template.layers):
        return None
    holds = "" if OUTPUT_FUNCTIONS.get(template.output.name) is template.output else f", {BOX}"
    return StabilityClass(
        "feed-forward",
        "No cell acts back on one that acts on it, not even through others, so that cells settle "
        f"in turn{holds}.",
    )


def _one_sided(template: Template) -> bool:
    """Whether all neighbours that act on a cell lie on one side of it, and the rim acts on none."""
    if template.layers > 1 or template.boundary.constant is None:
        return False
    middle = template.A.shape[-1] // 2
    offsets = [tuple(place) for place in np.argwhere(template.A[0, 0]) - middle if place.any()]
    if not offsets:
        return True
    angles = np.sort([np.arctan2(down, east) for down, east in offsets])
    gaps = np.diff(np.append(angles, angles[0] + 2.0 * np.pi))
    return bool(gaps.max() > np.pi + 1e-9)


def _loops(template: Template, shape: Shape) -> int:
    """Return the number of strongly connected components of the cells."""
    from scipy.sparse import coo_array  # imported late: it takes longer than the rest of this
    from scipy.sparse.csgraph import connected_components

    cells = math.prod(shape)
    to, source = list[NDArray[np.intp]](), list[NDArray[np.intp]]()
    for layer, tap, seen in cells_seen(template.A, template.boundary, shape):
        inside = np.flatnonzero(seen >= 0)
        to.append(layer * cells + inside)
        source.append(tap.source * cells + seen[inside])
    states = cells * template.layers
    places = (np.concatenate(to), np.concatenate(source))
    graph = coo_array((np.ones(len(places[0]), dtype=np.int8), places), (states, states))
    return int(connected_components(graph.tocsr(), connection="strong")[0])


def _positive(template: Template, shape: Shape, rise: float) -> StabilityClass | None:
    """Hirsch's theorem (1988): a steady slope above 0, and every cell acts on every other."""
    middle, layers = template.A.shape[-1] // 2, range(template.layers)
    others = template.A.copy()
    others[layers, layers, middle, middle] = 0.0
    if (others < 0.0).any():
        return None
    output = template.output
    rises = output.smooth and not output.limited and output.slope[0] >= 0.0
    if OUTPUT_FUNCTIONS.get(output.name) is not output:
        rises = rises and rise > 0.0
    if not rises:
        return StabilityClass(
            "unknown",
            "No cell pushes another away, but the theorem for that needs an output that rises "
            "steadily everywhere, and this one does not (Chua & Roska 1990; Hirsch 1988).",
        )
    if _loops(template, shape) != 1:
        return StabilityClass(
            "unknown",
            "No cell pushes another away, but the theorem for that needs every cell to act on "
            "every other, if through others (Chua & Roska 1990; Hirsch 1988).",
        )
    return StabilityClass(
        "positive cell-linking",
        "No cell pushes another away and all are linked, so that almost all transients settle "
        "(Chua & Roska 1990; Hirsch 1988).",
    )
