"""The cost of a program on a microcontroller by precision, and the loss of each."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cache, lru_cache
from math import inf, isfinite, nan

import numpy as np

from cnnum.arrays import Floats, Shape
from cnnum.drivers.simulated.grips import Trial, runs
from cnnum.embedded.making import Made
from cnnum.engine import Engine
from cnnum.errors import CnnumError, NotSupportedError
from cnnum.lab.embedded.cortex_m import Board
from cnnum.lab.embedded.gnu_arm import gnu_counted, missing_gnu_tools
from cnnum.lab.scoring.judge import judge, per_ten_minutes, sense_right, share
from cnnum.scenes.exporting import APART, bound_program, made, side_by_side, trials, vector_frames
from cnnum.scenes.exporting import made as made_program

OTHERS = 1000
"""First seed of the scenes that are scored: none of them was measured for ranges."""

REPORTS = ("gross_slip", "twist")
"""Flags that are reports."""

EXCERPT = 300
"""Frames of each stream that the reference engine runs, too: at rest, pressed, and pulled."""

LETS_GO = 10
"""How many times as fast as it was pressed an array is let go at their end: outputs of a release
have no size in frames without one, and their error is a share of it."""


@dataclass(frozen=True, slots=True)
class Loss:
    """How far the outputs are from those of the reference engine on the same frames.

    Attributes
    ----------
    error : float
        Root of the mean squared difference of an output over that of the output itself. The output
        is that with the largest; NaN where all are flags.
    output : str
        Its name.
    flags_differ : float
        Share of the flags that are up here or there and not in both; NaN where none is up.
    """

    error: float
    output: str
    flags_differ: float


@dataclass(frozen=True, slots=True)
class Events:
    """Scores of reports; NaN of programs that make none.

    Attributes
    ----------
    slip_recall, twist_recall : float
        Share of the scenes whose slip is reported, and whose twist is, in its own sense.
    false_reports : float
        In ten minutes.
    reports_differ : float
        Share of the frames with a report here or in float32 that lack it in one of them. NaN where
        none has one.
    """

    slip_recall: float
    twist_recall: float
    false_reports: float
    reports_differ: float


NO_EVENTS = Events(nan, nan, nan, nan)


@cache
def excerpt(shape: Shape, *, remembers: bool) -> Floats:
    """Return frames of a scene that slips and of one that twists, and let go, (frames, 2, …).

    Parameters
    ----------
    shape : (rows, cols)
    remembers : bool
        Whether the program has memories, and so needs all frames in their order.
    """
    some = [trial for trial in trials(shape, OTHERS, 1) if trial.family in ("slip", "twist")]
    frames = side_by_side(some, EXCERPT)
    frames = np.concatenate([frames, frames[::-LETS_GO]])
    return frames[:: 1 if remembers else APART]


@cache
def _reference(name: str, shape: Shape, needs: tuple[str, ...]) -> Mapping[str, Floats]:
    """Return the outputs of the reference engine on the excerpt."""
    plan = Engine("reference").compile(bound_program(name), shape, needs)
    frames = excerpt(shape, remembers=bool(plan.schedule.memories))
    stream = plan.stream((frames.shape[1],))
    answers = [stream.push(frame) for frame in frames]
    return {key: np.array([answer[key] for answer in answers]) for key in answers[0]}


def loss(made: Made, shape: Shape, name: str) -> Loss:
    """Return how far a program in a precision is from the reference engine; `name` is its place."""
    remembers = bool(made.schedule.memories)
    wanted = _reference(name, shape, tuple(made.schedule.outputs))
    result = made.run(excerpt(shape, remembers=remembers))
    worst, output, flags = -1.0, "", list[str]()
    for name, node in made.schedule.outputs.items():
        if node.logic:
            flags.append(name)
            continue
        size = float(np.sqrt(np.mean(wanted[name] ** 2)))
        off = float(np.sqrt(np.mean((result[name] - wanted[name]) ** 2)))
        error = off / size if size else (0.0 if not off else inf)
        if error > worst:
            worst, output = error, name
    return Loss(worst if output else nan, output, _unlike(result, wanted, flags))


def _unlike(
    answers: Mapping[str, Floats], wanted: Mapping[str, Floats], names: Sequence[str]
) -> float:
    """Return the share of the flags up in either that are not up in both; NaN if none is up."""
    pairs = [(answers[name] > 0, wanted[name] > 0) for name in names]
    either = sum(int((this | other).sum()) for this, other in pairs)
    both = sum(int((this & other).sum()) for this, other in pairs)
    return 1.0 - both / either if either else nan


def events(made: Made, shape: Shape, count: int, name: str) -> Events:
    """Return the scores of the reports of a program on scenes that it has not seen.

    Parameters
    ----------
    made : Made
    shape : (rows, cols)
    name : str
        The program's place.
    count : int
        Scenes of each kind.
    """
    known = made.program.outputs
    reports = [name for name in REPORTS if name in known]
    if not reports:
        return NO_EVENTS
    scenes = trials(shape, OTHERS, count)
    answers = _answers(made, scenes)
    slips, twists, false, seconds = list[bool](), list[bool](), 0, 0.0
    for scene, answer in zip(scenes, answers, strict=True):
        seconds += scene.seconds
        if "gross_slip" in known:
            verdict = judge(scene, answer)
            false += verdict.false
            if scene.slides and not scene.sense.any():
                slips.append(verdict.found)
        if "twist" in known:
            false += 0 if "gross_slip" in known else _false_twists(scene, answer)
            if scene.sense.any():
                twists.append(sense_right(scene, answer))
    exact = _exact_answers(name, shape, count)
    differ = _unlike(_together(answers, reports), _together(exact, reports), reports)
    return Events(_share(slips), _share(twists), per_ten_minutes(false, seconds), differ)


def _answers(made: Made, scenes: Sequence[Trial]) -> list[dict[str, Floats]]:
    """Return the outputs on each scene, (its frames, …)."""
    result = made.run(side_by_side(scenes))
    return [
        {name: values[: len(scene.frames), n] for name, values in result.items()}
        for n, scene in enumerate(scenes)
    ]


@lru_cache(maxsize=4)
def _exact_answers(name: str, shape: Shape, count: int) -> list[dict[str, Floats]]:
    """Return the reports of a program in float32 on the scenes that are scored."""
    result = _answers(made_program(name, shape, "float32"), trials(shape, OTHERS, count))
    return [{key: frame[key] for key in REPORTS if key in frame} for frame in result]


def _together(some: Sequence[Mapping[str, Floats]], names: Sequence[str]) -> dict[str, Floats]:
    return {name: np.concatenate([frame[name].ravel() for frame in some]) for name in names}


def _share(some: Sequence[bool]) -> float:
    return share(sum(some), len(some))


def _false_twists(trial: Trial, answer: Mapping[str, Floats]) -> int:
    said = (answer["twist"] > 0) & trial.scored
    return sum(not trial.sense[start:after].any() for start, after in runs(said))


PRECISIONS = ("q15", "q7", "q23", "float32")
USUAL = ("slip", "twist")
SHAPES: tuple[Shape, ...] = ((4, 4), (8, 8), (16, 16))
WITHOUT_DSP = ("-DCNNUM_PAIRS=0",)
COUNTED = 4
"""Frames that are counted: in the middle of a slip, where loops are longest."""

SCENES = 2
"""Scenes of each kind in which reports are scored."""

Case = tuple[str, Shape, str, str, str]
"""Program, shape, precision, method, core."""


@dataclass(frozen=True, slots=True)
class CostRow:
    """One program in one configuration.

    Attributes
    ----------
    case : str
        The program.
    shape : (rows, cols)
    precision, method, core : str
    instructions : int
        Instructions of the longest frame: counted, not timed, and not cycles.
    ram_bytes, flash_bytes : int
        From the ELF file; RAM with frame, answers and the deepest stack.
    error : float
        Against the reference engine, of the output with the largest.
    output : str
        Its name.
    flags_differ : float
        Share of the flags up here or on the reference engine that are not up on both.
    slip_recall, twist_recall, false_reports : float
        Of reports; false ones in ten minutes.
    reports_differ : float
        Share of the frames with a report here or in float32 that lack it in one of them.
    frames_per_s : float
        At most, at the clock, if an instruction took a cycle.
    cycles_least, cycles_most : float
        Cycles of the longest frame by Arm's manuals: the least without wait states, the most with
        those that were given, and no cache. Infinite where a manual has no upper bound.
    clock_hz : float
    stack_bytes : int
        The deepest stack.
    wrong : int
        Numbers that differ from the emulator's: 0.
    gnu_instructions, gnu_flash_bytes : int or None
        The same by GCC for Arm and QEMU, where they are installed; flash of the program alone.
    plain_instructions : int or None
        Instructions without those for DSP, where they were counted.
    """

    case: str
    shape: Shape
    precision: str
    method: str
    core: str
    instructions: int
    ram_bytes: int
    flash_bytes: int
    error: float
    output: str
    flags_differ: float
    slip_recall: float
    twist_recall: float
    false_reports: float
    reports_differ: float
    frames_per_s: float
    clock_hz: float
    stack_bytes: int
    wrong: int
    gnu_instructions: int | None = None
    gnu_flash_bytes: int | None = None
    cycles_least: float = 0.0
    cycles_most: float = inf
    plain_instructions: int | None = None


def cases(
    programs: Sequence[str],
    shapes: Sequence[Shape],
    precisions: Sequence[str],
    methods: Sequence[str],
    cores: Sequence[str],
) -> list[Case]:
    """Return all configurations."""
    return [
        (program, shape, precision, method, core)
        for program in programs
        for shape in shapes
        for precision in precisions
        for method in methods
        for core in cores
    ]


def measure_costs(
    some: Sequence[Case],
    clock: float,
    scenes: int,
    needs: Sequence[str] | None = None,
    wait_states: int = 0,
    *,
    only_costs: bool = False,
) -> Iterator[CostRow | str]:
    """Yield one row per configuration, or a sentence of one that is left out.

    Parameters
    ----------
    some : sequence of Case
    clock : float
        Hz.
    scenes : int
        Of each kind, in which reports are scored; 0 scores none.
    needs : sequence of str, optional
        Outputs; all by default.
    wait_states : int
        Of the flash.
    only_costs : bool
        Whether to count by Unicorn alone, without DSP instructions too, and to measure no error.
    """
    known: dict[tuple[str, Shape, str, str], tuple[object, ...]] = {}
    for program, shape, precision, method, core in some:
        key = (program, shape, precision, method)
        try:
            if key not in known:
                known.clear()
                export = made(program, shape, precision, method, needs)
                scored = events(export, shape, scenes, program) if scenes else NO_EVENTS
                lost = Loss(nan, "", nan) if only_costs else loss(export, shape, program)
                known[key] = (export, lost, scored)
            yield _row(key, core, clock, known[key], wait_states, only_costs=only_costs)
        except NotSupportedError as error:
            yield f"{program} on {shape[0]}×{shape[1]} in {precision} by {method}: {error}"
        except CnnumError as error:
            if not isinstance(error, ValueError):
                raise
            yield f"{program} on {shape[0]}×{shape[1]}: {error}"


def _row(
    key: tuple[str, Shape, str, str],
    core: str,
    clock: float,
    known: tuple[object, ...],
    wait_states: int,
    *,
    only_costs: bool,
) -> CostRow:
    from cnnum.embedded.making import Made
    from cnnum.lab.embedded.costs import Events, Loss

    counts, lost, scored = known
    assert isinstance(counts, Made)
    assert isinstance(lost, Loss)
    assert isinstance(scored, Events)
    program, shape, precision, method = key
    frames = vector_frames(shape, COUNTED)
    counted = Board.built(counts, frames[:1], core).run(frames, wait_states)
    gnu, plain = None, None
    if only_costs and counts.precision.integer:
        plain = Board.built(counts, frames[:1], core, WITHOUT_DSP).run(frames)
    elif counts.precision.integer and not missing_gnu_tools():
        gnu = gnu_counted(counts, frames, core)
    return CostRow(
        case=program,
        shape=shape,
        precision=precision,
        method=method,
        core=core,
        instructions=counted.worst,
        ram_bytes=counted.ram_bytes,
        flash_bytes=counted.flash_bytes,
        **asdict(lost),
        **asdict(scored),
        frames_per_s=counted.frames_per_second(clock),
        clock_hz=clock,
        stack_bytes=counted.stack_bytes,
        wrong=sum(count.wrong for count in (counted, gnu, plain) if count is not None),
        gnu_instructions=None if gnu is None else max(gnu.instructions),
        gnu_flash_bytes=None if gnu is None else gnu.flash_bytes,
        cycles_least=counted.cycles[0],
        cycles_most=counted.cycles[1],
        plain_instructions=None if plain is None else plain.worst,
    )


@dataclass(frozen=True, slots=True)
class Bounds:
    """Bounds on a program's cost and loss.

    Attributes
    ----------
    error : float
    ram, flash : float
        Bytes.
    rate : float
        Frames a second that must be reached.
    """

    error: float = inf
    ram: float = inf
    flash: float = inf
    rate: float = 0.0

    @property
    def asked(self) -> bool:
        """Whether anything is bounded."""
        return self != Bounds()

    def excess(self, row: CostRow) -> dict[str, float]:
        """Return by how many times a row exceeds each bound that it does."""
        error = row.error if isfinite(row.error) else (inf if row.error == inf else 0.0)
        shares = {
            "error": error / self.error,
            "RAM": row.ram_bytes / self.ram,
            "flash": row.flash_bytes / self.flash,
            "frame rate": self.rate / row.frames_per_s,
        }
        return {name: share for name, share in shares.items() if share > 1.0}


def answers(rows: Sequence[CostRow], bounds: Bounds) -> list[str]:
    """Return a sentence for each program and shape: its cheapest configuration, or the nearest."""
    result = list[str]()
    for case, shape in dict.fromkeys((row.case, row.shape) for row in rows):
        mine = [row for row in rows if (row.case, row.shape) == (case, shape)]
        within = [row for row in mine if not bounds.excess(row)]
        at = f"{case} on {shape[0]}×{shape[1]}"
        if within:
            best = min(within, key=lambda row: (row.instructions, row.ram_bytes))
            result.append(f"{at}: the cheapest within the bounds is {_words(best)}.")
            continue
        near = min(mine, key=lambda row: max(bounds.excess(row).values()))
        over = ", ".join(f"{name} {share:.3g}×" for name, share in bounds.excess(near).items())
        result.append(
            f"{at}: none is within the bounds; nearest is {_words(near)}, over in {over} the bound."
        )
    return result


def fits(row: CostRow, rate: float) -> str:
    """Return whether a row's frames fit a rate: "yes", "no" or "unsure"."""
    budget = row.clock_hz / rate
    if row.cycles_most <= budget:
        return "yes"
    return "no" if row.cycles_least > budget else "unsure"


