"""A stream: frames of an array in time, with memories that outlive each frame and no bad one."""

from __future__ import annotations  # signatures that `help` shows as they are written

import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from threading import RLock
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cnnum.arrays import Floats, all_finite, held, magnitude
from cnnum.engines.backend import OneFrame
from cnnum.errors import ArrayError, FrameError, MethodError
from cnnum.values import OfThisProcess

if TYPE_CHECKING:
    from cnnum.plan import Plan

Numbers = tuple[NDArray[np.floating], ...]

WATCHED = 32
"""Frames after an unusual one during which memories are looked at, and their values before it are
kept: a memory that it has filled with huge numbers overflows in the next frames, or not at all."""


@dataclass(slots=True, eq=False, repr=False)
class Stream(OfThisProcess):
    """A sequence of frames of one array, or of a batch of arrays, with the program's memories.

    A frame that causes an overflow raises an error and leaves the memories unchanged. To save time,
    only unusual frames are examined: those with numbers more than twice as large as any before, or
    so large that their fourth power overflows. If an ordinary frame makes memories infinite, they
    are reset.

    Threads that push to one stream take turns. Streams of one plan are independent.
    """

    plan: Plan
    batch: tuple[int, ...]
    frames: int = 0
    _memory: object = field(default=None)
    _one: OneFrame | None = field(default=None)
    _turn: RLock = field(default_factory=RLock)
    _usual: float = field(default=-1.0)  # magnitude up to which frames have proved harmless
    _before: Numbers = field(default=())  # memories before the last unusual frame
    _frames_before: int = field(default=0)
    _watch: int = field(default=0)  # frames during which that is still kept
    _read: tuple[int, int, int] = field(init=False)  # shape of the channels read

    def __post_init__(self) -> None:
        schedule = self.plan.schedule
        self._read = (*schedule.shape, len(schedule.channels_read))

    def __repr__(self) -> str:
        lead = f", a batch of {self.batch}" if self.batch else ""
        return f"Stream({self.plan.program}, {self.frames} frames so far{lead})"

    def _elsewhere(self) -> str:
        return "compile the program there, and call plan.stream()"

    def __enter__(self) -> Stream:
        """Return the stream itself."""
        return self

    def __exit__(self, *exception: object) -> None:
        """Let go of the memories; the next frame would be the first."""
        with self._turn:
            self._clear()

    def tare(self) -> None:
        """Restart the stream with the next frame, from which rest and noise are learned again."""
        with self._turn:
            self._clear()

    def push(self, frame: ArrayLike) -> dict[str, Floats]:
        """Run the program on the next frame of every array and update the memories.

        Raises
        ------
        FrameError
            If a number does not fit the precision, or an output or a memory would not be finite;
            the memories then stay as they were.
        ArrayError
            If the frame's leading axes are not those of the stream, or the frame contains NaN or
            infinity.
        MethodError
            If a transient does not reach its end.
        """
        array, size = self.plan.looked_at(frame)
        frames, lead = self.plan.read(array)
        if lead != self.batch:
            raise ArrayError(
                f"A frame of this stream must have the leading axes {self.batch}, got {lead}."
            )
        if lead:
            with self._turn:
                self._open()
                return self._carefully(frames, lead, size)
        return self.push_read(frames[0], size)

    def push_read(self, values: Floats, size: float | None = None) -> dict[str, Floats]:
        """Run the program on the next frame of one array, given only the channels that are read.

        Parameters
        ----------
        values : (rows, cols, channels read) float
            In the order of `plan.schedule.channels_read`; finite.
        size : float, optional
            A bound on the magnitudes in the frame, if the caller knows one.

        Raises
        ------
        ArrayError
            If the values have another shape.
        FrameError, MethodError
            As for `push`.
        """
        if values.shape != self._read:
            raise self.plan.misshapen("(", self.plan.schedule.channels_read, values.shape)
        if size is None:
            size = magnitude(values)
        with self._turn:
            single = self._one
            if single is None or self._watch or size > self._usual:
                self._open()
                return self._carefully(values[np.newaxis], (), size)
            outputs = single.run(values, first=self.frames == 0)
            if not all_finite(single.packed):
                self.begin_anew_if_infinite()
                self.plan.refuse_infinite(outputs)
            self.frames += 1
            return outputs

    def ordinary(self, size: float) -> bool:
        """Return whether the next frame is not examined, because it is no larger than usual."""
        return self.frames > 0 and not self._watch and size <= self._usual

    def _open(self) -> None:
        """Take the memories when the first frame comes."""
        if self._memory is None:
            executable = self.plan.executable
            self._memory = executable.new_memory(self._arrays)
            self._one = None if self.batch else executable.one(self._memory)

    @property
    def _arrays(self) -> int:
        return math.prod(self.batch)

    def _carefully(
        self, frames: NDArray[np.floating], lead: tuple[int, ...], size: float
    ) -> dict[str, Floats]:
        """Run a frame that is unusual, or comes soon after such a one."""
        unusual = size > self._usual
        if unusual:
            self._before = tuple(numbers.copy() for numbers in self._held())
            self._frames_before, self._watch = self.frames, WATCHED
        try:
            outputs = self._checked(frames, lead)
        except (FrameError, MethodError):
            kept = bool(self._watch)
            self._restore()
            if unusual or not kept:
                raise
            # an earlier unusual frame left the values that overflow now: they are forgotten
            outputs = self._again(frames, lead)
        self.frames += 1
        if unusual and size <= held(self.plan.precision) ** 0.25:
            self._usual = 2.0 * size
        elif not unusual:
            self._watch = max(0, self._watch - 1)
            self._before = self._before if self._watch else ()
        return outputs

    def _checked(self, frames: NDArray[np.floating], lead: tuple[int, ...]) -> dict[str, Floats]:
        """Run a frame; refuse it if an output or a memory is not finite after it."""
        if lead or self._one is None:
            ran = self.plan.executable.run(frames, self._memory, first=self.frames == 0)
            outputs = {n: v.reshape((*lead, *v.shape[1:])) for n, v in ran.items()}
        else:
            outputs = self._one.run(frames[0], first=self.frames == 0)
        self.plan.refuse_infinite(outputs)
        if self._watch and not self._sane():
            raise FrameError(
                f"A memory of program '{self.plan.program}' is not finite after the frame: its "
                "values are too large for it."
            )
        return outputs

    def _again(self, frames: NDArray[np.floating], lead: tuple[int, ...]) -> dict[str, Floats]:
        """Run a frame once more on the memories before, or on cleared ones for the next."""
        self._watch = 1
        try:
            return self._checked(frames, lead)
        except (FrameError, MethodError):
            self._clear()
            raise

    def lent(self) -> Numbers:
        """Return a copy of the memories, for a launch that many streams share."""
        return tuple(numbers.copy() for numbers in self._held())

    def took(self, numbers: Numbers) -> None:
        """Take memories back."""
        self.plan.executable.restore(self._memory, numbers, self._arrays)

    def _held(self) -> Numbers:
        return self.plan.executable.held(self._memory, self._arrays)

    def _sane(self) -> bool:
        return all(all_finite(numbers) for numbers in self._held())

    def _restore(self) -> None:
        """Let memories be as before the last unusual frame, or begin anew if they are infinite."""
        if self._watch:
            self.plan.executable.restore(self._memory, self._before, self._arrays)
            self.frames, self._watch, self._before = self._frames_before, 0, ()
        else:
            self.begin_anew_if_infinite()

    def begin_anew_if_infinite(self) -> None:
        """Let the next frame be the first, if a memory is not finite."""
        if not self._sane():
            self._clear()

    def _clear(self) -> None:
        """Let the next frame be the first."""
        self._memory = self._one = None
        self.frames, self._watch, self._before = 0, 0, ()


