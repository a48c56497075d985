"""The sections of a report, each from its data alone, and the page that is written from them."""

from collections.abc import Iterator, Sequence
from html import escape
from importlib import resources
from math import degrees
from pathlib import Path

import numpy as np

from cnnum.errors import ReportError
from cnnum.graph.schedule import grouped
from cnnum.report.charts import (
    check_chart,
    ladder_chart,
    ladder_style,
    latency_chart,
    micros,
    plain,
    scientific,
    series_of,
    series_style,
    si,
    symbol,
)
from cnnum.report.html import Cell, both, glyph, legend, paragraph, section, swatch, table
from cnnum.report.pictures import (
    MapScale,
    arrow_key,
    colour_bar,
    filmstrip,
    key_frames,
    shown_unit,
    timeline,
)
from cnnum.report.record import (
    MAX_DELAY,
    MAX_TURN,
    PlanCost,
    ReportData,
    SceneRecord,
    TrueEvent,
    Verdict,
    to_json,
)
from cnnum.report.work_precision import WorkPrecision
from cnnum.safety.files import write_whole
from cnnum.scenes.events import Event
from cnnum.sharing import style_rules
from cnnum.templating.checks import CheckResult

Row = tuple[bool, tuple[Cell, ...]]

EVENT_HEAD = ("event", "truth at", "reported at", "delay", "true direction", "reported", "verdict")
NONE = Cell("–")


def event_table(verdicts: Sequence[Verdict]) -> str:
    """Return reported events against the ground truth."""
    return table(EVENT_HEAD, (_event_row(verdict) for verdict in verdicts), style="fold")


def report_table(events: Sequence[Event]) -> str:
    """Return reported events, if there is no ground truth to compare them with."""
    rows = (
        (False, (Cell(event.title, strong=True), _when(event), Cell(_direction(event))))
        for event in events
    )
    return table(("event", "reported at", "direction"), rows, style="fold")


def check_table(checks: Sequence[CheckResult]) -> str:
    """Return every check, the nearest to its tolerance first."""
    head = ("template", "closed form", "engine", "method", "error", "tolerance", "time", "verdict")
    worst = sorted(checks, key=lambda c: (c.passed, -c.error / c.tolerance, c.template.lower()))
    return table(head, (_check_row(check) for check in worst), style="tall")


def plan_table(plans: Sequence[PlanCost]) -> str:
    """Return the cost of a frame under each plan."""
    head = ("plan", "p50", "p99", "operations", "arithmetic", "to device", "back", "channels read")
    return table(head, (_plan_row(plan) for plan in plans), style="fold")


def left_out_table(plan: PlanCost) -> str:
    """Return the operations that a plan leaves out."""
    rows = (
        (False, (Cell(x.what, style="text"), Cell(x.why, style="text"), Cell(x.saves)))
        for x in grouped(plan.explanation.left_out)
    )
    return table(("what", "why", "saves per frame"), rows, style="fold")


def _event_row(verdict: Verdict) -> Row:
    truth, reported = verdict.truth, verdict.reported
    delay = NONE if verdict.delay is None else Cell(_frames(verdict.delay))
    mark = Cell(f"✓ {verdict.text}", style="yes") if verdict.passed else _no(verdict.text)
    cells = (
        Cell(verdict.title, strong=True),
        NONE if truth is None else _when(truth),
        NONE if reported is None else _when(reported),
        delay,
        Cell(_direction(truth)),
        Cell(_direction(reported), _turn(verdict)),
        mark,
    )
    return not verdict.passed, cells


def _no(words: str) -> Cell:
    return Cell(f"✗ {words}", style="no")


def _when(event: TrueEvent | Event) -> Cell:
    return Cell(f"{event.time:.3f} s", f"frame {event.frame}")


def _frames(delay: int) -> str:
    sign = "+" if delay > 0 else "−" if delay < 0 else ""
    return f"{sign}{abs(delay)} frame{'' if abs(delay) == 1 else 's'}"


def _direction(event: TrueEvent | Event | None) -> str:
    if event is not None and event.sense:
        return "↻ x to y" if event.sense > 0 else "↺ y to x"
    if event is None or event.direction is None:
        return "–"
    return f"{degrees(event.direction):.1f}°".replace("-", "−")


