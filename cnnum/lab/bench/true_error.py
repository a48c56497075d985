"""The error that a user has, against run time: discretisation and arithmetic apart.

A lattice that is solved exactly is still not the continuum. So the total error is shown, with its
two parts: that of the exact answer on the same taxels and frames (discretisation; with the noise of
the readings, where they have some), and how far the run is from that answer (arithmetic). The knob
is the number of cells, or of frames a second where only time is in steps. Programs that report
events have a delay and misses in its place.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, partial
from itertools import accumulate, islice
from math import ceil, nan
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter

from cnnum.arrays import Floats
from cnnum.drivers.simulated.array import SimulatedOptions
from cnnum.drivers.simulated.settings import Phase
from cnnum.engine import Engine
from cnnum.errors import MethodError
from cnnum.frame import FORCE_AXES
from cnnum.lab.bench.programs.halfspace_runs import (
    MODULUS,
    PITCH,
    TAXELS,
    mirrored_patch,
    opposite_pushes,
)
from cnnum.lab.bench.programs.known_answers import (
    BUMP,
    KnownAnswer,
    Outputs,
    active_contour,
    body_fit,
    bumps,
    contact,
    mindlin_slip,
    motion_direction,
    on_off,
    outlines,
    receptors_in_space,
    receptors_in_time,
    tactile_flow,
)
from cnnum.lab.bench.programs.load_errors import measure
from cnnum.lab.bench.timing import Timing, timed
from cnnum.plan import Plan
from cnnum.programs import Program
from cnnum.programs.library import get_program
from cnnum.scenes.events import EVENT_RULES
from cnnum.templating.checks.tactile.halfspace import cover_stress

Row = Mapping[str, object]
Axes = Any
Picture = Any
"""Matplotlib says little of the types of its arguments."""

PARTS = (("error", "-", 1.2, "total"), ("discretisation", "-", 5.0, "discretisation"),
         ("arithmetic", ":", 1.2, "arithmetic"))  # fmt: skip
"""Key, line, width and name; a broad line of the discretisation shows below the total."""

COLOURS = {"float32": "#2f6db5", "float64": "#d1495b"}
ACROSS, WIDE = 3, 9.0
"""Panels side by side, and inches of the picture: its letters stay readable at a page's width."""

OTHERS = {"euler 0.1": ("#e8a33d", "D"), "heun 0.1": ("#5b9a3c", "^")}
"""Colour and mark of the methods that are compared with the chosen one."""

NEAR = 5.0
"""Ratio of errors up to which a panel shows them on a linear axis."""

FEW_DECADES = 2.3
"""Decades of an axis up to which it also has room for ticks at 2 and 5."""


