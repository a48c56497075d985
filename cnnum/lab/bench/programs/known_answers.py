"""Frames of which the right answer is known in the continuum, by program and by number of cells.

The same bodies on the same skin are read by more or fewer taxels, or the same course in time by
more or fewer frames. Whatever differs then is the discretisation's. No truth is made by the program
that is judged: tractions are Love's, Hertz's and Mindlin's, courses in time are exponentials of
small matrices.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.fft import dctn, idctn
from scipy.linalg import expm
from scipy.spatial import cKDTree

from cnnum.arrays import Floats
from cnnum.drivers.simulated.array import SimulatedOptions
from cnnum.drivers.simulated.settings import Phase
from cnnum.lab.bench.programs.contact_errors import NOISE, held
from cnnum.lab.bench.programs.edge_errors import Skin, found_places, off_outline
from cnnum.lab.bench.programs.edge_scenes import SHARP
from cnnum.lab.bench.programs.halfspace_runs import MODULUS, PITCH
from cnnum.programs import Program
from cnnum.programs.library import get_program
from cnnum.tactile.indenters import Disc, Touch, drawn, frame_under, readings
from cnnum.templating.checks.program_run import RATE

Outputs = Mapping[str, Floats]
"""Of all frames: (frames, streams, …)."""

SIDE = 8
"""Taxels a side of the skin in whose pitches bodies are drawn."""

MM = 1e3 * PITCH
"""Of such a pitch."""


@dataclass(frozen=True, slots=True)
class KnownAnswer:
    """A program, frames, and how far outputs are from what is true of them.

    Attributes
    ----------
    name : str
    truth : str
        What it is compared with, and its noise.
    knob : str
    setting : float
    program : Program
        With all of its parameters.
    frames : (frames, streams, rows, cols, 3) float
    needs : tuple of str
    off : callable
        Errors of outputs, one or more a stream: against the truth; or, with outputs of another run,
        against those.
    """

    name: str
    truth: str
    knob: str
    setting: float
    program: Program
    frames: Floats
    needs: tuple[str, ...]
    off: Callable[[Outputs, Outputs | None], Floats]


def _off_values(
    values: Callable[[Outputs], Floats], true: Floats, scale: Floats | float,
    got: Outputs, other: Outputs | None,
) -> Floats:  # fmt: skip
    """Return how far values are from true ones, or from those of another run, as shares."""
    goal = true if other is None else values(other)
    return np.asarray(np.abs(values(got) - goal) / scale)


def _last(name: str, outputs: Outputs) -> Floats:
    return np.asarray(outputs[name][-1], dtype=np.float64)


def contact(side: int, count: int) -> KnownAnswer:
    """Return the normal load of spheres, pulled, with noise: 1 of each."""
    size = side / SIDE
    touches = drawn(np.random.default_rng(1), (1.0 * size, 2.0 * size), side, count)
    frames = held([readings(touch, side, 0.75 * size, "strain") for touch in touches])
    program = get_program("contact").bind(rate=RATE, depth=0.75 * size, reads="strain")
    off = partial(_off_values, partial(_last, "load_normal"), np.ones(count), 1.0)
    truth = "loads of spheres, 2.5 mV of noise"
    return KnownAnswer(
        "contact", truth, "taxels a side", side, program, frames, ("load_normal",), off
    )


def body_fit(side: int, count: int) -> KnownAnswer:
    """Return the radius of Hertz's contacts, with noise; only what is reported counts."""
    size, rng = side / SIDE, np.random.default_rng(11)
    radii, places = size * rng.uniform(2.0, 3.0, count), size * rng.uniform(-0.5, 0.5, (count, 2))
    discs = [
        Disc(float(radius), (float(x), float(y)), "hertz")
        for radius, (x, y) in zip(radii, places, strict=True)
    ]
    loads = np.stack([frame_under(disc, (side, side), 0.5 * size, "strain") for disc in discs])
    frames = held([np.stack([0.0 * load, 0.0 * load, -load], axis=-1) for load in loads])
    program = get_program("body_fit").bind(rate=RATE, depth=0.5 * size, reads="strain")

    def reported(outputs: Outputs) -> Floats:
        return np.where(outputs["sphere_fits"][-1] > 0.5, outputs["contact_radius"][-1], np.nan)

    needs = ("sphere_fits", "contact_radius")
    off = partial(_off_values, reported, radii, radii)
    truth = "radii of spheres, 2.5 mV of noise"
    return KnownAnswer("body_fit", truth, "taxels a side", side, program, frames, needs, off)


