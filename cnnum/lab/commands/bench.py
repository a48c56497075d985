"""`cnnum bench`: error against run time, throughput, latency, scenes, the peers… one or all."""

import re
import shlex
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import inf, isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar, cast

import click
from rich.text import Text

from cnnum.cli.commands.export import shape_of
from cnnum.cli.following import STOPPED
from cnnum.cli.options import force_option, json_option, results_option, together
from cnnum.cli.output import Output, progress, table
from cnnum.cli.signals import stoppable, undisturbed
from cnnum.errors import CnnumError, MissingExtraError
from cnnum.safety.values import visible

if TYPE_CHECKING:
    from cnnum.engine import Engine
    from cnnum.lab.embedded.costs import Bounds, Case


SUFFIXES = {"": 1.0, "k": 1e3, "m": 1e6, "g": 1e9}
KIB = {"": 1.0, "k": 1024.0, "m": 1024.0**2}


SEVERAL: dict[str, Any] = {"multiple": True, "metavar": "NAME"}

embedded_options = together(
    click.option(
        "--program",
        "programs",
        **SEVERAL,
        help="Program, FILE.py:FUNCTION, or several as one, such as slip,twist; may be repeated; "
        "slip and twist by default.",
    ),
    click.option("--needs", help="Outputs, such as gross_slip,slip_x; all by default."),
    click.option("--shape", "shapes", **SEVERAL, help="Array and channels; 8x8x3 by default."),
    click.option(
        "--precision", "precisions", **SEVERAL, help="q15, q7, q23 or float32; all by default."
    ),
    click.option("--method", "methods", **SEVERAL, help="auto or euler; auto by default."),
    click.option("--core", "cores", **SEVERAL, help="m0, m4 or m7; m4 by default."),
    click.option("--clock", default="168MHz", show_default=True, help="Clock of the core."),
    click.option(
        "--max-error", type=click.FloatRange(min=0, min_open=True), help="Largest error allowed."
    ),
    click.option("--ram", help="Largest RAM allowed, such as 32k."),
    click.option("--flash", help="Largest flash allowed, such as 128k."),
    click.option("--rate", help="Frame rate to reach, such as 1kHz."),
    click.option(
        "--wait-states",
        type=click.IntRange(0, 15),
        default=0,
        show_default=True,
        help="Of the flash, for the most cycles; as if there was no cache.",
    ),
    click.option(
        "--power",
        type=click.FloatRange(min=0, min_open=True),
        help="Power of the core, mW/MHz, for the energy of a frame.",
    ),
    click.option("--quick", is_flag=True, help="Measure q15 and q7 only, and score no scenes."),
    click.option(
        "--costs",
        is_flag=True,
        help="Count the costs of q15 alone, with and without DSP instructions, and write them as "
        "the table of the documentation.",
    ),
    results_option,
    force_option,
    json_option,
)
"""Options of the command."""


@dataclass(frozen=True, slots=True)
class Wanted:
    """Configurations to measure.

    Attributes
    ----------
    cases : list of Case
    clock : float
        Hz.
    scenes : int
        Of each kind, in which reports are scored.
    bounds : Bounds
    """

    cases: "list[Case]"
    clock: float
    scenes: int
    bounds: "Bounds"

    @classmethod
    def of(cls, options: Mapping[str, object]) -> "Wanted":
        """Return the runs that options ask for.

        Raises
        ------
        click.UsageError
            If one is not understood.
        UnknownNameError
            If a program, a precision, a method or a core has another name.
        """
        from cnnum.embedded.formats import precision_named
        from cnnum.embedded.lowering.builder import METHODS
        from cnnum.errors import name_error
        from cnnum.lab.embedded.cortex_m import CORES
        from cnnum.lab.embedded.costs import PRECISIONS, SCENES, USUAL, Bounds, cases
        from cnnum.scenes.arrangement import named

        def names(key: str, usual: tuple[str, ...]) -> tuple[str, ...]:
            return cast("tuple[str, ...]", options[key]) or usual

        quick, costs = bool(options["quick"]), bool(options["costs"])
        programs = names("programs", USUAL)
        measured = PRECISIONS[:1] if costs else PRECISIONS[:2] if quick else PRECISIONS
        precisions = names("precisions", measured)
        methods, cores = names("methods", ("auto",)), names("cores", ("m4",))
        for program in programs:
            for part in program.split(","):
                named(part)
        for precision in precisions:
            precision_named(precision)
        for kind, some, known in (("method", methods, METHODS), ("core", cores, CORES)):
            for name in some:
                if name not in known:
                    raise name_error(kind, name, known)
        shapes = [shape_of(text) for text in names("shapes", ("8x8x3",))]
        bounds = Bounds(
            cast("float | None", options["max_error"]) or inf,
            _amount("ram", options, KIB, "") or inf,
            _amount("flash", options, KIB, "") or inf,
            _amount("rate", options, SUFFIXES, "hz"),
        )
        clock = _amount("clock", options, SUFFIXES, "hz")
        some_cases = cases(programs, shapes, precisions, methods, cores)
        return cls(some_cases, clock, 0 if quick or costs else SCENES, bounds)

    @property
    def label(self) -> str:
        """The runs, in words."""
        cores = sorted({case[-1] for case in self.cases})
        return f"Cortex {', '.join(core.upper() for core in cores)}, counted by Unicorn"