def _turn(verdict: Verdict) -> str:
    if verdict.turn is None:
        return ""
    turn = round(degrees(verdict.turn), 1)
    return f"{turn:+.1f}°".replace("-", "−") if turn else "0.0°"


def _check_row(check: CheckResult) -> Row:
    cells = (
        Cell(check.template, strong=True),
        Cell(check.check),
        Cell(f"{check.engine} {check.precision}"),
        Cell(check.method),
        Cell(scientific(check.error)),
        Cell(scientific(check.tolerance)),
        Cell(si(check.seconds, "s")),
        Cell("✓ passed", style="yes") if check.passed else _no("failed"),
    )
    return not check.passed, cells


def _plan_row(plan: PlanCost) -> Row:
    known = plan.explanation
    launches = f"{known.launches} launch{'' if known.launches == 1 else 'es'}"
    cells = (
        Cell(plan.label, f"{plan.frames} frames", strong=True),
        Cell(micros(plan.p50_us)),
        Cell(micros(plan.p99_us)),
        Cell(str(known.ops), f"at most {known.ops_most}, {launches}"),
        Cell(si(known.flops, "flops"), f"at most {si(known.flops_most, 'flops')}"),
        Cell(f"{known.bytes_in} B"),
        Cell(f"{known.bytes_out} B", ", ".join(known.maps_read_back)),
        Cell(", ".join(known.channels_read) or "none", style="names"),
    )
    return False, cells


def ratio_sentence(plans: Sequence[PlanCost]) -> Iterator[str]:
    """Yield the time of each plan after the first as a share of the first one's."""
    first = plans[0]
    for plan in plans[1:]:
        share = plain(100.0 * plan.p50_us / first.p50_us, 2)
        yield (
            f"A frame of the plan “{plan.label}” takes {micros(plan.p50_us)}, {share} % of the "
            f"{micros(first.p50_us)} of “{first.label}” (medians)."
        )


WIDE, NARROW = 920.0, 340.0


def head(data: ReportData) -> str:
    """Return the title, and the outcome."""
    record = data.record
    rows, cols = record.shape
    source = "whose ground truth is known" if record.truth else "without a ground truth"
    seconds = float(record.times[-1] - record.times[0]) if record.frames else 0.0
    lead = (
        "cnnum emulates a cellular-wave computer, the CNN universal machine, on the frames of a "
        "tactile array: a program of small templates turns them into contacts, slip, twist and "
        f"release. This page is the record of one run of the scene “{record.name}”: "
        f"{record.frames} frames in {plain(seconds)} s of an array of {rows} × {cols} taxels "
        f"{source}. It shows the reported events, and the error of every template."
    )
    tiles = "".join(_tile(*tile) for tile in _tiles(data))
    return (
        f'<header><p class="eyebrow">cnnum {escape(dict(record.environment.versions)["cnnum"])}'
        f" · {escape(_day(record.environment.date))} · {escape(record.environment.device)}</p>"
        f"<h1>{escape(_headline(data))}</h1>{paragraph(lead, 'lead')}"
        f'<ul class="tiles">{tiles}</ul></header>'
    )


def _tile(figure: str, words: str, good: bool) -> str:
    kind = "" if good else ' class="bad"'
    return f"<li{kind}><b>{escape(figure)}</b><span>{escape(words)}</span></li>"


def _day(date: str) -> str:
    return f"{date[:10]} {date[11:16]} UTC"


def _headline(data: ReportData) -> str:
    verdicts = data.verdicts
    if not verdicts:
        return f"{len(data.record.events)} events in the scene “{data.record.name}”"
    good = sum(v.passed for v in verdicts)
    if good == len(verdicts):
        return f"All {good} events of “{data.record.name}” reported in time"
    return f"{len(verdicts) - good} of {len(verdicts)} events of “{data.record.name}” are wrong"


