"""Where pictures come from: a scene that runs, an array alone, or a recording that is played."""

import logging
import time
from abc import ABC, abstractmethod
from base64 import b64decode
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from threading import Condition, Thread
from typing import Any, Protocol, TypeGuard, cast

import numpy as np

from cnnum.arrays import Floats
from cnnum.drivers.driver import Counters, Driver
from cnnum.engine import Engine
from cnnum.errors import CnnumError
from cnnum.frame import Frame
from cnnum.live.hub import Hub, Inside
from cnnum.programs.library import get_program
from cnnum.safety.values import is_real
from cnnum.scenes.conversion import unit_of
from cnnum.scenes.explaining import explained, explained_kinds, read_outs_of
from cnnum.scenes.frame_path import FrameResult
from cnnum.scenes.hand import Hand
from cnnum.scenes.pipeline import Passage, Scene

FIRST, ENOUGH = 0.3, 8
"""s, and frames at least, whose median is shown as nothing, of an array without a program."""

BEHIND = 0.1
"""s that a recording may lag behind its pace and catch up."""

SLOWEST, QUICKEST = 0.01, 100.0


class Feed(Protocol):
    """Brings moments to a hub from a thread of its own; those of a hand to one for each skin."""

    @property
    def hubs(self) -> Sequence[Hub]:
        """Hubs of all skins; one of anything else."""
        ...

    def start(self) -> None:
        """Begin."""
        ...

    def stop(self) -> None:
        """End."""
        ...

    def command(self, wanted: dict[str, Any]) -> None:
        """Follow a page's command."""
        ...


class Take(Protocol):
    """A recording in the making, which a page has begun."""

    def add(self, name: str, frame: Frame) -> None:
        """Keep a frame of a skin; `name` is empty where there is one array."""
        ...

    def finish(self) -> str:
        """Close its files, and return in a sentence what was kept."""
        ...


Begin = Callable[[], Take]
"""Begins a recording."""


class Rested:
    """Readings minus their rest, which is the median of the first good frames.

    Parameters
    ----------
    read : callable
        From a frame to its numbers.
    """

    def __init__(self, read: Callable[[Frame], Floats]) -> None:
        self._read = read
        self._rest: Floats | float = 0.0
        self._first: list[Floats] = []
        self._since, self._learns, self._anew = 0.0, True, True

    def begin(self) -> None:
        """Learn the rest from the next frames; any thread may ask for it."""
        self._anew = True

    def look(self, frame: Frame) -> None:
        """Take in a good frame."""
        if self._anew:
            self._anew, self._learns, self._first = False, True, []
        if not self._learns:
            return
        self._since = self._since if self._first else frame.time
        self._first.append(self._read(frame))
        count = len(self._first)
        self._learns = count < ENOUGH or frame.time - self._since < FIRST
        if count <= ENOUGH or not self._learns:
            first = np.stack(self._first)
            good = np.isfinite(first)
            # without the faults of a few frames; a taxel that is never finite is shown as nothing
            lost = np.where(good.any(axis=0), np.nan, 0.0)
            self._rest = np.nanmedian(np.where(good, first, lost), axis=0)

    def __call__(self, frame: Frame) -> Floats:
        """Return the numbers of a frame."""
        return np.asarray(self._read(frame) - self._rest)


class _Warnings(logging.Handler):
    """Gives a hub what the scene warns of: orders, dropouts, a silent array and so on."""

    def __init__(self, hub: Hub) -> None:
        super().__init__(logging.WARNING)
        self._hub = hub

    def emit(self, record: logging.LogRecord) -> None:
        """Hand on a sentence."""
        if record.name == "cnnum":
            self._hub.warn(record.getMessage())


class _Threaded(ABC):
    """A feed whose work ends by itself, or by an error that the page shows."""

    hub: Hub

    def __init__(self) -> None:
        self._thread = Thread(target=self._run, name="cnnum-view", daemon=True)
        self._stopped = False

    @property
    def hubs(self) -> Sequence[Hub]:
        """The one hub."""
        return (self.hub,)

    def start(self) -> None:
        """Begin."""
        self._thread.start()

    def _run(self) -> None:
        logger, handler = logging.getLogger("cnnum"), _Warnings(self.hub)
        logger.addHandler(handler)
        ended = "The source has ended."
        try:
            self._work()
        except CnnumError as error:
            ended = str(error)
        except Exception as error:  # of a driver of the user's own: the page is told, too
            said = " ".join(f"{type(error).__name__}: {error!s:.300}".split())
            ended = f"The source has failed ({said}): see to its driver."
            logging.getLogger(__name__).error("The source has failed.", exc_info=error)
        finally:
            logger.removeHandler(handler)
        for hub in self.hubs:
            hub.end(ended)

    @abstractmethod
    def _work(self) -> None:
        """Bring moments until the source ends or the feed is stopped."""


