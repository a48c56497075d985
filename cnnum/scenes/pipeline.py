"""Scenes: a driver's frames on their path through a program, and what a run of them leaves."""

import inspect
import logging
import math
import time
from collections.abc import Generator, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import cast

import numpy as np

from cnnum.arrays import Shape, number_type
from cnnum.drivers.driver import Driver
from cnnum.drivers.geometry import Grid, Reordered
from cnnum.drivers.recording_file import MEMORY, RecordingDriver
from cnnum.drivers.registry import open_driver
from cnnum.drivers.timing import SAME_TIME
from cnnum.engine import Engine
from cnnum.errors import SceneError, name_error
from cnnum.frame import SLOWEST, Frame, Limits, contradicted
from cnnum.graph.nodes import Graph, Input
from cnnum.graph.tracing import TraceStep, trace_steps
from cnnum.plan import Plan
from cnnum.programs import Program
from cnnum.programs.library import get_program
from cnnum.recordings.recording import Recording
from cnnum.safety.values import shown
from cnnum.scenes.arrangement import (
    bound,
    cure_of_times,
    events_of_everything,
    grid_of,
    program_of,
    refuse_missing_axes,
    refuse_other_limits,
    refuse_slow,
    refuse_unfit,
    rules_of,
    traced,
    wants_of,
    warn_of_no_bumps,
    warn_of_other_cover,
)
from cnnum.scenes.bad_frames import BadFrames, FrameRange, range_for
from cnnum.scenes.bad_taxels import BANDWIDTH, Dropouts, Liveness
from cnnum.scenes.conversion import (
    ByCalibration,
    Conversion,
    DeadCells,
    conversion_for,
    unit_of,
)
from cnnum.scenes.events import (
    EVENT_RULES,
    Event,
    EventDetector,
    EventRule,
    event_rule,
    titled,
    with_units,
)
from cnnum.scenes.explaining import (
    WEIGHTS,
    Explained,
    explained,
    explained_kinds,
    read_outs_of,
)
from cnnum.scenes.frame_path import FramePath, FrameResult
from cnnum.scenes.like_frames import like_frames
from cnnum.scenes.push_watch import HeldWatch, OrderWatch, PushWatch
from cnnum.scenes.saturation import CHANNEL, Saturation
from cnnum.scenes.scene_file import EVERYTHING, SceneSpec, read_scene, scene_names
from cnnum.scenes.scene_record import Histogram, SceneRecord, Summary, place_of
from cnnum.values import ByContent, OfThisProcess, same

TIMED = 64
"""Frames at the start whose times are held against the rate: as many as a median needs."""

EARLY = 3
"""Frames after which a warning names times in another unit, before the first event: two steps, so
that one pause does not count."""

FACTS = (
    "shape", "channels", "unit", "rate", "calibration", "live", "positions", "pitch", "pads",
    "bumps", "cover", "limits", "bandwidth", "full_scale",
)  # fmt: skip
"""All that the path of a frame takes from a driver."""

REAL = ("float32", "float64")


def facts_of(driver: Driver) -> tuple[object, ...]:
    """Return what the path of a frame takes from a driver."""
    return tuple(getattr(driver, name, None) for name in FACTS)


