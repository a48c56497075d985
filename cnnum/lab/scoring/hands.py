"""The suite "hands": what slip and twist meet in real hands, one row per situation.

Its scenes are those of `families.catalogue.HANDS`, and recorded grasps where they are at hand. A
second table compares what arrays that read fewer axes give with what the whole ones give.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np

from cnnum.arrays import Floats
from cnnum.drivers.simulated.grips import Flags, Trial, first, runs
from cnnum.engine import Engine
from cnnum.frame import FORCE_AXES
from cnnum.lab.scoring.families.catalogue import FAMILIES, HANDS, Family
from cnnum.lab.scoring.judge import auc, due, judge, median, onsets, per_ten_minutes, share
from cnnum.lab.scoring.subjects import Answers, in_batches, side_by_side
from cnnum.lab.scoring.table import Column, Row, Table
from cnnum.programs.library import get_program
from cnnum.scenes.push_watch import HeldWatch

FOUND, FALSE, STILL = 0.9, 1.0, 1.0
"""Aims: share found, false reports of slip in a minute, and reports of twist in ten minutes."""

LONG = 30.0
"""s from which a trial has several events, each of which counts."""

COLUMNS = (
    Column("situation", "situation"),
    Column("scenes", "scenes"),
    Column("minutes", "still minutes", 1),
    Column("slips", "slips"),
    Column("slips_found", "found"),
    Column("slips_share", "share", least=FOUND),
    Column("delay_s", "delay, s"),
    Column("auc", "area under the curve", 3),
    Column("false", "false / min", 1, most=FALSE),
    Column("unmarked", "of them unmarked"),
    Column("turns", "turns"),
    Column("turns_found", "found, sense right"),
    Column("turns_share", "share", least=FOUND),
    Column("twists", "false twists / 10 min", 1, most=STILL),
    Column("marked", "starts marked"),
)
NOTE = (
    "A slip is found if it is reported while it lasts, a turn if it is and in no other sense. "
    "Delay: median, from the onset. Area: of slip_strength (24 electrodes: flow_speed), slips "
    "against all else. Unmarked: reports of slip and twist that are false and have no mark "
    "'rest_held'. Starts marked: scenes of which the stream's begin is said to be held or moving."
)


@dataclass(frozen=True, slots=True)
class Played:
    """A trial with what was reported.

    Attributes
    ----------
    trial : Trial
    answers : Answers
    marks : (frames,) bool
        Where an event has the mark `rest_held`.
    """

    trial: Trial
    answers: Answers
    marks: Flags

    @property
    def slips(self) -> Flags:
        """Where slip is reported and counts."""
        return (self.answers["gross_slip"] > 0) & self.trial.scored

    @property
    def twists(self) -> Flags:
        """Where twist is reported and counts."""
        if "twist" not in self.answers:
            return np.zeros(len(self.marks), dtype=bool)
        return (self.answers["twist"] > 0) & self.trial.scored


SLIP = ("gross_slip", "slip_strength", "slip_x", "slip_y")
TWIST = ("twist", "twist_sense")
FLOW = ("flows", "flow_speed")


def play(engine: Engine, trials: Sequence[Trial], axes: tuple[str, ...]) -> list[Played]:
    """Return trials with the reports of slip and twist, or of a flow where no shear is read."""

    def run(some: Sequence[Trial]) -> list[Answers]:
        if FORCE_AXES[0] not in axes:
            flows = side_by_side(engine, get_program("tactile_flow"), FLOW, some, channels=axes)
            return [{"gross_slip": f["flows"], "slip_strength": f["flow_speed"]} for f in flows]
        pairs = zip(
            *(
                side_by_side(engine, get_program(name), outputs, some, channels=axes)
                for name, outputs in (("slip", SLIP), ("twist", TWIST))
            ),
            strict=True,
        )
        return [slip | twist for slip, twist in pairs]

    answers = in_batches(trials, run)
    return [Played(t, a, _marks(t, axes)) for t, a in zip(trials, answers, strict=True)]


def _marks(trial: Trial, axes: tuple[str, ...]) -> Flags:
    """Return the frames whose events are marked, as a scene marks them."""
    known = {name: value for name, value in trial.setting.items() if name in ("push", "shear_gain")}
    watch, marks = HeldWatch(get_program("slip").bind(**known), axes), list[bool]()
    for n, frame in enumerate(trial.frames):
        if watch.look(frame, n / trial.rate):
            watch.begin()
        marks.append(watch.marks)
    return np.array(marks)


def hands_table(
    engine: Engine,
    trials: Mapping[str, Sequence[Trial]],
    recorded: Mapping[str, Sequence[Trial]],
) -> Table:
    """Return one row per situation.

    Parameters
    ----------
    engine : Engine
    trials : mapping
        Scenes by the name of their family in `HANDS`.
    recorded : mapping
        Recorded trials by the name of their row.
    """
    rows: list[Row] = []
    drawn = [family for family in HANDS if family.name in trials]
    for name, families in groupby(drawn, key=_situation):
        played = [
            one for family in families for one in play(engine, trials[family.name], family.axes)
        ]
        rows.append(_row(name, played))
    for name, some in recorded.items():
        rows.append(_row(name, play(engine, some, FORCE_AXES)))
    return Table("hands", "Situations of real hands", NOTE, COLUMNS, rows)


def _situation(family: Family) -> str:
    name, _, body = family.name.partition(": ")
    return name if name == "gripped" else f"{name}, {body}" if body else name


def _row(name: str, played: Sequence[Played]) -> Row:
    still = sum(float((one.trial.scored & (one.trial.slips == 0)).sum()) / one.trial.rate
                for one in played)  # fmt: skip
    slips = found = turns = right = false = twists = unmarked = 0
    delays, with_slip, without = list[float](), list[Floats](), list[Floats]()
    for one in played:
        trial = one.trial
        if trial.seconds > LONG or trial.speed is not None:
            events = onsets(trial, one.slips)
            slips, found = slips + events.slips, found + events.found
            delays += events.delays
        elif trial.slides:
            verdict = judge(trial, one.answers)
            slips, found = slips + 1, found + verdict.found
            delays += [verdict.delay] * verdict.found
        wrong = [start for start, _ in runs(one.slips) if not due(trial, start)]
        turned = [
            start
            for start, after in runs(one.twists)
            if not trial.sense[start:after].any() and trial.slips[start] == 0
        ]
        false, twists = false + len(wrong), twists + len(turned)
        unmarked += sum(not one.marks[start] for start in (*wrong, *turned))
        if trial.sense.any():
            turns, right = turns + 1, right + _turn_found(one)
        strength = one.answers["slip_strength"]
        with_slip.append(strength[trial.scored & (trial.slips == 1)])
        without.append(strength[trial.scored & (trial.slips == 0) & ~trial.early])
    return {
        "situation": name,
        "scenes": len(played),
        "minutes": still / 60.0,
        "slips": slips,
        "slips_found": found,
        "slips_share": share(found, slips),
        "delay_s": median(delays),
        "auc": auc(np.concatenate(with_slip), np.concatenate(without)),
        "false": per_ten_minutes(false, still) / 10.0,
        "unmarked": unmarked,
        "turns": turns,
        "turns_found": right,
        "turns_share": share(right, turns),
        "twists": per_ten_minutes(twists, still),
        "marked": sum(bool(one.marks[one.trial.scored].any()) for one in played),
    }


BEFORE = 0.5
"""s before the contact turns as a whole from which a twist may be reported: it loosens by then."""


def _turn_found(one: Played) -> bool:
    """Return whether a turn is reported from shortly before it on, in its own sense alone."""
    turning = one.trial.sense != 0
    begin = max(0, first(turning) - round(BEFORE * one.trial.rate))
    said = one.twists & (np.arange(len(turning)) >= begin)
    true = one.trial.sense[turning][0]
    return bool(said.any() and (one.answers["twist_sense"][said] == true).all())


ARRAY_COLUMNS = (
    Column("quantity", "quantity"),
    Column("scenes", "scenes"),
    Column("whole", "three axes", 3),
    Column("alone", "normal load alone", 3),
    Column("off", "apart in the median", 3),
    Column("unit", "in"),
)
ARRAY_NOTE = (
    "Medians over scenes of the mean in a hold: a sphere, a flat disc or (bumps) a cover with "
    "bumps is pressed on. A direction is that of the flow in a slide, against the truth."
)
HOLDS = (0.95, 1.25)
"""s: between these all scenes hold still."""

Reading = tuple[str, tuple[str, ...], str, Mapping[str, str]]
READINGS: tuple[Reading, ...] = (
    ("contact", ("contact",), "1", {}),
    ("contact", ("contact_row", "contact_column"), "cells", {}),
    ("contact", ("load_normal",), "share", {}),
    ("contact", ("contact_area",), "cells", {}),
    ("localize", ("bump_normal",), "share", {}),
    ("contact", ("contact_row", "contact_column"), "cells", {"reads": "force"}),
    ("contact", ("load_normal",), "share", {"reads": "force"}),
)
"""Programs, outputs that make one quantity, its unit, and parameters."""

BUMPS = next(family for family in FAMILIES if family.name == "bumps")
PRESSED = ("shear alone, slide: spheres", "shear alone, slide: bristles")
"""Whose scenes show what arrays that read fewer axes give."""

AT = 100.0
"""Hz: of these scenes alone, as each rate would take programs of its own."""


def arrays_table(engine: Engine, trials: Mapping[str, Sequence[Trial]]) -> Table:
    """Return one row per quantity, of arrays with three axes and with the normal load alone."""
    rows = list[Row]()
    slides = [trial for name in PRESSED for trial in trials[name] if trial.rate == AT]
    bumps = [trial for trial in trials[BUMPS.name] if trial.rate == AT]
    if not slides or not bumps:
        return Table("arrays", "Arrays with the normal load alone", ARRAY_NOTE, ARRAY_COLUMNS)
    for name, outputs, unit, known in READINGS:
        some = bumps if name == "localize" else slides
        whole, alone = (
            _in_hold(engine, name, outputs, some, known, axes)
            for axes in (FORCE_AXES, FORCE_AXES[2:])
        )
        away = np.linalg.norm(whole - alone, axis=1)
        way = ", ".join(f"{key} {value}" for key, value in known.items())
        rows.append({
            "quantity": " and ".join(outputs) + f" ({way})" * bool(way),
            "scenes": len(some),
            "whole": float(np.median(whole)) if len(outputs) == 1 else None,
            "alone": float(np.median(alone)) if len(outputs) == 1 else None,
            "off": float(np.median(away / np.abs(whole[:, 0]) if unit == "share" else away)),
            "unit": unit,
        })  # fmt: skip
    off = _flow_off(engine, slides)
    rows.append({"quantity": "direction of the flow", "scenes": len(off), "whole": None,
                 "alone": None, "off": float(np.median(off)), "unit": "degrees"})  # fmt: skip
    return Table("arrays", "Arrays with the normal load alone", ARRAY_NOTE, ARRAY_COLUMNS, rows)


def _in_hold(
    engine: Engine, name: str, outputs: tuple[str, ...], trials: Sequence[Trial],
    known: Mapping[str, str], axes: tuple[str, ...],
) -> Floats:  # fmt: skip
    """Return the means of outputs in the hold, (trials, outputs)."""

    def run(some: Sequence[Trial]) -> list[Answers]:
        return side_by_side(engine, get_program(name), outputs, some, known, axes)

    pairs = zip(trials, in_batches(trials, run), strict=True)
    return np.array([
        [answer[o][slice(*(round(t * trial.rate) for t in HOLDS))].mean() for o in outputs]
        for trial, answer in pairs
    ])  # fmt: skip


def _flow_off(engine: Engine, trials: Sequence[Trial]) -> Floats:
    """Return by how many degrees the flow in each slide is off, of slides that show one."""

    def run(some: Sequence[Trial]) -> list[Answers]:
        outputs = ("flow_x", "flow_y", "flow_known")
        flow = get_program("tactile_flow")
        return side_by_side(engine, flow, outputs, some, channels=FORCE_AXES[2:])

    off = list[float]()
    for trial, answer in zip(trials, in_batches(trials, run), strict=True):
        seen = (answer["flow_known"] > 0) & (trial.slips == 1)
        if seen.any():
            x, y = (answer[name][seen].sum() for name in ("flow_x", "flow_y"))
            off.append(abs(np.angle(np.exp(1j * (np.arctan2(y, x) - trial.direction)), deg=True)))
    return np.array(off)
