"""Reported events against the ground truth: found, missed, late, wrong way, or not there at all."""

from collections.abc import Iterator
from dataclasses import dataclass
from math import atan2, degrees, isfinite, pi, remainder

import numpy as np

from cnnum.report.record import SceneRecord
from cnnum.scenes.events import Event, titled

MAX_DELAY = 5
"""Frames that a report may be early or late."""

MAX_TURN = pi / 18
"""rad, 10°: how far a reported direction may be from the true one."""

MATCH_WITHIN = 0.6
"""s, beyond which a report and a true event are held for two different things."""


@dataclass(frozen=True, slots=True)
class Lane:
    """A kind of event, and the column of the ground truth that holds while it lasts.

    Attributes
    ----------
    kind, phase : str
        Of the event that begins it; the phase is empty for all but slip.
    want : str
        The wants of a scene that expects it.
    truth : str
        Column of the ground truth.
    flag : str
        Output of the program.
    ends : str
        Kind of the event when it ends; none where empty.
    early, late : float
        s, that a report may be early or late where that is more than `MAX_DELAY` frames.
    """

    kind: str
    phase: str
    want: str
    truth: str
    flag: str
    ends: str = ""
    early: float = 0.0
    late: float = 0.0

    @property
    def title(self) -> str:
        """Name for people."""
        return titled(self.phase, self.kind)


LANES = (
    Lane("contact", "", "contact", "contact", "contact", ends="release"),
    Lane("slip", "incipient", "slip", "incipient", "incipient_slip"),
    # a pattern that moves is seen after some 0.1 mm; a shear that turns before half of it slips
    Lane("slip", "gross", "slip", "slip", "gross_slip", late=0.3),
    Lane("twist", "", "twist", "twist_slip", "twist", early=0.5, late=0.3),
)


@dataclass(frozen=True, slots=True)
class TrueEvent:
    """Something that really began or ended.

    Attributes
    ----------
    kind, phase : str
    frame : int
    time : float, s
    direction : float or None
        rad; of a gross slip that of the sliding, of an incipient one that of the shear force.
    sense : int or None
        Of a twist: +1 from x towards y, −1 the other way.
    """

    kind: str
    phase: str
    frame: int
    time: float
    direction: float | None = None
    sense: int | None = None

    @property
    def title(self) -> str:
        """Name for people."""
        return titled(self.phase, self.kind)


@dataclass(frozen=True, slots=True)
class Verdict:
    """One row of the comparison.

    Attributes
    ----------
    truth : TrueEvent or None
        None for a report of something that was not there.
    reported : Event or None
        None for an event that was missed.
    delay : int or None
        Frames from the truth to the report; negative if it came early.
    turn : float or None
        rad, reported minus true direction, within ±π.
    passed : bool
    text : str
        The verdict in words.
    """

    truth: TrueEvent | None
    reported: Event | None
    delay: int | None
    turn: float | None
    passed: bool
    text: str

    @property
    def title(self) -> str:
        """Its subject."""
        if self.truth is not None:
            return self.truth.title
        assert self.reported is not None
        return self.reported.title

    @property
    def frame(self) -> int:
        """Frame at which it is listed."""
        known = self.truth or self.reported
        assert known is not None
        return known.frame


def spans(record: SceneRecord, lane: Lane) -> list[tuple[int, int]]:
    """Return the first frame and the frame after the last of every time that a lane holds."""
    return held(record.truth.get(lane.truth))


def held(values: np.ndarray | None) -> list[tuple[int, int]]:
    """Return (first, after the last) of every run of frames in which values are above 0."""
    if values is None:
        return []
    holds = np.concatenate(([False], np.nan_to_num(values) > 0.0, [False]))
    edges = np.flatnonzero(holds[1:] != holds[:-1])
    return [(int(first), int(after)) for first, after in edges.reshape(-1, 2)]


