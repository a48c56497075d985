"""The suite "families": every family of scenes, one row each."""

import os
import signal
from collections.abc import Callable, Generator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing import get_context

import numpy as np

from cnnum.drivers.simulated.grips import Arrays, Trial
from cnnum.engines.devices.child import safe_path
from cnnum.lab.scoring.families.catalogue import FAMILIES, HANDS, Family
from cnnum.lab.scoring.judge import (
    NEAR,
    Verdict,
    judge,
    median,
    per_ten_minutes,
    sense_right,
    share,
)
from cnnum.lab.scoring.subjects import Answers, Subject
from cnnum.lab.scoring.table import Column, Row, Table

FOUND, SENSE, FALSE = 0.95, 0.98, 1.0
"""Aims: shares found and of right senses, and false reports in ten minutes."""

_FAMILY = (
    Column("family", "family"),
    Column("about", "apart by", explains=True),
    Column("scenes", "scenes"),
)
SLIPS = (
    *_FAMILY,
    Column("found", "found", 2, least=FOUND),
    Column("slid_mm", "slid, mm", 2, most=NEAR * 1e3),
    Column("near", "by 0.3 mm"),
    Column("turned", "off, °", 1),
    Column("false", "false / 10 min", 1, most=FALSE),
    Column("twists", "twist, too", 2, most=1 - SENSE),
)
TWISTS = (
    *_FAMILY,
    Column("found", "found"),
    Column("sense", "sense right", 2, least=SENSE),
    Column("slips", "slip, too", 2, most=1 - SENSE),
)
HELD = (
    *_FAMILY,
    Column("minutes", "minutes", 1),
    Column("false", "false / 10 min", 1, most=FALSE),
    Column("with_false", "scenes with one"),
    Column("twists", "twists / 10 min", 1, most=FALSE),
)

FEW = 100
"""Scenes that are not worth more processes."""

THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")

Advance = Callable[[str], object]


@dataclass(frozen=True, slots=True)
class Scenes:
    """Scenes of all families, with the programs' outputs.

    Attributes
    ----------
    trials : mapping of str to sequence of Trial
        By family.
    answers : mapping of str to sequence of Answers
    """

    trials: Mapping[str, Sequence[Trial]]
    answers: Mapping[str, Sequence[Answers]]

    def verdicts(self, family: str) -> list[Verdict]:
        """Return the scores of the reports in a family's scenes."""
        pairs = zip(self.trials[family], self.answers[family], strict=True)
        return [judge(trial, answers) for trial, answers in pairs]


def drawn(
    count: int,
    seed: int,
    advance: Advance,
    trials: dict[str, list[Trial]] | None = None,
    families: Sequence[Family] = FAMILIES,
) -> dict[str, list[Trial]]:
    """Return scenes of every family: `count` each, from a seed on.

    Parameters
    ----------
    count, seed : int
    advance : callable
        Called with the name of every family that is drawn.
    trials : dict, optional
        Takes each family in as it comes, so that those of a run that is stopped are not lost.
    families : sequence of Family

    Raises
    ------
    CnnumError
        If a contact leaves its array.
    """
    trials = {} if trials is None else trials
    if count * len(families) <= FEW:
        for family in families:
            trials[family.name] = _drawn(family.name, count, seed)
            advance(family.name)
        return trials
    names = [family.name for family in families]
    with _workers() as workers:
        waiting = [workers.submit(_drawn, name, count, seed) for name in names]
        for name, future in zip(names, waiting, strict=True):
            trials[name] = future.result()
            advance(name)
    return trials


def _drawn(name: str, count: int, seed: int) -> list[Trial]:
    """Return a family's scenes; by name, since their maker cannot go to another process."""
    arrays, family = Arrays(), next(f for f in (*FAMILIES, *HANDS) if f.name == name)
    return [family.make(arrays, name, n) for n in range(seed, seed + count)]


