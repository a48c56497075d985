"""The path of one frame from host memory to its events."""

import time
from dataclasses import dataclass, replace
from typing import NamedTuple

from cnnum.arrays import Floats, Shape
from cnnum.drivers.geometry import Grid
from cnnum.errors import ArrayError, CnnumError, FrameError, MethodError
from cnnum.frame import Frame, Quality
from cnnum.scenes.bad_frames import ANY, FrameRange
from cnnum.scenes.bad_taxels import Dropouts, Liveness
from cnnum.scenes.conversion import DeadCells, Reader
from cnnum.scenes.events import Event, EventDetector
from cnnum.scenes.saturation import Mask, Saturation, Seen, marked
from cnnum.stream import Stream


class FrameResult(NamedTuple):
    """One frame on its way through the scene; a tuple, as one is made for every frame.

    Attributes
    ----------
    number : int
        Number of the frame, from 0.
    frame : Frame
        Frame as the driver read it.
    values : (rows, cols, channels read) float or None
        Input of the program, or None if the frame was bad or a repeat.
    outputs : dict of str to array
        Outputs of the program; empty if it did not run.
    events : tuple of Event
    seconds : float
        Time from the frame in host memory to its events.
    error : CnnumError or None
        Fault of a bad frame, which is skipped.
    saturated : (rows, cols) bool or None
        Taxels at an end of their range because of a load (all, if it is not known which), so that
        normal loads found on them are lower bounds, or None if there is none.
    masked : (rows, cols) bool or None
        Taxels that have dropped out and are continued from their neighbours; None if there is none.
    """

    number: int
    frame: Frame
    values: Floats | None
    outputs: dict[str, Floats]
    events: tuple[Event, ...]
    seconds: float
    error: CnnumError | None = None
    saturated: Mask | None = None
    masked: Mask | None = None

    @property
    def load_is_bound(self) -> bool:
        """Whether normal loads are lower bounds, because a taxel is at an end of its range.

        Shear may then be too high or too low, or have the wrong sign.
        """
        return self.saturated is not None


class Ready(NamedTuple):
    """A frame on which the program can run.

    Attributes
    ----------
    number : int
    frame : Frame
    values : (rows, cols, channels read) float
    size : float
        A bound of the magnitudes in the frame.
    seen : Seen or None
        What it shows of taxels at an end of their range.
    masked : (rows, cols) bool or None
    silent : tuple of Event
        Events of arrays that fall silent or resume.
    started : float, s
        When its way began, by the host's clock.
    """

    number: int
    frame: Frame
    values: Floats
    size: float
    seen: Seen | None
    masked: Mask | None
    silent: tuple[Event, ...]
    started: float


