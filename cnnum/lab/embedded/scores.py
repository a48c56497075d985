"""Losses of a precision: error against the reference engine, flags that differ, events."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache, lru_cache
from math import inf, nan

import numpy as np

from cnnum.arrays import Floats, Shape
from cnnum.embedded.making import Made
from cnnum.engine import Engine
from cnnum.lab.embedded.streams import APART, bound, side_by_side, trials
from cnnum.lab.embedded.streams import made as made_program
from cnnum.lab.scoring.judge import judge, sense_right
from cnnum.lab.scoring.measures import per_ten_minutes, share
from cnnum.lab.scoring.trial import Trial, runs

OTHERS = 1000
"""First seed of the scenes that are scored: none of them was measured for ranges."""

REPORTS = ("gross_slip", "twist")
"""Flags that are reports."""

EXCERPT = 300
"""Frames of each stream that the reference engine runs, too: at rest, pressed, and pulled."""


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
    """Return frames of a scene that slips and of one that twists, (frames, 2, …).

    Parameters
    ----------
    shape : (rows, cols)
    remembers : bool
        Whether the program has memories, and so needs all frames in their order.
    """
    some = [one for one in trials(shape, OTHERS, 1) if one.family in ("slip", "twist")]
    return side_by_side(some, EXCERPT)[:: 1 if remembers else APART]


@cache
def _reference(name: str, shape: Shape, needs: tuple[str, ...]) -> Mapping[str, Floats]:
    """Return the outputs of the reference engine on the excerpt."""
    plan = Engine("reference").compile(bound(name), shape, needs)
    frames = excerpt(shape, remembers=bool(plan.schedule.memories))
    stream = plan.stream((frames.shape[1],))
    answers = [stream.push(frame) for frame in frames]
    return {key: np.array([one[key] for one in answers]) for key in answers[0]}


def loss(made: Made, shape: Shape) -> Loss:
    """Return how far a program in a precision is from the reference engine."""
    remembers = bool(made.schedule.memories)
    wanted = _reference(made.program.name, shape, tuple(made.schedule.outputs))
    found = made.run(excerpt(shape, remembers=remembers))
    worst, output, flags = -1.0, "", list[str]()
    for name, node in made.schedule.outputs.items():
        if node.logic:
            flags.append(name)
            continue
        size = float(np.sqrt(np.mean(wanted[name] ** 2)))
        off = float(np.sqrt(np.mean((found[name] - wanted[name]) ** 2)))
        error = off / size if size else (0.0 if not off else inf)
        if error > worst:
            worst, output = error, name
    return Loss(worst if output else nan, output, _unlike(found, wanted, flags))


def _unlike(
    found: Mapping[str, Floats], wanted: Mapping[str, Floats], names: Sequence[str]
) -> float:
    """Return the share of the flags up in either that are not up in both; NaN if none is up."""
    pairs = [(found[name] > 0, wanted[name] > 0) for name in names]
    either = sum(int((one | other).sum()) for one, other in pairs)
    both = sum(int((one & other).sum()) for one, other in pairs)
    return 1.0 - both / either if either else nan


def events(made: Made, shape: Shape, count: int) -> Events:
    """Return the scores of the reports of a program on scenes that it has not seen.

    Parameters
    ----------
    made : Made
    shape : (rows, cols)
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
    for one, answer in zip(scenes, answers, strict=True):
        seconds += one.seconds
        if "gross_slip" in known:
            verdict = judge(one, answer)
            false += verdict.false
            if one.slides and not one.sense.any():
                slips.append(verdict.found)
        if "twist" in known:
            false += 0 if "gross_slip" in known else _false_twists(one, answer)
            if one.sense.any():
                twists.append(sense_right(one, answer))
    exact = _exact_answers(made.program.name, shape, count)
    differ = _unlike(_together(answers, reports), _together(exact, reports), reports)
    return Events(_share(slips), _share(twists), per_ten_minutes(false, seconds), differ)


def _answers(made: Made, scenes: Sequence[Trial]) -> list[dict[str, Floats]]:
    """Return the outputs on each scene, (its frames, …)."""
    found = made.run(side_by_side(scenes))
    return [
        {name: values[: len(one.frames), n] for name, values in found.items()}
        for n, one in enumerate(scenes)
    ]


@lru_cache(maxsize=4)
def _exact_answers(name: str, shape: Shape, count: int) -> list[dict[str, Floats]]:
    """Return the reports of a program in float32 on the scenes that are scored."""
    found = _answers(made_program(name, shape, "float32"), trials(shape, OTHERS, count))
    return [{key: one[key] for key in REPORTS if key in one} for one in found]


def _together(some: Sequence[Mapping[str, Floats]], names: Sequence[str]) -> dict[str, Floats]:
    return {name: np.concatenate([one[name].ravel() for one in some]) for name in names}


def _share(some: Sequence[bool]) -> float:
    return share(sum(some), len(some))


def _false_twists(trial: Trial, answer: Mapping[str, Floats]) -> int:
    said = (answer["twist"] > 0) & trial.scored
    return sum(not trial.sense[start:after].any() for start, after in runs(said))
