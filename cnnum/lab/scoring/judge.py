"""A play against the closed forms: what was found, what was missed, what was not there."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import degrees, hypot, pi, remainder

import numpy as np

from cnnum.lab.scoring.episodes import Episode, episodes_of
from cnnum.lab.scoring.play import Play
from cnnum.report.verdicts import LANES, MAX_DELAY, MAX_TURN, TrueEvent, held
from cnnum.scenes.events import Event

QUIET = ("contact", "release")
"""Reports that are not false alarms of slip or twist."""

HALF_PITCH = 0.5
RATE_SHARE = 0.1
"""How far a reported centre (cells) and rate (share) may be off."""


@dataclass(frozen=True, slots=True)
class Find:
    """Something that really happened, with its report if there is one.

    Attributes
    ----------
    truth : TrueEvent
    report : Event or None
    play : Play
    """

    truth: TrueEvent
    report: Event | None
    play: Play

    @property
    def delay(self) -> int | None:
        """Frames from the truth to the report; negative if it came early."""
        return None if self.report is None else self.report.frame - self.truth.frame

    @property
    def in_time(self) -> bool:
        """Whether it was reported at most `MAX_DELAY` frames away."""
        return self.delay is not None and abs(self.delay) <= MAX_DELAY

    @property
    def turn(self) -> float | None:
        """How far the reported direction is off, rad, within ±π."""
        if self.report is None or self.report.direction is None or self.truth.direction is None:
            return None
        return remainder(self.report.direction - self.truth.direction, 2 * pi)

    @property
    def away(self) -> float | None:
        """How far the reported place is from the contact's centre, cells."""
        if self.report is None or self.report.where is None:
            return None
        row, column = self.play.centre(self.report.frame)
        return hypot(self.report.where[0] - row, self.report.where[1] - column)


@dataclass(frozen=True, slots=True, eq=False)
class Judgement:
    """What a play came to.

    Attributes
    ----------
    play : Play
    episodes : tuple of Episode
    finds : tuple of Find
        Of everything that should have been reported.
    false : tuple of Event
        Reports of what was not there, or was reported already.
    """

    play: Play
    episodes: tuple[Episode, ...]
    finds: tuple[Find, ...]
    false: tuple[Event, ...]

    def of(self, title: str) -> list[Find]:
        """Return the finds of a kind: "gross slip", "twist"…"""
        return [find for find in self.finds if find.truth.title == title]

    @property
    def alarms(self) -> tuple[Event, ...]:
        """False reports of slip or twist."""
        return tuple(event for event in self.false if event.kind not in QUIET)


def judge(play: Play) -> Judgement:
    """Return what was right and wrong in a play.

    Of gross slip, a contact and a release a report is right from `MAX_DELAY` frames before it
    begins on, as long as it lasts. Incipient slip and twist grow: there a report is right in a pull
    or twist whose stick radius does fall below half the contact radius; how early or late it is
    stands in the delays. Every second report of one thing is false. A slip outside of pulls, as a
    contact vanishes, need not be reported, and may be.
    """
    episodes = episodes_of(play)
    finds = [*_touches(play), *_loose(play, episodes), *_gross(play, episodes)]
    used = {id(find.report) for find in finds}
    false = tuple(
        event
        for event in play.events
        if id(event) not in used and _known(event) and not _harmless(play, episodes, event)
    )
    return Judgement(play, episodes, tuple(sorted(finds, key=lambda f: f.truth.frame)), false)


def _known(event: Event) -> bool:
    kinds = {(lane.kind, lane.phase) for lane in LANES} | {(lane.ends, "") for lane in LANES}
    return (event.kind, event.phase or "") in kinds


def _harmless(play: Play, episodes: Sequence[Episode], event: Event) -> bool:
    if event.kind != "slip" or any(e.holds(event.frame, MAX_DELAY) for e in episodes):
        return False
    near = slice(max(event.frame - MAX_DELAY, 0), event.frame + MAX_DELAY + 1)
    return bool((play.truth["slip"][near] > 0).any() or (play.truth["incipient"][near] > 0).any())


def _touches(play: Play) -> Iterator[Find]:
    for first, after in held(play.truth["contact"]):
        while_held = [e for e in _reports(play, "contact") if _within(e, first, after)]
        yield _find(play, "contact", "", first, while_held)
        if after < play.frames:
            gone = [e for e in _reports(play, "release") if _within(e, after, play.frames)]
            yield _find(play, "release", "", after, gone[:1])


def _loose(play: Play, episodes: Sequence[Episode]) -> Iterator[Find]:
    for episode in episodes:
        if episode.loose is None:
            continue
        twist = episode.kind == "twist"
        kind, phase = ("twist", "") if twist else ("slip", "incipient")
        mine = [e for e in _reports(play, kind, phase) if episode.holds(e.frame)]
        if twist:
            rate = float(play.truth["twist_rate"][episode.loose])
            yield _find(play, kind, phase, episode.loose, mine, sense=int(np.sign(rate)))
        else:
            force = (float(play.truth[f"shear_{axis}"][episode.loose]) for axis in "xy")
            x, y = force
            yield _find(play, kind, phase, episode.loose, mine, direction=float(np.arctan2(y, x)))


def _gross(play: Play, episodes: Sequence[Episode]) -> Iterator[Find]:
    for episode in episodes:
        if episode.gross is None:
            continue
        mine = [
            event
            for event in _reports(play, "slip", "gross")
            if _within(event, episode.gross, episode.gross_after)
        ]
        direction = float(play.truth["slip_direction"][episode.gross])
        yield _find(play, "slip", "gross", episode.gross, mine, direction=direction)


def _reports(play: Play, kind: str, phase: str = "") -> list[Event]:
    return [e for e in play.events if e.kind == kind and (e.phase or "") == phase]


def _within(event: Event, first: int, after: int) -> bool:
    return first - MAX_DELAY <= event.frame < after + MAX_DELAY


def _find(
    play: Play,
    kind: str,
    phase: str,
    frame: int,
    reports: Sequence[Event],
    *,
    direction: float | None = None,
    sense: int | None = None,
) -> Find:
    truth = TrueEvent(kind, phase, frame, float(play.times[frame]), direction, sense)
    return Find(truth, reports[0] if reports else None, play)


def faults(judgement: Judgement) -> Iterator[str]:
    """Yield what went wrong in a play, in words, the worst first."""
    for event in judgement.alarms:
        title = f"{event.phase or ''} {event.kind}".strip()
        yield f"false {title} at frame {event.frame} ({doing(judgement.play, event.frame)})"
    for find in judgement.finds:
        yield from _faults_of(find)


def _faults_of(find: Find) -> Iterator[str]:
    title, at = find.truth.title, f"at frame {find.truth.frame}"
    if title in QUIET:
        return
    if find.report is None:
        yield f"{title} {at} missed"
        return
    if title == "gross slip" and not find.in_time:
        yield f"{title} {at} reported {find.delay} frames late"
    if find.turn is not None and abs(find.turn) > MAX_TURN:
        yield f"{title} {at}: direction off by {abs(degrees(find.turn)):.0f}°"
    if find.truth.sense is not None and find.report.sense != find.truth.sense:
        yield f"{title} {at}: wrong sense"
    if find.away is not None and find.away > HALF_PITCH:
        yield f"{title} {at}: centre off by {find.away:.2f} pitches"


def doing(play: Play, frame: int) -> str:
    """Return what the hand does at a frame."""
    return next((p.kind for p in play.phases if p.first <= frame < p.after), "unknown")