def fit_sentence(row: CostRow, rate: float, power: float | None = None) -> str:
    """Return a sentence on cycles, the share of a frame, and the energy where power is given.

    Parameters
    ----------
    row : CostRow
    rate : float, Hz
    power : float, optional
        mW/MHz, which is nJ a cycle.
    """
    budget = row.clock_hz / rate
    energy = "" if power is None else f", {_span(row, 1e-3 * power, '.3g')} µJ a frame"
    return (
        f"{row.case} in {row.precision} on {row.core} fits {rate:g} Hz at {row.clock_hz / 1e6:g} "
        f"MHz: {fits(row, rate)} ({_span(row, 1.0, ',.0f')} cycles, "
        f"{_span(row, 100.0 / budget, '.3g')} % of a frame{energy})."
    )


def page_table(rows: Sequence[CostRow], rates: Sequence[float]) -> list[str]:
    """Return the lines of the documentation's table of costs, and whether frames fit each rate."""
    asked = ", ".join(f"{rate:g} Hz" if rate < 1e3 else f"{rate / 1e3:g} kHz" for rate in rates)
    lines = [
        "| program | instructions (without DSP) | cycles | RAM, bytes | flash, bytes | fits "
        f"{asked} |",
        "|---|---|---|---|---|---|",
    ]
    kinds = [{_kind(row)[n] for row in rows} for n in range(4)]
    for row in rows:
        name = ", ".join(f"`{part}`" for part in row.case.split(","))
        name += "".join(
            f", {what}" for what, of in zip(_kind(row), kinds, strict=True) if of - {what}
        )
        plain = row.plain_instructions
        other = "" if plain in (None, row.instructions) else f" ({plain:,})"
        fit = ", ".join(fits(row, rate) for rate in rates)
        lines.append(
            f"| {name} | {row.instructions:,}{other} | {_span(row, 1.0, ',.0f')} | "
            f"{row.ram_bytes:,} | {row.flash_bytes:,} | {fit} |"
        )
    return lines


def _kind(row: CostRow) -> tuple[str, ...]:
    return f"{row.shape[0]}×{row.shape[1]}", row.precision, row.method, row.core


def _span(row: CostRow, scale: float, form: str) -> str:
    """Return the least and the most cycles times a number, in words."""
    both = row.cycles_least, row.cycles_most
    return " to ".join(format(end * scale, form) if isfinite(end) else "more" for end in both)


def _words(row: CostRow) -> str:
    return (
        f"{row.precision} by {row.method} on {row.core}, with {row.instructions:,} instructions a "
        f"frame, {row.ram_bytes:,} bytes of RAM, {row.flash_bytes:,} of flash, and an error of "
        f"{row.error:.2g} of '{row.output}' (at most {row.frames_per_s:,.0f} frames a second at "
        f"{row.clock_hz / 1e6:g} MHz, if each instruction took a cycle)"
    )


def front(rows: Sequence[CostRow]) -> list[CostRow]:
    """Return the rows of which no other one has both fewer instructions and a smaller error."""
    ordered = sorted(rows, key=lambda row: (row.instructions, row.error))
    kept = list[CostRow]()
    for row in ordered:
        if not kept or row.error < kept[-1].error:
            kept.append(row)
    return kept
