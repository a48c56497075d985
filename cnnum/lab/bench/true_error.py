"""The error that a user has, over run time: against the continuum, and against what was touched.

A lattice that is solved exactly is still not the continuum. So the total error is shown, with its
two parts: that of the lattice's own exact answer (discretisation), and how far the run is from that
answer (arithmetic). The knob is the number of cells. Programs that report events have a delay and
misses in its place, and the frames a second for a knob.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from math import nan

import numpy as np

from cnnum.arrays import Floats
from cnnum.drivers.simulated.array import SimulatedOptions
from cnnum.drivers.simulated.script import Phase
from cnnum.engine import Engine
from cnnum.errors import MethodError
from cnnum.frame import FORCE_AXES
from cnnum.lab.bench.programs.contact_errors import errors, held
from cnnum.lab.bench.programs.edge_errors import Skin, by_enhancement, by_program, tally
from cnnum.lab.bench.programs.edge_scenes import SHARP
from cnnum.lab.bench.programs.halfspace_runs import (
    MODULUS,
    PITCH,
    TAXELS,
    mirrored_patch,
    opposite_pushes,
)
from cnnum.lab.bench.programs.load_errors import measure
from cnnum.lab.bench.timing import Timing, timed
from cnnum.plan import Plan
from cnnum.programs import Program
from cnnum.programs.library import get_program
from cnnum.tactile.indenters import Disc, frame_under
from cnnum.tactile.touches import drawn, readings
from cnnum.templating.checks.program_run import RATE
from cnnum.templating.checks.tactile.lattice_cover import cover_stress

AXES = ("xz", "yz", "zz")
THICKNESS = 1.0e-3
"""Of the cover over taxels 1.5 mm apart, m."""

CELLS, FEW = (1, 2, 4, 8), (1, 2)
"""A taxel, along each axis; programs of many layers take no more than two."""

PRECISIONS = ("float32", "float64")
BUDGET_S = 0.4
"""s after which no further run of a point begins."""

RATES = (50.0, 100.0, 200.0)
"""Frames a second."""

TRIALS = 8
LATE = 0.5
"""s after which a report no longer belongs to what happened."""

OMISSIONS = (
    "Bumps of localize and texture are simulated by the finite elements that they invert. "
    "Rows show noise and neighbours. `tests/tactile/test_texture_program.py` has another mesh.",
    "edges and edge_enhancement are of one skin and three kinds of punches; all are in tables of "
    "`python -m cnnum.lab.bench.programs.edge_errors`, and those of body_fit in `body_errors`.",
    "grasp_code is a code of signs, which is right or wrong: `cnnum templates check grasp_code`. "
    "tactile is made of the others. mindlin_slip takes the law that the simulated sphere obeys: "
    "`python docs/figures/incipient_slip.py` has its delays. receptors and on_off are filters in "
    "time, and tactile_flow and motion_direction compare frames in time, without a lattice that "
    "stands for a continuum, and active_contour moves a wave of cells: "
    "`cnnum templates check NAME`.",
    "halfspace_layers and halfspace_equilibrium stop at two cells: beyond, one takes minutes to "
    "build and the other relaxes for seconds.",
    "The cover of the half-space programs is 1 mm over taxels 1.5 mm apart, with one value a cell. "
    "Loads go on mirrored beyond the rim, for the program and for the truth.",
)
"""What no row shows, and why."""


@dataclass(frozen=True, slots=True)
class TrueError:
    """A program at one setting: how far from the truth, and at what cost.

    Attributes
    ----------
    case : str
        The program.
    truth : str
        What it is compared with.
    knob : str
        What is set: "cells", "rounds", "taxels a side", "frames a second".
    setting : float
    engine, precision, method : str
    error : float
        The total error, as a share, and of edges in pitches; NaN where the answer is an event.
    discretisation, arithmetic : float
        Its parts: the exact answer on the lattice against the truth, and the run against that.
        NaN where they cannot be told apart.
    delay_s : float
        Median from what happened to its report; NaN where the answer is a field.
    missed : float
        Share of what happened that was not reported within half a second.
    too_early : float
        Share of trials with a report before anything happened.
    seconds, spread : float
        Of one frame; of one second of touch where the knob is the frames a second.
    """

    case: str
    truth: str
    knob: str
    setting: float
    engine: str
    precision: str
    method: str
    error: float
    discretisation: float
    arithmetic: float
    delay_s: float
    missed: float
    too_early: float
    seconds: float
    spread: float


def measure_true_error(device: str | None, *, quick: bool = False) -> Iterator[TrueError | str]:
    """Yield the rows of every program that has a truth, and a sentence for each that is left out.

    Parameters
    ----------
    device : str, optional
        Part of the OpenCL device's name.
    quick : bool
        Fewer cells, trials and one precision.
    """
    precisions = PRECISIONS[:1] if quick else PRECISIONS
    engines = [Engine("opencl", device=device, precision=p) for p in precisions]
    exact = Engine("opencl", device=device, precision="float64")
    for engine in engines:
        for cells in CELLS[:3] if quick else CELLS:
            for name in ("halfspace_stress", "halfspace_strain"):
                yield _under_patches(engine, exact, name, cells)
        for cells in FEW:
            yield _under_patches(engine, exact, "halfspace_layers", cells)
            yield _equilibrium(engine, exact, cells)
        for rounds in (0, 1, 2, 4):
            yield _surface_load(engine, rounds, count=20 if quick else 100)
        for side in (4, 8, 16):
            yield _contact(engine, side, count=8 if quick else 24)
        for side in (8, 16):
            for name in OUTLINES:
                yield _edges(engine, name, side, count=4 if quick else 20)
            yield _body_fit(engine, side, count=8 if quick else 40)
        for side in (4, 8):
            yield from _bumps(engine, side)
    trials = 2 if quick else TRIALS
    for rate in RATES[:2] if quick else RATES:
        for engine in engines:
            yield from _events(engine, rate, trials)
    if not quick:
        for method, step in (("euler", 0.1), ("heun", 0.1)):
            yield from _events(engines[0], RATES[1], trials, method, step)


def _row(case: str, truth: str, knob: str, setting: float, engine: Engine) -> TrueError:
    """Return a row without its numbers."""
    empty = (nan,) * 8
    return TrueError(case, truth, knob, setting, engine.name, engine.precision, "auto", *empty)


def _cost(row: TrueError, timing: Timing, frames: float = 1.0) -> TrueError:
    return replace(row, seconds=frames * timing.least, spread=frames * timing.spread)


def _split(row: TrueError, got: Floats, exact: Floats, truth: Floats) -> TrueError:
    """Return the row with the total error and its parts, as shares of the largest true value."""
    scale = float(np.abs(truth).max())
    return replace(
        row,
        error=float(np.abs(got - truth).max()) / scale,
        discretisation=float(np.abs(exact - truth).max()) / scale,
        arithmetic=float(np.abs(got - exact).max()) / scale,
    )


def _levelled(maps: Sequence[Floats]) -> Floats:
    """Return maps side by side without their means, which mirrored loads leave open."""
    return np.stack([each - each.mean((-2, -1), keepdims=True) for each in maps], axis=-1)


def _under_patches(engine: Engine, exact: Engine, name: str, cells: int) -> TrueError:
    """Return the row of stress or strain under a patch of 2×2 taxels that pulls or presses."""
    n = TAXELS * cells
    place = (np.arange(n, dtype=np.float64) + 0.5) * (PITCH / cells) - TAXELS * PITCH / 2
    inside = np.abs(place) < PITCH
    patch = (inside[:, None] & inside).astype(np.float64)
    frames = patch[..., None] * np.eye(3)[:, None, None, :]
    strain = name == "halfspace_strain"
    outputs = [f"{'strain' if strain else 'stress'}_{axis}" for axis in AXES]
    options: dict[str, object] = {"thickness": THICKNESS, "pitch": PITCH, "cells": cells}
    if strain:
        options["youngs_modulus"] = MODULUS
    if name == "halfspace_layers":
        options["layers"] = 2 * cells
    program = get_program(name).bind(**options)
    plan = engine.compile(program, (n, n), outputs)
    got = _levelled([plan(frames)[each] for each in outputs])
    truth = np.stack(
        [
            mirrored_patch(place, THICKNESS, axis, modulus=MODULUS if strain else None)
            for axis in range(3)
        ]
    )
    if name == "halfspace_stress":
        fields = np.stack([cover_stress(frame, THICKNESS / PITCH * cells) for frame in frames])
        own = _levelled([fields[..., k] for k in range(3)])
    else:
        fine = program if name == "halfspace_layers" else program.bind(tolerance=2e-9)
        lattice = exact.compile(fine, (n, n), outputs)(frames)
        own = _levelled([lattice[each] for each in outputs])
    row = _row(name, "Love and Cerruti, patches of 2×2 taxels", "cells", cells, engine)
    return _cost(_split(row, got, own, truth), _alone(plan, frames[0]))


def _alone(plan: Plan, frame: Floats) -> Timing:
    """Return the time of one frame, whose kernel is built before."""
    plan(frame)
    return timed(partial(plan, frame), budget=BUDGET_S)


def _equilibrium(engine: Engine, exact: Engine, cells: int, poisson: float = 0.3) -> TrueError:
    """Return the row of u_z in a block under a push and a pull, against (4.9) and its images."""
    n = 8 * cells
    load = np.zeros((n, n, 3))
    load[cells : 2 * cells, cells : 2 * cells, 2] = 1.0
    load[5 * cells : 6 * cells, 5 * cells : 6 * cells, 2] = -1.0
    program = get_program("halfspace_equilibrium").bind(
        thickness=2e-3, pitch=1e-3, cells=cells, layers=2 * cells, slabs=6 * cells,
        poisson=poisson, youngs_modulus=2e-3 * (1 + poisson),
    )  # fmt: skip
    plan = engine.compile(program, (n, n), ["displacement_z"])
    fine = exact.compile(program, (n, n), ["displacement_z"])
    truth = opposite_pushes((np.arange(n) + 0.5) / cells, poisson)
    got, own = (np.asarray(run(load)["displacement_z"], np.float64) for run in (plan, fine))
    row = _row("halfspace_equilibrium", "(4.9) and its images", "cells", cells, engine)
    return _cost(_split(row, got, own, truth), _alone(plan, load))


def _surface_load(engine: Engine, rounds: int, count: int) -> TrueError:
    """Return the row of loads found from noisy strain: RMS error over the mean pressure, 8 kPa."""
    found = measure(engine, 1e-4, rounds, count=count)
    row = _row("surface_load", "loads of one to three contacts", "rounds", rounds, engine)
    return replace(row, error=found.rms / 8e3, seconds=found.seconds, spread=nan)


def _contact(engine: Engine, side: int, count: int) -> TrueError:
    """Return the row of the normal load of spheres: median error over the load."""
    touches = drawn(np.random.default_rng(1), (0.5, 1.5), side, count)
    frames = held([readings(touch, side, 0.75, "strain") for touch in touches])
    program = get_program("contact").bind(rate=RATE, depth=0.75, reads="strain")
    plan = engine.compile(program, (side, side))
    stream, outputs = plan.stream((len(touches),)), dict[str, Floats]()
    for frame in frames:
        outputs = stream.push(frame)
    off = errors(touches, outputs, side)["load_normal"]
    row = _row("contact", "loads of spheres, 2.5 mV of noise", "taxels a side", side, engine)
    alone, one = plan.stream(), frames[-1][0]
    alone.push(one)  # its kernel is built before it is timed
    timing = timed(partial(alone.push, one), budget=BUDGET_S)
    return _cost(replace(row, error=float(np.median(np.abs(off)))), timing)


OUTLINES: Mapping[str, Callable[[Engine, Floats, Skin], list[Floats]]] = {
    "edges": by_program,
    "edge_enhancement": by_enhancement,
}
"""Programs that say where outlines are."""

PUNCHES = ("square punch, turned", "bar", "triangle")
"""Kinds of bodies on which no constant of `edges` was chosen."""


def _edges(engine: Engine, name: str, side: int, count: int) -> TrueError:
    """Return the row of edges of flat punches: median distance from the true outline, pitches."""
    skin, rng = Skin(cells=side), np.random.default_rng(7)
    punches = [SHARP[kind](rng, side, count) for kind in PUNCHES]
    found = [tally(partial(OUTLINES[name], engine), bodies, [skin]) for bodies in punches]
    off = np.concatenate([each.off for each in found])
    known = {"depth": skin.depth, "reads": skin.reads} if name == "edges" else {}
    plan = engine.compile(get_program(name).bind(rate=RATE, **known), (side, side))
    frame = np.zeros((side, side, 3))
    frame[..., 2] = -skin.stream(punches[0].frames(side, skin.depth, skin.reads))[-1, 0]
    alone = plan.stream()
    alone.push(frame)
    timing = timed(partial(alone.push, frame), budget=BUDGET_S)
    row = _row(name, "outlines of flat punches, pitches", "taxels a side", side, engine)
    return _cost(replace(row, error=float(np.median(off))), timing)


def _body_fit(engine: Engine, side: int, count: int) -> TrueError:
    """Return the row of the radius of Hertz's contacts: median error over it, of those reported.

    The larger the array, the more taxels the same sphere covers.
    """
    rng, size = np.random.default_rng(11), side / 8
    radii, places = size * rng.uniform(2.0, 3.0, count), size * rng.uniform(-0.5, 0.5, (count, 2))
    discs = [
        Disc(float(radius), (float(x), float(y)), "hertz")
        for radius, (x, y) in zip(radii, places, strict=True)
    ]
    loads = np.stack([frame_under(disc, (side, side), 0.5, "strain") for disc in discs])
    frames = held([np.stack([0.0 * load, 0.0 * load, -load], axis=-1) for load in loads])
    plan = engine.compile(
        get_program("body_fit").bind(rate=RATE, depth=0.5, reads="strain"),
        (side, side),
        ["sphere_fits", "contact_radius"],
        channels=FORCE_AXES,
    )
    columns = [FORCE_AXES.index(channel) for channel in plan.schedule.channels]
    given = np.ascontiguousarray(frames[..., columns])
    stream, outputs = plan.stream((count,)), dict[str, Floats]()
    for frame in given:
        outputs = stream.push(frame)
    fits = outputs["sphere_fits"] > 0.5
    off = np.abs(outputs["contact_radius"] / radii - 1.0)[fits]
    alone = plan.stream()
    alone.push(given[-1][0])
    timing = timed(partial(alone.push, given[-1][0]), budget=BUDGET_S)
    row = _row("body_fit", "radii of spheres, 2.5 mV of noise", "taxels a side", side, engine)
    found = float(np.median(off)) if off.size else nan
    return _cost(replace(row, error=found), timing)


RUBBED = (
    Phase("hold", 0.3),
    Phase("press", 0.2, load=0.1),
    Phase("pull", 0.7, speed=2e-3, direction=0.5),
)
BUMP, FRICTION = 0.2e-3, 0.6
"""Radius of the bumps, m, and thickness of the rubber below them; the friction of the sphere."""


def _bumps(engine: Engine, side: int) -> Iterator[TrueError]:
    """Yield the rows of the load that bumps bear, and of the friction of what slides over them."""
    options = SimulatedOptions(
        script=RUBBED, shape=(side, side), cover="bumpy", bump_radius=BUMP, thickness=BUMP,
        friction=FRICTION,
    )  # fmt: skip
    with options.open() as array:
        frames = list(array.frames())
        strain = array.calibration.to_strain(np.stack([frame.values for frame in frames]))
    truth = frames[-1].truth
    load = truth["normal_force"] if truth is not None else nan
    cases: dict[str, tuple[str, float, dict[str, object]]] = {
        "localize": ("bump_normal", load, {"unit": MODULUS * BUMP**2}),
        "texture": ("friction", FRICTION, {"window": 32, "taxels": "strain"}),
    }
    for name, (output, true, known) in cases.items():
        plan = engine.compile(get_program(name).bind(rate=RATE, **known), (side, side), [output])
        stream, got = plan.stream(), nan
        columns = [FORCE_AXES.index(channel) for channel in plan.schedule.channels]
        given = np.ascontiguousarray(strain[..., columns])
        for frame in given:
            got = float(stream.push(frame)[output])
        row = _row(name, "a sphere that slides over bumps", "taxels a side", side, engine)
        timing = timed(partial(stream.push, given[-1]), budget=BUDGET_S)
        yield _cost(replace(row, error=abs(got / true - 1.0)), timing)


@dataclass(frozen=True, slots=True)
class Trial:
    """A simulated touch, and when things began in it.

    Attributes
    ----------
    strain : (frames, rows, cols, 3) float
    began : mapping of str to float
        Seconds at which contact, gross slip and twist begin.
    """

    strain: Floats
    began: Mapping[str, float]


FLAGS = {"contact": "contact", "slip": "gross_slip", "twist": "twist"}
"""Programs that report events, and their flags."""


@cache
def trial(number: int, rate: float) -> Trial:
    """Return a sphere that comes down, is pulled until it slips, and then turned."""
    rng = np.random.default_rng([5, number])
    script = (
        Phase("hold", 0.5),
        Phase("press", 0.2, load=float(rng.uniform(0.5, 1.0))),
        Phase("hold", float(rng.uniform(0.2, 0.4))),
        Phase("pull", 0.7, 0.0, float(rng.uniform(0.8e-3, 2e-3)),
              float(rng.uniform(0.0, 2 * np.pi))),
        Phase("relax", 0.3),
        Phase("hold", 0.2),
        Phase("twist", 0.5, angle=float(rng.choice([-1.0, 1.0]) * rng.uniform(0.15, 0.3))),
    )  # fmt: skip
    options = SimulatedOptions(
        script=script, rate=rate, seed=number, friction=float(rng.uniform(0.4, 0.8))
    )
    with options.open() as array:
        frames = list(array.frames())
        volts = np.stack([frame.values for frame in frames])
        strain = array.calibration.to_strain(volts)
    truths = [frame.truth for frame in frames if frame.truth is not None]
    began = {
        event: _first([truth[name] != 0.0 for truth in truths], rate)
        for event, name in (("contact", "contact"), ("slip", "slip"), ("twist", "twist_rate"))
    }
    return Trial(np.asarray(strain), began)


def _first(flags: Sequence[bool] | Floats, rate: float) -> float:
    places = np.flatnonzero(np.asarray(flags))
    return float(places[0]) / rate if places.size else nan


def _events(
    engine: Engine, rate: float, trials: int, method: str | None = None, step: float | None = None
) -> Iterator[TrueError | str]:
    """Yield a row a program that reports events, of the same trials, or why there is none."""
    for name, flag in FLAGS.items():
        known: dict[str, object] = {"depth": 0.667} if name == "contact" else {}
        program = get_program(name).bind(rate=rate, **known)
        row = _row(name, "simulated touches", "frames a second", rate, engine)
        try:
            yield _reported(engine, program, flag, row, trials, method, step)
        except MethodError as error:  # a step beyond the stability bound
            yield f"{name} by {method or 'auto'}, step {step}, has no row: {error}"


def _reported(
    engine: Engine, program: Program, flag: str, row: TrueError, trials: int,
    method: str | None, step: float | None,
) -> TrueError:  # fmt: skip
    rate, delays, early = row.setting, list[float](), 0
    shape = trial(0, rate).strain.shape[1:3]
    plan = engine.compile(program, shape, [flag], method=method, dt=step)
    columns = [FORCE_AXES.index(channel) for channel in plan.schedule.channels]
    for number in range(trials):
        one = trial(number, rate)
        stream, frames = plan.stream(rate=rate), np.ascontiguousarray(one.strain[..., columns])
        seen = np.array([float(np.any(stream.push(frame)[flag] > 0.5)) for frame in frames])
        began = one.began[row.case]
        # a contact that goes on is no early report of itself
        early += bool(seen[: int(began * rate)].any())
        delays.append(_first(np.append(np.zeros(int(began * rate)), seen[int(began * rate) :]),
                             rate) - began)  # fmt: skip
    taken = np.array(delays)
    on_time = taken[taken <= LATE]  # not a number where nothing was reported
    frames = np.ascontiguousarray(trial(0, rate).strain[..., columns])
    stream = plan.stream(rate=rate)
    timing = timed(partial(_played, stream.push, frames), budget=BUDGET_S)
    return replace(
        row,
        method="auto" if method is None else f"{method} {step:g}",
        delay_s=float(np.median(on_time)) if on_time.size else nan,
        missed=1.0 - on_time.size / trials,
        too_early=early / trials,
        seconds=timing.least / len(frames) * rate,
        spread=timing.spread / len(frames) * rate,
    )


def _played(push: Callable[[Floats], object], frames: Floats) -> None:
    for frame in frames:
        push(frame)