class Passage:
    """One pass over the frames of a scene: their path, its tares, and all that watches them.

    Parameters
    ----------
    scene : Scene

    Attributes
    ----------
    path : FramePath
    first : float
        Time of the first frame, s.
    """

    __slots__ = ("_due", "_scene", "_times", "first", "path")

    def __init__(self, scene: "Scene") -> None:
        self._scene, self.path, self.first = scene, scene.path(), math.nan
        self._due, self._times = sorted(scene.spec.tares), list[float]()
        for watch in self.watches:
            watch.begin()
        scene.follow(self.path)

    def step(self, number: int, frame: Frame) -> FrameResult:
        """Return the results of a frame; it raises as `FramePath.step`.

        Raises
        ------
        SceneError
            If the times of a recording contradict the program's rate.
        """
        if self.tares(number, frame):
            self.tare()
        self.hold_times(frame)
        return self.end(self.path.step(number, frame))

    @property
    def watches(self) -> tuple[HeldWatch, PushWatch, OrderWatch]:
        """All that watches the scene."""
        return self._scene.holds, self._scene.push, self._scene.orders

    @property
    def channels(self) -> int:
        """Channels of the array's frames."""
        return len(self._scene.driver.channels)

    @property
    def due(self) -> bool:
        """Whether `tares` and `hold_times` have something to do before the next frame."""
        return len(self._times) < TIMED or self._scene.tared or bool(self._due)

    def tares(self, number: int, frame: Frame) -> bool:
        """Return whether rest is to be learned again from this frame on."""
        self.first = self.first if number else frame.time
        while self._due and frame.time - self.first >= self._due[0] - SAME_TIME:
            self._due.pop(0)
            self._scene.tare()
        return self._scene.take_tare()

    def tare(self) -> None:
        """Let all learn rest again."""
        self._scene.push.begin()
        self._scene.holds.begin()
        self.path.tare()

    def ask_tare(self) -> None:
        """Let the next frame be the first from which rest is learned again."""
        self._scene.tare()

    def hold_times(self, frame: Frame) -> None:
        """Hold the times of the first frames against the rate; it raises as `step`."""
        if len(self._times) < TIMED:
            self._times.append(frame.time)
            self._scene.check_times(self._times)

    def end(self, moment: FrameResult) -> FrameResult:
        """Let all that watches the scene see a result; return it, with the mark of a held rest."""
        scene, frame = self._scene, moment.frame
        if moment.values is not None:
            if scene.holds.look(moment.values, frame.time):
                scene.tare()
            scene.push.look(moment.values, frame.time)
            scene.orders.look(scene.on_grid(frame))
        return moment._replace(events=self.marked(moment.events)) if moment.events else moment

    def marked(self, events: tuple[Event, ...]) -> tuple[Event, ...]:
        """Return events of the last frame, with the mark of a rest that was held."""
        if not self._scene.holds.marks:
            return events
        return tuple(replace(event, rest_held=True) for event in events)

    def count(self, moment: FrameResult) -> None:
        """Take a result into the summary of the scene."""
        self._scene.count(moment)

    def count_good(
        self, place: int, micros: float, late_place: int = 0, late: float = math.nan
    ) -> None:
        """Take a good frame with nothing unusual into it, as `Scene.count_good`."""
        self._scene.count_good(place, micros, late_place, late)


@dataclass(frozen=True, slots=True, eq=False)
class Compiled(ByContent):
    """What a plan is made of; scenes with equal ones can share it, and its launches."""

    engine: Engine
    function: object
    parameters: tuple[tuple[str, object], ...]
    shape: Shape
    needs: tuple[str, ...]
    channels: tuple[str, ...]


