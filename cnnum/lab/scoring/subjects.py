"""The programs that are judged, as subjects: the one place that knows their names and outputs."""

import inspect
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import groupby
from math import ceil
from types import MappingProxyType
from typing import Any

import numpy as np

from cnnum.arrays import Floats
from cnnum.drivers.simulated.grips import Flags, Trial
from cnnum.engine import Engine
from cnnum.frame import FORCE_AXES
from cnnum.programs import Program
from cnnum.programs.library import get_program
from cnnum.programs.parameters import RATE
from cnnum.programs.reports import HOLD, latched, level_of
from cnnum.templates.tactile.slip import LEVELS

SLIP, TWIST = "slip", "twist"
"""Programs that report slip and twist."""

OUTPUTS = {
    SLIP: ("gross_slip", "slip_x", "slip_y", "slip_strength"),
    TWIST: ("twist", "twist_sense"),
}

MORE = {
    SLIP: ("slip_turning", "slip_pivots"),
    TWIST: ("twist_strength", "twist_ratio", "twist_divergence"),
}
"""Outputs that are looked at where a program has them."""

BATCH = 32
"""Arrays side by side: enough to hide the cost of a launch, few enough to keep in memory."""

Answers = dict[str, Floats]


def default(name: str) -> float:
    """Return the value of a parameter of the slip program, as shipped."""
    return float(inspect.signature(get_program(SLIP).function).parameters[name].default)


def shipped_level() -> float:
    """Return the level of `slip_strength` from which the shipped program reports slip."""
    return level_of(default("false_reports"), LEVELS)


def reports(strength: Floats, level: float, rate: float) -> Flags:
    """Return the flags of slip at another level than the shipped one, as the program has them.

    Parameters
    ----------
    strength : (frames,) float
    level : float
    rate : float, Hz

    Returns
    -------
    (frames,) bool
    """
    return latched(strength, level, HOLD * level, ceil(default("hold_time") * rate - 0.5))


@dataclass(frozen=True, slots=True)
class Subject:
    """Slip and twist as judged.

    Attributes
    ----------
    engine : Engine
    constants : mapping
        Parameters other than the shipped ones.
    twists : bool
        Whether twist is judged, too.
    programs : mapping
        Programs instead of those of the library, by `SLIP` or `TWIST`: they give the same outputs.
    """

    engine: Engine
    constants: Mapping[str, float] = field(default_factory=dict[str, float])
    twists: bool = True
    programs: Mapping[str, Program] = field(default_factory=dict[str, Program])

    def play(self, trials: Sequence[Trial]) -> list[Answers]:
        """Return the programs' outputs of every frame of every trial, one array per output.

        Raises
        ------
        CnnumError
            If a program lacks a parameter or an output.
        """
        return in_batches(trials, self._run)

    def _run(self, trials: Sequence[Trial]) -> list[Answers]:
        answers: list[Answers] = [{} for _ in trials]
        for name, outputs in OUTPUTS.items():
            if name == SLIP or self.twists:
                for mine, more in zip(answers, self._one(name, outputs, trials), strict=True):
                    mine.update(more)
        return answers

    def _one(self, name: str, outputs: tuple[str, ...], trials: Sequence[Trial]) -> list[Answers]:
        program = self.programs.get(name) or get_program(name)
        if name not in self.programs:
            outputs = (*outputs, *MORE[name])
        return side_by_side(self.engine, program, outputs, trials, self.constants)


def in_batches(
    trials: Sequence[Trial], run: Callable[[Sequence[Trial]], list[Answers]]
) -> list[Answers]:
    """Return the outputs of every trial, run with those of the same kind and a like length."""
    order = sorted(range(len(trials)), key=lambda n: (_kind(trials[n]), len(trials[n].frames)))
    result: dict[int, Answers] = {}
    for _, same in groupby(order, key=lambda n: _kind(trials[n])):
        numbers = list(same)
        for start in range(0, len(numbers), BATCH):
            some = numbers[start : start + BATCH]
            result.update(zip(some, run([trials[n] for n in some]), strict=True))
    return [result[n] for n in range(len(trials))]


def side_by_side(
    engine: Engine,
    program: Program,
    outputs: Sequence[str],
    trials: Sequence[Trial],
    constants: Mapping[str, float | str] = MappingProxyType({}),
    channels: tuple[str, ...] = FORCE_AXES,
) -> list[Answers]:
    """Return the outputs of one program, all trials side by side; it sees some channels alone.

    A trial that is over repeats its last frame; its outputs are dropped.
    """
    bound = _bound(program, {**trials[0].setting, **constants})
    plan = engine.compile(bound, trials[0].shape, outputs, channels=channels)
    columns = [FORCE_AXES.index(channel) for channel in plan.schedule.channels]
    stream, longest = plan.stream((len(trials),)), max(len(trial.frames) for trial in trials)
    series = {output: np.empty((longest, len(trials))) for output in outputs}
    for n, frame in enumerate(_frames(trials, longest)):
        for output, values in stream.push(frame[..., columns]).items():
            series[output][n] = values
    return [
        {output: values[: len(trial.frames), place] for output, values in series.items()}
        for place, trial in enumerate(trials)
    ]


def _frames(trials: Sequence[Trial], longest: int) -> Iterator[Any]:
    last = [len(trial.frames) - 1 for trial in trials]
    for n in range(longest):
        yield np.stack([t.frames[min(n, end)] for t, end in zip(trials, last, strict=True)])


def _bound(program: Program, known: Mapping[str, float | bool | str]) -> Program:
    """Return the program with those of the known parameters that it takes."""
    takes = inspect.signature(program.function).parameters
    return program.bind(**{name: known[name] for name in known if name in (RATE, *takes)})


def _kind(trial: Trial) -> tuple[object, ...]:
    return (trial.shape, *sorted(trial.setting.items()))
