"""Runs to equilibrium, continued until there is one, or time is up."""

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from cnnum.arrays import Floats
from cnnum.graph.nodes import RunSpec
from cnnum.runs.contraction import distances, may_contract
from cnnum.runs.equilibrium import NEAR, has_certificate, verdict
from cnnum.runs.result import Result
from cnnum.templating.template import Template

STRETCH = 32.0
"""Time constants by which a run goes on between two looks at whether it rests."""

Maps = NDArray[np.floating]
Given = Mapping[str, Maps]
Rerun = Callable[[dict[str, Maps], float], Result]
"""Runs frames from a state for a time."""


def at_rest(
    result: Result,
    template: Template,
    given: Given,
    again: Rerun,
    spec: RunSpec,
    precision: str,
) -> Result:
    """Return a result whose frames rest where they say so.

    Parameters
    ----------
    result : Result
        Of a run to equilibrium.
    template : Template
    given : mapping of str to (..., maps, rows, cols) float
        The run's maps, by role.
    again : callable
        Runs some frames for a time; it is given the state, too.
    spec : RunSpec
        Its limit is the time constants after which a frame is said not to rest.
    precision : str
        Of the engine.

    Returns
    -------
    Result
        Errors are those to the equilibrium. Frames that ran on have a later time, more steps and an
        unknown error.
    """
    if not may_contract(template) or not result.settled.any():
        return result
    found = _Frames(result, template, given)
    if has_certificate(template):
        _until_they_rest(found, template, again, spec, precision)
    else:
        size = np.abs(found.state).max(axis=(1, 2, 3), initial=0.0)
        found.error += np.where(found.settled, spec.atol + spec.rtol * size, 0.0)
    found.bring_errors_down(spec.rtol, spec.atol)
    return found.result()


def _until_they_rest(
    found: "_Frames", template: Template, again: Rerun, spec: RunSpec, precision: str
) -> None:
    """Let frames run on until it is shown that they rest, or their time is up."""
    waiting = np.flatnonzero(found.settled)
    while len(waiting):
        some = found.given_of(waiting)
        state = found.state[waiting]
        error = {"rtol": spec.rtol, "atol": spec.atol}
        seen = verdict(template, some, state, **error, precision=precision)
        found.state[waiting], found.settled[waiting] = seen.state, seen.rests
        found.error[waiting] += np.where(seen.rests, seen.off, 0.0)
        waiting = waiting[~seen.rests & (found.time[waiting] < spec.settle_limit)]
        if len(waiting):
            found.run_on(waiting, again)


def saturated(result: Result | None, template: Template, rtol: float, atol: float) -> Result | None:
    """Return the result of a run to equilibrium if all its cells are saturated, else None.

    Such an array rests under any drive, as `verdict` has it. Most runs of a single frame end here,
    and a closer look would take as long as they do.

    Parameters
    ----------
    result : Result or None
    template : Template
    rtol, atol : float
    """
    if result is None or not result.settled.all() or template.output.name != "standard":
        return None
    sizes = np.abs(result.state)
    off = atol + rtol * float(sizes.max())
    if not template.plain or float(sizes.min()) < 1.0 + max(off, NEAR):
        return None
    # a way whose error leaves all cells saturated leads to the same equilibrium
    same = result.error < float(sizes.min()) - 1.0 - off
    return replace(result, error=np.where(same, 0.0, result.error) + off)


class _Frames:
    """The frames of a batch in one row."""

    def __init__(self, result: Result, template: Template, given: Given) -> None:
        self._result, self._template = result, template
        self._lead = result.settled.shape
        self._batch = int(np.prod(self._lead, dtype=np.int64))
        rows_cols = result.state.shape[-2:]
        self._shape = (self._batch, template.layers, *rows_cols)
        self.state = np.array(result.state, dtype=np.float64).reshape(self._shape)
        self.time = np.array(result.time, dtype=np.float64).reshape(self._batch)
        self.steps = np.array(result.steps).reshape(self._batch)
        self.error = np.array(result.error, dtype=np.float64).reshape(self._batch)
        self.settled = np.array(result.settled).reshape(self._batch)
        self._given = {role: self._flat(maps) for role, maps in given.items() if role != "state"}

    def _flat(self, maps: Maps) -> Floats:
        """Return maps as (batch or 1, maps, rows, cols)."""
        if maps.ndim == 3 or all(n == 1 for n in maps.shape[:-3]):
            return np.asarray(maps, dtype=np.float64).reshape(1, *maps.shape[-3:])
        whole = np.broadcast_to(maps, (*self._lead, *maps.shape[-3:]))
        return np.asarray(whole, dtype=np.float64).reshape(self._batch, *maps.shape[-3:])

    def given_of(self, frames: np.ndarray) -> dict[str, Floats]:
        """Return the maps of some frames, without their state."""
        return {
            role: maps if len(maps) == 1 else maps[frames] for role, maps in self._given.items()
        }

    def run_on(self, frames: np.ndarray, again: Rerun) -> None:
        """Run some frames on from their states."""
        more = again({**self.given_of(frames), "state": self.state[frames]}, STRETCH)
        count = len(frames)
        self.state[frames] = more.state.reshape(count, *self._shape[1:])
        self.time[frames] += more.time.reshape(count)
        self.steps[frames] += more.steps.reshape(count)
        self.error[frames] = np.inf

    def bring_errors_down(self, rtol: float, atol: float) -> None:
        """Let errors be distances to the equilibrium where the array is shown to contract.

        Frames whose cells are all saturated get the bound that `saturated` has for single ones.
        """
        sizes = np.abs(self.state).reshape(self._batch, -1)
        off = atol + rtol * sizes.max(axis=1)
        spare = sizes.min(axis=1) - 1.0
        held = self.settled & (spare >= np.maximum(off, NEAR))
        held &= self._template.output.name == "standard"
        same = held & (self.error - off < spare - off)
        self.error[same] = off[same]
        at = np.flatnonzero(self.settled & ~held)
        if len(at):
            near = distances(self._template, self.given_of(at), self.state[at], self.error[at])
            self.error[at] = np.minimum(self.error[at], near)

    def result(self) -> Result:
        """Return the result of all frames."""
        old, lead = self._result, self._lead
        state = self.state.reshape(old.state.shape)
        output = old.output
        if has_certificate(self._template):
            output = state.copy() if self._template.output.linear else np.clip(state, -1.0, 1.0)
        return replace(
            old,
            state=state,
            output=output,
            time=self.time.reshape(lead),
            steps=self.steps.reshape(lead),
            settled=self.settled.reshape(lead),
            error=self.error.reshape(lead),
        )