def mindlin_slip(side: int, count: int) -> KnownAnswer:
    """Return the share of the radius that sticks, (1 − Q/μP)^⅓, of spheres that are pulled."""
    size = side / SIDE
    touches = drawn(np.random.default_rng(2), (2.2 * size, 3.0 * size), side, count)
    seen = np.stack([readings(touch, side, 0.5 * size, "strain") for touch in touches])
    noise = NOISE * np.abs(seen).max(axis=(1, 2, 3), keepdims=True)
    rest, frames = round(0.5 * RATE), round(0.3 * RATE)
    stream = noise * np.random.default_rng(3).normal(size=(rest + frames, *seen.shape))
    stream[rest:] += seen
    program = get_program("mindlin_slip").bind(
        rate=RATE, depth=0.5 * size, reads="strain", friction=touches[0].friction
    )

    def reported(outputs: Outputs) -> Floats:
        return np.where(outputs["mindlin_holds"][-1] > 0.5, outputs["stick_share"][-1], np.nan)

    off = partial(_off_values, reported, np.array([_sticks(touch) for touch in touches]), 1.0)
    needs, truth = ("mindlin_holds", "stick_share"), "Mindlin's c/a of pulled spheres, 2.5 mV"
    return KnownAnswer("mindlin_slip", truth, "taxels a side", side, program, stream, needs, off)


def _sticks(touch: Touch) -> float:
    return float((1.0 - touch.pull / touch.friction) ** (1.0 / 3.0))


PUNCHES = ("square punch, turned", "bar", "triangle")
"""Kinds of bodies on which no constant of `edges` was chosen."""


def outlines(name: str, side: int, count: int) -> KnownAnswer:
    """Return the outlines of flat punches, of `edges` or `edge_enhancement`: distances in mm."""
    size, rng = side / SIDE, np.random.default_rng(7)
    skin = Skin(cells=side, depth=0.5 * size)
    punches = [SHARP[kind](rng, side, count) for kind in PUNCHES]
    bodies = [body for punch in punches for body in punch.outlines]
    loads = np.concatenate([punch.frames(side, skin.depth, skin.reads) for punch in punches])
    stream = -skin.stream(loads)
    frames = np.stack([0.0 * stream, 0.0 * stream, stream], axis=-1)
    known: dict[str, object] = {"depth": skin.depth, "reads": skin.reads} if name == "edges" else {}

    def places(outputs: Outputs) -> list[Floats]:
        pairs = zip(outputs["edge_to_right"][-1], outputs["edge_to_below"][-1], strict=True)
        return [found_places(right, below) for right, below in pairs]

    def off(got: Outputs, other: Outputs | None) -> Floats:
        cells = places(got)
        if other is None:
            far = [off_outline(b, cell, side) for b, cell in zip(bodies, cells, strict=True)]
        else:
            far = [_apart(a, b) for a, b in zip(cells, places(other), strict=True)]
        return np.concatenate(far) * MM / size

    program, needs = get_program(name).bind(rate=RATE, **known), ("edge_to_right", "edge_to_below")
    truth = "outlines of flat punches, mm"
    return KnownAnswer(name, truth, "taxels a side", side, program, frames, needs, off)


def _apart(some: Floats, others: Floats) -> Floats:
    """Return the way from each place to the next one of the others, and the other way round."""
    if not (len(some) and len(others)):
        return np.full(len(some) + len(others), np.inf)
    ways = [cKDTree(a).query(b)[0] for a, b in ((some, others), (others, some))]
    return np.concatenate([np.asarray(way, np.float64) for way in ways])


