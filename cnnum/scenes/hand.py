"""A hand: several skins in one process, which share launches and one clock."""

import asyncio
import math
import time
from collections.abc import (
    AsyncIterator,
    Callable,
    Generator,
    Iterable,
    Iterator,
    Mapping,
    Sequence,
)
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, closing
from dataclasses import dataclass
from pathlib import Path
from threading import Condition, Thread, current_thread
from threading import Event as ThreadEvent
from typing import cast

from cnnum.drivers.driver import Mailbox
from cnnum.errors import SceneError, name_error
from cnnum.frame import Frame
from cnnum.safety.values import checked_name, is_real, shown
from cnnum.scenes.abreast import PathsAbreast, StepAbreast
from cnnum.scenes.events import Event
from cnnum.scenes.frame_path import FrameResult
from cnnum.scenes.pipeline import Passage, Scene
from cnnum.scenes.scene_file import read_hand
from cnnum.scenes.scene_record import Histogram, Summary
from cnnum.values import OfThisProcess

DEPTH = 256
"""Frames of a live skin that may wait for their turn: a bound on memory, at any rate."""

TOGETHER = 0.5
"""Part of the shortest period within which frames of several skins are of one step."""


class HandResult:
    """One step of a hand: at most one frame of each skin, with its results.

    Attributes
    ----------
    number : int
        Number of the step, from 0.
    time : float
        Time of its last frame on the hand's clock, s. Frames and events keep the time of their own
        array.
    seconds : float
        Time from the arrival of the first of these frames at the host, or from the beginning of
        the step if that is not known, to the last event.
    missed : bool
        Whether that was longer than the hand's deadline.
    events : tuple of (str, Event)
        Names of skins with their events, in the order of the skins.
    """

    __slots__ = ("_order", "_parts", "_skins", "events", "missed", "number", "seconds", "time")

    def __init__(
        self,
        number: int,
        time: float,
        seconds: float,
        events: tuple[tuple[str, Event], ...],
        order: Iterable[str],
        parts: Sequence[tuple[Sequence[str], StepAbreast]],
        *,
        missed: bool = False,
    ) -> None:
        self.number, self.time, self.seconds, self.missed = number, time, seconds, missed
        self.events, self._order, self._parts = events, order, parts
        self._skins: dict[str, FrameResult] | None = None

    @property
    def skins(self) -> dict[str, FrameResult]:
        """The skins that had a frame, with its results, which are computed when they are read."""
        if self._skins is None:
            made = {
                names[lane]: moment
                for names, part in self._parts
                for lane, moment in part.results().items()
            }
            self._skins = {name: made[name] for name in self._order if name in made}
        return self._skins

    def __getitem__(self, name: str) -> FrameResult:
        return self.skins[name]

    def __contains__(self, name: object) -> bool:
        return name in self.skins

    def __repr__(self) -> str:
        return f"HandResult({self.number} at {self.time:.4f} s, {', '.join(self.skins)})"


@dataclass(frozen=True, slots=True)
class HandSummary:
    """Summary of a hand so far.

    Attributes
    ----------
    steps : int
    missed : int
        Steps that took longer than the deadline.
    p50_us, p99_us : float
        `HandResult.seconds` in µs, within 1 %.
    waiting, dropped, skipped : int
        Frames that are queued; that were lost because the queue was full; that were passed over
        for newer ones.
    skins : dict of str to Summary
    """

    steps: int
    missed: int
    p50_us: float
    p99_us: float
    waiting: int
    dropped: int
    skipped: int
    skins: dict[str, Summary]