def _amount(
    key: str, options: Mapping[str, object], suffixes: Mapping[str, float], unit: str
) -> float:
    """Return a number with a suffix; 0 where none is given."""
    given = options[key]
    if given is None:
        return 0.0
    text = str(given).strip().lower().removesuffix(unit or "b")
    match = re.fullmatch(r"(\d+(?:\.\d+)?)\s*([kmg]?)(?:i?b?)", text)
    if match is None or match[2] not in suffixes or not float(match[1]) > 0.0:
        example = "168MHz" if unit else "32k"
        raise click.UsageError(
            f"--{key} must be a number above 0, such as {example}, got '{given!s:.40}'."
        )
    return float(match[1]) * suffixes[match[2]]


FAILED = 2
"""Exit code where a benchmark could not be run, as it would be of that benchmark alone."""


def run_all(
    ctx: click.Context,
    benchmarks: Mapping[str, click.Command],
    options: Mapping[str, object],
    output: Output,
) -> int:
    """Run benchmarks with the same options, name those that did not end, return a code.

    Parameters
    ----------
    ctx : click.Context
        Of the command that runs them.
    benchmarks : mapping
        In the order in which they run.
    options : mapping
        By parameter; others of a benchmark are as if they had not been given.
    output : Output

    Returns
    -------
    int
        0 where all have come to their end but for those that want an extra that is not
        installed. 130 where one was stopped, after which none begins. 2 where one has failed.
    """
    unfinished: dict[str, str] = {}
    names, code = list(benchmarks), 0
    for place, name in enumerate(names):
        output.show(Text(f"\ncnnum bench {name}", style="bold"))
        try:
            if _invoke(ctx, benchmarks[name], options) == STOPPED:
                unfinished[name] = "It was stopped."
                unfinished |= dict.fromkeys(names[place + 1 :], "It was not begun.")
                code = STOPPED
                break
        except MissingExtraError as missing:
            unfinished[name] = str(missing)
        except CnnumError as error:
            unfinished[name], code = str(error), FAILED
            click.echo(visible(f"cnnum bench {name}: {error}"), err=True)
    _summarise(output, names, unfinished)
    return code


def _invoke(ctx: click.Context, benchmark: click.Command, options: Mapping[str, object]) -> object:
    try:
        taken = {parameter.name for parameter in benchmark.params}
        given = {name: value for name, value in options.items() if name in taken}
        return ctx.invoke(benchmark, **given)
    except KeyboardInterrupt:  # before its first row, or after its last
        return STOPPED


def _summarise(output: Output, names: Sequence[str], unfinished: Mapping[str, str]) -> None:
    done = [name for name in names if name not in unfinished]
    output.record({"kind": "benchmarks", "run": done, "unfinished": unfinished})
    output.show(f"\nRun to the end: {', '.join(done) or 'nothing'}.\nNot run to the end:")
    lines = [f"  {name}: {reason}" for name, reason in unfinished.items()]
    output.show(*(lines or ["  nothing"]))


Function = TypeVar("Function", bound=Callable[..., Any])


@click.group("bench", context_settings={"help_option_names": ["-h", "--help"]})
def command() -> None:
    """Measure speed and error, and write a picture, the data and a page.

    Every benchmark names the cases that it leaves out, and why.
    """


_options = together(
    click.option("--device", help="Part of the OpenCL device's name."),
    click.option("--quick", is_flag=True, help="Measure fewer cases with fewer repeats."),
    results_option,
    force_option,
    json_option,
)


def _engine(device: str | None) -> "Engine":
    from cnnum.engine import Engine

    return Engine(device=device)