class _Asked(_Threaded):
    """A feed that waits for commands of the page."""

    def __init__(self) -> None:
        super().__init__()
        self._changed = Condition()

    def stop(self) -> None:
        """End."""
        with self._changed:
            self._stopped = True
            self._changed.notify_all()
        self._thread.join(5.0)


class _Live(_Threaded):
    """A feed whose time is that of the world: it cannot be moved in time."""

    def __init__(self, begin: Begin | None = None) -> None:
        super().__init__()
        self._begin, self._take, self._keeps = begin, cast(Take | None, None), False

    def command(self, wanted: dict[str, Any]) -> None:
        """Learn rest anew, of one skin or of all, and begin or end a recording."""
        if wanted.get("tare") is True:
            skin = wanted.get("skin")
            self.tare(skin if isinstance(skin, str) else "")
        if isinstance(keeps := wanted.get("record"), bool) and self._begin is not None:
            self._keeps = keeps

    @abstractmethod
    def tare(self, skin: str) -> None:
        """Learn rest anew from the next frame on; of all skins where no name is given."""

    def _keep(self, frames: Mapping[str, Frame]) -> None:
        """Record frames, by the names of their skins, while a page wants it."""
        hub = self.hubs[0]
        try:
            if self._keeps and self._take is None and self._begin is not None:
                self._take, hub.recorded = self._begin(), ""
            if self._take is not None and self._keeps:
                for name, frame in frames.items():
                    self._take.add(name, frame)
        except CnnumError as error:
            self._keeps, hub.recorded = False, str(error)
        if not self._keeps:
            self._finish()
        hub.recording = self._take is not None

    def _finish(self) -> None:
        """End a recording, if there is one."""
        take, self._take = self._take, None
        if take is not None:
            said, hub = take.finish(), self.hubs[0]
            hub.recorded, hub.recording = f"{hub.recorded} {said}".strip(), False

    def _run(self) -> None:
        try:
            super()._run()
        finally:
            self._finish()


class SceneFeed(_Live):
    """A scene as it runs: its program sees every frame, pages the newest."""

    def __init__(self, scene: Scene, *, inside: bool = False, begin: Begin | None = None) -> None:
        super().__init__(begin)
        self._scene, self._shown = scene, shown_of(scene)
        self.hub = hub_of(scene, self._shown, inside=inside)
        self.hub.records = begin is not None

    def _work(self) -> None:
        begin = time.monotonic()
        for moment in self._scene.results():
            if moment.frame.monotonic_ns is None:  # a simulation is as quick as it can be
                time.sleep(max(0.0, begin + moment.frame.time - time.monotonic()))
            if moment.values is not None:
                self._shown.look(moment.frame)
            self.hub.offer(moment)
            self._keep({"": moment.frame})
            if self._stopped:
                return

    def tare(self, skin: str) -> None:
        """Learn rest anew from the next frame on."""
        self._shown.begin()
        self._scene.tare()

    def stop(self) -> None:
        """End the scene."""
        self._stopped = True
        self._scene.driver.close()
        self._thread.join(5.0)


class HandFeed(_Live):
    """A hand as it runs: programs see every frame, pages the newest of each skin."""

    def __init__(self, hand: Hand, *, begin: Begin | None = None) -> None:
        super().__init__(begin)
        self._hand = hand
        self._shown = {name: shown_of(scene) for name, scene in hand.skins.items()}
        self._hubs = {name: hub_of(hand[name], shown) for name, shown in self._shown.items()}
        self.hub = self.hubs[0]
        self.hub.records = begin is not None

    @property
    def hubs(self) -> Sequence[Hub]:
        """Hubs of the skins."""
        return tuple(self._hubs.values())

    def _work(self) -> None:
        begin = time.monotonic()
        for step in self._hand.results():
            if not self._live:
                time.sleep(max(0.0, begin + step.time - time.monotonic()))
            for name, moment in step.skins.items():
                if moment.values is not None:
                    self._shown[name].look(moment.frame)
                self._hubs[name].offer(moment)
            self._keep({name: moment.frame for name, moment in step.skins.items()})
            if self._stopped:
                return

    @property
    def _live(self) -> bool:
        return any(getattr(scene.driver, "live", False) for scene in self._hand.skins.values())

    def tare(self, skin: str) -> None:
        """Learn rest anew from the next frames on."""
        names = [skin] if skin in self._hubs else list(self._hubs)
        for name in names:
            self._shown[name].begin()
        self._hand.tare(*names)

    def stop(self) -> None:
        """End the hand."""
        self._stopped = True
        with suppress(CnnumError):
            self._hand.stop()
        self._thread.join(5.0)
        self._hand.close()