@dataclass(slots=True, eq=False, repr=False)
class Scene(OfThisProcess):
    """A scene that is ready to run: the whole path from its driver to its events.

    Attributes
    ----------
    spec : SceneSpec
    engine : Engine
    driver : Driver
    conversion : Conversion
    plan : Plan
    rules : tuple of EventRule
    range : FrameRange
        Conditions that a good frame meets.
    dead : DeadCells or None
        Taxels whose values come from their neighbours.
    offered : tuple of str
        All outputs of the program, requested or not.
    push : PushWatch
        Detects motion while the rest is measured, and pushes that read as pulls.
    orders : OrderWatch
        Detects axes in a wrong order or with a wrong sign.
    holds : HeldWatch
        Detects a stream that begins with the object held; the object's release tares the scene.
    grid : Grid or None
        Square grid on which the program runs, for taxels that are not on one.
    compiled : Compiled or None
        What the plan was compiled from, or None if the plan is for this array alone.
    bad : BadFrames
        Frames skipped so far.
    tared : bool
        Whether the rest is to be measured again from the next frame on.
    """

    spec: SceneSpec
    engine: Engine
    driver: Driver
    conversion: Conversion
    plan: Plan
    rules: tuple[EventRule, ...]
    range: FrameRange
    dead: DeadCells | None
    offered: tuple[str, ...]
    push: PushWatch
    orders: OrderWatch
    holds: HeldWatch
    grid: Grid | None = None
    compiled: Compiled | None = field(default=None, init=False)
    bad: BadFrames = field(default_factory=BadFrames)
    _micros: Histogram = field(default_factory=Histogram)
    _late: Histogram = field(default_factory=Histogram)  # µs from arrival to events
    _repeated: int = 0
    _passes: int = 0
    _before: int = 0
    _last_before: Frame | None = None
    _seconds_before: float = 0.0
    _saturated: int = 0
    _masked: int = 0
    _way: FramePath | None = None  # of the present pass
    tared: bool = field(default=False, init=False)

    @classmethod
    def of(
        cls,
        spec: SceneSpec,
        engine: Engine | None = None,
        recording: Recording | None = None,
        beside: Sequence["Scene"] = (),
    ) -> "Scene":
        """Open the array of a scene and compile its program for the wanted events.

        Parameters
        ----------
        spec : SceneSpec
        engine : Engine, optional
            Engine to use instead of the scene's own.
        recording : Recording, optional
            Recording to run over instead of the array.
        beside : sequence of Scene
            Scenes whose engines, and equal plans, are shared.

        Raises
        ------
        CnnumError
            If the file, the array, the program or the device has a fault.
        """
        how = {"device": spec.device, "precision": spec.precision, "fallback": spec.fallback}
        known = (scene.engine for scene in beside if _same_engine(scene.spec, spec))
        used = engine or next(known, None) or Engine(spec.engine, **how)
        if recording is not None:
            if not isinstance(cast(object, recording), Recording):
                kind = type(recording).__name__
                raise SceneError(f"'recording' must be a cnnum.Recording, got {kind}.")
            spec = replace(spec, driver=MEMORY, driver_options={})
            driver: Driver = RecordingDriver(recording)
        else:
            driver = open_driver(spec.driver, spec.driver_options, base=spec.base)
        try:
            driver = Reordered(driver, spec.reading) if spec.reading else driver
            refuse_slow(spec, driver)
            conversion = conversion_for(spec.calibration, driver, spec.base, spec.scale)
            refuse_other_limits(spec, driver)
            grid = grid_of(spec, driver)
            measured = unit_of(conversion, driver)
            program = bound(program_of(spec), spec, driver, grid, measured)
            refuse_unfit(program, spec, driver, measured)
            shape = driver.shape if grid is None else grid.shape
            graph = traced(program, spec, shape, (*conversion.channels, CHANNEL))
            outputs = graph.outputs
            channels = (*conversion.channels, *([CHANNEL] if _reads_marks(graph) else []))
            refuse_missing_axes(program, spec, shape, conversion.channels, outputs)
            wants = wants_of(spec, outputs, events_of_everything(driver))
            warn_of_no_bumps(spec, driver)
            warn_of_other_cover(program, spec, driver, measured)
            rules = with_units(rules_of(spec, wants, outputs), program, measured)
            fields = tuple(w for w in wants if w not in EVENT_RULES and w not in spec.own)
            needs = tuple(dict.fromkeys((*(n for rule in rules for n in rule.needs), *fields)))
            dead = None
            if spec.dead:
                dead = DeadCells(spec.dead, driver.shape, fills=grid is None)
            at_ends = None
            if channels[-1] == CHANNEL:
                limit = _end_of_range(driver, conversion)
                at_ends = Saturation(driver.shape, limit, spec.dead, quiet=True)
            made = (program.function, program.parameters, shape, needs, channels)
            compiled = Compiled(used, *made) if used.precision in REAL else None
            plan = next((x.plan for x in beside if compiled and x.compiled == compiled), None)
            if plan is None:
                like = like_frames(spec, used.precision, driver, conversion, dead, at_ends, grid)
                plan = used.compile_traced(program, graph, needs, channels=channels, like=like)
            if graph.timed and graph.rate is None:
                raise SceneError(
                    f"Scene '{spec.name}': the program '{spec.program}' contains times in "
                    "seconds, but the array does not state its frame rate: set "
                    "'program.parameters.rate'; 'cnnum probe' measures it."
                )
            plan.warm_up()
        except BaseException:
            driver.close()
            raise
        within = _range(spec, driver, conversion, used.precision)
        push = PushWatch(program, plan.schedule.channels_read)
        orders = OrderWatch(driver.channels, getattr(driver, "pads", None) or 1)
        holds = HeldWatch(program, plan.schedule.channels_read)
        offered = tuple(outputs)
        scene = cls(
            spec, used, driver, conversion, plan, rules, within, dead, offered, push, orders,
            holds, grid,
        )  # fmt: skip
        scene.compiled = compiled
        return scene

    def results(self, begin: float = 0.0) -> Iterator[FrameResult]:
        """Yield every frame with its results, until the source ends or the caller stops.

        Each call is a pass from the first frame, with its own memories and counts. The array is
        closed when the pass ends.

        Parameters
        ----------
        begin : float
            Time after the first frame, s. Earlier frames run silently, so that rest, tare,
            memories and all later results are those of the whole source.

        Raises
        ------
        SceneError
            If the array is live and its frames were taken before, or a later pass has begun.
        """
        with closing(self.source()) as frames:
            way = Passage(self)
            for number, frame in enumerate(frames):
                moment = way.step(number, frame)
                if frame.time - way.first < begin - SAME_TIME:
                    self._before, self._last_before = self._before + 1, frame
                    self._seconds_before = frame.time - way.first
                    continue
                self.count(moment)
                yield moment

    def check_times(self, times: Sequence[float]) -> None:
        """Compare the program's rate with the times of the first frames.

        Raises
        ------
        SceneError
            If they contradict each other and the frames come from a recording. A live array may
            start unevenly, and gives only a warning.
        """
        rate, live = self.plan.rate, getattr(self.driver, "live", False)
        if len(times) not in (EARLY, TIMED):
            return
        early = bool((np.diff(times[:EARLY]) >= SLOWEST).all())
        if len(times) < TIMED and not early:
            return
        cure = cure_of_times(self.driver, np.asarray(times))
        seen = None
        if len(times) == TIMED:
            seen = None if rate is None else contradicted(rate, np.asarray(times))
        if seen is None or rate is None:
            said_before = early and len(times) == TIMED
            # the reader of a layout has said it
            if cure and not said_before and getattr(self.driver, "layout", None) is None:
                logging.getLogger("cnnum").warning(
                    "Scene '%s': the times of the first %d frames are %.4g s apart.%s",
                    self.spec.name, len(times), np.median(np.diff(times)), cure,
                )  # fmt: skip
            return
        said = (
            f"Scene '{self.spec.name}': the program assumes {rate:.6g} frames per second, but "
            f"the times of the first {TIMED} frames show {seen:.4g}: correct "
            f"'program.parameters.rate' or the times of the array.{cure}"
        )
        if not live:
            raise SceneError(said)
        logging.getLogger("cnnum").warning("%s", said)

    def source(self) -> Generator[Frame, None, None]:
        """Begin a pass: yield the frames of the source from its first one, and close it.

        Raises
        ------
        SceneError
            If the source is live and had its pass, or a later pass has taken the source over.
        """
        live = getattr(self.driver, "live", False)
        if self._passes:
            if live:
                raise SceneError(
                    f"The array of scene '{self.spec.name}' is live, and the frames of its first "
                    "pass are gone: load the scene again, or record the array with 'cnnum record' "
                    "and replay it."
                )
            self.bad, self._micros, self._late = BadFrames(), Histogram(), Histogram()
            self._repeated = self._before = self._saturated = self._masked = 0
            self._last_before = None
            self._seconds_before = 0.0
        self._passes += 1
        own = self._passes
        try:
            for frame in self.driver.frames():
                if self._passes != own:
                    raise SceneError(
                        f"Another pass over scene '{self.spec.name}' has begun, and a scene "
                        "supports only one pass at a time: load the scene twice to run two."
                    )
                yield frame
        finally:
            if self._passes == own:
                self.driver.close()

    def __repr__(self) -> str:
        spec, shape = self.spec, self.shape
        return (
            f"Scene('{spec.name}': {spec.driver}, {shape[0]}×{shape[1]} → {spec.program_name} → "
            f"{', '.join(spec.needs)}; {self.engine.name} {self.engine.precision})"
        )

    def _elsewhere(self) -> str:
        return "load it there, by cnnum.load_scene"

    def close(self) -> None:
        """Close the array; a scene of a recording or a simulation can still begin a pass."""
        self.driver.close()

    def __enter__(self) -> "Scene":
        """Return the scene itself."""
        return self

    def __exit__(self, *exception: object) -> None:
        """Close the scene's array."""
        self.close()

    def over(self, driver: Driver) -> bool:
        """Let the next pass run over another source, if it is compatible with the scene.

        Returns
        -------
        bool
            Whether shape, channels, unit, rate and everything else that the path depends on are
            equal. If not, nothing changes. A scene in whole numbers is fitted to its source and
            accepts no other.
        """
        whole = self.engine.precision not in REAL
        other = Reordered(driver, self.spec.reading) if self.spec.reading else driver
        if whole or not same(facts_of(other), facts_of(self.driver)):
            return False
        self.driver.close()
        self.driver = other
        return True

    def path(self) -> "FramePath":
        """Return the path of a frame from host memory to its events, with its own memories."""
        return self._path(self.plan, self.rules)

    def _path(self, plan: Plan, rules: tuple[EventRule, ...], *, quiet: bool = False) -> FramePath:
        channels = plan.schedule.channels_read
        marks = CHANNEL in channels
        read = self.conversion.reader(channels[:-1] if marks else channels, checks=False)
        saturation = Saturation(
            self.driver.shape,
            _end_of_range(self.driver, self.conversion),
            self.spec.dead,
            [f"event of {titled(rule.phase, rule.kind)}" for rule in rules if rule.shape],
            self.spec.program_name,
            marks=marks,
            quiet=quiet,
        )
        detector = EventDetector(rules)
        end = _end_of_range(self.driver, self.conversion)
        dead, limits = self.spec.dead, self._limits()
        known = cast(float | None, getattr(self.driver, "bandwidth", None))
        dropouts = Dropouts(
            self.driver.shape,
            limits,
            dead,
            bandwidth=self.spec.bandwidth or known or BANDWIDTH,
            end=end,
            quiet=quiet,
        )
        lives = Liveness(dead, end=end, quiet=quiet)
        return FramePath(
            read, plan.stream(), detector, self.range, self.dead, saturation, marks, dropouts,
            lives, self.grid,
        )  # fmt: skip

    def _limits(self) -> Limits | None:
        """Return the limits of raw values: the scene's own, else those that the driver knows."""
        known = cast(Limits | None, getattr(self.driver, "limits", None))
        return self.spec.limits or known

    def follow(self, way: FramePath) -> None:
        """Let the summary be that of a new pass."""
        self._way = way

    def count(self, moment: FrameResult) -> None:
        """Take a result into the summary."""
        if moment.values is not None:
            self._saturated += moment.saturated is not None
            self._masked += moment.masked is not None
            micros, arrived = 1e6 * moment.seconds, moment.frame.monotonic_ns
            late = math.nan if arrived is None else 1e-3 * (time.monotonic_ns() - arrived)
            self.count_good(place_of(micros), micros, place_of(late), late)
        elif moment.error is not None:
            frame = moment.frame
            self.bad.add(moment.number, frame.time, moment.error, self._micros.total)
        else:
            self._repeated += 1

    def count_good(self, place: int, micros: float, late_place: int, late: float) -> None:
        """Take a frame on which the program ran into it.

        Parameters
        ----------
        place, late_place : int
            Bins of the next two.
        micros : float
            µs from the frame to its events.
        late : float
            µs since its arrival, or NaN if that is not known.
        """
        self._micros.add_at(place, micros)
        if not math.isnan(late):
            self._late.add_at(late_place, late)

    def on_grid(self, frame: Frame) -> Frame:
        """Return a frame on the grid of the program, or unchanged if no grid is needed."""
        if self.grid is None or self.orders.said:
            return frame
        return replace(frame, values=self.grid.maps(frame.values), saturated=None)

    def tare(self) -> None:
        """Measure rest and noise again, from the next frame on, while nothing touches the array.

        A contact that is held is released. This may be called from any thread.
        """
        self.tared = True

    def take_tare(self) -> bool:
        """Return whether the rest must be measured again, and clear that request."""
        if not self.tared:
            return False
        self.tared = False
        return True

    def events(self) -> Iterator[Event]:
        """Yield the events of the scene as they occur; each call is a pass, as in `results`."""
        for moment in self.results():
            yield from moment.events

    @property
    def shape(self) -> Shape:
        """Rows and columns of the program's maps."""
        return self.driver.shape if self.grid is None else self.grid.shape

    @property
    def last_before(self) -> Frame | None:
        """Last frame that ran silently, or None."""
        return self._last_before

    @property
    def seconds_before(self) -> float:
        """Time from the first frame to the last one that ran silently, s; 0 if none did."""
        return self._seconds_before

    @property
    def fields(self) -> tuple[str, ...]:
        """Outputs of the program that the scene wants by name, apart from events."""
        wanted = set(self.spec.needs)
        known = self.plan.schedule.outputs
        events = {*EVENT_RULES, *self.spec.own}
        return tuple(n for n in known if n in wanted and n not in events) or tuple(
            known if EVERYTHING in wanted else ()
        )

    def collect(self, frames: int | None = None) -> SceneRecord:
        """Run the scene to its end, or for a number of frames, and return its fields and events.

        Raises
        ------
        SceneError
            If the number is not a positive whole number.
        """
        if frames is not None and (not isinstance(cast(object, frames), int) or frames < 1):
            raise SceneError(f"'frames' must be a whole number of at least 1, got {shown(frames)}.")
        record = SceneRecord(self.fields)
        for moment in self.results():
            record.add(moment)
            if frames is not None and moment.number + 1 >= frames:
                break
        return record

    def trace(self, number: int) -> tuple[TraceStep, ...]:
        """Return every operation of the program with its result on one frame of the scene.

        The frames before it are run too, so that memories hold the same values.

        Raises
        ------
        SceneError
            If the scene has no such frame, or if it was bad or repeated, so that nothing ran on it.
        """
        way = self._path(self.plan.keeping_everything(), (), quiet=True)
        with closing(self.source()) as frames:
            for at, frame in enumerate(frames):
                moment = way.step(at, frame)
                if at == number and moment.values is None:
                    raise SceneError(
                        f"Frame {number} is bad or repeated, so the program does not run on it."
                    )
                if at == number:
                    return tuple(trace_steps(self.plan.schedule, moment.outputs))
        raise SceneError(f"The scene '{self.spec.name}' has no frame {number}.")

    def keep_everything(self) -> None:
        """Let every later moment hold the result of every operation, by its index as text."""
        self.plan = self.plan.keeping_everything(beside=True)

    def explain(self, time: float) -> tuple[Explained, ...]:
        """Return why slip and twist are reported at a time, or are not.

        The frames before it are run too, so that memories hold the same values.

        Parameters
        ----------
        time : float
            Time after the first frame, s. The first frame from then on that reaches the program
            counts.

        Raises
        ------
        SceneError
            If the program reports neither slip nor twist with their read-outs, or the scene has no
            frame at that time.
        """
        return self.explain_between(time, time)[0]

    def explain_between(self, begin: float, end: float) -> tuple[tuple[Explained, ...], ...]:
        """Return why slip and twist are reported, or are not, frame by frame.

        Parameters
        ----------
        begin, end : float
            Times after the first frame, s. The first frame from `begin` on counts in any case.

        Raises
        ------
        SceneError
            As for `explain`.
        """
        kinds = explained_kinds(self.offered)
        if not kinds:
            raise SceneError(
                f"Scene '{self.spec.name}': the program '{self.spec.program_name}' has no "
                "read-outs of slip or twist to explain: take 'slip', 'twist' or 'tactile'."
            )
        measured = unit_of(self.conversion, self.driver)
        program = bound(program_of(self.spec), self.spec, self.driver, self.grid, measured)
        channels = self.plan.schedule.channels
        needs = read_outs_of(kinds, self.offered)
        way = self._path(self.engine.compile(program, self.shape, needs, channels=channels), ())
        weights, result = self.weights(), list[tuple[Explained, ...]]()
        with closing(self.source()) as frames:
            first = math.nan
            for number, frame in enumerate(frames):
                first = first if number else frame.time
                moment = way.step(number, frame)
                if moment.values is None or frame.time - first < begin - SAME_TIME:
                    continue
                if result and frame.time - first > end + SAME_TIME:
                    break
                result.append(explained(moment.outputs, kinds, frame.time, number, weights))
                if frame.time - first > end - SAME_TIME:
                    break
        if not result:
            raise SceneError(
                f"The scene '{self.spec.name}' has no frame {begin:g} s after its first one."
            )
        return tuple(result)

    def weights(self) -> dict[str, float]:
        """Return the weights of other causes of movement in `slip`, by parameter."""
        defaults = inspect.signature(get_program("slip").function).parameters
        own = inspect.signature(program_of(self.spec).function).parameters
        given = {name: defaults[name].default for name in WEIGHTS}
        given |= {name: value for name, value in self.spec.parameters.items() if name in own}
        return {name: float(cast(float, given[name])) for name in WEIGHTS}

    def summary(self) -> Summary:
        """Return the summary so far."""
        handed_on, way = self._micros.total, self._way
        drops = None if way is None else way.dropouts
        return Summary(
            frames=handed_on + self.bad.count + self._repeated,
            before=self._before,
            handed_on=handed_on,
            refused=self.bad.count,
            repeated=self._repeated,
            saturated=self._saturated,
            masked=self._masked,
            dropouts=0 if drops is None else drops.count,
            counters=self.driver.counters,
            longest_gap=0.0 if way is None else way.detector.longest_gap,
            p50_us=self._micros.quantile(0.50),
            p99_us=self._micros.quantile(0.99),
            arrival_p50_us=self._late.quantile(0.50) if self._late.total else None,
            arrival_p99_us=self._late.quantile(0.99) if self._late.total else None,
        )


