"""Runs of many templates at once: as lanes of one launch, or one after the other."""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cnnum.arrays import Floats, Shape
from cnnum.errors import ArrayError, NotSupportedError
from cnnum.graph.nodes import RunSpec
from cnnum.integrators.tableau import BOGACKI_SHAMPINE
from cnnum.plan import Plan
from cnnum.runs.arguments import as_frame, channels_and_lead, maps_by_role
from cnnum.runs.result import Result, result_of
from cnnum.templating.batch import TemplateBatch
from cnnum.templating.template import Template

OWN_WEIGHTS = "opencl"
"""The engine whose lanes can have weights of their own."""

MOST_CELLS = 256
"""Of arrays whose frames lie in lanes."""

ALL = ("input", "previous", "state", "bias", "mask")

LADDER = 2.0**0.5
"""Between two radii of rates for which a kernel is built: batches of near rates share one."""

ANGLES = 16
LEAST = 1e-9
"""Weights that stand for those of the frames: too small to change how fast an array is."""

Maps = dict[str, NDArray[np.floating]]
Plans = Callable[[tuple[object, ...], Template, Shape, tuple[str, ...], RunSpec], Plan]


def run_batch(
    engine: str,
    precision: str,
    plans: Plans,
    one: Callable[..., Result],
    batch: TemplateBatch,
    arrays: Sequence[ArrayLike | None],
    asked: Mapping[str, Any],
) -> Result:
    """Run every template of a batch.

    Parameters
    ----------
    engine, precision : str
    plans : callable
        Returns the plan of a run.
    one : callable
        Runs a single template.
    batch : TemplateBatch
    arrays : sequence of array or None
        In the order of the roles of a run; leading axes broadcast with those of the batch.
    asked : mapping
        Options of `Engine.run`.

    Raises
    ------
    ArrayError
        If the leading axes do not broadcast.
    NotSupportedError
        If an option takes single templates.
    """
    if asked.get("force") or asked.get("estimate") or asked.get("at") is not None:
        raise NotSupportedError(
            "A batch of templates runs without 'force', 'estimate' and 'at': run them one by one."
        )
    maps, shape = maps_by_role(batch.template, dict(zip(ALL, arrays, strict=True)))
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
    options = {key: value for key, value in asked.items() if key not in ("force", "estimate", "at")}
    if _fits(engine, batch, shape, options):
        found = _launches(batch, lead, flat, shape, options, plans, precision)
    else:
        found = _one_by_one(batch, lead, flat, options, one)
    return _shaped(found, lead)


def _fits(engine: str, batch: TemplateBatch, shape: Shape, asked: Mapping[str, Any]) -> bool:
    template, cells = batch.template, shape[0] * shape[1]
    known = asked["method"] in ("auto", BOGACKI_SHAMPINE.name, "euler") or asked["dt"] is not None
    plain = template.layers == 1 and not template.output.discrete and known
    return engine == OWN_WEIGHTS and plain and _count(batch) <= cells <= MOST_CELLS


def _count(batch: TemplateBatch) -> int:
    return int(_pattern(batch).sum())