class ArrayFeed(_Live):
    """An array alone, without a program: its numbers less those of the first frames."""

    def __init__(self, name: str, driver: Driver, *, begin: Begin | None = None) -> None:
        super().__init__(begin)
        self._driver = driver
        self._shown = Rested(lambda frame: frame.values)
        self.hub = Hub(
            name,
            driver.shape,
            driver.channels,
            driver.unit,
            driver.rate,
            self._shown,
            lambda: driver.counters,
        )
        self.hub.records = begin is not None

    def _work(self) -> None:
        begin = time.monotonic()
        for number, frame in enumerate(self._driver.frames()):
            if frame.monotonic_ns is None:
                time.sleep(max(0.0, begin + frame.time - time.monotonic()))
            self._shown.look(frame)
            self.hub.offer(FrameResult(number, frame, None, {}, (), 0.0))
            self._keep({"": frame})
            if self._stopped:
                return

    def tare(self, skin: str) -> None:
        """Show the next frames as nothing."""
        self._shown.begin()

    def stop(self) -> None:
        """Let go of the array."""
        self._stopped = True
        self._driver.close()
        self._thread.join(5.0)


class RecordingFeed(_Asked):
    """A recording that is played at a pace, paused, and moved in time.

    Parameters
    ----------
    scene : Scene
        With the recording as its array. Frames before the place that it is moved to run silently,
        so that rest, tare and memories there are those of the whole recording.
    """

    def __init__(self, scene: Scene, *, inside: bool = False) -> None:
        super().__init__()
        self._scene = scene
        with scene.driver:
            self._frames: Sequence[Frame] = list(scene.driver.frames())
        self._times: Floats = np.array([frame.time for frame in self._frames])
        duration = float(self._times[-1] - self._times[0]) if len(self._times) else 0.0
        self._shown = shown_of(scene)
        self.hub = hub_of(scene, self._shown, duration, inside=inside)
        self._seek: float | None = 0.0
        self._speed, self._paused, self._woken, self._tared = 1.0, False, False, False
        self._due = time.monotonic()

    def command(self, wanted: dict[str, Any]) -> None:
        """Pause, go on, change the pace, move to a time (s from the beginning), or tare."""
        with self._changed:
            self._tared = self._tared or wanted.get("tare") is True
            if isinstance(wanted.get("paused"), bool):
                self._paused = wanted["paused"]
            if _is_number(wanted.get("speed")):
                self._speed = min(QUICKEST, max(SLOWEST, float(wanted["speed"])))
            if _is_number(wanted.get("seek")):
                self._seek = float(wanted["seek"])
            self._woken = True
            self._changed.notify_all()

    def _work(self) -> None:
        at, way = 0, Passage(self._scene)
        while not self._stopped:
            moved = self._taken()
            if moved is not None:
                goal = self._at(moved)
                if goal < at:
                    at, way = 0, Passage(self._scene)
                    self._shown.begin()
                self.hub.forget()
                while at < goal and not self._interrupted():
                    self._step(way, at)
                    at += 1
                if at < goal:
                    continue
            if at >= len(self._frames) or (self._paused and moved is None):
                self._wait(None)
                continue
            if self._tared:
                self._tared = False
                self._shown.begin()
                self._scene.tare()
            self.hub.offer(self._step(way, at))
            at += 1
            if at < len(self._frames):
                self._wait(float(self._times[at] - self._times[at - 1]))

    def _step(self, way: Passage, at: int) -> FrameResult:
        moment = way.step(at, self._frames[at])
        if moment.values is not None:
            self._shown.look(moment.frame)
        return moment

    def _interrupted(self) -> bool:
        """Return whether the way to a place is no longer wanted."""
        return self._stopped or self._seek is not None

    def _taken(self) -> float | None:
        with self._changed:
            moved, self._seek = self._seek, None
            return moved

    def _at(self, seconds: float) -> int:
        last = max(0, len(self._frames) - 1)
        wanted = float(self._times[0]) + max(0.0, seconds)
        return min(last, int((self._times < wanted).sum()))

    def _wait(self, seconds: float | None) -> None:
        """Wait for the time of the next frame, or for a command."""
        with self._changed:
            if seconds is None:
                self._changed.wait_for(lambda: self._stopped or self._woken)
                self._due = time.monotonic()
            else:
                self._due = max(self._due + seconds / self._speed, time.monotonic() - BEHIND)
                wait = max(0.0, self._due - time.monotonic())
                if self._changed.wait_for(lambda: self._stopped or self._woken, wait):
                    self._due = time.monotonic()
            self._woken = False


