"""What is taken for what: slip, twist, grip, roll and the rest against what was reported."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from cnnum.lab.scoring.episodes import Episode
from cnnum.lab.scoring.judge import Judgement
from cnnum.lab.scoring.measures import Measure, share
from cnnum.report.verdicts import MAX_DELAY

TRUE_KINDS = ("slip", "part pull", "twist", "part twist", "grip", "roll", "vibrate")
REPORTED = ("slip", "twist")

CONFUSED = 0.01
"""Share of slips and twists that may be taken for the other."""


@dataclass(frozen=True, slots=True)
class Seen:
    """One thing that the hand did, and what was reported of it.

    Attributes
    ----------
    kind : str
        One of `TRUE_KINDS`.
    reported : frozenset of str
        "slip", "twist", both or neither.
    """

    kind: str
    reported: frozenset[str]


def confusion_measures(suite: str, judged: Sequence[Judgement]) -> Iterator[Measure]:
    """Yield how often each thing that was done was reported as slip and as twist."""
    seen = [item for one in judged for item in seen_of(one)]
    both = [item for item in seen if item.kind in REPORTED]
    if both:
        wrong = sum(_other(item.kind) in item.reported for item in both)
        value = share(wrong, len(both))
        yield Measure("slip against twist", suite, value, len(both), "", CONFUSED, "at most")
    for kind in TRUE_KINDS:
        mine = [item for item in seen if item.kind == kind]
        for told in REPORTED if mine else ():
            value = share(sum(told in item.reported for item in mine), len(mine))
            yield Measure(f"{kind} reported as {told}", suite, value, len(mine))


def _other(kind: str) -> str:
    return REPORTED[1 - REPORTED.index(kind)]


def seen_of(one: Judgement) -> Iterator[Seen]:
    """Yield what was done in a play, with what was reported meanwhile.

    Pulls and twists are the episodes of the truth, the rest the phases of the script in which
    neither is there; a report may come `MAX_DELAY` frames late.
    """
    for episode in one.episodes:
        kind = _kind(episode)
        # a twist sets free what a pull has left behind, and the other way round: not one of its own
        part = kind not in REPORTED and any(_overlap(episode, e) for e in one.episodes)
        if not part:
            yield Seen(kind, _reported(one, episode.first, episode.after))
    for phase in one.play.phases:
        busy = any(e.first < phase.after and phase.first < e.after for e in one.episodes)
        if phase.kind in TRUE_KINDS and not busy:
            yield Seen(phase.kind, _reported(one, phase.first, phase.after))


def _kind(episode: Episode) -> str:
    reached = episode.loose if episode.kind == "twist" else episode.gross
    whole = {"pull": "slip", "twist": "twist"}[episode.kind]
    return f"part {episode.kind}" if reached is None else whole


def _overlap(part: Episode, other: Episode) -> bool:
    """Return whether a whole pull or twist goes on at the time of a part of one."""
    together = part.first < other.after and other.first < part.after
    return together and _kind(other) in REPORTED


def _reported(one: Judgement, first: int, after: int) -> frozenset[str]:
    return frozenset(
        event.kind
        for event in one.play.events
        if event.kind in REPORTED and first <= event.frame < after + MAX_DELAY
    )