def _reads_marks(graph: Graph) -> bool:
    """Return whether a program asks which taxels stand at an end of their range."""
    return any(node.operation == Input(CHANNEL) for node in graph.nodes)


def _same_engine(this: SceneSpec, other: SceneSpec) -> bool:
    """Return whether two scenes ask for the same engine, in real numbers."""
    asked = ((x.engine, x.device, x.precision, x.fallback) for x in (this, other))
    return next(asked) == next(asked) and (this.precision or REAL[0]) in REAL


def _end_of_range(driver: Driver, conversion: Conversion) -> float:
    """Return the magnitude from which a value stands at an end of its range."""
    if isinstance(conversion, ByCalibration):
        return conversion.calibration.limit
    full_scale = cast(float | None, getattr(driver, "full_scale", None))
    return math.inf if full_scale is None else full_scale


def _range(spec: SceneSpec, driver: Driver, conversion: Conversion, precision: str) -> FrameRange:
    """Return the conditions on a good frame of a scene."""
    known = conversion.calibration if isinstance(conversion, ByCalibration) else None
    return range_for(
        driver.unit,
        number_type(precision),
        given=spec.frame_range,
        full_scale=cast(float | None, getattr(driver, "full_scale", None)),
        saturated=known.limit if known is not None else math.inf,
    )