SIDE = 32
"""Rows and columns of a picture that is drawn for a program."""


class PictureFeed(_Asked):
    """A program of pictures, run on what the page draws.

    Parameters
    ----------
    name : str
        Of a program of the library whose frames have one channel, "picture".
    parameters : mapping of str to object
        Of the program.
    engine : Engine, optional
    """

    def __init__(
        self, name: str, parameters: Mapping[str, object], engine: Engine | None = None
    ) -> None:
        super().__init__()
        program = get_program(name).bind(**parameters)
        engine = Engine("numba") if engine is None else engine
        plan = engine.compile(program, (SIDE, SIDE), channels=("picture",))
        self._plan = plan.keeping_everything(beside=True)
        self.hub = Hub(
            name,
            (SIDE, SIDE),
            ("picture",),
            "picture",
            0.0,
            lambda frame: (frame.values + 1.0) / 2.0,
            Counters,
            inside=Inside(self._plan.schedule),
            drawn=True,
        )
        self._wanted: Floats | None = first_picture()

    def command(self, wanted: dict[str, Any]) -> None:
        """Take a picture: base64 of one byte per cell, from −100 (white) to 100 (black)."""
        try:
            cells = np.frombuffer(b64decode(wanted["picture"], validate=True), np.int8)
            picture = np.clip(cells.reshape(SIDE, SIDE) / 100.0, -1.0, 1.0)
        except (KeyError, TypeError, ValueError):
            return
        with self._changed:
            self._wanted = picture
            self._changed.notify_all()

    def _work(self) -> None:
        begin, number = time.monotonic(), 0
        while not self._stopped:
            with self._changed:
                self._changed.wait_for(lambda: self._stopped or self._wanted is not None)
                shown, self._wanted = self._wanted, None
            if shown is None:
                return
            since = time.monotonic()
            values = shown[..., np.newaxis]
            frame = Frame(values, ("picture",), "picture", number, since - begin)
            outputs = self._plan(values)
            seconds = time.monotonic() - since
            self.hub.offer(FrameResult(number, frame, values, outputs, (), seconds))
            number += 1


def first_picture() -> Floats:
    """Return a picture to begin with: a ring with a hole, a blinker, a block and a bar."""
    picture = -np.ones((SIDE, SIDE))
    for rows, cols, colour in (
        ((4, 14), (4, 14), 1.0),
        ((7, 11), (7, 11), -1.0),
        ((6, 7), (20, 23), 1.0),
        ((18, 20), (6, 8), 1.0),
        ((20, 27), (16, 19), 1.0),
        ((24, 27), (16, 27), 1.0),
    ):
        picture[slice(*rows), slice(*cols)] = colour
    return picture


def _is_number(value: object) -> TypeGuard[float]:
    return is_real(value) and not isinstance(value, bool)


def shown_of(scene: Scene) -> Rested:
    """Return the numbers of a scene's frames that a page shows, less their rest."""
    conversion, grid = scene.conversion, scene.grid
    read: Callable[[Frame], Floats] = conversion.reader(conversion.channels, checks=False)
    return Rested(read if grid is None else lambda frame: grid.maps(read(frame)))


def hub_of(scene: Scene, shown: Rested, duration: float = 0.0, *, inside: bool = False) -> Hub:
    """Return the hub of a scene; `inside` of one that keeps the results of all operations."""
    conversion, driver = scene.conversion, scene.driver
    known = set(scene.plan.schedule.outputs)
    kinds = [
        k for k in explained_kinds(known) if known.issuperset(read_outs_of([k], scene.offered))
    ]
    weights = scene.weights()

    def why(moment: FrameResult) -> list[dict[str, object]]:
        time, number = moment.frame.time, moment.number
        said = explained(moment.outputs, kinds, time, number, weights)
        return [{**report.record(), "said": str(report)} for report in said]

    return Hub(
        scene.spec.name,
        scene.shape,
        conversion.channels,
        unit_of(conversion, driver),
        driver.rate,
        shown,
        lambda: driver.counters,
        duration,
        why if kinds else None,
        Inside(scene.plan.schedule) if inside else None,
    )
