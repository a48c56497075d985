"""The way of a frame: driver, conversion, plan, events; one obvious path."""

import inspect
import time
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import cast

import numpy as np

from cnnum.arrays import Floats, Shape
from cnnum.conversion import Conversion, Reader, conversion_for
from cnnum.drivers.driver import Counters, Driver
from cnnum.drivers.registry import open_driver
from cnnum.engine import Engine
from cnnum.errors import ArrayError, SceneError, name_error
from cnnum.events import EVENT_RULES, Event, EventDetector, EventRule
from cnnum.frame import BAD, Frame, Quality
from cnnum.plan import Plan, Stream
from cnnum.program_library import get_program
from cnnum.programs import Program
from cnnum.scene import EVERYTHING, SceneSpec, read_scene
from cnnum.tactile.taxel import Calibration
from cnnum.tracing import TraceStep, trace_steps

REFUSED = BAD | Quality.REPEATED
"""Flags under which the program does not run."""


@dataclass(frozen=True, slots=True, eq=False)
class Moment:
    """One frame on its way through the scene.

    Attributes
    ----------
    number : int
        Of the frame, from 0.
    frame : Frame
        As the driver read it.
    values : (rows, cols, channels read) float or None
        What went to the program; None where the frame was bad or a repeat.
    outputs : dict of str to array
        What came back; empty where the program did not run.
    events : tuple of Event
    seconds : float
        From the frame in host memory to its events.
    """

    number: int
    frame: Frame
    values: Floats | None
    outputs: dict[str, Floats]
    events: tuple[Event, ...]
    seconds: float


@dataclass(frozen=True, slots=True, eq=False)
class Way:
    """The way of a frame from host memory to its events; what one frame does not change is done.

    Attributes
    ----------
    read : callable
        From a driver's frame to what the program takes.
    stream : Stream
    detector : EventDetector
    """

    read: Reader
    stream: Stream
    detector: EventDetector

    def step(self, number: int, frame: Frame) -> Moment:
        """Return what comes of a frame; the program does not run on one that is bad or a repeat.

        Raises
        ------
        ArrayError
            If the frame is not of the array's shape, or holds NaN or infinity.
        """
        started = time.perf_counter()
        # a good frame has no flags, and is asked no more: flags are slow to take apart
        if frame.quality and frame.quality & REFUSED:
            return Moment(number, frame, None, {}, (), 0.0)
        _refuse_other_shape(frame, self.stream.plan.schedule.shape)
        values = self.read(frame)
        outputs = self.stream.push_read(values)
        events = self.detector.update(frame.time, number, outputs)
        return Moment(number, frame, values, outputs, events, time.perf_counter() - started)


@dataclass(frozen=True, slots=True)
class Summary:
    """What a scene came to.

    Attributes
    ----------
    frames : int
        Handed on by the driver; bad and repeated ones are among them.
    bad_frames, repeated : int
        Frames that were not allowed to become an event, and repeats of the scan before.
    counters : Counters
        The driver's own.
    p50_us, p99_us : float
        Time from a frame in host memory to its events, µs.
    """

    frames: int
    bad_frames: int
    repeated: int
    counters: Counters
    p50_us: float
    p99_us: float


