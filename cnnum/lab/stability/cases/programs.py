"""Programs of the cover and of streams, at the ends of their ranges."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from cnnum.arrays import Floats
from cnnum.engine import Engine
from cnnum.integrators.schemes import CHEBYSHEV
from cnnum.lab.stability.record import Case, Family, Solved
from cnnum.programs import program
from cnnum.programs.fields import Field
from cnnum.programs.library import get_program
from cnnum.programs.machine import FrameFields
from cnnum.scenes.pipeline import load_scene
from cnnum.templating.checks.tactile.halfspace import block_displacement, cover_stress, on_plane

SHAPE = (8, 8)
YEARS = 10.0 * 365.25 * 86400.0
"""Ten of them, in seconds."""

AXES = ("xz", "yz", "zz")
SLABS = 6


def cases() -> Iterator[Case]:
    """Return the cases of programs."""
    for depth in (1e-6, 1e-3, 0.1, 1e3):
        yield _cover(depth)
    for layers in (12, 64, 256):
        yield _stack(layers)
    for poisson in (0.0, 0.3, 0.49, 0.499, 0.4999, 0.5):
        yield _block(poisson)
        yield _relaxing_block(poisson)
    yield _rim_load()
    for frames in (1_000, 50_000, 1_000_000):
        yield _leaky_stream(frames)
    yield _counter()
    yield _after_years()
    for name, load in (("no-load", 0.0), ("one-taxel", 1.0), ("one-taxel-tiny", 1e-30)):
        yield _sparse_contact(name, load)


def _load() -> Floats:
    return np.random.default_rng(7).normal(size=(*SHAPE, 3))


def _fields(
    engine: Engine, name: str, wanted: Sequence[str], options: Mapping[str, object]
) -> Floats:
    bound = get_program(name).bind(**options)
    out = engine.compile(bound, SHAPE, wanted)(_load())
    return np.stack([np.asarray(out[field], dtype=np.float64) for field in wanted], axis=-1)


def _case(
    name: str,
    family: Family,
    title: str,
    run: tuple[str, Sequence[str], Mapping[str, object]],
    truth: Floats,
    share: tuple[float, float],
    reason: str,
    refusal: str = "",
    slow: str = "",
) -> Case:
    size = float(np.abs(truth).max(initial=1e-300))

    def solve(engine: Engine) -> Solved:
        return Solved(_fields(engine, *run) / size)

    return Case(name, family, title, solve, lambda: truth / size, *share, reason, refusal, slow)


def _cover(depth: float) -> Case:
    """Stress at a depth from nothing to far more than the array, in pitches of 1 mm."""
    wanted = [f"stress_{axis}" for axis in AXES]
    options = {"thickness": depth * 1e-3, "pitch": 1e-3}
    return _case(
        f"cover-depth-{depth:g}",
        "extreme",
        f"stress under a cover that is {depth:g} pitches thick",
        ("halfspace_stress", wanted, options),
        cover_stress(_load(), depth),
        (1e-4, 1e-4),
        "the read-out of the waves, as a share of the largest stress",
        r"thickness|depth",
    )


def _rim_load() -> Case:
    """Loads on the outermost taxels alone, half of whose field lies beyond the array."""
    load = _load()
    load[1:-1, 1:-1] = 0.0
    truth = cover_stress(load, 1.0)
    size = float(np.abs(truth).max())

    def solve(engine: Engine) -> Solved:
        bound = get_program("halfspace_stress").bind(thickness=1e-3, pitch=1e-3)
        wanted = [f"stress_{axis}" for axis in AXES]
        out = engine.compile(bound, SHAPE, wanted)(load)
        result = np.stack([np.asarray(out[name], dtype=np.float64) for name in wanted], axis=-1)
        return Solved(result / size)

    return Case(
        "cover-rim-load",
        "extreme",
        "stress under loads on the rim of the array alone",
        solve,
        lambda: truth / size,
        1e-4,
        1e-4,
        "the read-out of the waves, as a share of the largest stress",
    )


def _stack(layers: int) -> Case:
    wanted = [f"stress_{axis}" for axis in AXES]
    return _case(
        f"depth-stack-{layers}",
        "stiff",
        f"a cover as {layers} layers of depth at rest",
        ("halfspace_layers", wanted, {"thickness": 1e-3, "pitch": 1.5e-3, "layers": layers}),
        cover_stress(_load(), 1.0 / 1.5),
        (2e-4, 2e-5),
        "slabs as thin as this leave 1e-5; single precision adds roundings of the stack",
        slow="its layers relax there without the modes that others use, which takes minutes",
    )


def _block(poisson: float) -> Case:
    """An elastic block at rest; the volume's stiffness grows without bound as ν nears 1/2."""
    return _case(
        f"elastic-block-{poisson:g}",
        "stiff",
        f"a block with Poisson's ratio {poisson:g} at rest",
        _of_block(poisson),
        _at_rest(poisson),
        (1e-5, 1e-10),
        "sums of 192 products in single precision; a solve whose condition is 1/(1 − 2ν) in double",
        r"Poisson|poisson",
        "it relaxes there by explicit steps, which takes minutes",
    )


