"""The saving in time: scenes that need one event against one that needs all."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cnnum.arrays import Floats
from cnnum.engine import Engine
from cnnum.frame import Frame
from cnnum.lab.bench.latency import seconds_of_launch
from cnnum.scenes.pipeline import Scene, load_scene
from cnnum.scenes.scene_file import read_scene

WHOLE = "tactile"
"""The scene that wants everything; its array gives the frames of all."""

SCENES = ("contact", "edges", "localize", "slip", "twist", WHOLE)

REST, EVERY = 60, 10
"""Frames of rest that answers are compared on; of the later ones, every tenth. The reference engine
takes 60 ms for one with a contact."""

Answer = Mapping[str, Floats]

OMISSIONS = (
    "reading the frame from its driver: the time is from a frame in host memory to its events",
    "the array of 'localize', a bumpy cover: all scenes are given the frames of 'tactile'",
    "errors of all frames: answers are compared on a stream of the first and of every tenth",
)


@dataclass(frozen=True, slots=True)
class SceneCost:
    """A row of `cnnum bench scenes`.

    Attributes
    ----------
    case, device : str
        The scene's name.
    p50_us, p99_us : float
        From a frame in host memory to its events.
    share : float
        Of the time that the same frame takes in the scene that wants everything: the median.
    saved_us : float
        Less than that: the median.
    launch_us : float
        Median of a launch that does nothing where frames run, with as many bytes in and out.
    ops, channels, maps : int
        That run (those in loop bodies counted once), are read, and are read back.
    bytes_in, bytes_out : int
        To the device and back.
    frames : int
        Measured.
    error : float
        Largest difference of the answers from the reference engine's results, each over its
        largest. The frames are those of the scene that wants everything, as far as their flags
        agree.
    flips : int
        Frames in which a flag, or one of a taxel, is not the reference engine's.
    compared : int
        Frames that the last two are from.
    """

    case: str
    device: str
    p50_us: float
    p99_us: float
    share: float
    saved_us: float
    launch_us: float
    ops: int
    channels: int
    maps: int
    bytes_in: int
    bytes_out: int
    frames: int
    error: float
    flips: int
    compared: int


def measure_scenes(
    engine: Engine, *, rounds: int = 8, every: int = EVERY
) -> Iterator[SceneCost | None]:
    """Yield one row per scene, after None for each round and for the truth.

    Every frame goes through all scenes before the next one comes.

    Parameters
    ----------
    engine : Engine
        On an OpenCL device.
    rounds : int
        Times that the frames of the scene's script are run.
    every : int
        Of how many frames one is compared with the reference engine's answer.
    """
    opened = {name: opened_scene(name, engine) for name in SCENES}
    with opened[WHOLE].driver as driver:
        frames = list(driver.frames())
    turns = _Turns(opened)
    for _ in range(rounds):
        turns.run(frames)
        yield None
    some, seconds = compared(frames, every), turns.seconds()
    true = answers(opened_scene(WHOLE, Engine("reference")), some)
    yield None
    for name, scene in opened.items():
        error = error_of(scene, answers(scene, some), true)
        yield _row(name, scene, seconds, error, len(true), engine)


def opened_scene(name: str, engine: Engine) -> Scene:
    """Return the scene with the wants of the named one, on the array of `WHOLE`."""
    wants = list(read_scene(name).needs)
    return load_scene(WHOLE, engine=engine, changes={"needs": wants})


def compared(frames: Sequence[Frame], every: int) -> list[Frame]:
    """Return a stream of the first frames, which are of rest, and one of a number after them."""
    return [*frames[:REST], *frames[REST::every]]


def answers(scene: Scene, frames: Sequence[Frame]) -> list[Answer]:
    """Return the outputs of a scene's program on a stream of frames; none of bad ones."""
    way = scene.path()
    moments = [way.step(number, frame) for number, frame in enumerate(frames)]
    return [moment.outputs for moment in moments if moment.values is not None]


def error_of(scene: Scene, got: Sequence[Answer], true: Sequence[Answer]) -> tuple[float, int]:
    """Return the largest error of frames whose flags agree, and the number of all others."""
    outputs = scene.plan.schedule.outputs
    agree = np.ones(len(true), dtype=bool)
    for name in (name for name, node in outputs.items() if node.logic):
        agree &= ~_off(name, got, true).any(axis=-1)
    result = [0.0]
    for name in outputs:
        largest = max(float(np.abs(frame[name]).max()) for frame in true)
        result.append(float(_off(name, got, true)[agree].max(initial=0.0)) / (largest or 1.0))
    return max(result), int(np.count_nonzero(~agree))


def _off(name: str, got: Sequence[Answer], true: Sequence[Answer]) -> Floats:
    """Return (frames, cells) differences of an output."""
    ours, theirs = (np.stack([np.ravel(frame[name]) for frame in all_]) for all_ in (got, true))
    return np.abs(ours - theirs)


class _Turns:
    """Scenes that take turns, a frame each."""

    def __init__(self, opened: Mapping[str, Scene]) -> None:
        self._ways = {name: scene.path() for name, scene in opened.items()}
        self._taken: dict[str, list[float]] = {name: [] for name in opened}
        self._order, self._number = list(self._ways), 0

    def run(self, frames: Sequence[Frame]) -> None:
        """Run more frames, after those that have been run."""
        for frame in frames:
            # another one goes first every time: it finds the caches as the whole scene left them
            self._order.append(self._order.pop(0))
            for name in self._order:
                moment = self._ways[name].step(self._number, frame)
                self._taken[name].append(moment.seconds if moment.values is not None else np.nan)
            self._number += 1

    def seconds(self) -> dict[str, NDArray[np.float64]]:
        """Return (frames,) s by scene, of frames that ran."""
        arrays = {name: np.array(values) for name, values in self._taken.items()}
        return {name: array[np.isfinite(array)] for name, array in arrays.items()}


def _row(
    name: str,
    scene: Scene,
    seconds: dict[str, NDArray[np.float64]],
    error: tuple[float, int],
    compared: int,
    engine: Engine,
) -> SceneCost:
    plan, own, whole = scene.plan.explain(), seconds[name], seconds[WHOLE]
    p50, p99 = (1e6 * float(np.percentile(own, p)) for p in (50, 99))
    return SceneCost(
        case=name,
        device=engine.device,
        p50_us=p50,
        p99_us=p99,
        share=float(np.median(own / whole)),
        saved_us=1e6 * float(np.median(whole - own)),
        launch_us=1e6 * seconds_of_launch(engine, plan),
        ops=plan.ops,
        channels=len(plan.channels_read),
        maps=len(plan.maps_read_back),
        bytes_in=plan.bytes_in,
        bytes_out=plan.bytes_out,
        frames=len(own),
        error=error[0],
        flips=error[1],
        compared=compared,
    )