def _tiles(data: ReportData) -> list[tuple[str, str, bool]]:
    tiles: list[tuple[str, str, bool]] = []
    verdicts, summary = data.verdicts, data.record.summary
    if verdicts:
        true = [v for v in verdicts if v.truth]
        good = sum(v.passed for v in true)
        tiles.append(
            (
                f"{good} of {len(true)}",
                "events right",
                good == len(true),
            )
        )
        false = len(verdicts) - len(true)
        tiles.append((str(false), "false reports", false == 0))
    tiles.append((micros(summary.p50_us), f"a frame (p50), p99 {micros(summary.p99_us)}", True))
    if data.checks:
        good = sum(c.passed for c in data.checks)
        words = "template checks passed"
        tiles.append((f"{good} of {len(data.checks)}", words, good == len(data.checks)))
    bad = summary.bad_frames + summary.counters.dropped
    tiles.append((str(bad), f"bad or dropped of {summary.frames} frames", bad == 0))
    return tiles


def story(number: int, data: ReportData) -> str:
    """Return the scene as a timeline."""
    record, verdicts = data.record, data.verdicts
    words = (
        "The events on the array and the reports of the program. The program sees only the frames "
        "of the taxels; the curves and the coloured bars are the ground truth."
        if record.truth
        else "The reports of the program; there is no ground truth to compare them with."
    )
    key = legend(
        (
            swatch("truth", "bar: ground truth"),
            swatch("seen", "thin line: the program's flag"),
            f"{glyph('reported', 'M6 1l5 9h-10z')}reported, with its delay in frames",
            f"{glyph('mark', 'M6 -2v16')}true beginning or end",
        )
    )
    pictures = both(timeline(record, verdicts, WIDE), timeline(record, verdicts, NARROW))
    return section(number, "story", "The scene in time", paragraph(words), key, pictures)


def frames(number: int, data: ReportData) -> str:
    """Return the key frames, and the player."""
    record = data.record
    scale = MapScale.of(record)
    calibrated = (
        "the strain at the taxels: compression is positive, and arrows point along the pull"
        if record.unit == "strain"
        else "the array's own values"
    )
    words = (
        "Frames as the program receives them, seen from above, with x to the right and y "
        f"downwards. They show {calibrated}. All pictures have the same scale."
    )
    items = [
        colour_bar(record, scale),
        arrow_key(record, scale),
        f"{glyph('taxel', 'M6 6h0')}taxel",
    ]
    if record.pitch is not None and "contact_radius" in record.truth:
        items += [swatch("ring", "true contact"), swatch("ring dashed", "true stick region")]
    seen = {"contact_map": ("cell", "contact"), "stick_map": ("cell dashed", "stick region")}
    for name, (style, what) in seen.items():
        if name in record.maps():
            items.append(swatch(style, f"{what}, as the program saw it"))
    strip = filmstrip(record, scale)
    return section(
        number, "frames", "Key frames", paragraph(words), legend(items), strip, _player(data, scale)
    )