def true_events(record: SceneRecord) -> tuple[TrueEvent, ...]:
    """Return the true events among those that the scene wants, in order of time.

    A phase that the scene's program does not report is not among it.
    """
    found = (
        event
        for lane in LANES
        if lane.want in record.needs and lane.flag in record.outputs
        for event in _events_of(record, lane)
    )
    return tuple(sorted(found, key=lambda event: event.frame))


def _events_of(record: SceneRecord, lane: Lane) -> Iterator[TrueEvent]:
    for first, after in spans(record, lane):
        yield TrueEvent(
            kind=lane.kind,
            phase=lane.phase,
            frame=first,
            time=float(record.times[first]),
            direction=_direction(record, lane, first),
            sense=int(np.sign(record.at("twist_rate", first))) if lane.kind == "twist" else None,
        )
        if lane.ends and after < record.frames:
            yield TrueEvent(lane.ends, "", after, float(record.times[after]))


def _direction(record: SceneRecord, lane: Lane, frame: int) -> float | None:
    if lane.phase == "gross":
        angle = record.at("slip_direction", frame)
    elif lane.phase == "incipient":
        angle = atan2(record.at("shear_y", frame), record.at("shear_x", frame))
    else:
        return None
    return angle if isfinite(angle) else None


def compare(record: SceneRecord) -> tuple[Verdict, ...]:
    """Return every true event with its report, and every report without one, in order of time.

    Reports of kinds that the ground truth does not know are left alone. Without any ground truth
    there is nothing to compare.
    """
    if not record.truth:
        return ()
    kinds = {(lane.kind, lane.phase) for lane in LANES} | {(lane.ends, "") for lane in LANES}
    truths = true_events(record)
    reports = [event for event in record.events if (event.kind, event.phase or "") in kinds]
    pairs = _pairs(truths, reports)
    rows = [_verdict(truth, pairs.get(index)) for index, truth in enumerate(truths)]
    used = {id(event) for event in pairs.values()}
    rows += [_verdict(None, event) for event in reports if id(event) not in used]
    return tuple(sorted(rows, key=lambda row: row.frame))


def _pairs(truths: tuple[TrueEvent, ...], reports: list[Event]) -> dict[int, Event]:
    """Return a report for each truth, the nearest pairs first; none is used twice."""
    near = sorted(
        (abs(event.time - truth.time), i, j)
        for i, truth in enumerate(truths)
        for j, event in enumerate(reports)
        if (event.kind, event.phase or "") == (truth.kind, truth.phase)
    )
    pairs: dict[int, Event] = {}
    taken: set[int] = set()
    for distance, i, j in near:
        if distance <= MATCH_WITHIN and i not in pairs and j not in taken:
            pairs[i] = reports[j]
            taken.add(j)
    return pairs


def _verdict(truth: TrueEvent | None, event: Event | None) -> Verdict:
    if truth is None:
        return Verdict(None, event, None, None, False, "false report")
    if event is None:
        return Verdict(truth, None, None, None, False, "missed")
    delay = event.frame - truth.frame
    turn = None
    if truth.direction is not None and event.direction is not None:
        turn = remainder(event.direction - truth.direction, 2 * pi)
    faults = tuple(_faults(truth, event, delay, turn))
    return Verdict(truth, event, delay, turn, not faults, "; ".join(faults) or "passed")


def _faults(truth: TrueEvent, event: Event, delay: int, turn: float | None) -> Iterator[str]:
    lane = next((lane for lane in LANES if lane.title == truth.title), LANES[0])
    off = event.time - truth.time
    if abs(delay) > MAX_DELAY and not -lane.early <= off <= lane.late:
        yield f"{abs(delay)} frames {'late' if delay > 0 else 'early'}"
    if truth.direction is not None and turn is None:
        yield "no direction"
    if turn is not None and abs(turn) > MAX_TURN:
        yield f"direction off by {abs(degrees(turn)):.0f}°"
    if truth.sense is not None and event.sense != truth.sense:
        yield "wrong sense" if event.sense else "no sense"