def _relaxing_block(poisson: float) -> Case:
    """The same, relaxed: the time it takes grows as its stiffness."""
    return _case(
        f"relaxing-block-{poisson:g}",
        "stiff",
        f"a block with Poisson's ratio {poisson:g} relaxes to equilibrium",
        _of_block(poisson, method=CHEBYSHEV),
        _at_rest(poisson),
        (1e-2, 1e-2),
        "twice the 5e-3 that the program leaves to come",
        r"Poisson|poisson|did not reach",
        "explicit steps of such a block take minutes there",
    )


def _of_block(poisson: float, **options: object) -> tuple[str, list[str], dict[str, object]]:
    sizes = {"thickness": 2.0e-3, "pitch": 1.0e-3, "slabs": SLABS, "match": False}
    cover = {"poisson": poisson, "youngs_modulus": 2.0e-3 * (1.0 + poisson)}
    wanted = [f"displacement_{axis}" for axis in "xyz"]
    return "halfspace_equilibrium", wanted, {**sizes, **cover, **options}


def _at_rest(poisson: float) -> Floats:
    return on_plane(block_displacement(_load(), SLABS, 1.0, min(poisson, 0.4999)), 2)


@program
def _remembering(frame: FrameFields) -> Mapping[str, Field]:
    """A leaky mean over some hundred frames."""
    memory = frame.memory()
    now = memory.value + 0.01 * (frame.normal - memory.value)
    memory.store(now)
    return {"mean": now}


@program
def _counting(frame: FrameFields) -> Mapping[str, Field]:
    """Frames since the start."""
    memory = frame.memory(scalar=True)
    memory.store(memory.value + 1.0)
    return {"count": memory.value + 1.0}


def _leaky_stream(frames: int) -> Case:
    """A leaky mean forgets its roundings: it does not drift however long the stream."""

    def solve(engine: Engine) -> Solved:
        plan = engine.compile(_remembering, SHAPE)
        stream, out = plan.stream(), {}
        # one channel is read
        frame = np.full((*SHAPE, 1), 0.7, dtype=engine.precision)
        for _ in range(frames):
            out = stream.push_read(frame, 0.7)
        return Solved(np.asarray(out["mean"], dtype=np.float64))

    left = 0.99**frames
    return Case(
        f"stream-of-{frames}",
        "precision",
        f"a leaky mean over {frames} frames",
        solve,
        lambda: np.full(SHAPE, 0.7 * (1.0 - left)),
        2.0**-24 / 0.01,
        2.0**-52 / 0.01,
        "one rounding per frame, over the leak of 0.01",
        slow="it takes minutes there" if frames > 100_000 else "",
        patience=6e-4 * frames,
    )


def _counter() -> Case:
    """A count in single precision is exact up to 2²⁴ frames."""

    def solve(engine: Engine) -> Solved:
        stream, count = engine.compile(_counting, SHAPE).stream(), 0.0
        frame = np.zeros((*SHAPE, 3))
        for _ in range(20_000):
            count = float(stream.push(frame)["count"])
        return Solved(np.array(count))

    return Case(
        "frame-counter",
        "precision",
        "a memory that counts 20,000 frames",
        solve,
        lambda: np.array(20_000.0),
        0.0,
        0.0,
        "whole numbers are exact up to 2²⁴",
    )


def _sparse_contact(name: str, load: float) -> Case:
    """The number of contacts where at most one taxel feels a load."""

    def solve(engine: Engine) -> Solved:
        plan = engine.compile(
            get_program("contact").bind(rate=200.0), SHAPE, ["contact", "contact_area"]
        )
        stream, out = plan.stream(), {}
        frame = np.zeros((*SHAPE, 3))
        for number in range(20):
            frame[3, 4, 2] = -load if number >= 10 else 0.0
            out = stream.push(frame)
        numbers = [np.asarray(out["contact"]).ravel(), np.asarray(out["contact_area"]).ravel()]
        return Solved(np.isfinite(np.concatenate(numbers).astype(np.float64)).astype(np.float64))

    return Case(
        name,
        "extreme",
        "contact and its area where at most one taxel feels a load",
        solve,
        lambda: np.ones(2),
        0.0,
        0.0,
        "every number is finite",
    )


def _after_years() -> Case:
    """Frames with times and numbers of ten years of 1 kHz: the same events as from 0."""

    def solve(engine: Engine) -> Solved:
        return Solved(_times(engine, YEARS, 1000 * int(YEARS)) - YEARS)

    return Case(
        "years-of-frames",
        "extreme",
        "a press after ten years of frames: times of its events",
        solve,
        lambda: _times(Engine("reference"), 0.0, 0),
        # the spacing of double precision at ten years of seconds
        6e-8,
        6e-8,
        "the spacing of times of ten years, in seconds",
    )


def _times(engine: Engine, later: float, number: int) -> Floats:
    """Return the times of the events of a press whose frames begin then, with that number."""
    press = [{"kind": "press", "load": 1.0, "duration": 0.2}]
    scene = load_scene("contact", engine=engine, changes={"array.script": press})
    way, result = scene.path(), list[float]()
    with scene.driver:
        for place, frame in enumerate(scene.driver.frames()):
            moved = replace(frame, time=frame.time + later, sequence=frame.sequence + number)
            result += [event.time for event in way.step(place + number, moved).events]
    return np.array(result)