def _pattern(batch: TemplateBatch) -> NDArray[np.bool_]:
    """Return which weights of A any template has; its own always."""
    used = np.asarray((batch.A != 0.0).reshape(-1, *batch.A.shape[-2:]).any(axis=0))
    used[used.shape[0] // 2, used.shape[1] // 2] = True
    return used


def _one_by_one(
    batch: TemplateBatch,
    lead: tuple[int, ...],
    maps: Maps,
    asked: Mapping[str, Any],
    one: Callable[..., Result],
) -> Result:
    """Run frame by frame, frames of the same template together."""
    places = np.broadcast_to(np.arange(batch.size).reshape(batch.lead), lead).ravel()
    parts: list[tuple[NDArray[np.intp], Result]] = []
    layers = batch.template.layers
    for number, template in enumerate(batch.templates()):
        at = np.flatnonzero(places == number)
        own = {role: _inner(array[at], role, layers) for role, array in maps.items()}
        parts.append((at, one(template, **own, **asked)))
    return _joined(parts)


def _inner(array: NDArray[np.floating], role: str, layers: int) -> NDArray[np.floating]:
    return array[:, 0] if array.shape[1] == 1 and (layers == 1 or role == "mask") else array


def _joined(parts: list[tuple[NDArray[np.intp], Result]]) -> Result:
    """Return one result of runs in the order of their places."""
    order = np.argsort(np.concatenate([at for at, _ in parts]), kind="stable")
    first = parts[0][1]

    def put(name: str) -> Any:
        values = [np.asarray(getattr(result, name)) for _, result in parts]
        return np.concatenate(values)[order]

    names = ("output", "state", "time", "steps", "settled", "error")
    return Result(**{name: put(name) for name in names}, method=first.method, reason=first.reason)


def _launches(
    batch: TemplateBatch,
    lead: tuple[int, ...],
    maps: Maps,
    shape: Shape,
    asked: Mapping[str, Any],
    plans: Plans,
    precision: str,
) -> Result:
    """Run all frames with lanes of their own weights; templates of another τ are another launch."""
    a, b, z, tau = batch.flat(lead)
    template = batch.template
    drive = z[:, 0, np.newaxis, np.newaxis] + _driven(b, maps.get("input"), template, shape)
    if "bias" in maps:
        drive = drive + maps["bias"][:, 0]
    pattern, radius = _pattern(batch), _radius(batch, asked["dt"])
    given = {"state": _start(template, maps, drive.shape), "bias": drive[:, np.newaxis]}
    if "mask" in maps:
        given["mask"] = maps["mask"]
    given["weights"] = _packed(a[:, 0, 0][:, pattern], shape)
    parts: list[tuple[NDArray[np.intp], Result]] = []
    for one in np.unique(tau[:, 0]):
        at = np.flatnonzero(tau[:, 0] == one)
        stands = _standing(template, pattern, radius, float(one))
        parts.append(
            (at, _launch(stands, {k: v[at] for k, v in given.items()}, asked, plans, precision))
        )
    return _joined(parts)


def _launch(
    template: Template, given: Maps, asked: Mapping[str, Any], plans: Plans, precision: str
) -> Result:
    names, lead = channels_and_lead(given)
    shape = (int(given["state"].shape[-2]), int(given["state"].shape[-1]))
    method = BOGACKI_SHAMPINE.name if asked["method"] == "auto" and asked["dt"] is None else None
    spec = RunSpec(
        asked["duration"], method or asked["method"], asked["rtol"], asked["atol"], asked["dt"]
    )
    plan = plans((template.digest, shape, names, spec, "own weights"), template, shape, names, spec)
    outputs = plan.run_finite(as_frame(given, lead, np.dtype(precision)))
    (solver,) = plan.solvers.values()
    reason = f"templates side by side in lanes; {solver.reason}"
    return result_of(outputs, 1, solver.method, reason)


def _driven(b: Floats, inputs: Any, template: Template, shape: Shape) -> Floats:
    """Return B∗u of every frame."""
    total = np.zeros((len(b), *shape))
    if inputs is None:
        return total
    radius, boundary = b.shape[-1] // 2, template.input_boundary
    rim = [(0, 0), (0, 0), (radius, radius), (radius, radius)]
    padded = (
        np.pad(inputs, rim, mode=boundary.pad_mode)
        if boundary.constant is None
        else np.pad(inputs, rim, constant_values=boundary.constant)
    )
    for source, row, col in np.argwhere((b[:, 0] != 0.0).any(axis=0)):
        seen = padded[:, source, row : row + shape[0], col : col + shape[1]]
        total += b[:, 0, source, row, col, np.newaxis, np.newaxis] * seen
    return total


def _start(template: Template, maps: Maps, frames: tuple[int, ...]) -> NDArray[np.floating]:
    if "state" in maps:
        return maps["state"]
    if template.initial == "input":
        return maps["input"]
    return np.full((frames[0], 1, *frames[1:]), float(template.initial))


def _packed(weights: Floats, shape: Shape) -> Floats:
    """Return weights as the first cells of maps."""
    maps = np.zeros((len(weights), shape[0] * shape[1]))
    maps[:, : weights.shape[1]] = weights
    return maps.reshape(-1, 1, *shape)


def _radius(batch: TemplateBatch, dt: float | None) -> float:
    """Return the largest rate, on a torus, of any template whose cells all are in their range.

    Rates of arrays with other boundaries, or with saturated cells, are within the same disc.
    """
    kernels = batch.A.reshape(-1, *batch.A.shape[-2:])
    count = kernels.shape[-1]
    places: Floats = np.arange(count, dtype=np.float64) - count // 2
    angles: Floats = np.arange(ANGLES, dtype=np.float64) * (2.0 * np.pi / ANGLES)
    turns = angles[:, np.newaxis] * places
    waves = np.exp(1j * turns)
    modes = np.einsum("ar,nrc,bc->nab", waves, kernels, waves) - 1.0
    falls = modes[modes.real < 0.0]
    exact = max(1.0, float(np.abs(falls).max(initial=1.0)))
    rung = LADDER ** math.ceil(math.log(exact, LADDER) - 1e-9)
    if dt is not None and exact * dt <= 2.0:
        return min(rung, 2.0 / dt)
    return rung


def _standing(
    template: Template, pattern: NDArray[np.bool_], radius: float, tau: float
) -> Template:
    """Return the template that stands for all: where weights are, and the fastest rate of any."""
    places: Floats = np.arange(int(pattern.sum()), dtype=np.float64)
    numbers = LEAST * (1.0 + places / 64.0)
    kernel = np.zeros(pattern.shape)
    kernel[pattern] = numbers
    # 0 is no weight, and would leave none
    kernel[pattern.shape[0] // 2, pattern.shape[1] // 2] += 1.0 - radius
    return Template(
        "batch",
        kernel,
        tau=tau,
        boundary=template.boundary,
        duration=template.duration,
        output=template.output,
    )


def _shaped(result: Result, lead: tuple[int, ...]) -> Result:
    """Return a result whose first axis is the batch's leading ones."""

    def of(name: str) -> Any:
        value = np.asarray(getattr(result, name))
        return value.reshape(*lead, *value.shape[1:])

    names = ("output", "state", "time", "steps", "settled", "error")
    return Result(**{name: of(name) for name in names}, method=result.method, reason=result.reason)
