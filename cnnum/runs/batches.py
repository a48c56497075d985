"""Runs of many templates at once: as lanes of one launch, or one after the other."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cnnum.errors import ArrayError, NotSupportedError
from cnnum.runs.arguments import channels_and_lead, maps_by_role
from cnnum.runs.delays import by_halving, delay_of, halved
from cnnum.runs.lanes import Maps, fits_lanes, run_lanes
from cnnum.runs.request import Ask
from cnnum.runs.result import Result
from cnnum.runs.settling import lanes_at_rest
from cnnum.templating.batch import TemplateBatch
from cnnum.templating.template import Template

PARTS = ("output", "state", "time", "steps", "settled", "error")
"""Of a result, with an axis of frames."""

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
    *asked, force, estimate = ask.options
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
    options: dict[str, Any] = dict(zip(OPTIONS, asked, strict=True))
    lanes = engine.record.lanes and not engine.whole
    if lanes and fits_lanes(batch, shape, options):

        def side_by_side(dt: float | None) -> Result:
            asked = {**options, "dt": dt}
            return _joined(run_lanes(batch, lead, flat, shape, asked, engine))

        result = _halved(batch.template, side_by_side, options, engine.precision)
        if ask.duration == "settle":
            result = lanes_at_rest(result, batch.template, options["rtol"], options["atol"])
    else:
        result = _joined(_one_by_one(ask, lead, flat, down))
    return _shaped(result, lead)


def _halved(
    template: Template,
    run: Callable[[float | None], Result],
    asked: Mapping[str, Any],
    precision: str,
) -> Result:
    """Return a run of frames; with a delay in shorter steps until the tolerance is kept."""

    def finer(step: float, frames: NDArray[np.intp]) -> Result:
        found = run(step)
        return replace(found, **{name: getattr(found, name)[frames] for name in PARTS})

    first = run(asked["dt"])
    duration = template.duration if asked["duration"] is None else asked["duration"]
    if not by_halving(template, dt=asked["dt"], settle=duration == "settle"):
        return first
    return halved(first, finer, delay_of(template), (asked["rtol"], asked["atol"]), precision)


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
    """Return maps as a user gives them: a single one has no axis of its own."""
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