def active_contour(side: int, count: int) -> KnownAnswer:
    """Return the area within the contour of round flat punches, with 1 % of noise."""
    size, rng = side / SIDE, np.random.default_rng(5)
    discs = [
        Disc(size * float(rng.uniform(1.6, 2.8)), _near_middle(rng, size), "punch")
        for _ in range(count)
    ]
    skin = Skin(cells=side, depth=0.5 * size)
    loads = [frame_under(disc, (side, side), skin.depth, skin.reads) for disc in discs]
    stream = -skin.stream(np.stack(loads))
    frames = np.concatenate([stream, np.repeat(stream[-1:], 3 * side, axis=0)])
    frames = np.stack([0.0 * frames, 0.0 * frames, frames], axis=-1)
    program = get_program("active_contour").bind(rate=RATE, depth=skin.depth, reads=skin.reads)
    areas = np.pi * np.array([disc.radius for disc in discs]) ** 2
    off = partial(_off_values, partial(_last, "contour_area"), areas, areas)
    truth = "areas of round punches, 1 % of noise"
    return KnownAnswer(
        "active_contour", truth, "taxels a side", side, program, frames, ("contour_area",), off
    )


def _near_middle(rng: np.random.Generator, size: float) -> tuple[float, float]:
    x, y = size * rng.uniform(-0.5, 0.5, 2)
    return float(x), float(y)


RUBBED = (
    Phase("hold", 0.3),
    Phase("press", 0.2, load=0.1),
    Phase("pull", 0.7, speed=2e-3, direction=0.5),
)
BUMP, FRICTION = 0.2e-3, 0.6
"""Radius of the bumps, m, and thickness of the rubber below them; the friction of the sphere."""


def bumps(side: int) -> Iterator[KnownAnswer]:
    """Yield the load that bumps bear under a sphere that slides, and its friction."""
    options = SimulatedOptions(
        script=RUBBED, shape=(side, side), cover="bumpy", bump_radius=BUMP, thickness=BUMP,
        friction=FRICTION,
    )  # fmt: skip
    with options.open() as array:
        frames = list(array.frames())
        strain = array.calibration.to_strain(np.stack([frame.values for frame in frames]))
    truth = frames[-1].truth
    load = truth["normal_force"] if truth is not None else np.nan
    cases: dict[str, tuple[str, float, dict[str, object]]] = {
        "localize": ("bump_normal", load, {"unit": MODULUS * BUMP**2}),
        "texture": ("friction", FRICTION, {"window": 32, "taxels": "strain"}),
    }
    for name, (output, true, known) in cases.items():
        off = partial(_off_values, partial(_last, output), np.array([true]), true)
        yield KnownAnswer(
            name, "a sphere that slides over bumps", "taxels a side", side,
            get_program(name).bind(rate=RATE, **known), np.asarray(strain)[:, np.newaxis],
            (output,), off,
        )  # fmt: skip


SPEEDS = (-2.0, 1.0, 3.0)
"""Speeds of gratings, taxels per second."""


def tactile_flow(taxels: int) -> KnownAnswer:
    """Return the speed of gratings ω/k that drift along x, with so many taxels a wave."""
    k, shape = 2.0 * np.pi / taxels, (4, 16)
    program = get_program("tactile_flow").bind(rate=RATE, rest=0.05, push=1.0)
    off = partial(_off_values, partial(_last, "flow_map_x"), _spread(SPEEDS), 3.0)
    frames = _gratings(k, RATE, shape, seconds=0.7)
    return KnownAnswer("tactile_flow", "v = −u_t/u_x of gratings", "taxels a wave", taxels,
                       program, frames, ("flow_map_x",), _inside(off))  # fmt: skip


def motion_direction(rate: float) -> KnownAnswer:
    """Return the correlation A² sin k · ωτ / (1 + ω²τ²) of gratings of six taxels, A = 1."""
    k, delay = 2.0 * np.pi / 6.0, 0.1
    late = k * np.array(SPEEDS) * delay
    true = _spread(np.sin(k) * late / (1.0 + late**2))
    program = get_program("motion_direction").bind(
        rate=rate, rest=0.05, push=1.0, delay=delay, contrast=False
    )
    off = partial(_off_values, partial(_last, "motion_map_x"), true, float(np.abs(true).max()))
    frames = _gratings(k, rate, (4, 16), seconds=2.0)
    truth = "R = sin k ωτ/(1 + ω²τ²) of gratings"
    return KnownAnswer("motion_direction", truth, "frames a second", rate, program, frames,
                       ("motion_map_x",), _inside(off))  # fmt: skip


def _spread(values: Sequence[float] | Floats) -> Floats:
    return np.asarray(values, np.float64)[:, np.newaxis, np.newaxis]