def _player(data: ReportData, scale: MapScale) -> str:
    rows, cols = data.record.shape
    keys = key_frames(data.record)
    first = keys[len(keys) // 2].frame
    _, unit = shown_unit(data.record)
    return (
        '<div class="player" id="player" hidden>'
        f'<canvas width="{640}" height="{round(640 * rows / cols)}" data-normal="{scale.normal:g}" '
        f'data-shear="{scale.shear:g}" data-first="{first}" role="img" '
        f'aria-label="The frame that the slider stands at, in {escape(unit)}"></canvas>'
        "<div><h3>Every frame</h3><dl></dl>"
        '<div class="controls"><input type="range" min="0" value="0" aria-label="Frame">'
        '<button type="button">Play</button><select aria-label="Speed">'
        '<option value="0.1">0.1 ×</option><option value="0.25">0.25 ×</option>'
        '<option value="1" selected>real time</option></select></div></div></div>'
    )


def events(number: int, data: ReportData) -> str:
    """Return reported events against the ground truth."""
    title = "Events against the ground truth"
    if not data.record.truth:
        words = "The source of these frames has no ground truth, so the reports stand alone."
        listed = report_table(data.record.events)
        return section(number, "events", "Events", paragraph(words), listed)
    words = (
        f"A report is right if it comes within {MAX_DELAY} frames of the truth, points within "
        f"{np.degrees(MAX_TURN):.0f}° of it and turns the same way. A gross slip may be reported "
        "up to 0.3 s after the truth, and a twist from 0.5 s before to 0.3 s after half of the "
        "contact slips. Directions are angles from x (right) towards y (down). A report of "
        "something that did not happen is listed as false."
    )
    return section(number, "events", title, paragraph(words), event_table(data.verdicts))


def errors(number: int, data: ReportData) -> str:
    """Return each template's error against its run time."""
    parts = [*_checks(data), *_ladders(data)]
    if not parts:
        parts = [paragraph("No template was checked in this run.", "note")]
    return section(number, "errors", "Error against run time", *parts)


def _checks(data: ReportData) -> list[str]:
    checks = data.checks
    if not checks:
        return []
    words = (
        "Every template runs on pictures whose exact answer is known from a closed form. It "
        "shares no code with the engines. Digital templates are right or wrong and mostly end at "
        "an error of exactly 0."
    )
    series = {series_of(c): series_style(c.engine, c.precision) for c in checks}
    items = [f"{symbol(style)}{escape(name)}" for name, style in series.items()]
    if not all(c.passed for c in checks):
        items.append(f"{symbol('wrong')}outside its tolerance")
    pictures = both(check_chart(checks, WIDE), check_chart(checks, NARROW))
    note = "Sorted by error as a share of the tolerance. The time is the median of one run."
    table = check_table(checks)
    return [paragraph(words), legend(items), pictures, paragraph(note, "note"), table]


def _ladders(data: ReportData) -> list[str]:
    points = data.work_precision
    if not points:
        return []
    words = (
        "The same templates with other methods, tolerances and steps, compared with the float64 "
        "reference: further down and to the left is better. Times are per picture in a batch of "
        f"{max(p.pictures for p in points)}."
    )
    methods = dict.fromkeys(p.method for p in points)
    items = [f"{symbol(f'm-{method}')}{escape(method)}" for method in methods]
    series = dict.fromkeys((p.engine, p.precision) for p in points)
    items += [f"{symbol(ladder_style('any', *key))}{escape(', '.join(key))}" for key in series]
    cases = dict.fromkeys(p.case for p in points)
    charts = "".join(f"{_ladder(points, case)}" for case in cases)
    panels = f'<div class="panels">{charts}</div>'
    return ["<h3>Other methods</h3>", paragraph(words), legend(items), panels]


def plans(number: int, data: ReportData) -> str:
    """Return the operations left out of each plan, and the cost of a frame."""
    words = (
        "A scene names the events it wants. Operations that do not contribute to them are left "
        "out, channels that are not read are neither decoded nor copied, and equal operations run "
        "only once. The numbers of operations are per frame, with the body of each loop counted "
        "once; “at most” counts every loop up to its limit."
    )
    if not data.plans:
        note = paragraph("No plan was timed in this run.", "note")
        return section(number, "plans", "Left out", paragraph(words), note)
    parts = [paragraph(words), *(paragraph(s) for s in ratio_sentence(data.plans))]
    parts.append(plan_table(data.plans))
    for plan in data.plans:
        count = len(plan.explanation.left_out)
        parts.append(f"<h3>Left out of “{escape(plan.label)}”</h3>")
        parts.append(left_out_table(plan) if count else paragraph("Nothing.", "note"))
    return section(number, "plans", "Left out", *parts)


def latency(number: int, data: ReportData) -> str:
    """Return how long frames took."""
    seconds, summary = data.record.seconds, data.record.summary
    if not np.isfinite(seconds).any():
        none = paragraph("No frame ran.", "note")
        return section(number, "latency", "Latency of one frame", none)
    words = (
        "The time from a frame in host memory to its events: conversion, copy to the device, one "
        "run of the program, and copy back. Half of the frames took at most "
        f"{micros(summary.p50_us)}, 99 % at most {micros(summary.p99_us)}."
    )
    pictures = both(latency_chart(seconds, WIDE), latency_chart(seconds, NARROW))
    return section(number, "latency", "Latency of one frame", paragraph(words), pictures)


def _ladder(points: Sequence[WorkPrecision], case: str) -> str:
    drawn = both(ladder_chart(points, case, WIDE / 2 - 15.0), ladder_chart(points, case, NARROW))
    return f"<div>{drawn}</div>"


COMMANDS = (
    ("cnnum demo", "this page again, measured anew"),
    ("cnnum plan contact", "the operations of a scene that wants only contacts"),
    ("cnnum run my_scene.toml", "your own scene: its array, its program and the events it wants"),
    ("cnnum templates list", "the template library; show NAME prints a template, check checks all"),
    ("cnnum devices", "platforms and devices, with their measured peak"),
)


def further(number: int, data: ReportData) -> str:
    """Return suggestions for further steps."""
    width = max(len(command) for command, _ in COMMANDS)
    rows = "\n".join(
        f"{escape(command.ljust(width))}  <i>{escape(words)}</i>" for command, words in COMMANDS
    )
    words = (
        "Each command has the options --json and --help. The page contains its data as JSON, in "
        "the element with the id “data”: series with seven digits, and maps as 16-bit integers."
    )
    return section(number, "further", "How to go on", f"<pre>{rows}</pre>", paragraph(words))


def foot(data: ReportData) -> str:
    """Return the place, time and tools of the measurement."""
    here = data.record.environment
    versions = ", ".join(f"{name} {number}" for name, number in here.versions)
    engine = f"{data.record.explanation.engine}, {data.record.explanation.precision}"
    rows = (
        ("Date", here.date),
        ("Machine", here.machine),
        ("System", here.system),
        ("Device", here.device),
        ("Engine", engine),
        ("Versions", versions),
    )
    listed = "".join(f"<dt>{escape(n)}</dt><dd>{escape(v)}</dd>" for n, v in rows)
    return f"<footer><dl>{listed}</dl></footer>"


def page(data: ReportData) -> str:
    """Return a whole HTML document that needs nothing from outside itself."""
    title = f"cnnum: the scene “{data.record.name}”"
    parts = (
        "<!DOCTYPE html>\n",
        '<html lang="en"><head><meta charset="utf-8"><meta name="generator" content="cnnum">',
        f"<title>{escape(title)}</title>",
        '<meta name="viewport" content="width=device-width, initial-scale=1">',
        f"<style>{_resource('style.css')}{style_rules()}</style></head><body>",
        head(data),
        f"<main>{_body(data)}</main>",
        foot(data),
        f'<script type="application/json" id="data">{to_json(data)}</script>',
        f"<script>{_resource('player.js')}</script></body></html>\n",
    )
    return "".join(parts)


def _body(data: ReportData) -> str:
    chosen = (
        story,
        frames,
        events,
        errors,
        plans,
        latency,
        further,
    )
    return "".join(part(number, data) for number, part in enumerate(chosen, start=1))


def _resource(name: str) -> str:
    return (resources.files("cnnum.report") / name).read_text(encoding="utf-8")


def write_demo_report(
    path: str | Path,
    record: SceneRecord,
    checks: Sequence[CheckResult] = (),
    work_precision: Sequence[WorkPrecision] = (),
    plans: Sequence[PlanCost] = (),
    *,
    force: bool = False,
) -> None:
    """Write the results of a scene as one self-contained HTML file.

    Parameters
    ----------
    path : str or Path
    record : SceneRecord
        From a `SceneRecorder` that was given every moment of the scene.
    checks : sequence of CheckResult
        Checks of the templates, on any number of engines.
    work_precision : sequence of WorkPrecision
        Results of `measure_work_precision` for a few templates.
    plans : sequence of PlanCost
        The scene's own first; the others are compared with it.
    force : bool
        Whether a file that is there, and is no report of cnnum, is replaced.

    Raises
    ------
    ReportError
        If there is no frame to show, another file is there, or it cannot be written.
    """
    if record.frames == 0:
        raise ReportError(f"The scene '{record.name}' had no frame; a report needs at least one.")
    data = ReportData(record, tuple(checks), tuple(work_precision), tuple(plans))
    content = page(data).encode("utf-8")
    write_whole(Path(path), content, force=force)