def _all_finite(outputs: Mapping[str, Floats]) -> bool:
    """Return whether all outputs are finite, or False if a number in their shared buffer is not."""
    base = next(iter(outputs.values())).base
    if base is not None and all(numbers.base is base for numbers in outputs.values()):
        return all_finite(base)
    return all(all_finite(numbers) for numbers in outputs.values())


Answer = dict[str, Floats] | FrameError | MethodError
"""Outputs of a frame, or why it was refused."""

FEWEST = 3
"""Ordinary frames from which a shared launch is quicker than one for each."""


class Abreast:
    """Streams of one plan whose frames share a launch, though each begins and is tared by itself.

    The memories of a stream are its own ("at home") or a row of the shared memory. A first frame, a
    frame larger than those before, or one without the others runs at home, as it would alone, so
    the results are those of separate streams if the engine gives the same for a frame in a batch.

    Parameters
    ----------
    plan : Plan
        In real numbers.
    count : int
        Streams.

    Attributes
    ----------
    streams : tuple of Stream
    shape : (rows, cols)
    """

    __slots__ = ("_all", "_away", "_memory", "_plan", "_turn", "shape", "streams")

    def __init__(self, plan: Plan, count: int) -> None:
        self.streams = tuple(plan.stream() for _ in range(count))
        self._plan, self._turn = plan, RLock()
        self._memory: object = None
        self._away, self._all = [False] * count, list(range(count))
        self.shape = plan.schedule.shape

    def warm_up(self) -> None:
        """Build the kernels; no memory changes."""
        self._plan.warm_up()
        executable, count = self._plan.executable, len(self.streams)
        read = len(self._plan.schedule.channels_read)
        empty = np.zeros((count, *self._plan.schedule.shape, read))
        with self._turn, suppress(MethodError):  # loops of an empty frame may not end
            executable.run(empty, executable.new_memory(count), first=True)

    def push(
        self, lanes: Sequence[int], values: Floats, sizes: Sequence[float]
    ) -> tuple[dict[str, Floats], dict[int, Answer]]:
        """Run the program on the next frame of some of the streams.

        Parameters
        ----------
        lanes : sequence of int
            Streams, each at most once.
        values : (lanes, rows, cols, channels read) float
            Finite.
        sizes : sequence of float
            A bound on the magnitudes in each frame.

        Returns
        -------
        dict of str to (streams, …) float
            Outputs of the frames that shared a launch.
        dict of int to outputs or error
            For each stream whose frame did not its outputs, or why it was refused.
        """
        with self._turn:
            streams, results = self.streams, dict[int, Answer]()
            ready = [
                place for place, lane in enumerate(lanes) if streams[lane].ordinary(sizes[place])
            ]
            outputs = dict[str, Floats]()
            if len(ready) >= FEWEST:
                outputs = self._together(lanes, values, ready, results)
            shared = set(ready) if outputs else set[int]()
            if len(shared) < len(lanes):
                for place, lane in enumerate(lanes):
                    if place not in shared:
                        results[lane] = self._alone(lane, values[place], sizes[place])
            return outputs, results

    def _alone(self, lane: int, values: Floats, size: float) -> Answer:
        self._bring_home([lane])
        try:
            return self.streams[lane].push_read(values, size)
        except (FrameError, MethodError) as error:
            return error

    def _together(
        self,
        lanes: Sequence[int],
        values: Floats,
        ready: Sequence[int],
        refused: dict[int, Answer],
    ) -> dict[str, Floats]:
        """Run ordinary frames in one launch; return nothing where a transient does not end."""
        executable, count = self._plan.executable, len(self.streams)
        running = [lanes[place] for place in ready]
        self._send_away(running)
        before = self._rows()
        if running == self._all:
            frames = values
        else:
            frames = np.zeros((count, *values.shape[1:]))
            frames[running] = values if len(ready) == len(lanes) else values[ready]
        try:
            outputs = executable.run(frames, self._memory, first=False)
        except MethodError:
            self._write(before)  # as it was; each alone shows which one does not end
            return {}
        if len(running) < count:
            others = [lane for lane in range(count) if lane not in set(running)]
            after = self._rows()
            for now, was in zip(after, before, strict=True):
                now[others] = was[others]
            self._write(after)
        for lane in running:
            self.streams[lane].frames += 1
        if not _all_finite(outputs):
            self._refuse(running, outputs, refused)
        return outputs

    def _refuse(
        self, running: Sequence[int], outputs: Mapping[str, Floats], refused: dict[int, Answer]
    ) -> None:
        """Refuse frames whose outputs are not finite."""
        for lane in running:
            own = {name: numbers[lane] for name, numbers in outputs.items()}
            try:
                self._plan.refuse_infinite(own)
            except FrameError as error:
                self.streams[lane].frames -= 1
                self._bring_home([lane])
                self.streams[lane].begin_anew_if_infinite()
                refused[lane] = error

    def _rows(self) -> Numbers:
        """Return a copy of the shared memory, a row for each stream."""
        count = len(self.streams)
        held = self._plan.executable.held(self._memory, count)
        return tuple(numbers.reshape(count, -1).copy() for numbers in held)

    def _write(self, rows: Numbers) -> None:
        count = len(self.streams)
        held = self._plan.executable.held(self._memory, count)
        shaped = [new.reshape(old.shape) for new, old in zip(rows, held, strict=True)]
        self._plan.executable.restore(self._memory, shaped, count)

    def _send_away(self, lanes: Sequence[int]) -> None:
        """Bring the memories of streams into the shared one."""
        if self._memory is None:
            self._memory = self._plan.executable.new_memory(len(self.streams))
        new = [lane for lane in lanes if not self._away[lane]]
        if not new:
            return
        rows = self._rows()
        for lane in new:
            for row, own in zip(rows, self.streams[lane].lent(), strict=True):
                row[lane] = own.ravel()
            self._away[lane] = True
        self._write(rows)

    def _bring_home(self, lanes: Sequence[int]) -> None:
        """Bring memories back to their streams."""
        for lane in lanes:
            stream, away = self.streams[lane], self._away[lane]
            self._away[lane] = False
            if not away or stream.frames == 0:  # it was tared: no memory is left
                continue
            shared = zip(self._rows(), stream.lent(), strict=True)
            stream.took(tuple(row[lane].reshape(own.shape) for row, own in shared))
