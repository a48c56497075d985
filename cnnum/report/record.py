"""The record of a scene's run for a report: frames, outputs, events, ground truth."""

from dataclasses import dataclass, field
from typing import cast

import numpy as np

from cnnum.arrays import Floats, Shape
from cnnum.drivers.in_memory import MEMORY
from cnnum.drivers.registry import driver_options
from cnnum.frame import FORCE_AXES, truth_columns
from cnnum.plan import Explanation
from cnnum.report.environment import Environment
from cnnum.scenes.conversion import ByCalibration
from cnnum.scenes.events import Event
from cnnum.scenes.pipeline import FrameResult, Scene
from cnnum.scenes.summary import Summary

SHEAR_X, SHEAR_Y, NORMAL = FORCE_AXES


@dataclass(frozen=True, slots=True, eq=False)
class SceneRecord:
    """Everything that a report says about a run comes from here.

    Attributes
    ----------
    name : str
    needs : tuple of str
        The outputs that the scene wants.
    shape : (rows, cols)
    rate : float
        Frames a second, Hz; 0 where it is unknown.
    pitch : float or None
        Between taxels, m; None where it is unknown, and then no circle can be drawn to scale.
    channels : tuple of str
        Of `values`: the force axes that were read.
    unit : str
        Of `values`: "strain", "count", "N"…
    times : (frames,) float, s
    values : (frames, rows, cols, channels) float
        The program's input; NaN in frames that were not allowed to run.
    push : int
        Sign with which a push on the skin, or a pull along an axis, reads in `values`: −1 for
        strain, which counts tension as positive.
    outputs : dict of str to (frames,) or (frames, rows, cols) float
        The program's outputs; NaN where the program did not run.
    events : tuple of Event
    truth : dict of str to (frames,) float
        Ground truth by name; empty where the source has none, NaN in frames without.
    seconds : (frames,) float, s
        From a frame in host memory to its events; NaN where the program did not run.
    explanation : Explanation
    summary : Summary
    environment : Environment
    """

    name: str
    needs: tuple[str, ...]
    shape: Shape
    rate: float
    pitch: float | None
    channels: tuple[str, ...]
    unit: str
    times: Floats
    values: Floats
    push: int
    outputs: dict[str, Floats]
    events: tuple[Event, ...]
    truth: dict[str, Floats]
    seconds: Floats
    explanation: Explanation
    summary: Summary
    environment: Environment

    @property
    def frames(self) -> int:
        """Number of frames."""
        return len(self.times)

    def channel(self, name: str) -> Floats | None:
        """Return (frames, rows, cols) of a force axis, or None where it was not read."""
        if name not in self.channels:
            return None
        return self.values[..., self.channels.index(name)]

    def maps(self) -> dict[str, Floats]:
        """Return the outputs that are maps."""
        return {name: values for name, values in self.outputs.items() if values.ndim == 3}

    def at(self, name: str, frame: int) -> float:
        """Return the ground truth of that name at a frame; NaN where there is none."""
        values = self.truth.get(name)
        return float("nan") if values is None else float(values[frame])


@dataclass(slots=True, eq=False)
class SceneRecorder:
    """Collects the moments of a scene as they come.

    Attributes
    ----------
    scene : Scene
    """

    scene: Scene
    _moments: list[FrameResult] = field(default_factory=list[FrameResult])

    def add(self, moment: FrameResult) -> None:
        """Take the next moment."""
        self._moments.append(moment)

    def record(self) -> SceneRecord:
        """Return the record so far."""
        scene, moments = self.scene, self._moments
        explanation = scene.plan.explain()
        calibrated = isinstance(scene.conversion, ByCalibration)
        return SceneRecord(
            name=scene.spec.name,
            needs=scene.spec.needs,
            shape=scene.shape,
            rate=scene.driver.rate,
            pitch=_pitch(scene),
            channels=scene.plan.schedule.channels_read,
            unit="strain" if calibrated else scene.driver.unit,
            times=np.array([moment.frame.time for moment in moments]),
            values=_values(scene, moments),
            push=_push(scene, calibrated),
            outputs=_outputs(moments),
            events=tuple(event for moment in moments for event in moment.events),
            truth=truth_columns([moment.frame.truth for moment in moments]),
            seconds=np.array([m.seconds if m.outputs else np.nan for m in moments]),
            explanation=explanation,
            summary=scene.summary(),
            environment=Environment.here(explanation.device),
        )


def _pitch(scene: Scene) -> float | None:
    if scene.grid is not None:
        return scene.grid.pitch
    spec = scene.spec
    if spec.driver == MEMORY:
        return None
    options = driver_options(spec.driver, spec.driver_options, base=spec.base)
    return cast(float | None, getattr(options, "pitch", None))


def _push(scene: Scene, calibrated: bool) -> int:
    push = scene.spec.parameters.get("push", -1 if calibrated else 1)
    return -1 if isinstance(push, int | float) and push < 0 else 1


def _values(scene: Scene, moments: list[FrameResult]) -> Floats:
    channels = scene.plan.schedule.channels_read
    values = np.full((len(moments), *scene.shape, len(channels)), np.nan)
    for number, moment in enumerate(moments):
        if moment.values is not None:
            values[number] = moment.values
    return values


def _outputs(moments: list[FrameResult]) -> dict[str, Floats]:
    none: dict[str, Floats] = {}
    known = next((moment.outputs for moment in moments if moment.outputs), none)
    found = {name: np.full((len(moments), *np.shape(v)), np.nan) for name, v in known.items()}
    for number, moment in enumerate(moments):
        for name, value in moment.outputs.items():
            found[name][number] = value
    return found
