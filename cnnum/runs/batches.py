"""Runs of many templates at once: as lanes of one launch, or in sequence.

One template represents all: its placeholder values say where weights are and how fast the fastest
array is. The actual values are maps of each frame. The sum over inputs is computed here, once.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cnnum.arrays import Floats, Shape
from cnnum.errors import ArrayError, NotSupportedError
from cnnum.graph.nodes import RunSpec
from cnnum.integrators.tableau import BOGACKI_SHAMPINE, TABLEAUX
from cnnum.runs.growth import by_halving, delay_of, halved
from cnnum.runs.request import Ask, OpenEngine, as_frame, channels_and_lead, maps_by_role
from cnnum.runs.result import Result, result_of, with_fallback
from cnnum.runs.settling import lanes_at_rest
from cnnum.templating.batch import LADDER, Parts, TemplateBatch, inner, own_parts
from cnnum.templating.couplings import DelayedCoupling
from cnnum.templating.network import jumps
from cnnum.templating.numbers import with_numbers
from cnnum.templating.template import Template

ANGLES = 16
"""Number of wave numbers on a torus along each axis."""


def fastest(batch: TemplateBatch, dt: float | None) -> float:
    """Return the fastest rate of any template, 1/time, rounded up to a rung or the bound of dt."""
    numbers = batch.flat(batch.lead)
    exact = float((_rates(batch.template, numbers) / numbers["tau"]).max())
    rung = LADDER ** math.ceil(math.log(exact, LADDER) - 1e-9)
    if dt is not None and exact * dt <= 2.0:
        return min(rung, 2.0 / dt)
    return rung


def _rates(template: Template, numbers: Parts) -> Floats:
    """Return bounds on the rates of layers, times τ: on a torus, whose cells are in their range.

    Rates of arrays with other boundaries, or with saturated cells, are within the same disc.

    Returns
    -------
    (frames, layers) float
    """
    kernels = numbers["A"]
    if template.layers > 1:
        linear = np.abs(kernels).sum(axis=(2, 3, 4)) + 1.0
    else:
        count = kernels.shape[-1]
        places: Floats = np.arange(count, dtype=np.float64) - count // 2
        angles: Floats = np.arange(ANGLES, dtype=np.float64) * (2.0 * np.pi / ANGLES)
        waves = np.exp(1j * angles[:, np.newaxis] * places)
        modes = np.einsum("ar,nrc,bc->nab", waves, kernels[:, 0, 0], waves) - 1.0
        sizes = np.where(modes.real < 0.0, np.abs(modes), 1.0)
        linear = sizes.reshape(len(kernels), -1).max(axis=1)[:, np.newaxis]
    extra = _widened(template, numbers)
    if "delayed A" in numbers:
        extra = extra + np.abs(numbers["delayed A"]).sum(axis=(2, 3, 4))
    return np.asarray(linear + extra, dtype=np.float64)


def _widened(template: Template, numbers: Parts) -> Floats:
    """Return how much |dx/dt|·τ of each layer may change in addition to A, (frames, layers)."""
    total = np.zeros(numbers["tau"].shape)
    for k, gain in enumerate(template.gains, 1):
        most = np.abs(numbers[f"gain {k}"]).max(axis=-1)
        weights = np.abs(numbers["A"][:, gain.to, gain.source]).sum(axis=(1, 2))
        total[:, gain.to] += np.maximum(most - 1.0, 0.0) * weights * template.output.steepest
    for k, coupling in enumerate(template.nonlinear, 1):
        per_weight = replace(coupling, weights=np.ones((1, 1))).stiffness
        total[:, coupling.to] += per_weight * np.abs(numbers[f"coupling {k}"]).sum(axis=(1, 2))
    return total


def growth(template: Template, numbers: Parts) -> Floats:
    """Return the bound on the growth of errors of every frame, 1/time (`error_growth`)."""
    a = numbers["A"]
    own = np.einsum("nllkk->nlk", a)[..., a.shape[-1] // 2]
    low, high = template.output.slope
    others = template.output.steepest * (np.abs(a).sum(axis=(2, 3, 4)) - np.abs(own))
    rows = np.maximum(low * own, high * own) + others + _widened(template, numbers) - 1.0
    return np.asarray((rows / numbers["tau"]).max(axis=1), dtype=np.float64)


MOST_CELLS = 256
"""Largest number of cells in arrays whose frames are processed in lanes."""

LEAST = 1e-9
"""Placeholder values for per-frame weights: too small to affect the rates of an array."""

Maps = dict[str, NDArray[np.floating]]


def fits_lanes(batch: TemplateBatch, shape: Shape, options: Mapping[str, Any]) -> bool:
    """Return whether the templates of a batch can be lanes of a launch."""
    template = batch.template
    method, fixed = options["method"], options["dt"] is not None
    known = method in ("auto", BOGACKI_SHAMPINE.name, "euler") or (fixed and method in TABLEAUX)
    return known and not template.output.discrete and shape[0] * shape[1] <= MOST_CELLS


def run_lanes(
    batch: TemplateBatch,
    lead: tuple[int, ...],
    maps: Maps,
    shape: Shape,
    options: Mapping[str, Any],
    engine: OpenEngine,
) -> list[tuple[NDArray[np.intp], Result]]:
    """Run all frames of a batch, and return results with the places of their frames.

    All run in one launch, except for delays: each rung of a ladder of delays has its own launch.

    Parameters
    ----------
    batch : TemplateBatch
    lead : tuple of int
        Leading axes to which batch and maps broadcast.
    maps : dict of str to (n, maps, rows, cols) array
        By role.
    shape : (rows, cols)
    options : mapping
        Options of the run.
    engine : OpenEngine
    """
    template, numbers = batch.template, batch.flat(lead)
    given = _given(template, numbers, maps, shape)
    patterns, rate = _patterns(batch), fastest(batch, options["dt"])
    rungs = _rungs(template, numbers)
    parts: list[tuple[NDArray[np.intp], Result]] = []
    for rung in np.unique(rungs):
        at = np.flatnonzero(rungs == rung)
        standing = _standing(template, patterns, rate, float(rung))
        own = {role: array[at] for role, array in given.items()}
        own["weights"] = _packed(template, numbers, patterns, at, shape)
        parts.append((at, _launch(standing, own, options, engine)))
    return parts


def _launch(
    template: Template, given: Maps, options: Mapping[str, Any], engine: OpenEngine
) -> Result:
    names, lead = channels_and_lead(given)
    shape = (int(given["state"].shape[-2]), int(given["state"].shape[-1]))
    free = options["method"] == "auto" and options["dt"] is None
    follows = free and template.delayed is None and not jumps(template)
    method = BOGACKI_SHAMPINE.name if follows else options["method"]
    spec = RunSpec(options["duration"], method, options["rtol"], options["atol"], options["dt"])
    plan = engine.plan_for(template, shape, names, spec, "own weights")
    outputs = plan.run_finite(as_frame(given, lead, np.dtype(engine.precision)))
    (solver,) = plan.solvers.values()
    reason = f"templates side by side in lanes; {solver.reason}"
    return with_fallback(result_of(outputs, template.layers, solver.method, reason), plan)


def _given(template: Template, numbers: Parts, maps: Maps, shape: Shape) -> Maps:
    """Return the maps of all frames by role, in a transient's order."""
    count = len(numbers["A"])
    drive = np.zeros((count, template.layers, *shape)) + numbers["z"][..., np.newaxis, np.newaxis]
    if "input" in maps and "B" in numbers:
        drive += _driven(numbers["B"], maps["input"], template)
    if "bias" in maps:
        drive = drive + maps["bias"]
    kept = ("input", "previous") if _sees_inputs(template) else ()
    given = {role: maps[role] for role in kept if role in maps}
    given |= {"state": _start(template, maps, drive.shape), "bias": drive}
    return given | ({"mask": maps["mask"]} if "mask" in maps else {})