def get_scene(name: str, *, engine: Engine | None = None) -> Scene:
    """Return a packaged scene by its name; `load_scene` also accepts files.

    Raises
    ------
    UnknownNameError
        If there is no packaged scene of that name.
    """
    if name not in scene_names():
        raise name_error("scene", name, scene_names())
    return load_scene(name, engine=engine)


def load_scene(
    scene: str | Path,
    *,
    engine: Engine | None = None,
    recording: Recording | None = None,
    program: Program | str | None = None,
    events: Sequence[Mapping[str, object]] = (),
    changes: Mapping[str, object] | None = None,
    trust: bool = False,
) -> Scene:
    """Open a scene: the whole path, from its array to its events.

    Parameters
    ----------
    scene : str or Path
        A TOML file, or the name of a packaged scene.
    engine : Engine, optional
        Engine to use instead of the scene's own.
    recording : Recording, optional
        Recording to run over instead of the scene's array.
    program : Program or str, optional
        Program to run instead of the scene's own, with its own parameters. All of its outputs are
        requested unless `changes` sets "needs".
    events : sequence of mapping
        Additional events, with the keys of a table [[event]] of a scene file, such as
        {"kind": "poke", "flag": "poke", "on": 0.5}.
    changes : mapping of str to object, optional
        Values that override those of the file, by dotted key.
    trust : bool
        Whether a driver or a program that the file names as "module:name" may be imported, which
        executes its code. Otherwise only one that is named here, or a driver of an installed
        package, is imported.

    Raises
    ------
    CnnumError
        If the file, the array, the program or the device has a fault.
    """
    if changes is not None and not isinstance(cast("object", changes), Mapping):
        raise SceneError(f"'changes' must be a mapping of keys to values, got {shown(changes)}.")
    given: dict[str, object] = dict(changes or {})
    if program is not None:
        given = {"needs": [EVERYTHING], "program": {}, **given}
        if isinstance(program, str):
            given["program.name"] = program
    spec = read_scene(scene, changes=given, trust=trust)
    if isinstance(program, Program):
        spec = replace(spec, program=program)
    own = (event_rule(table, f"Event {n}") for n, table in enumerate(events, 1))
    return Scene.of(replace(spec, events=(*spec.events, *own)), engine, recording)
