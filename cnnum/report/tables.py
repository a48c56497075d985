"""The tables of a report: every figure in them comes from its data."""

from collections.abc import Iterator, Sequence
from math import degrees

from cnnum.graph.schedule import grouped
from cnnum.report.html import Cell, table
from cnnum.report.pictures.svg import micros, plain, scientific, si
from cnnum.report.plan_cost import PlanCost
from cnnum.report.verdicts import TrueEvent, Verdict
from cnnum.scenes.events import Event
from cnnum.templating.checks import CheckResult

Row = tuple[bool, tuple[Cell, ...]]

EVENT_HEAD = ("event", "truth at", "reported at", "delay", "true direction", "reported", "verdict")
NONE = Cell("–")


def event_table(verdicts: Sequence[Verdict]) -> str:
    """Return reported events against the ground truth."""
    return table(EVENT_HEAD, (_event_row(verdict) for verdict in verdicts), style="fold")


def report_table(events: Sequence[Event]) -> str:
    """Return reported events, where nothing is known to compare them with."""
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
    return table(("what", "why", "saves a frame"), rows, style="fold")


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
        Cell(", ".join(known.channels_read) or "none"),
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