def _sees_inputs(template: Template) -> bool:
    """Return whether any coupling but B reads inputs."""
    delayed = template.delayed is not None and template.inputs > 0
    return delayed or any(
        "u" in (coupling.neighbour, coupling.centre) for coupling in template.nonlinear
    )


def _driven(b: Floats, inputs: NDArray[np.floating], template: Template) -> Floats:
    """Return B∗u of every frame and layer."""
    radius, boundary = b.shape[-1] // 2, template.input_boundary
    rows, cols = inputs.shape[-2:]
    total = np.zeros((len(b), b.shape[1], rows, cols))
    rim = [(0, 0), (0, 0), (radius, radius), (radius, radius)]
    padded = (
        np.pad(inputs, rim, mode=boundary.pad_mode)
        if boundary.constant is None
        else np.pad(inputs, rim, constant_values=boundary.constant)
    )
    for layer, source, row, col in np.argwhere((b != 0.0).any(axis=0)):
        seen = padded[:, source, row : row + rows, col : col + cols]
        total[:, layer] += b[:, layer, source, row, col, np.newaxis, np.newaxis] * seen
    return total


def _start(template: Template, maps: Maps, frames: tuple[int, ...]) -> NDArray[np.floating]:
    if "state" in maps:
        return maps["state"]
    if template.initial == "input":
        return maps["input"]
    return np.full(frames, float(template.initial))