def _inside(
    off: Callable[[Outputs, Outputs | None], Floats], rim: int = 2
) -> Callable[[Outputs, Outputs | None], Floats]:
    """Return errors of maps but for the rim, where a slope has no neighbours."""
    return lambda got, other: off(got, other)[..., rim:-rim]


def _gratings(k: float, rate: float, shape: tuple[int, int], seconds: float) -> Floats:
    """Return a grating a stream, after a rest."""
    rest, time = 10, np.arange(round(seconds * rate))[:, None, None, None] / rate
    signal = np.cos(k * (np.arange(shape[1]) - _spread(SPEEDS) * time)) + np.zeros((shape[0], 1))
    frames = np.zeros((rest + len(signal), len(SPEEDS), *shape, 3))
    frames[rest:, ..., 2] = signal
    return frames


CHAINS = {"sa1": (0, 1.0, 15.0), "ra1": (1, 20.0, 50.0), "pc": (2, 60.0, 400.0)}
"""High-passes of a channel, their corner and that of its low-pass, Hz: Table 2.I."""

WIDTHS = {"sa1": 2.0, "ra1": 2.5}
"""Of the fields that an array of 12 mm holds, mm (Table 2.I)."""

RISE, HELD = 0.2, 0.1
"""s in which a push rises as (1 − cos)/2, and for which it is held."""

BELL = 1.2
"""Standard deviation of the push over the skin, mm."""

QUIET = 0.4
"""s before it."""


def receptors_in_time(rate: float) -> KnownAnswer:
    """Return three channels of a taxel under a push that rises smoothly, by rates."""
    time = np.arange(round((QUIET + RISE + HELD) * rate) + 1) / rate - QUIET
    frames = np.zeros((time.size, 1, 1, 1, 3))
    frames[:, 0, 0, 0, 2] = _push(time)
    true = {name: _chain(time, *chain) for name, chain in CHAINS.items()}
    fields = dict.fromkeys(("sa1_field", "ra1_field", "pc_field", "sa2_field"), 0.0)
    program = get_program("receptors").bind(rate=rate, rest=QUIET, push=1.0, **fields)

    def off(got: Outputs, other: Outputs | None) -> Floats:
        goal = true if other is None else {name: other[name][:, 0, 0, 0] for name in true}
        return np.array([
            np.abs(got[name][:, 0, 0, 0] - goal[name]).max() / np.abs(true[name]).max()
            for name in true
        ])  # fmt: skip

    truth = "a push that rises in 0.2 s, SA-I, RA-I and PC"
    return KnownAnswer("receptors", truth, "frames a second", rate, program, frames,
                       tuple(true), off)  # fmt: skip


def receptors_in_space(side: int) -> KnownAnswer:
    """Return the fields of SA-I and RA-I under a bell of a push, by taxels."""
    rate, pitch = 200.0, MM * SIDE / side
    time = np.arange(round((QUIET + RISE + HELD) * rate) + 1) / rate - QUIET
    place = (np.arange(side) - (side - 1) / 2) * pitch
    away = place[:, None] ** 2 + place**2
    course = _push(time)
    frames = np.zeros((time.size, 1, side, side, 3))
    frames[:, 0, ..., 2] = course[:, None, None] * np.exp(-away / (2.0 * BELL**2))
    widths: dict[str, object] = {f"{name}_field": width / pitch for name, width in WIDTHS.items()}
    program = get_program("receptors").bind(rate=rate, rest=QUIET, push=1.0, **widths)
    spread = {name: width**2 / (8.0 * np.log(2.0)) for name, width in WIDTHS.items()}
    # a bell through a bell is a bell
    true = {
        name: _chain(time, *CHAINS[name])[:, None, None]
        * BELL**2 / (BELL**2 + spread[name]) * np.exp(-away / (2.0 * (BELL**2 + spread[name])))
        for name in WIDTHS
    }  # fmt: skip

    def off(got: Outputs, other: Outputs | None) -> Floats:
        goal = true if other is None else {name: other[name][:, 0] for name in true}
        return np.array([
            np.abs(got[name][:, 0] - goal[name]).max() / np.abs(true[name]).max() for name in true
        ])  # fmt: skip

    truth = "a bell of a push, fields of SA-I and RA-I"
    return KnownAnswer("receptors", truth, "taxels a side", side, program, frames,
                       tuple(true), off)  # fmt: skip