class Hand(OfThisProcess):
    """Several named skins, of any shapes, that are processed together.

    Skins with the same shape, program and engine share the launches of one plan. Each has its own
    rest, memories, events and errors, and its results are the same as if it ran alone.

    Parameters
    ----------
    skins : mapping of str to Scene
        Scenes that are to share launches must have been loaded with the same `Engine`.
    deadline : float, optional
        s from the arrival of a frame to its events; later steps are counted as missed.

    Raises
    ------
    SceneError
        If there is no skin, a name is not one line of printable characters, a scene is given twice,
        or the deadline is not a positive time.

    Examples
    --------
    >>> with cnnum.load_hand("hand.toml") as hand:  # doctest: +SKIP
    ...     for step in hand.results():
    ...         for skin, event in step.events:
    ...             print(skin, event)
    """

    def __init__(self, skins: Mapping[str, Scene], *, deadline: float | None = None) -> None:
        if not skins:
            raise SceneError("A hand must have at least one skin, got none.")
        for name, scene in skins.items():
            checked_name("a skin", name, SceneError)
            if not isinstance(cast("object", scene), Scene):
                raise SceneError(
                    f"Skin {name!r} must be a scene that cnnum.load_scene has opened, got "
                    f"{shown(scene)}."
                )
        if len({id(scene) for scene in skins.values()}) < len(skins):
            raise SceneError("A hand must have a scene for each skin: one is given twice.")
        if deadline is not None and not (is_real(deadline) and 0.0 < deadline < math.inf):
            raise SceneError(f"'deadline' must be a positive time in s, got {shown(deadline)}.")
        self._skins, self._deadline = dict(skins), deadline
        self._boxes: tuple[Mailbox, ...] = ()
        self._newest = self._stopped = False
        self._changed = Condition()
        self._thread: Thread | None = None
        self._failed: Exception | None = None
        self.begin()

    def begin(self) -> None:
        """Restart with the next frames: memories, numbers, clocks and counts of steps."""
        self._clocks: dict[str, float] = {}
        self._began: dict[bool, int] = {}  # by the host's two clocks, which have no common zero
        self._steps = self._missed = 0
        self._micros = Histogram()
        groups: dict[str, list[str]] = {}
        for name, scene in self._skins.items():
            first = next((n for n in groups if _alike(self._skins[n], scene)), name)
            groups.setdefault(first, []).append(name)
        self._groups = [
            (names, PathsAbreast([Passage(self._skins[name]) for name in names]))
            for names in groups.values()
        ]

    def __getitem__(self, name: str) -> Scene:
        if name not in self._skins:
            raise name_error("skin", name, tuple(self._skins))
        return self._skins[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._skins)

    def __len__(self) -> int:
        return len(self._skins)

    def __repr__(self) -> str:
        return f"Hand({', '.join(self._skins)}; {self.launches} launches a step)"

    def _elsewhere(self) -> str:
        return "load it there, by cnnum.load_hand"

    @property
    def skins(self) -> dict[str, Scene]:
        """Scenes by the names of the skins."""
        return dict(self._skins)

    @property
    def launches(self) -> int:
        """Launches per step in which every skin has a frame."""
        return len(self._groups)

    def warm_up(self) -> None:
        """Build all kernels now, so that no step waits for them; no memory changes."""
        for _, group in self._groups:
            group.warm_up()

    def push(self, frames: Mapping[str, Frame]) -> HandResult:
        """Process the next frames of some skins, which the caller has read.

        Parameters
        ----------
        frames : mapping of str to Frame
            At most one per skin, and at least one.

        Raises
        ------
        UnknownNameError
            If there is no such skin.
        ArrayError, SceneError, MethodError
            As for a scene, or if there is no frame.
        """
        if not frames:
            raise SceneError("A step of a hand must have a frame of at least one skin, got none.")
        for name in frames:
            self[name]
        return self._step(frames)

    def _step(self, frames: Mapping[str, Frame]) -> HandResult:
        begun = time.monotonic_ns()
        parts = list[tuple[list[str], StepAbreast]]()
        for names, group in self._groups:
            lanes = [lane for lane, name in enumerate(names) if name in frames]
            if lanes:
                parts.append((names, group.step(lanes, [frames[names[lane]] for lane in lanes])))
        arrived, last, clocks = begun, -math.inf, self._clocks
        for name, frame in frames.items():
            clock, came = clocks.get(name), frame.monotonic_ns
            now = self._time(name, frame) if clock is None else frame.time + clock
            last = now if now > last else last
            if came is not None and came < arrived:
                arrived = came
        found = {names[lane]: own for names, part in parts for lane, own in part.events.items()}
        order = self._skins if found else ()
        events = tuple((name, event) for name in order for event in found.get(name, ()))
        seconds = 1e-9 * (time.monotonic_ns() - arrived)
        missed = self._deadline is not None and seconds > self._deadline
        self._micros.add(1e6 * seconds)
        self._missed += missed
        self._steps += 1
        number = self._steps - 1
        return HandResult(number, last, seconds, events, self._skins, parts, missed=missed)

    def _time(self, name: str, frame: Frame) -> float:
        """Return the time of a frame on the hand's clock, s since the first frame of the hand."""
        if name not in self._clocks:
            steady = frame.monotonic_ns is not None
            arrived = frame.monotonic_ns if steady else frame.wall_ns
            if arrived is None:
                self._clocks[name] = 0.0
            else:
                began = self._began.setdefault(steady, arrived)
                self._clocks[name] = 1e-9 * (arrived - began) - frame.time
        return frame.time + self._clocks[name]

    def results(self, *, newest: bool = False) -> Generator[HandResult, None, None]:
        """Yield the steps of the hand until all sources end or the caller stops.

        Live arrays are read in threads: frames that arrive while a step is processed are queued for
        the next step. Recordings and simulations are processed in the order of their times, as fast
        as possible.

        Parameters
        ----------
        newest : bool
            Process only the newest frame of each live array, as a controller may want, and count
            the others as skipped. By default, every frame is processed in order; if more than
            `DEPTH` are queued, the oldest are dropped and counted, and the next one is flagged.

        Raises
        ------
        SceneError
            As for `Scene.results`.
        """
        self._stopped = False  # now, so that a `stop` before the first step counts
        return self._pass(newest)

    def frames(self, *, newest: bool = False) -> Generator[dict[str, Frame], None, None]:
        """Yield the frames of each step by the names of their skins, without processing them."""
        self._stopped = False
        return self._frames(newest)

    def _frames(self, newest: bool) -> Generator[dict[str, Frame], None, None]:
        self.begin()
        self._newest = newest
        live = any(getattr(scene.driver, "live", False) for scene in self._skins.values())
        with closing(self._live(newest) if live else self._merged()) as steps:
            for frames in steps:
                if self._stopped:
                    return
                yield frames

    def _pass(self, newest: bool) -> Generator[HandResult, None, None]:
        with closing(self._frames(newest)) as steps:
            for frames in steps:
                yield self._step(frames)

    def events(self, *, newest: bool = False) -> Iterator[tuple[str, Event]]:
        """Yield the events of the hand as they occur, with the names of their skins."""
        with closing(self.results(newest=newest)) as steps:
            for step in steps:
                yield from step.events

    def _merged(self) -> Generator[dict[str, Frame], None, None]:
        """Yield frames that come together on the hand's clock, from sources at hand."""
        rates = [scene.driver.rate for scene in self._skins.values() if scene.driver.rate > 0.0]
        apart = TOGETHER / max(rates, default=math.inf)
        with ExitStack() as stack:
            sources = {
                name: stack.enter_context(closing(scene.source()))
                for name, scene in self._skins.items()
            }
            ahead = {name: next(source, None) for name, source in sources.items()}
            while any(frame is not None for frame in ahead.values()):
                times = {
                    name: self._time(name, frame)
                    for name, frame in ahead.items()
                    if frame is not None
                }
                end = min(times.values()) + apart
                taken = [
                    name for name, at in times.items() if at < end or at == min(times.values())
                ]
                yield {name: cast(Frame, ahead[name]) for name in taken}
                for name in taken:
                    ahead[name] = next(sources[name], None)

    def _live(self, newest: bool) -> Generator[dict[str, Frame], None, None]:
        """Yield what waits of each skin, from threads that read the arrays."""
        boxes = {
            name: Mailbox(1 if newest else DEPTH, lost=not newest, changed=self._changed)
            for name in self._skins
        }
        self._boxes = tuple(boxes.values())
        left = ThreadEvent()
        readers = [
            Thread(target=_read, args=(scene, boxes[name], left), name=f"cnnum-{name}", daemon=True)
            for name, scene in self._skins.items()
        ]
        for reader in readers:
            reader.start()

        def ready() -> bool:
            some = any(box.waiting for box in boxes.values())
            return some or self._stopped or any(box.ended for box in boxes.values())

        try:
            while boxes and not self._stopped:
                with self._changed:
                    self._changed.wait_for(ready)
                    given = {n: cast(Frame, box.take()) for n, box in boxes.items() if box.waiting}
                if given:
                    yield given
                # even where frames of others always wait: a hand that falls behind hears of it
                for name in [name for name, box in boxes.items() if box.ended]:
                    boxes.pop(name).take()  # raises what ended it
        finally:
            left.set()
            self.close()
            for reader in readers:
                reader.join(5.0)

    def run(self, callback: Callable[[HandResult], object], *, newest: bool = False) -> HandSummary:
        """Call a function with each step, in this thread, until the sources end or `stop`."""
        return self._follow(self.results(newest=newest), callback)

    def _follow(
        self,
        results: Generator[HandResult, None, None],
        callback: Callable[[HandResult], object],
    ) -> HandSummary:
        with closing(results) as steps:  # an error of the callback ends the pass, too
            for step in steps:
                callback(step)
        return self.summary()

    def start(self, callback: Callable[[HandResult], object], *, newest: bool = False) -> None:
        """Call a function with each step, in a thread of its own, until `stop`.

        Raises
        ------
        SceneError
            If such a thread is already running.
        """
        if self._thread is not None:
            raise SceneError("The hand has been started: call its method stop first.")

        results = self.results(newest=newest)

        def work() -> None:
            try:
                self._follow(results, callback)
            except Exception as error:  # handed on by `stop`
                self._failed = error

        self._failed = None
        self._thread = Thread(target=work, name="cnnum-hand", daemon=True)
        self._thread.start()

    def stop(self) -> HandSummary:
        """End the current pass, wait for its thread, and return the summary.

        Raises
        ------
        Exception
            The exception that ended the thread begun by `start`.
        """
        with self._changed:
            self._stopped = True
            self._changed.notify_all()
        thread = self._thread
        if thread is not None and thread is not current_thread():
            thread.join()
            self._thread = None
        failed, self._failed = self._failed, None
        if failed is not None:
            raise failed
        return self.summary()

    async def stream(self, *, newest: bool = False) -> AsyncIterator[HandResult]:
        """Yield the steps of the hand to a coroutine; they are processed in a thread.

        A step begins when the previous one has been taken, so that frames are queued only here.
        """
        loop, steps = asyncio.get_running_loop(), self.results(newest=newest)
        with ThreadPoolExecutor(1, "cnnum-hand") as pool:
            try:
                while (step := await loop.run_in_executor(pool, next, steps, None)) is not None:
                    yield step
            finally:
                with self._changed:
                    self._stopped = True
                    self._changed.notify_all()
                pool.submit(steps.close)

    def tare(self, *names: str) -> None:
        """Measure rest and noise of some skins, or of all, again from their next frames on.

        Nothing may touch them meanwhile. This may be called from any thread.

        Raises
        ------
        UnknownNameError
            If there is no such skin; no skin is then tared.
        """
        for scene in [self[name] for name in names or self._skins]:
            scene.tare()

    def summary(self) -> HandSummary:
        """Return the summary so far."""
        lost = sum(box.pushed_out for box in self._boxes)
        return HandSummary(
            steps=self._steps,
            missed=self._missed,
            p50_us=self._micros.quantile(0.50),
            p99_us=self._micros.quantile(0.99),
            waiting=sum(box.waiting for box in self._boxes),
            dropped=0 if self._newest else lost,
            skipped=lost if self._newest else 0,
            skins={name: scene.summary() for name, scene in self._skins.items()},
        )

    def close(self) -> None:
        """Close all arrays."""
        for scene in self._skins.values():
            scene.close()

    def __enter__(self) -> "Hand":
        """Return the hand itself."""
        return self

    def __exit__(self, kind: object, *exception: object) -> None:
        """End the pass as `stop` does, and close all arrays."""
        try:
            self.stop()
        except Exception:
            if kind is None:
                raise
        finally:
            self.close()