def _report(
    name: str,
    results: Iterable[object],
    total: int | None,
    device: str,
    out: Path | None,
    force: bool,
    as_json: bool,
    omissions: tuple[str, ...] = (),
) -> int:
    """Print rows as they come, and write the report of those that came.

    A string is something left out, and None a step without a message. A list has rows that come at
    once. Ctrl-C and SIGTERM end the benchmark, not the report.
    """
    output, rows, left_out = Output(as_json), list[Mapping[str, object]](), list(omissions)
    if out is not None:
        _refuse(out, name, force=force)
    stopped = not _collect(name, results, total, output, rows, left_out, out, force)
    if stopped:
        left_out.append("It was stopped here: all later rows are missing.")
    output.record({"kind": "omissions", "bench": name, "omissions": left_out})
    if rows:
        output.show(f"On {device}.", _table(rows), spare=SPARES.get(name, SPARE))
    output.show("Left out:", *(f"  {text}" for text in left_out or ["nothing"]))
    if out is not None and rows:
        from cnnum.lab.bench.page import write_report
        from cnnum.lab.bench.records import rows_file

        with undisturbed():
            paths = write_report(out, name, rows, device, left_out, _asked(name), force=force)
            rows_file(out, name).unlink(missing_ok=True)
        output.show(f"Wrote {', '.join(str(path) for path in paths)}.")
    return STOPPED if stopped else 0


def _refuse(out: Path, name: str, *, force: bool) -> None:
    """Refuse, before all is measured, a folder or a file that cannot be written then."""
    from cnnum.errors import ReportError
    from cnnum.lab.bench.page import report_files
    from cnnum.lab.bench.records import rows_file
    from cnnum.safety.files import make_folder, refuse_target, sentences

    with sentences(out, ReportError):
        make_folder(out)
    for path in (rows_file(out, name), *report_files(out, name)):
        refuse_target(path, force=force)


def _asked(name: str) -> str:
    """Return the command as it was typed, but for options that do not change the measurement."""
    words, context = ["cnnum", "bench", name], click.get_current_context(silent=True)
    for option in [] if context is None else context.command.params:
        value = cast(click.Context, context).params.get(str(option.name))
        unsaid = value in (None, False, ()) or value == option.default
        if unsaid or option.name in ("out", "force", "as_json"):
            continue
        for item in cast("tuple[object, ...]", value) if option.multiple else (value,):
            words += [option.opts[0]] if item is True else [option.opts[0], str(item)]
    return shlex.join(words)


def _collect(
    name: str,
    results: Iterable[object],
    total: int | None,
    output: Output,
    rows: list[Mapping[str, object]],
    left_out: list[str],
    out: Path | None,
    force: bool,
) -> bool:
    """Gather rows and omissions; return whether that came to its end.

    With a folder, rows also go to a file there at once, one line per row: it is all that is left of
    a run that is killed.
    """
    from cnnum.lab.bench.records import append_row, as_row

    with progress(name, total, as_json=output.as_json) as steps:
        try:
            with stoppable():
                for item in results:
                    if isinstance(item, str):
                        left_out += [] if item in left_out else [item]
                    elif item is not None:
                        several = cast("list[object]", item) if isinstance(item, list) else [item]
                        for row in several:
                            rows.append(as_row(row))
                            output.record({"kind": name, **rows[-1]})
                            append_row(out, name, rows, force=force)
                    steps.advance()
        except KeyboardInterrupt:
            return False
    return True


SPARE = (
    "peer_version", "compared", "steps", "pictures", "spread", "launches", "channels", "maps",
    "bytes_in", "bytes_out", "events", "saved_us", "launch_us", "ops", "peer_method",
    "host_to_host_per_s", "flops", "peak_flops", "precision", "ordinary_seconds", "seconds",
    "peer_seconds", "method", "empty_tail", "first_us", "clock_hz", "stack_bytes", "wrong",
    "output",
)  # fmt: skip
"""Columns that go first where a terminal has no room for all."""

SPARES = {
    "embedded": (
        "wrong", "clock_hz", "stack_bytes", "gnu_flash_bytes", "gnu_instructions",
        "plain_instructions",
        "reports_differ", "false_reports", "twist_recall", "slip_recall", "flags_differ", "core",
        "output", "cycles_least", "cycles_most", "frames_per_s", "flash_bytes",
    )
}  # fmt: skip
"""The same of a benchmark whose rows differ in precision and method."""


def _table(rows: list[Mapping[str, object]]) -> Any:
    """Return all rows; their device stands above the table, unless they differ in it."""
    from cnnum.lab.bench.page import cell

    same = len({row.get("device") for row in rows}) == 1
    kept = [key for key in rows[0] if key != "device" or not same]
    made = table(*(key if n == 0 else f">{key}" for n, key in enumerate(kept)))
    for row in rows:
        made.add_row(*(cell(row[key]) for key in kept))
    return made


