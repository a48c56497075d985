"""What is left out, as time: scenes that want one thing beside the scene that wants everything."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cnnum.bench.latency import seconds_of_launch
from cnnum.engine import Engine
from cnnum.frame import Frame
from cnnum.pipeline import Scene, load_scene
from cnnum.scene import read_scene

WHOLE = "tactile"
"""The scene that wants everything; its array gives the frames of all."""

SCENES = ("contact", "edges", "localize", "slip", "twist", WHOLE)

OMISSIONS = (
    "reading the frame from its driver: the time is from a frame in host memory to its events",
    "the array of 'localize', a bumpy cover: all scenes are given the frames of 'tactile'",
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
        That run, are read, and are read back.
    bytes_in, bytes_out : int
        To the device and back.
    frames : int
        Measured.
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


def measure_scenes(engine: Engine, *, rounds: int = 8) -> list[SceneCost]:
    """Return a row a scene; every frame goes through all of them before the next one comes.

    Parameters
    ----------
    engine : Engine
        On an OpenCL device.
    rounds : int
        Times that the frames of the scene's script are run.
    """
    opened = {
        name: load_scene(WHOLE, engine=engine, changes={"wants": list(read_scene(name).wants)})
        for name in SCENES
    }
    with opened[WHOLE].driver as driver:
        frames = list(driver.frames())
    seconds = _seconds(opened, frames * rounds)
    return [_row(name, opened[name], seconds, engine) for name in SCENES]


def _seconds(opened: dict[str, Scene], frames: list[Frame]) -> dict[str, NDArray[np.float64]]:
    """Return (frames,) s by scene, of frames that run."""
    ways = {name: scene.way() for name, scene in opened.items()}
    taken: dict[str, list[float]] = {name: [] for name in opened}
    order = list(ways)
    for number, frame in enumerate(frames):
        # another one goes first every time: it finds the caches as the whole scene left them
        order.append(order.pop(0))
        for name in order:
            moment = ways[name].step(number, frame)
            taken[name].append(moment.seconds if moment.values is not None else np.nan)
    return {name: np.array(found)[np.isfinite(found)] for name, found in taken.items()}


def _row(
    name: str, scene: Scene, seconds: dict[str, NDArray[np.float64]], engine: Engine
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
    )