# per-frame values and their placeholders


def _patterns(batch: TemplateBatch) -> dict[str, NDArray[np.bool_]]:
    """Return which weights are nonzero in any template; gains and centre weights always count."""
    result: dict[str, NDArray[np.bool_]] = {}
    for name, part in own_parts(batch.parts).items():
        lead = tuple(range(part.ndim - inner(name)))
        used = np.asarray((part != 0.0).any(axis=lead))
        if name.startswith("gain"):
            used = np.ones_like(used)
        if name == "A":
            middle = used.shape[-1] // 2
            used[range(len(used)), range(len(used)), middle, middle] = True
        result[name] = used
    return result


def _packed(
    template: Template,
    numbers: Parts,
    patterns: Mapping[str, NDArray[np.bool_]],
    at: NDArray[np.intp],
    shape: Shape,
) -> Floats:
    """Return the numbers of frames as the cells of as many maps as they need."""
    columns = [numbers[name][at][:, used] for name, used in patterns.items()]
    columns += [numbers["tau"][at], growth(template, numbers)[at, np.newaxis]]
    if template.delayed is not None:
        columns.append(numbers["delay"][at, np.newaxis])
    packed = np.concatenate(columns, axis=1)
    cells = shape[0] * shape[1]
    count = -(-packed.shape[1] // cells)
    maps = np.zeros((len(at), count * cells))
    maps[:, : packed.shape[1]] = packed
    return maps.reshape(-1, count, *shape)


def _standing(
    template: Template, patterns: Mapping[str, NDArray[np.bool_]], rate: float, delay: float
) -> Template:
    """Return the template that represents all, with placeholder values and the fastest rate."""
    parts, first = dict[str, Floats](), 0
    for name, used in patterns.items():
        count = int(used.sum())
        parts[name] = np.zeros(used.shape)
        # a weight of 0 would be dropped
        parts[name][used] = LEAST * (1.0 + (first + np.arange(count)) / 64.0)
        first += count
    middle, layers = parts["A"].shape[-1] // 2, range(template.layers)
    parts["A"][layers, layers, middle, middle] += 1.0 - rate
    inputs = template.inputs if _sees_inputs(template) else 0
    delayed = template.delayed
    if delayed is not None:
        seen = parts["delayed B"][:, :inputs] if inputs else np.zeros((template.layers, 0, 1, 1))
        delayed = DelayedCoupling(delay, parts["delayed A"], seen)
    form = Template(
        "batch",
        parts["A"],
        np.zeros((template.layers, inputs, 1, 1)) if inputs else None,
        boundary=template.boundary,
        input_boundary=template.input_boundary,
        duration=template.duration,
        output=template.output,
        nonlinear=template.nonlinear,
        delayed=delayed,
        gains=template.gains,
    )
    return with_numbers(form, {name: part for name, part in parts.items() if name[0] in "cg"})


def _rungs(template: Template, numbers: Parts) -> Floats:
    """Return, for each frame, the smallest rung of a ladder that is not below its delay."""
    if template.delayed is None:
        return np.ones(len(numbers["A"]))
    steps = np.ceil(np.log(numbers["delay"]) / math.log(LADDER) - 1e-9)
    return np.asarray(LADDER**steps, dtype=np.float64)


PARTS = ("output", "state", "time", "steps", "settled", "error")
"""Attributes of a result that have an axis of frames."""

OPTIONS = ("duration", "method", "rtol", "atol", "dt")

ALL = ("input", "previous", "state", "bias", "mask")


def as_batch(ask: Ask, down: Callable[[Ask], Result]) -> Result:
    """Run every template of a batch; leading axes of arrays broadcast with its own.

    Raises
    ------
    ArrayError
        If the leading axes do not broadcast.
    NotSupportedError
        If an option takes single templates.
    """
    engine, batch = ask.engine, ask.template
    *shared, force, estimate = ask.options
    if force or estimate or ask.at is not None:
        raise NotSupportedError(
            "A batch of templates runs without 'force', 'estimate' and 'at': run them one by one."
        )
    maps, shape = maps_by_role(batch.template, dict(zip(ALL, ask.arrays, strict=True)))
    _, own = channels_and_lead(maps)
    try:
        lead = np.broadcast_shapes(batch.lead, own)
    except ValueError:
        raise ArrayError(
            f"The axes of the templates, {batch.lead}, and of the arrays, {own}, do not broadcast."
        ) from None
    flat = {
        role: np.broadcast_to(array, (*lead, *array.shape[-3:])).reshape(-1, *array.shape[-3:])
        for role, array in maps.items()
    }
    options: dict[str, Any] = dict(zip(OPTIONS, shared, strict=True))
    lanes = engine.record.lanes and not engine.whole
    if lanes and fits_lanes(batch, shape, options):

        def side_by_side(dt: float | None) -> Result:
            stepped = {**options, "dt": dt}
            return _joined(run_lanes(batch, lead, flat, shape, stepped, engine))

        result = _halved(batch.template, side_by_side, options, engine.precision)
        if ask.duration == "settle":
            result = lanes_at_rest(result, batch.template, options["rtol"], options["atol"])
    else:
        result = _joined(_one_by_one(ask, lead, flat, down))
    return _shaped(result, lead)


def _halved(
    template: Template,
    run: Callable[[float | None], Result],
    options: Mapping[str, Any],
    precision: str,
) -> Result:
    """Return a run of frames; with a delay, halve the steps until the tolerance is met."""

    def finer(step: float, frames: NDArray[np.intp]) -> Result:
        result = run(step)
        return replace(result, **{name: getattr(result, name)[frames] for name in PARTS})

    first = run(options["dt"])
    duration = template.duration if options["duration"] is None else options["duration"]
    if not by_halving(template, dt=options["dt"], settle=duration == "settle"):
        return first
    return halved(first, finer, delay_of(template), (options["rtol"], options["atol"]), precision)


def _one_by_one(
    ask: Ask, lead: tuple[int, ...], maps: Maps, down: Callable[[Ask], Result]
) -> list[tuple[NDArray[np.intp], Result]]:
    """Run frame by frame, frames of the same template together."""
    batch: TemplateBatch = ask.template
    places = np.broadcast_to(np.arange(batch.size).reshape(batch.lead), lead).ravel()
    parts: list[tuple[NDArray[np.intp], Result]] = []
    for number, template in enumerate(batch.templates()):
        at = np.flatnonzero(places == number)
        own = {role: _plain(array[at]) for role, array in maps.items()}
        parts.append((at, down(ask.of(template, [own.get(name) for name in ALL]))))
    return parts


def _plain(array: NDArray[np.floating]) -> NDArray[np.floating]:
    """Return maps in the user's form: a single map has no layer axis."""
    return array[:, 0] if array.shape[1] == 1 else array


def _joined(parts: list[tuple[NDArray[np.intp], Result]]) -> Result:
    """Return one result of runs in the order of their places."""
    order = np.argsort(np.concatenate([at for at, _ in parts]), kind="stable")
    first = parts[0][1]

    def put(name: str) -> Any:
        values = [np.asarray(getattr(result, name)) for _, result in parts]
        return np.concatenate(values)[order]

    return Result(**{name: put(name) for name in PARTS}, method=first.method, reason=first.reason)


def _shaped(result: Result, lead: tuple[int, ...]) -> Result:
    """Return a result whose first axis is the batch's leading ones."""

    def of(name: str) -> Any:
        value = np.asarray(getattr(result, name))
        return value.reshape(*lead, *value.shape[1:])

    return Result(**{name: of(name) for name in PARTS}, method=result.method, reason=result.reason)