@command.command("work-precision")
@click.option(
    "--case",
    "names",
    multiple=True,
    help="Template or program; by default all, or three with --quick.",
)
@_options
def work_precision(
    names: tuple[str, ...],
    device: str | None,
    quick: bool,
    out: Path | None,
    force: bool,
    as_json: bool,
) -> int:
    """Measure error against run time by template or program, method, precision and engine."""
    from cnnum.lab.bench.work_precision import cases, count, engines_here, measure_cases, omissions

    chosen, engines = names or cases(quick=quick), engines_here(device, quick=quick)
    result = measure_cases(chosen, engines, quick=quick)
    label = engines[0].device
    total = count(chosen, engines, quick=quick)
    left_out = omissions(chosen, quick=quick)
    return _report("work-precision", result, total, label, out, force, as_json, left_out)


@command.command("truth")
@_options
def truth(device: str | None, quick: bool, out: Path | None, force: bool, as_json: bool) -> int:
    """Measure the error against the continuum over run time, and delay and misses of events.

    The total error is divided into the error of the lattice and the error of the run on it.
    """
    from cnnum.lab.bench.true_error import OMISSIONS, measure_true_error

    label = _engine(device).device
    rows = measure_true_error(device, quick=quick)
    return _report("truth", rows, None, label, out, force, as_json, OMISSIONS)


@command.command("throughput")
@_options
def throughput(
    device: str | None, quick: bool, out: Path | None, force: bool, as_json: bool
) -> int:
    """Measure cell updates per second, as a share of the device's multiply-add peak."""
    from cnnum.lab.bench.throughput import CASES, measure_throughput

    engine = _engine(device)
    result = measure_throughput(engine, quick=quick)
    return _report("throughput", result, len(CASES), engine.device, out, force, as_json)


@command.command("latency")
@click.option("--frames", default=20_000, type=click.IntRange(min=200), help="Frames per program.")
@click.option("--engine", "name", help="Engine to measure; the usual one of this machine if unset.")
@_options
def latency(
    frames: int,
    name: str | None,
    device: str | None,
    quick: bool,
    out: Path | None,
    force: bool,
    as_json: bool,
) -> int:
    """Measure one frame from host memory to host events, and an empty launch with its copies."""
    from cnnum.engine import Engine
    from cnnum.lab.bench.latency import OMISSIONS, measure_latency

    engine = Engine(name, device=device)
    rows = measure_latency(engine, count=2000 if quick else frames)
    return _report("latency", rows, None, engine.device, out, force, as_json, OMISSIONS)


@command.command("scenes")
@click.option(
    "--rounds", default=8, type=click.IntRange(min=1), help="Number of passes over the frames."
)
@_options
def scenes(
    rounds: int, device: str | None, quick: bool, out: Path | None, force: bool, as_json: bool
) -> int:
    """Measure the cost of a frame for scenes that need one event and one that needs all."""
    from cnnum.lab.bench.scene_costs import OMISSIONS, SCENES, measure_scenes

    engine = _engine(device)
    turns = 1 if quick else rounds
    rows = measure_scenes(engine, rounds=turns)
    total = turns + 1 + len(SCENES)
    return _report("scenes", rows, total, engine.device, out, force, as_json, OMISSIONS)


@command.command("compile")
@_options
def compile_time(
    device: str | None, quick: bool, out: Path | None, force: bool, as_json: bool
) -> int:
    """Measure how long a plan of a dozen 8×8 templates takes to build, without and with caches."""
    from cnnum.lab.bench.compile_time import STARTS, measure_compile

    engine, repeats = _engine(device), 1 if quick else 3
    rows = measure_compile(engine, repeats=repeats)
    return _report("compile", rows, repeats * STARTS + 1, engine.device, out, force, as_json)


@command.command("denormals")
@_options
def denormals(device: str | None, quick: bool, out: Path | None, force: bool, as_json: bool) -> int:
    """Measure runs whose states and inputs decay below the smallest normal number."""
    from cnnum.lab.bench.denormals import COUNT, measure_denormals

    engine = _engine(device)
    result = measure_denormals(engine, quick=quick)
    return _report("denormals", result, COUNT, engine.device, out, force, as_json)


@command.command("fusing")
@_options
def fusing(device: str | None, quick: bool, out: Path | None, force: bool, as_json: bool) -> int:
    """Measure tactile programs with and without fused linear operations."""
    from cnnum.lab.bench.fusing import measure_fusing

    engine = _engine(device)
    rows = measure_fusing(engine, quick=quick)
    return _report("fusing", rows, None, engine.device, out, force, as_json)


