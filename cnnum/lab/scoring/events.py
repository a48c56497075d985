"""Measures of each kind of event: precision, recall, delay, and what it says besides."""

from collections.abc import Iterator, Sequence
from math import degrees

import numpy as np

from cnnum.lab.scoring.judge import QUIET, Find, Judgement
from cnnum.lab.scoring.measures import Measure, auc, quantile, share
from cnnum.report.verdicts import MAX_DELAY, MAX_TURN

KINDS = ("contact", "release", "incipient slip", "gross slip", "twist")

GROSS_RECALL, GROSS_PRECISION = 0.995, 0.99
BEFORE, STICK_LEFT = 0.95, 0.3
"""Share of the pulls in which incipient slip is reported before gross slip, and the median c/a."""


def event_measures(suite: str, judged: Sequence[Judgement]) -> Iterator[Measure]:
    """Yield precision, recall and delays of every kind of event that was there or reported."""
    for kind in KINDS:
        finds = [find for one in judged for find in one.of(kind)]
        found = [find for find in finds if find.report is not None]
        false = sum(title_of(e.phase, e.kind) == kind for one in judged for e in one.false)
        reports = len(found) + false
        if not finds and not reports:
            continue
        gross = kind == "gross slip"
        in_time = sum(find.in_time for find in finds)
        yield Measure(
            f"{kind}: precision",
            suite,
            share(len(found), reports),
            reports,
            target=GROSS_PRECISION if gross else None,
        )
        yield Measure(f"{kind}: recall", suite, share(len(found), len(finds)), len(finds))
        yield Measure(
            f"{kind}: recall within {MAX_DELAY} frames",
            suite,
            share(in_time, len(finds)),
            len(finds),
            target=GROSS_RECALL if gross else None,
        )
        yield from _delays(suite, kind, found)
        yield from _directions(suite, kind, found)


def title_of(phase: str | None, kind: str) -> str:
    """Return what a report is called: "gross slip", "twist"…"""
    return f"{phase or ''} {kind}".strip()


def _delays(suite: str, kind: str, found: Sequence[Find]) -> Iterator[Measure]:
    frames = [float(find.delay or 0) for find in found]
    seconds = [(find.delay or 0) / find.play.rate for find in found]
    for name, place in (("median", 0.5), ("5 % below", 0.05), ("95 % below", 0.95)):
        count = len(found)
        title, more = f"{kind}: delay, {name}", name != "median" or kind in QUIET
        in_frames, in_seconds = quantile(frames, place), quantile(seconds, place)
        yield Measure(title, suite, in_frames, count, "frames", detail=more)
        yield Measure(title, suite, in_seconds, count, "s", detail=more)


def _directions(suite: str, kind: str, found: Sequence[Find]) -> Iterator[Measure]:
    if "slip" not in kind:
        return
    turns = [degrees(abs(find.turn)) for find in found if find.turn is not None]
    near = sum(turn <= degrees(MAX_TURN) for turn in turns)
    count = len(found)
    yield Measure(f"{kind}: direction error, median", suite, quantile(turns, 0.5), count, "°")
    yield Measure(f"{kind}: direction within 10°", suite, share(near, count), count)


def warning_measures(suite: str, judged: Sequence[Judgement]) -> Iterator[Measure]:
    """Yield how often and how early incipient slip was told before gross slip."""
    pulls = warnings(judged)
    if not pulls:
        return
    told = [stick for stick in pulls if stick is not None]
    yield Measure(
        "incipient slip before gross slip",
        suite,
        share(len(told), len(pulls)),
        len(pulls),
        "of pulls",
        BEFORE,
    )
    slow = warnings(judged, room=MAX_DELAY)
    value = share(sum(stick is not None for stick in slow), len(slow))
    name = f"incipient slip before gross slip, {MAX_DELAY} frames or more after c = a/2"
    yield Measure(name, suite, value, len(slow), "of pulls")
    known = [stick for stick in told if np.isfinite(stick)]
    yield Measure(
        "stick radius c/a at the report of incipient slip, median",
        suite,
        quantile(known, 0.5),
        len(known),
        "a",
        STICK_LEFT,
    )


def warnings(judged: Sequence[Judgement], room: int = 0) -> list[float | None]:
    """Return, for each pull that ends in gross slip, c/a at the report before it, if any.

    Only pulls in which gross slip comes at least `room` frames after c = a/2 are looked at.
    """
    found: list[float | None] = []
    for one in judged:
        for episode in one.episodes:
            if episode.gross is None or episode.gross - (episode.loose or 0) < room:
                continue
            early = [
                event.frame
                for event in one.play.events
                if event.phase == "incipient" and episode.first <= event.frame < episode.gross
            ]
            found.append(one.play.stick(early[0]) if early else None)
    return found


def strength_measures(suite: str, judged: Sequence[Judgement]) -> Iterator[Measure]:
    """Yield how well `slip_strength` ranks all frames of a suite."""
    plays = [one.play for one in judged]
    if not plays:
        return
    strength = np.concatenate([play.outputs["slip_strength"] for play in plays])
    gross = np.concatenate([play.truth["slip"] for play in plays])
    any_slip = np.maximum(gross, np.concatenate([play.truth["incipient"] for play in plays]))
    ran = np.isfinite(strength)
    for name, label in (("incipient or gross slip", any_slip), ("gross slip", gross)):
        value = auc(strength[ran], label[ran])
        yield Measure(f"slip_strength against {name}: AUC", suite, value, int(ran.sum()), "frames")