@dataclass(frozen=True, slots=True, eq=False)
class FramePath:
    """The way of a frame from host memory to its events; work that no frame changes is done.

    Attributes
    ----------
    read : callable
        From a driver's frame to the program's input.
    stream : Stream
    detector : EventDetector
    range : FrameRange
        Conditions on a good frame.
    dead : DeadCells or None
        Taxels that are not looked at.
    saturation : Saturation or None
        Finds taxels at an end of their range; without it the driver's flags are not looked at.
    marks : bool
        Whether the program reads them, as its last channel.
    dropouts : Dropouts or None
        Masks taxels that are lost.
    liveness : Liveness or None
        Says when the array, or taxels of it, give no sign of life.
    grid : Grid or None
        Makes maps of taxels at known places, which the program reads.
    """

    read: Reader
    stream: Stream
    detector: EventDetector
    range: FrameRange = ANY
    dead: DeadCells | None = None
    saturation: Saturation | None = None
    marks: bool = False
    dropouts: Dropouts | None = None
    liveness: Liveness | None = None
    grid: Grid | None = None

    def step(self, number: int, frame: Frame) -> FrameResult:
        """Return the results of a frame; a bad one or a repeat leaves everything as it was.

        Raises
        ------
        ArrayError
            If the frame is not of the array's shape.
        MethodError
            If a transient of the first frame does not reach its end: that is the method's fault.
        """
        ready = self.prepare(number, frame)
        if isinstance(ready, FrameResult):
            return ready
        try:
            outputs = self.stream.push_read(ready.values, ready.size)
        except (FrameError, MethodError) as error:
            return self.refused(ready, error)
        return self.finish(ready, outputs)

    def prepare(self, number: int, frame: Frame) -> "Ready | FrameResult":
        """Return the input of the program, or the result of a frame on which it does not run.

        Raises
        ------
        ArrayError
            If the frame is not of the array's shape.
        """
        started = time.perf_counter()
        # a good frame has no flags, and is asked no more: flags are slow to take apart
        if frame.quality and (passed_over := self._flagged(number, frame)) is not None:
            return passed_over._replace(events=self._lives(number, frame))
        grid = self.grid
        _refuse_other_shape(frame, grid.taxels if grid else self.stream.plan.schedule.shape)
        silent, masked = self._lives(number, frame), None
        try:
            looked_at = frame if self.dead is None else self.dead.without(frame)
            if self.dropouts is not None:
                looked_at = self.dropouts.look(looked_at)
                masked = self.dropouts.masked
            size = self.range.size(looked_at)
            seen = None if self.saturation is None else self.saturation.look(looked_at, size)
            at_end = None if seen is None else seen.found
            values = self.read(looked_at)
            if self.dead is not None:
                values = self.dead.filled(values)
            if grid is not None:
                values = grid.maps(values)
            if self.marks:
                values = marked(values, at_end if grid is None else grid.marks(at_end))
        except FrameError as error:
            return self._bad(number, frame, error)._replace(events=silent)
        return Ready(number, frame, values, size, seen, masked, silent, started)

    def refused(self, ready: "Ready", error: FrameError | MethodError) -> FrameResult:
        """Return the result of a frame that the program has refused.

        Raises
        ------
        MethodError
            If it is the first one.
        """
        if isinstance(error, MethodError) and not self.stream.frames:
            raise error
        return self._bad(ready.number, ready.frame, error)._replace(events=ready.silent)

    def finish(self, ready: "Ready", outputs: dict[str, Floats]) -> FrameResult:
        """Return the result of a frame from what the program gave."""
        number, frame, values, _, seen, masked, silent, started = ready
        at_end = None if seen is None else seen.found
        if self.saturation is not None:
            self.saturation.take(seen)
        bound = at_end is not None
        events = self.detector.update(frame.time, number, outputs, saturated=bound)
        grid = self.grid
        if grid is not None and events:
            events = tuple(_placed(event, grid) for event in events)
        spent = time.perf_counter() - started
        events = (*silent, *events) if silent else events
        return FrameResult(number, frame, values, outputs, events, spent, None, at_end, masked)

    @property
    def idle(self) -> bool:
        """Whether no gap ends, and no taxel has been at an end of its range for long enough."""
        return self.detector.idle and (self.saturation is None or self.saturation.idle)

    def tare(self) -> None:
        """Restart with the next frame, from which rest and noise are learned again."""
        self.stream.tare()
        for part in (self.read, self.dropouts):
            tare = getattr(part, "tare", None)
            if callable(tare):
                tare()

    def _lives(self, number: int, frame: Frame) -> tuple[Event, ...]:
        return () if self.liveness is None else self.liveness.look(number, frame)

    def _flagged(self, number: int, frame: Frame) -> FrameResult | None:
        """Return the result of a frame that its driver flags as bad or as a repeat."""
        if frame.quality & Quality.DROPPED_BEFORE:
            self.detector.miss()
        if frame.bad:
            return self._bad(number, frame, FrameError("its driver flags it as damaged"))
        return FrameResult(number, frame, None, {}, (), 0.0) if frame.repeated else None

    def _bad(self, number: int, frame: Frame, error: CnnumError) -> FrameResult:
        self.detector.miss()
        return FrameResult(number, frame, None, {}, (), 0.0, error)


def _placed(event: Event, grid: Grid) -> Event:
    """Return an event with its place in mm."""
    return event if event.where is None else replace(event, place=grid.place(*event.where))


def _refuse_other_shape(frame: Frame, shape: Shape) -> None:
    """Raise if a frame is not of its array's shape: a calibration would stretch a single row."""
    if frame.shape != shape:
        raise ArrayError(
            f"A frame of this array has {shape[0]}×{shape[1]} taxels, got "
            f"{frame.shape[0]}×{frame.shape[1]} in frame {frame.sequence}."
        )