def true_error(rows: Sequence[Row]) -> Picture:
    """Return error over time by the knob, and delay and misses over time of reports of events."""
    fields, events = (
        list(dict.fromkeys(_key(row) for row in rows if _is_event(row) == kind))
        for kind in (False, True)
    )
    lines = [-(-len(keys) // ACROSS) for keys in (fields, events)]
    heights = [0.7 + 2.3 * lines[0], 0.7 + 3.2 * lines[1]]
    figure: Picture = Figure(figsize=(WIDE, sum(heights)), layout="constrained")
    parts = figure.subfigures(2, 1, height_ratios=heights)
    for part, keys, count, draw in zip(
        parts, (fields, events), lines, (_errors, _reports), strict=True
    ):
        named: dict[str, Any] = {}
        for place, key in enumerate(keys):
            own = [row for row in rows if _key(row) == key]
            for axes in draw(part, (max(count, 1), ACROSS), place, own):
                axes.grid(visible=True, which="major", color="#dddddd", linewidth=0.6)
                axes.tick_params(labelsize=8)
                for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
                    named.setdefault(label, handle)
        order = sorted(named, key=lambda label: label.split(", ", 1)[::-1])
        if order:
            part.legend([named[label] for label in order], order, loc="outside upper center",
                        ncols=4, fontsize=9, frameon=False)  # fmt: skip
    return figure


def _key(row: Row) -> tuple[str, str, bool]:
    return str(row["case"]), str(row["knob"]), _is_event(row)


def _is_event(row: Row) -> bool:
    return row["missed"] is not None


def _number(row: Row, key: str) -> float:
    value = row[key]
    return float(value) if isinstance(value, int | float) else float("nan")


def _errors(part: Picture, shape: tuple[int, int], place: int, rows: Sequence[Row]) -> list[Axes]:
    axes: Axes = part.add_subplot(*shape, place + 1)
    _title(axes, rows[0])
    for precision, colour in COLOURS.items():
        own = [row for row in rows if row["precision"] == precision]
        x = [1e6 * _number(row, "seconds") for row in own]
        for key, style, width, name in PARTS:
            y = [_number(row, key) for row in own]
            if any(value == value for value in y):  # not all missing
                label = f"{precision}, {name}"
                axes.plot(x, y, style, color=colour, lw=width, label=label,
                          marker="o" if width < 2.0 else "", ms=3.5,
                          alpha=1.0 if width < 2.0 else 0.25)  # fmt: skip
        # one precision is named: both have the same total
        for at, row in zip(x, own, strict=True) if precision == rows[0]["precision"] else ():
            axes.annotate(f"{_number(row, 'setting'):g}", (at, _number(row, "error")), fontsize=7.5,
                          xytext=(2, 5), textcoords="offset points")  # fmt: skip
    _scaled(axes, [_number(row, key) for row in rows for key, *_ in PARTS])
    unit = "mm" if str(rows[0]["truth"]).endswith("mm") else "share"
    axes.set_xlabel(f"µs a frame; at points: {rows[0]['knob']}", fontsize=8.5)
    axes.set_ylabel(f"error, {unit}", fontsize=8.5)
    mark_few(axes)
    return [axes]


def _scaled(axes: Axes, values: Sequence[float]) -> None:
    """Give logarithmic axes, with room for numbers; errors that are near each other begin at 0."""
    known = [value for value in values if value > 0.0]
    axes.margins(0.12)
    axes.set(xscale="log", yscale="log")
    if max(known) < NEAR * min(known):
        axes.set(yscale="linear")
        axes.set_ylim(0.0, 1.3 * max(known))


def _reports(part: Picture, shape: tuple[int, int], place: int, rows: Sequence[Row]) -> list[Axes]:
    """Draw the delays of a program's reports, and below them the share that is missed or early."""
    grid = part.add_gridspec(*shape)[place // shape[1], place % shape[1]]
    upper, lower = grid.subgridspec(2, 1, height_ratios=(2.0, 1.0), hspace=0.0)
    delays: Axes = part.add_subplot(upper)
    misses: Axes = part.add_subplot(lower, sharex=delays)
    _title(delays, rows[0])
    names = list(dict.fromkeys((str(row["precision"]), str(row["method"])) for row in rows))
    for precision, method in names:
        own = [row for row in rows if (row["precision"], row["method"]) == (precision, method)]
        x = [1e3 * _number(row, "seconds") for row in own]
        delay, missed, early = (
            [scale * _number(row, key) for row in own]
            for key, scale in (("delay_s", 1e3), ("missed", 100.0), ("too_early", 100.0))
        )
        colour, mark = OTHERS.get(method, (COLOURS[precision], "o"))
        chosen = "the chosen method" if method == "auto" else method
        style = {"color": colour, "ms": 4.5, "lw": 1.2}
        delays.plot(x, delay, marker=mark, label=f"{precision}, {chosen}", **style)
        misses.plot(x, missed, marker=mark, **style)
        misses.plot(x, early, marker=mark, mfc="white", ls=":", **style)
        for at, y, row in (
            zip(x, delay, own, strict=True) if (precision, method) == names[0] else ()
        ):
            delays.annotate(f"{_number(row, 'setting'):g}/s", (at, y), fontsize=8, xytext=(2, 5),
                            textcoords="offset points")  # fmt: skip
    misses.plot([], [], "ko", ms=4.5, label="missed within 0.5 s")
    misses.plot([], [], "ko:", mfc="white", ms=4.5, label="reported too early")
    delays.margins(x=0.15)
    delays.set(xscale="log")
    top = 1.35 * max(
        10.0, *(1e3 * value for row in rows if (value := _number(row, "delay_s")) >= 0)
    )
    delays.set_ylim(-0.06 * top, top)  # many report with the first frame
    misses.set(ylim=(-12.0, 112.0), yticks=(0, 50, 100))
    delays.tick_params(labelbottom=False, which="both")
    delays.set_ylabel("delay, ms", fontsize=8.5)
    misses.set_ylabel("share, %", fontsize=8.5)
    misses.set_xlabel("ms of work per second of touch", fontsize=8.5)
    mark_few(misses)
    return [delays, misses]


def _title(axes: Axes, row: Row) -> None:
    axes.set_title(f"{row['case']}\n{row['truth']}", fontsize=8.5)


def mark_few(axes: Axes) -> None:
    """Mark 1, 2 and 5 where there is room for them, else whole decades; nothing in between."""
    low, high = axes.get_xlim()
    few = high / low < 10.0**FEW_DECADES
    axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if few else (1.0,), numticks=8))
    axes.xaxis.set_major_formatter("{x:g}")
    axes.xaxis.set_minor_formatter(NullFormatter())


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
    "Bumps of localize and texture are simulated by the finite elements that they invert, one a "
    "taxel. Rows show noise and neighbours. `tests/tactile/test_texture_program.py` has another "
    "mesh.",
    "edges and edge_enhancement are of one skin and three kinds of punches; all are in tables of "
    "`python -m cnnum.lab.bench.programs.edge_errors`, and those of body_fit in `body_errors`.",
    "tactile has the outputs of contact, slip, twist, edges and localize, and their errors.",
    "halfspace_layers and halfspace_equilibrium stop at two cells: beyond, one takes minutes to "
    "build and the other relaxes for seconds.",
    "The cover of the half-space programs is 1 mm over taxels 1.5 mm apart, with one value a cell. "
    "Loads go on mirrored beyond the rim, for the program and for the truth.",
    "Steps in space of on_off and motion_direction are part of what they are: their layers and "
    "neighbours are a taxel apart. Their rows are of steps in time.",
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
        What is set: "cells", "rounds", "taxels a side", "taxels a wave", "frames a second".
    setting : float
    engine, precision, method : str
    error : float
        The total error, as a share, and of edges in mm; NaN where the answer is an event. Of
        several bodies it is the median.
    discretisation, arithmetic : float
        Its parts: the exact answer on the lattice against the truth, likewise, and the run against
        that, the largest. NaN where the answer is an event.
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
            yield _surface_load(engine, exact, rounds, count=20 if quick else 100)
    other = Engine("numba", precision="float64")
    for known in _known(quick=quick):
        own = _every(_plan(other, known), known)
        for engine in engines:
            yield _answered(engine, own, known)
    trials = 2 if quick else TRIALS
    for rate in RATES[:2] if quick else RATES:
        for engine in engines:
            yield from _events(engine, rate, trials)
    if not quick:
        for method, step in (("euler", 0.1), ("heun", 0.1)):
            yield from _events(engines[0], RATES[1], trials, method, step)


def _known(*, quick: bool) -> Iterator[KnownAnswer]:
    """Yield all frames of which the answer is known."""
    few, sides = (3, (8,)) if quick else (8, (8, 16))
    for side in (4, *sides):
        yield contact(side, 2 * few)
        yield receptors_in_space(side)
    for side in sides:
        yield body_fit(side, 2 * few)
        yield mindlin_slip(side, few)
        yield active_contour(side, few)
        for name in ("edges", "edge_enhancement"):
            yield outlines(name, side, few)
    for side in (4, 8):
        yield from bumps(side)
    for taxels in (4, 8) if quick else (4, 6, 8, 16):
        yield tactile_flow(taxels)
    for rate in RATES[:2] if quick else RATES:
        yield motion_direction(rate)
        yield receptors_in_time(rate)
        yield on_off(rate)


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
    return np.stack([plane - plane.mean((-2, -1), keepdims=True) for plane in maps], axis=-1)


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
    got = _levelled([plan(frames)[output] for output in outputs])
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
        own = _levelled([lattice[output] for output in outputs])
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


def _surface_load(engine: Engine, exact: Engine, rounds: int, count: int) -> TrueError:
    """Return the row of loads found from noisy strain: RMS error over the mean pressure, 8 kPa."""
    result, own = (
        measure(engine_used, 1e-4, rounds, count=count) for engine_used in (engine, exact)
    )
    row = _row("surface_load", "loads of one to three contacts", "rounds", rounds, engine)
    return replace(
        row,
        error=result.rms / 8e3,
        discretisation=own.rms / 8e3,
        arithmetic=float(np.abs(result.pressure - own.pressure).max()) / 8e3,
        seconds=result.seconds,
        spread=nan,
    )


def _answered(engine: Engine, own: Outputs, known: KnownAnswer) -> TrueError:
    """Return the row of a program on frames of which the answer is known, and of its exact run."""
    plan = _plan(engine, known)
    got = _every(plan, known)
    alone, middle = plan.stream(), _read(plan, known)[len(known.frames) // 2, 0]
    alone.push(middle)  # its kernel is built before it is timed
    timing = timed(partial(alone.push, middle), budget=BUDGET_S)
    row = replace(
        _row(known.name, known.truth, known.knob, known.setting, engine),
        error=_median(known.off(got, None)),
        discretisation=_median(known.off(own, None)),
        arithmetic=float(np.nanmax(known.off(got, own))),
    )
    return _cost(row, timing)


def _plan(engine: Engine, known: KnownAnswer) -> Plan:
    shape = known.frames.shape[2:4]
    return engine.compile(known.program, shape, known.needs, channels=FORCE_AXES)


def _read(plan: Plan, known: KnownAnswer) -> Floats:
    """Return the frames with the channels that a plan reads."""
    columns = [FORCE_AXES.index(channel) for channel in plan.schedule.channels]
    return np.ascontiguousarray(known.frames[..., columns])


def _every(plan: Plan, known: KnownAnswer) -> Outputs:
    """Return the outputs of all frames, (frames, streams, …)."""
    frames = _read(plan, known)
    stream = plan.stream((frames.shape[1],))
    answers = [stream.push(frame) for frame in frames]
    return {name: np.array([answer[name] for answer in answers], np.float64) for name in answers[0]}


def _median(off: Floats) -> float:
    """Return the median of errors, but for those that are not known."""
    return float(np.median(off[~np.isnan(off)])) if not np.isnan(off).all() else nan


@dataclass(frozen=True, slots=True)
class Trial:
    """A simulated touch, and when things began in it.

    Attributes
    ----------
    strain : (frames, rows, cols, 3) float
    began : mapping of str to float
        Seconds at which contact, incipient and gross slip, a pull and twist begin.
    """

    strain: Floats
    began: Mapping[str, float]


KNOWN_FRICTION, WIDE_RADIUS = 0.6, 70e-3
"""Of the spheres of `mindlin_slip`; m."""


@dataclass(frozen=True, slots=True)
class Reporter:
    """A program that reports events.

    Attributes
    ----------
    flag : str
    event : str
        What it reports, by its name in `Trial.began`.
    known : mapping
        Parameters.
    touches : str
        Its trials: "spheres", "spheres of known friction", "punches", "bumps", "ridges" or "two
        fingers".
    """

    flag: str
    event: str
    known: Mapping[str, object] = field(default_factory=dict[str, object])
    touches: str = "spheres"

    @property
    def steady(self) -> float:
        """Time for which the flag holds until it is an event, s."""
        rules = (rule for rules in EVENT_RULES.values() for rule in rules)
        return next(rule.steady for rule in rules if rule.flag == self.flag)


DEEP: Mapping[str, object] = {"depth": THICKNESS / PITCH}

REPORTERS: Mapping[str, Reporter] = {
    "contact": Reporter("contact", "contact", DEEP),
    "active_contour": Reporter("contour_holds", "contact", DEEP),
    "on_off": Reporter("comes", "contact"),
    "receptors": Reporter("sa1_active", "contact"),
    "slip": Reporter("gross_slip", "slip"),
    "twist": Reporter("twist", "twist"),
    "edges": Reporter("edge_count", "contact", DEEP, "punches"),
    "edge_enhancement": Reporter("edge_count", "contact", touches="punches"),
    "localize": Reporter("bump_count", "contact", touches="bumps"),
    "texture": Reporter("texture_rubs", "slip", {"taxels": "strain", "window": 16}, "ridges"),
    "mindlin_slip": Reporter(
        "incipient_slip", "incipient", {**DEEP, "friction": KNOWN_FRICTION},
        "spheres of known friction",
    ),
    "grasp_code": Reporter("grasp_slip", "pull", touches="two fingers"),
    "tactile_flow": Reporter("flows", "slip", {"still": 1.5}, "ridges"),
    "motion_direction": Reporter("drifts", "slip", touches="ridges"),
}  # fmt: skip
"""Programs that report events."""


@cache
def trial(number: int, rate: float, touches: str = "spheres") -> Trial:
    """Return a body that comes down and is pulled until it slips; spheres are turned then."""
    rng = np.random.default_rng([5, number])
    down = [Phase("hold", 0.5), Phase("press", 0.2, load=float(rng.uniform(0.5, 1.0))),
            Phase("hold", float(rng.uniform(0.2, 0.4)))]  # fmt: skip
    speed, way = float(rng.uniform(0.8e-3, 2e-3)), float(rng.uniform(0.0, 2 * np.pi))
    turned = float(rng.choice([-1.0, 1.0]) * rng.uniform(0.15, 0.3))
    pulled = [Phase("pull", 0.7, 0.0, speed, way)]
    friction = float(rng.uniform(0.4, 0.8))
    body: dict[str, Any] = {"friction": friction}
    if touches == "two fingers":
        body |= {"fingers": 2, "body": "punch", "width": 12e-3, "start": (0.0, 0.0)}
    elif touches == "punches":
        body |= {"body": "punch", "width": float(rng.uniform(4.5e-3, 7e-3))}
    elif touches == "bumps":
        body |= {"cover": "bumpy", "bump_radius": BUMP, "thickness": BUMP}
        down = [Phase("hold", 0.5), Phase("press", 0.3, load=0.15), Phase("hold", 0.3)]
    elif touches == "ridges":
        body |= {"cover": "bumpy", "bump_radius": BUMP, "thickness": BUMP, "body": "textured",
                 "period": 9e-3}  # fmt: skip
        down = [Phase("hold", 0.5), Phase("press", 0.3, load=2.0), Phase("hold", 0.6)]
        # across the ridges, which are all that moves
        way = float(rng.choice([0.0, np.pi]) + rng.uniform(-0.5, 0.5))
        pulled = [Phase("pull", 0.9, 0.0, 2.0 * speed + 1.6e-3, way)]
    elif touches == "spheres of known friction":
        # wide enough for a law of spheres, and slow enough for some frames before the slide
        body = {"friction": KNOWN_FRICTION, "radius": WIDE_RADIUS}
        pulled = [Phase("pull", 1.2, 0.0, 0.3 * speed, way)]
    else:
        pulled += [Phase("relax", 0.3), Phase("hold", 0.2), Phase("twist", 0.5, angle=turned)]
    options = SimulatedOptions(script=(*down, *pulled), rate=rate, seed=number, **body)
    with options.open() as array:
        frames = list(array.frames())
        volts = np.stack([frame.values for frame in frames])
        strain = array.calibration.to_strain(volts)
    truths = [frame.truth for frame in frames if frame.truth is not None]
    began = {
        event: _first([truth[name] != 0.0 for truth in truths], rate)
        for event, name in (
            ("contact", "contact"), ("incipient", "incipient"), ("slip", "slip"),
            ("twist", "twist_rate"),
        )
    }  # fmt: skip
    sheared = [truth["shear_x"] != 0.0 or truth["shear_y"] != 0.0 for truth in truths]
    return Trial(np.asarray(strain), {**began, "pull": _first(sheared, rate)})


def _first(flags: Sequence[bool] | Floats, rate: float) -> float:
    places = np.flatnonzero(np.asarray(flags))
    return float(places[0]) / rate if places.size else nan


def _events(
    engine: Engine, rate: float, trials: int, method: str | None = None, step: float | None = None
) -> Iterator[TrueError | str]:
    """Yield a row a program that reports events, of the same trials, or why there is none."""
    for name, reporter in REPORTERS.items():
        program = get_program(name).bind(rate=rate, **reporter.known)
        row = _row(name, f"reports: {reporter.touches}", "frames a second", rate, engine)
        try:
            yield _reported(engine, program, reporter, row, trials, method, step)
        except MethodError as error:  # a step beyond the stability bound
            yield f"{name} by {method or 'auto'}, step {step}, has no row: {error}"


def _reported(
    engine: Engine, program: Program, reporter: Reporter, row: TrueError, trials: int,
    method: str | None, step: float | None,
) -> TrueError:  # fmt: skip
    rate, delays, early, flag = row.setting, list[float](), 0, reporter.flag
    shape = trial(0, rate, reporter.touches).strain.shape[1:3]
    plan = engine.compile(program, shape, [flag], method=method, dt=step)
    columns = [FORCE_AXES.index(channel) for channel in plan.schedule.channels]
    for number in range(trials):
        scene_trial = trial(number, rate, reporter.touches)
        stream, frames = (
            plan.stream(rate=rate),
            np.ascontiguousarray(scene_trial.strain[..., columns]),
        )
        seen = _lasting(
            [bool(np.any(stream.push(frame)[flag] > 0.5)) for frame in frames],
            ceil(reporter.steady * rate - 1e-9),
        )
        began = scene_trial.began[reporter.event]
        # a contact that goes on is no early report of itself
        early += bool(seen[: int(began * rate)].any())
        delays.append(_first(np.append(np.zeros(int(began * rate)), seen[int(began * rate) :]),
                             rate) - began)  # fmt: skip
    taken = np.array(delays)
    on_time = taken[taken <= LATE]  # not a number where nothing was reported
    frames = np.ascontiguousarray(trial(0, rate, reporter.touches).strain[..., columns])
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


def _lasting(flags: Sequence[bool], frames: int) -> Floats:
    """Return 1 where a flag has held for that number of frames."""
    lasts = accumulate(flags, lambda count, flag: (count + 1) * flag, initial=0)
    return np.array([float(count > frames) for count in islice(lasts, 1, None)])


def _played(push: Callable[[Floats], object], frames: Floats) -> None:
    for frame in frames:
        push(frame)