@command.command("scaling")
@_options
def scaling(device: str | None, quick: bool, out: Path | None, force: bool, as_json: bool) -> int:
    """Measure cost against array, batch, radius, layers and taxel grid."""
    from cnnum.lab.bench.scaling import measure_scaling, points

    engine = _engine(device)
    result = measure_scaling(engine, quick=quick)
    return _report("scaling", result, len(points(quick=quick)), engine.device, out, force, as_json)


@command.command("peers")
@_options
def peers(device: str | None, quick: bool, out: Path | None, force: bool, as_json: bool) -> int:
    """Measure other libraries on the same work to the same error; missing ones are named."""
    from cnnum.lab.bench.peer_runs import measure_peers

    engine = _engine(device)
    result = measure_peers(engine, quick=quick)
    return _report("peers", result, None, engine.device, out, force, as_json)


@command.command("answers")
@_options
def answers(device: str | None, quick: bool, out: Path | None, force: bool, as_json: bool) -> int:
    """Compare the run time of templates with OpenCV and SciPy functions of the same result."""
    from cnnum.lab.bench.answers import COUNT, measure_answers

    engine = _engine(device)
    result = measure_answers(engine, quick=quick)
    return _report("answers", result, COUNT, engine.device, out, force, as_json)


@command.command("design")
@_options
def design(device: str | None, quick: bool, out: Path | None, force: bool, as_json: bool) -> int:
    """Measure learning templates from pictures to the same loss, with celnn's two ways and ours."""
    from cnnum.lab.bench.peers.design_race import measure_design

    engine = _engine(device)
    result = measure_design(quick=quick)
    return _report("design", result, None, engine.device, out, force, as_json)


@command.command("embedded")
@embedded_options
def embedded(**options: Any) -> int:
    """Measure programs on a Cortex-M: instructions, RAM, flash, error and events.

    Instructions are counted; cycles are an interval by Arm's manuals, and infinite for an M7. With
    bounds, the command names the cheapest configuration within them, or the nearest one. With
    --rate it says whether frames fit: yes, no, or unsure.
    """
    from cnnum.lab.embedded.costs import (
        CostRow,
        answers,
        fit_sentence,
        measure_costs,
        page_table,
    )

    for key in ("power", "max_error"):
        if options[key] is not None and not isfinite(options[key]):
            name = key.replace("_", "-")
            raise click.UsageError(f"--{name} must be a finite number, got {options[key]:g}.")
    wanted, kept = Wanted.of(options), list[CostRow]()
    if options["power"] is not None and not wanted.bounds.rate:
        raise click.UsageError("--power gives the energy of a frame with --rate only: add --rate.")
    needs, wait_states = options["needs"], int(options["wait_states"])
    names = None if needs is None else tuple(name.strip() for name in needs.split(","))

    def rows() -> Iterator[CostRow | str]:
        for row in measure_costs(
            wanted.cases,
            wanted.clock,
            wanted.scenes,
            names,
            wait_states,
            only_costs=bool(options["costs"]),
        ):
            if isinstance(row, CostRow):
                kept.append(row)
            yield row

    out, force, as_json = options["out"], bool(options["force"]), bool(options["as_json"])
    code = _report("embedded", rows(), len(wanted.cases), wanted.label, out, force, as_json)
    output, rate, sentences = Output(as_json), wanted.bounds.rate, list[str]()
    if wanted.bounds.asked and code == 0:
        sentences += answers(kept, wanted.bounds)
    if rate and code == 0:
        sentences += [fit_sentence(row, rate, options["power"]) for row in kept]
    if options["quick"]:
        sentences.append("--quick leaves out q23, float32 and the scores of slip and twist.")
    if sentences:
        output.record({"kind": "answer", "answers": sentences})
        output.show(*sentences)
    if options["costs"] and kept and not as_json:
        click.echo("\n".join(page_table(kept, (200.0, rate or 1000.0))))
    return code


@command.command("all")
@_options
@click.pass_context
def every(
    ctx: click.Context,
    device: str | None,
    quick: bool,
    out: Path | None,
    force: bool,
    as_json: bool,
) -> int:
    """Run every benchmark with the same options.

    A benchmark whose extra is not installed is named and left out. If another one fails, the rest
    still runs and the exit code is 2. Ctrl-C and SIGTERM end the current benchmark, whose report
    is written, and start no further one.
    """
    _engine(device)  # a wrong name shall not fail once a benchmark
    benchmarks = {
        name: benchmark
        for name, benchmark in command.commands.items()
        if benchmark is not ctx.command
    }
    given = {"device": device, "quick": quick, "out": out, "force": force, "as_json": as_json}
    return run_all(ctx, benchmarks, given, Output(as_json))