def on_off(rate: float) -> KnownAnswer:
    """Return both answers under pushes that rise smoothly, wave by wave."""
    shape, (receptor, surround, adapting) = (6, 6), (0.01, 0.03, 0.1)
    size = np.random.default_rng(9).uniform(0.0, 1.0, shape)
    time = np.arange(round((QUIET + RISE + HELD) * rate) + 1) / rate - QUIET
    waves = dctn(size, norm="ortho")
    rows, cols = (-4.0 * np.sin(0.5 * np.pi * np.arange(n) / n) ** 2 for n in shape)
    answers = np.zeros((2, time.size, *shape))
    for at in np.ndindex(shape):
        rate_near, rate_far = (1.0 - width * (rows[at[0]] + cols[at[1]]) for width in (0.25, 2.0))
        matrix = np.array([
            [-rate_near / receptor, 0.0, 0.0],
            [1.0 / surround, -rate_far / surround, 0.0],
            [1.0 / adapting, -1.0 / adapting, -1.0 / adapting],
        ])  # fmt: skip
        near, far, late = _course(time, matrix, np.array([1.0 / receptor, 0.0, 0.0]))[:, 1:].T
        answers[(slice(None), slice(None), *at)] = waves[at] * np.array(
            [near - far, near - far - late]
        )
    true = dict(
        zip(("sustained", "transient"), idctn(answers, axes=(2, 3), norm="ortho"), strict=True)
    )
    frames = np.zeros((time.size, 1, *shape, 3))
    frames[:, 0, ..., 2] = _push(time)[:, None, None] * size
    program = get_program("on_off").bind(rate=rate, rest=QUIET, push=1.0)

    def answer(outputs: Outputs, name: str) -> Floats:
        return outputs[f"on_{name}"][:, 0] - outputs[f"off_{name}"][:, 0]

    def off(got: Outputs, other: Outputs | None) -> Floats:
        return np.array([
            np.abs(answer(got, name) - (wanted if other is None else answer(other, name))).max()
            / np.abs(wanted).max()
            for name, wanted in true.items()
        ])  # fmt: skip

    needs = tuple(f"{sign}_{name}" for name in true for sign in ("on", "off"))
    truth = "pushes that rise in 0.2 s, wave by wave"
    return KnownAnswer("on_off", truth, "frames a second", rate, program, frames, needs, off)


def _push(time: Floats) -> Floats:
    return _course(time, np.zeros((0, 0)), np.zeros(0))[:, 0]


def _chain(time: Floats, stages: int, slow: float, quick: float) -> Floats:
    """Return a channel's answer to the push: high-passes in a row, then a low-pass."""
    a, b = 2.0 * np.pi * slow, 2.0 * np.pi * quick
    count = stages + 1
    matrix, drive = np.zeros((count, count)), np.zeros(count)
    # what has passed the stages so far: the push less the slow cells before
    for n in range(stages):
        matrix[n, : n + 1], drive[n] = -a, a
    matrix[stages, :stages], matrix[stages, stages], drive[stages] = -b, -b, b
    return _course(time, matrix, drive)[:, -1]


def _course(time: Floats, matrix: Floats, drive: Floats) -> Floats:
    """Return the push and the cells x' = matrix x + drive · push, at times from its start.

    The push is (1 − cos(πt/RISE))/2, and 1 after `RISE`: an oscillator and a constant, beside the
    cells. An exponential of the whole is exact over any step.
    """
    n, w = len(drive), np.pi / RISE
    rising = np.zeros((n + 3, n + 3))  # push, its slope over w, half of 1, cells
    rising[0, 1], rising[1, 0], rising[1, 2] = w, -w, w
    rising[3:, 0], rising[3:, 3:] = drive, matrix
    resting = rising.copy()
    resting[:2] = 0.0
    start = np.zeros(n + 3)
    start[2] = 0.5
    step = time[1] - time[0]
    rises, rests = (np.asarray(expm(rates * step), np.float64) for rates in (rising, resting))
    states = [start]
    # one after another: `RISE` is a whole number of steps
    for before in time[:-1]:
        on = before > -0.5 * step
        over = before > RISE - 0.5 * step
        states.append((rests if over else rises) @ states[-1] if on else start)
    return np.array(states)[:, [0, *range(3, n + 3)]]