@contextmanager
def _workers() -> Generator[ProcessPoolExecutor]:
    """Yield one process per core, each with one thread for matrices, as more slow each other."""
    before = {name: os.environ.get(name) for name in THREADS}
    os.environ.update(dict.fromkeys(THREADS, "1"))
    try:
        with safe_path():  # its semaphores alone start a process
            workers = ProcessPoolExecutor(
                mp_context=get_context("spawn"), initializer=_not_by_ctrl_c
            )
            try:
                yield workers
            finally:
                # families that wait are dropped: after Ctrl-C only those in hand are drawn
                workers.shutdown(cancel_futures=True)
    finally:
        for name, value in before.items():
            os.environ.pop(name)
            if value is not None:
                os.environ[name] = value


def _not_by_ctrl_c() -> None:
    """Leave Ctrl-C to the process that has the scenes drawn."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def played(subject: Subject, trials: Mapping[str, Sequence[Trial]]) -> Scenes:
    """Return the programs' outputs of scenes."""
    flat = [trial for ones in trials.values() for trial in ones]
    answers = iter(subject.play(flat))
    return Scenes(trials, {name: [next(answers) for _ in ones] for name, ones in trials.items()})


def tables(scenes: Scenes) -> list[Table]:
    """Return one table each for scenes that slip, that twist, and that are held."""
    rows: dict[str, list[Row]] = {"slip": [], "twist": [], "held": []}
    for family in (family for family in FAMILIES if family.name in scenes.trials):
        rows[family.kind].append(_ROWS[family.kind](family, scenes))
    return [
        Table("slips", "Scenes that slip", SLIPS_NOTE, SLIPS, rows["slip"]),
        Table("twists", "Scenes that twist", TWISTS_NOTE, TWISTS, rows["twist"]),
        Table("held", "Scenes without slip", HELD_NOTE, HELD, rows["held"]),
    ]


SLIPS_NOTE = (
    "Found: slip is reported while the object slips. Slid: median of the sliding before that "
    "report. Off: median error of its direction. False: reports that begin more than 0.1 s before "
    "the slip, while the contact sticks on more than half its radius. Twist, too: share of scenes."
)
TWISTS_NOTE = "Sense right: a twist is reported, and never in the other sense."
HELD_NOTE = "Each report of slip is false, each of its own if the flag goes out in between."


def _slip_row(family: Family, scenes: Scenes) -> Row:
    verdicts = scenes.verdicts(family.name)
    result = [verdict for verdict in verdicts if verdict.found]
    slid = [verdict.slid if verdict.found else np.inf for verdict in verdicts]
    return {
        **_head(family, verdicts),
        "found": share(len(result), len(verdicts)),
        "slid_mm": median(slid) * 1e3,
        "near": share(sum(way <= NEAR for way in slid), len(verdicts)),
        "turned": median([onset.turned for onset in result]),
        "false": _rate(verdicts),
        "twists": share(sum(verdict.twists > 0 for verdict in verdicts), len(verdicts)),
    }


def _twist_row(family: Family, scenes: Scenes) -> Row:
    verdicts = scenes.verdicts(family.name)
    pairs = list(zip(scenes.trials[family.name], scenes.answers[family.name], strict=True))
    result = sum(bool((answers["twist"][trial.scored] > 0).any()) for trial, answers in pairs)
    right = sum(sense_right(trial, answers) for trial, answers in pairs)
    return {
        **_head(family, verdicts),
        "found": share(result, len(pairs)),
        "sense": share(right, len(pairs)),
        "slips": share(sum(verdict.false > 0 for verdict in verdicts), len(verdicts)),
    }


def _held_row(family: Family, scenes: Scenes) -> Row:
    verdicts = scenes.verdicts(family.name)
    seconds = sum(verdict.seconds for verdict in verdicts)
    return {
        **_head(family, verdicts),
        "minutes": seconds / 60.0,
        "false": _rate(verdicts),
        "with_false": sum(verdict.false > 0 for verdict in verdicts),
        "twists": per_ten_minutes(sum(verdict.twists for verdict in verdicts), seconds),
    }


_ROWS = {"slip": _slip_row, "twist": _twist_row, "held": _held_row}


def _head(family: Family, verdicts: Sequence[Verdict]) -> Row:
    return {"family": family.name, "about": family.about, "scenes": len(verdicts)}


def _rate(verdicts: Sequence[Verdict]) -> float:
    false, seconds = (
        sum(verdict.false for verdict in verdicts),
        sum(verdict.seconds for verdict in verdicts),
    )
    return per_ten_minutes(false, seconds)
