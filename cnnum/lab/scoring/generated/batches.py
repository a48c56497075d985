"""Cases through the program: arrays of one shape and rate run side by side."""

import inspect
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import groupby

import numpy as np

from cnnum.arrays import Floats, Shape
from cnnum.engine import Engine
from cnnum.frame import FORCE_AXES
from cnnum.lab.scoring.generated.case import Case
from cnnum.lab.scoring.generated.simulate import Simulated, Simulator
from cnnum.lab.scoring.play import Play, spans_of
from cnnum.plan import Plan
from cnnum.programs import Program
from cnnum.programs.library import get_program
from cnnum.scenes.events import Event, EventDetector, rules_that_fit

WANTS = ("contact", "slip", "twist")
EXTRA = ("twist_rate",)
"""Outputs that are scored where a program has them."""

BATCH = 8
"""Arrays side by side: enough to hide the cost of a launch, few enough to keep frames in memory."""


class Player:
    """Plays cases on an engine.

    Parameters
    ----------
    engine : Engine
    program : str
        Name of a tactile program with the outputs that contact, slip and twist need.
    """

    def __init__(self, engine: Engine, program: str = "tactile") -> None:
        self._engine, self._program = engine, get_program(program)
        self._simulate = Simulator()
        self._plans: dict[tuple[object, ...], Plan] = {}
        self._rules = rules_that_fit(WANTS, self._program.trace((4, 4)).outputs)

    def play(self, cases: Iterable[Case]) -> Iterator[Play]:
        """Yield a play for every case, those of one shape and rate together.

        Raises
        ------
        CnnumError
            If the program lacks an output, or a contact leaves its array.
        """
        ordered = sorted(cases, key=lambda case: (_array(case), str(case.geometry)))
        for array, group in groupby(ordered, key=_array):
            mine = list(group)
            for first in range(0, len(mine), BATCH):
                some = [self._simulate(case) for case in mine[first : first + BATCH]]
                yield from self._run(self._plan(*array), some)

    def _plan(self, shape: Shape, rate: float, depth: float, cover: str, bump: float) -> Plan:
        program = self._bound({"rate": rate, "depth": depth, "cover": cover, "bump": bump})
        key = (shape, program.parameters)
        if key not in self._plans:
            known = program.trace(shape).outputs
            needs = [name for rule in self._rules for name in rule.needs]
            needs += [name for name in EXTRA if name in known]
            self._plans[key] = self._engine.compile(
                program, shape, tuple(dict.fromkeys(needs)), channels=FORCE_AXES
            )
        return self._plans[key]

    def _bound(self, known: Mapping[str, float | str]) -> Program:
        """Return the program, told of the array what it takes: whoever has one knows as much."""
        takes = inspect.signature(self._program.function).parameters
        return self._program.bind(**{name: known[name] for name in known if name in takes})

    def _run(self, plan: Plan, some: Sequence[Simulated]) -> Iterator[Play]:
        columns = [FORCE_AXES.index(name) for name in plan.schedule.channels]
        stream, longest = plan.stream((len(some),)), max(len(one.times) for one in some)
        outputs: list[dict[str, Floats]] = []
        for frame in range(longest):
            # an array whose scene is over keeps its last frame; what comes of it is dropped
            now = [one.strain[min(frame, len(one.times) - 1)] for one in some]
            outputs.append(stream.push(np.stack(now)[..., columns]))
        for place, one in enumerate(some):
            count = len(one.times)
            mine = {
                name: np.array([float(known[name][place]) for known in outputs[:count]])
                for name in outputs[0]
            }
            yield _play(one, mine, events_of(self._detector(), one.times, mine))

    def _detector(self) -> EventDetector:
        return EventDetector(self._rules)


def events_of(
    detector: EventDetector, times: Floats, outputs: Mapping[str, Floats]
) -> tuple[Event, ...]:
    """Return the events of a scene from its (frames,) outputs, as its pipeline reports them."""
    found: list[Event] = []
    for frame, time in enumerate(times.tolist()):
        now = {name: values[frame] for name, values in outputs.items()}
        found += detector.update(time, frame, now)
    return tuple(found)


def _array(case: Case) -> tuple[Shape, float, float, str, float]:
    """Return what a program is compiled for: shape, frames a second, and the cover in pitches."""
    settings = case.settings
    depth, bump = settings.thickness / settings.pitch, settings.bump_radius / settings.pitch
    return settings.shape, settings.rate, depth, settings.cover, bump


def _play(one: Simulated, outputs: dict[str, Floats], events: tuple[Event, ...]) -> Play:
    case, settings = one.case, one.case.settings
    return Play(
        name=case.name,
        suite=case.suite,
        seed=case.seed,
        shape=settings.shape,
        rate=settings.rate,
        pitch=settings.pitch,
        times=one.times,
        truth=one.truth,
        outputs=outputs,
        events=events,
        phases=spans_of(settings.script, settings.rate),
        traits=case.traits(),
        about=case.describe(),
    )