def _read(scene: Scene, box: Mailbox, left: ThreadEvent) -> None:
    """Bring the frames of an array into its mailbox; those of a simulation at their times."""
    try:
        with closing(scene.source()) as frames:
            begun: float | None = None
            for frame in frames:
                if not getattr(scene.driver, "live", False):
                    begun = time.monotonic() - frame.time if begun is None else begun
                    left.wait(max(0.0, begun + frame.time - time.monotonic()))
                if left.is_set():
                    break
                box.put(frame)
    except Exception as error:  # of a driver of the user's own, too: the hand raises it
        box.end(error)
    else:
        box.end()


def _alike(this: Scene, other: Scene) -> bool:
    """Return whether frames of two scenes can share the launches of the first one's plan."""
    return this.compiled is not None and this.compiled == other.compiled


def load_hand(
    hand: str | Path,
    *,
    deadline: float | None = None,
    changes: Mapping[str, object] | None = None,
    trust: bool = False,
) -> Hand:
    """Open a hand: several skins, from their arrays to their events.

    Parameters
    ----------
    hand : str or Path
        A TOML file with the keys of a scene, which are common to all skins, and a table
        [skin.NAME] for each of them with keys of its own.
    deadline : float, optional
        s from the arrival of a frame to its events; later steps are counted as missed.
    changes : mapping of str to object, optional
        Values that override those of the file, by dotted key: "array.rate" for all skins,
        "skin.thumb.array.rate" for one.
    trust : bool
        As in `load_scene`.

    Raises
    ------
    CnnumError
        If the file, an array, a program or the device has a fault.
    """
    if changes is not None and not isinstance(cast("object", changes), Mapping):
        raise SceneError(f"'changes' must be a mapping of keys to values, got {shown(changes)}.")
    scenes: dict[str, Scene] = {}
    try:
        for name, spec in read_hand(hand, changes=changes, trust=trust).items():
            scenes[name] = Scene.of(spec, beside=tuple(scenes.values()))
        return Hand(scenes, deadline=deadline)
    except BaseException:
        for scene in scenes.values():
            scene.close()
        raise