@dataclass(slots=True, eq=False)
class Scene:
    """A scene ready to run: the whole path, from its driver to its events.

    Attributes
    ----------
    spec : SceneSpec
    engine : Engine
    driver : Driver
    conversion : Conversion
    plan : Plan
    rules : tuple of EventRule
    """

    spec: SceneSpec
    engine: Engine
    driver: Driver
    conversion: Conversion
    plan: Plan
    rules: tuple[EventRule, ...]
    _seconds: list[float] = field(default_factory=list[float])
    _frames: int = 0
    _bad: int = 0
    _repeated: int = 0

    @classmethod
    def of(cls, spec: SceneSpec, engine: Engine | None = None) -> "Scene":
        """Open the array of a scene and compile its program for what the scene wants.

        Raises
        ------
        CnnumError
            Whatever is wrong with the file, the array, the program or the device.
        """
        used = engine or Engine(spec.engine, device=spec.device, precision=spec.precision)
        driver = open_driver(spec.driver, spec.driver_options, base=spec.base)
        try:
            known = cast(Calibration | None, getattr(driver, "calibration", None))
            conversion = conversion_for(spec.calibration, driver.channels, known, spec.base)
            program = _bound(get_program(spec.program), spec, driver.rate)
            outputs = program.trace(driver.shape, conversion.channels).outputs
            wants = _wants(spec, outputs)
            rules = _rules(spec, wants, outputs)
            fields = tuple(want for want in wants if want not in EVENT_RULES)
            needs = tuple(dict.fromkeys((*(n for rule in rules for n in rule.needs), *fields)))
            plan = used.compile(program, driver.shape, needs, channels=conversion.channels)
            plan.warm_up()
        except BaseException:
            driver.close()
            raise
        return cls(spec, used, driver, conversion, plan, rules)

    def moments(self) -> Iterator[Moment]:
        """Yield every frame with what came of it, until the source ends or the caller stops."""
        way = self.way()
        with self.driver:
            for number, frame in enumerate(self.driver.frames()):
                moment = way.step(number, frame)
                self._count(moment)
                yield moment

    def way(self) -> "Way":
        """Return the way of a frame from host memory to its events, with memories of its own."""
        wanted = self.plan.schedule.channels_read
        return Way(self.conversion.reader(wanted), self.plan.stream(), EventDetector(self.rules))

    def _count(self, moment: Moment) -> None:
        self._frames += 1
        if moment.values is not None:
            self._seconds.append(moment.seconds)
        elif moment.frame.bad:
            self._bad += 1
        else:
            self._repeated += 1

    def events(self) -> Iterator[Event]:
        """Yield the events of the scene as they come."""
        for moment in self.moments():
            yield from moment.events

    def trace(self, number: int) -> tuple[TraceStep, ...]:
        """Return every operation of the program with its result on one frame of the scene.

        The frames before it are run too, so that memories hold what they held.

        Raises
        ------
        SceneError
            If the scene has no such frame, or it was bad or a repeat and nothing ran on it.
        """
        plan = self.plan.keeping_everything()
        stream, read = plan.stream(), self.conversion.reader(plan.schedule.channels_read)
        with self.driver:
            for at, frame in enumerate(self.driver.frames()):
                runs = not frame.quality & REFUSED
                if runs:
                    _refuse_other_shape(frame, plan.schedule.shape)
                outputs = stream.push_read(read(frame)) if runs else {}
                if at == number and runs:
                    return tuple(trace_steps(self.plan.schedule, outputs))
                if at == number:
                    raise SceneError(f"Frame {number} is bad or a repeat: nothing runs on it.")
        raise SceneError(f"The scene '{self.spec.name}' has no frame {number}.")

    def summary(self) -> Summary:
        """Return what has been seen so far."""
        micros = 1e6 * np.array(self._seconds or [0.0])
        return Summary(
            frames=self._frames,
            bad_frames=self._bad + self.driver.counters.bad,
            repeated=self._repeated,
            counters=self.driver.counters,
            p50_us=float(np.percentile(micros, 50)),
            p99_us=float(np.percentile(micros, 99)),
        )


def _refuse_other_shape(frame: Frame, shape: Shape) -> None:
    """Raise if a frame is not of its array's shape: a calibration would stretch a single row."""
    if frame.shape != shape:
        raise ArrayError(
            f"A frame of this array has {shape[0]}×{shape[1]} taxels, got "
            f"{frame.shape[0]}×{frame.shape[1]} in frame {frame.sequence}."
        )


def _wants(spec: SceneSpec, outputs: Collection[str]) -> tuple[str, ...]:
    """Return what a scene wants, by name where it wants everything."""
    if EVERYTHING not in spec.wants:
        return spec.wants
    events = (want for want in EVENT_RULES if _fitting(want, outputs))
    return tuple(dict.fromkeys((*events, *outputs)))


def _fitting(want: str, outputs: Collection[str]) -> list[EventRule]:
    """Return the rules of an event that a program with these outputs can follow."""
    return [rule for rule in EVENT_RULES.get(want, ()) if set(rule.needs) <= set(outputs)]


def _rules(
    spec: SceneSpec, wants: Sequence[str], outputs: Collection[str]
) -> tuple[EventRule, ...]:
    """Return the rules of the wanted events; one whose outputs the program lacks is no part of it.

    Raises
    ------
    SceneError
        If the program gives nothing of a wanted event.
    """
    found: list[EventRule] = []
    for want in wants:
        fitting = _fitting(want, outputs)
        if want in EVENT_RULES and not fitting:
            raise SceneError(
                f"Scene '{spec.name}' wants '{want}', which the program '{spec.program}' does not "
                f"give: it has {', '.join(outputs)}."
            )
        found += fitting
    return tuple(found)


def _bound(program: Program, spec: SceneSpec, rate: float) -> Program:
    """Return the program with the scene's parameters, and the array's rate if it takes one."""
    known = inspect.signature(program.function).parameters
    for name in spec.parameters:
        if name not in known:
            choices = [key for key in known if key != "frame"]
            raise SceneError(f"Scene '{spec.name}': {name_error('parameter', name, choices)}")
    if "rate" in known and "rate" not in spec.parameters and rate > 0:
        program = program.bind(rate=rate)
    return program.bind(**spec.parameters)


def load_scene(
    scene: str | Path,
    *,
    engine: Engine | None = None,
    changes: Mapping[str, object] | None = None,
) -> Scene:
    """Open a scene: the whole path, from its array to its events.

    Parameters
    ----------
    scene : str or Path
        A TOML file, or the name of a scene that comes with the package.
    engine : Engine, optional
        To run on instead of the scene's own.
    changes : mapping of str to object, optional
        Values to set over those of the file, by dotted key.

    Raises
    ------
    CnnumError
        Whatever is wrong with the file, the array, the program or the device.
    """
    return Scene.of(read_scene(scene, changes=changes), engine)
