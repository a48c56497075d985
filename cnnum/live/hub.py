"""From the source to the pages: moments as the few bytes that a page draws, and the newest.

A picture: one frame with its results, as the few bytes that the page draws.

Little-endian: number u32, flags u32 (from bit 16 on the number of the skin), time f64 (s), wait f32
(ms), load f32. Then shear x, shear y and normal of all taxels (f32). Then one mark per taxel (u8):
bit 0 contact, bit 1 bump, bit 2 edge.
"""

import struct
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import replace
from threading import Lock

import numpy as np

from cnnum.arrays import Floats, Shape
from cnnum.drivers.driver import Counters
from cnnum.frame import FORCE_AXES, Frame, Quality
from cnnum.graph.schedule import Schedule
from cnnum.graph.tracing import everything_kept, folds, trace_steps
from cnnum.scenes.bad_taxels import GapWatch
from cnnum.scenes.frame_path import FrameResult

HEAD = struct.Struct("<IIdff")

CONTACT, INCIPIENT, GROSS, TWIST, BAD, DROPPED, SATURATED = (1 << n for n in range(7))

MARKS = {"contact_map": 1, "bump_contact": 2, "edges": 4}
"""Fields of a program that mark taxels, by the bit of their mark."""

FLAGS = {"contact": CONTACT, "gross_slip": GROSS, "twist": TWIST}
"""Outputs of a program that are a flag, by their bit."""

NODES = struct.Struct("<IId")
"""Before the numbers (u32) and values (f32) of operations: 2³² − 1, their count, the time in s."""

Read = Callable[[Frame], Floats]
Why = Callable[[FrameResult], list[dict[str, object]]]


def planes(values: Floats, channels: tuple[str, ...]) -> Floats:
    """Return shear x, shear y and normal, (3, rows, cols); a missing axis is 0.

    An array with no axis of these names shows its first channel as the normal.
    """
    result = np.zeros((3, *values.shape[:2]))
    for at, name in enumerate(FORCE_AXES):
        if name in channels:
            result[at] = values[..., channels.index(name)]
    if not set(FORCE_AXES) & set(channels):
        result[2] = values[..., 0]
    return np.nan_to_num(result, posinf=0.0, neginf=0.0)


SKIN = 16
"""First bit of a picture's flags that is of the number of its skin."""


def encoded(moment: FrameResult, loads: Floats, slip: str | None = None, skin: int = 0) -> bytes:
    """Return the bytes of a picture.

    Parameters
    ----------
    moment : FrameResult
    loads : (3, rows, cols) float
        As `planes` returns them.
    slip : str, optional
        Phase of the slip that goes on: "incipient" or "gross".
    skin : int
        Number of the skin of a hand.
    """
    frame, outputs = moment.frame, moment.outputs
    flags = sum(bit for name, bit in FLAGS.items() if _holds(outputs.get(name)))
    flags |= {"incipient": INCIPIENT, "gross": GROSS}.get(slip or "", 0)
    flags |= BAD if moment.error is not None else 0
    flags |= DROPPED if frame.quality & Quality.DROPPED_BEFORE else 0
    flags |= SATURATED if frame.quality & Quality.SATURATED else 0
    marks = np.zeros(loads.shape[1:], np.uint8)
    for name, bit in MARKS.items():
        field = outputs.get(name)
        if field is not None and field.shape == marks.shape:
            marks |= np.where(field > 0, bit, 0).astype(np.uint8)
    late = (time.monotonic_ns() - frame.monotonic_ns) * 1e-6 if frame.monotonic_ns else 0.0
    wait = late or 1e3 * moment.seconds  # of what did not just arrive, the time of its way
    said = outputs.get("load_normal")
    load = float(np.abs(loads[2]).sum()) if said is None else float(said)
    flags |= skin << SKIN
    head = HEAD.pack(moment.number & 0xFFFFFFFF, flags, frame.time, wait, load)
    return head + loads.astype("<f4").tobytes() + marks.tobytes()


class Inside:
    """The operations of a program, and their results in a moment as the page takes them.

    Parameters
    ----------
    schedule : Schedule
        With the result of every operation among its outputs.
    """

    def __init__(self, schedule: Schedule) -> None:
        nodes = everything_kept(schedule).outputs
        blank = {name: np.zeros(schedule.shape_of(node)) for name, node in nodes.items()}
        self._keys = tuple(nodes)
        own = {name: node for name, node in schedule.outputs.items() if name not in nodes}
        self._steps = tuple(trace_steps(replace(schedule, outputs=own), blank))

    def record(self) -> dict[str, object]:
        """Return the graph as a JSON object."""
        into = folds(self._steps)
        return {
            "nodes": [
                {
                    "number": step.number,
                    "operation": step.operation,
                    "arguments": step.arguments,
                    "outputs": step.outputs,
                    "stores": step.stores,
                    "origin": step.origin,
                    "template": step.template,
                    "shape": step.value.shape,
                    "into": into.get(step.number),
                }
                for step in self._steps
            ]
        }

    def known(self, numbers: Sequence[object]) -> list[int]:
        """Return those of some numbers that are operations."""
        return [n for n in numbers if isinstance(n, int) and 0 <= n < len(self._keys)]

    def encoded(self, moment: FrameResult, numbers: Sequence[int]) -> bytes:
        """Return the results of some operations in a moment of their program."""
        values = [np.asarray(moment.outputs[self._keys[n]], "<f4").tobytes() for n in numbers]
        head = NODES.pack(0xFFFFFFFF, len(numbers), moment.frame.time)
        return b"".join([head, np.array(numbers, "<u4").tobytes(), *values])


def _holds(value: Floats | None) -> bool:
    return value is not None and bool(np.asarray(value).any())


KEPT = 2000
"""Events that a page which connects gets."""

WARNED = 20
"""Newest warnings that a page shows."""

SLIPPING = 0.3
"""s after its event during which a slip is shown."""


class Hub:
    """Takes every moment of a source in passing; pictures are made when a page wants one.

    Parameters
    ----------
    name : str
    shape : (rows, cols)
    channels : tuple of str
        Channels of the numbers that `read` returns.
    unit : str
    rate : float, Hz
    read : callable
        From a frame to the numbers that are shown.
    counters : callable
        The source's own counts.
    duration : float
        s of a recording; 0 of a live array.
    why : callable, optional
        From a moment to what is said of slip and twist in it, as JSON objects.
    inside : Inside, optional
        The program's operations, where the plan keeps their results.
    drawn : bool
        Whether a page draws the frames.

    Attributes
    ----------
    records, recording : bool
        Whether a page can begin a recording, and whether one goes on.
    recorded : str
        What the last recording has kept, in a sentence.
    """

    def __init__(
        self,
        name: str,
        shape: Shape,
        channels: tuple[str, ...],
        unit: str,
        rate: float,
        read: Read,
        counters: Callable[[], Counters],
        duration: float = 0.0,
        why: Why | None = None,
        inside: Inside | None = None,
        drawn: bool = False,
    ) -> None:
        self._why, self.inside, self.drawn = why, inside, drawn
        self._told: FrameResult | None = None
        self.name, self.shape, self.channels = name, shape, channels
        self.unit, self.rate, self.duration = unit, rate, duration
        self._read, self._counters = read, counters
        self._newest: FrameResult | None = None
        self._read_last: FrameResult | None = None  # a repeated scan has no read-outs
        self._events: deque[dict[str, object]] = deque(maxlen=KEPT)
        self._warnings: deque[str] = deque(maxlen=WARNED)
        self._lock = Lock()
        self._slip: tuple[float, str] | None = None
        self._gaps = GapWatch()
        self.frames = self.count = 0
        self.ended = self.recorded = ""
        self.records = self.recording = False
        self._since = (time.monotonic(), 0)

    def offer(self, moment: FrameResult) -> None:
        """Take in a moment; it costs the source next to nothing."""
        self._newest = moment
        if moment.values is not None:
            self._read_last = moment
        self.frames += 1
        gap = self._gaps.seen(moment.number, moment.frame)
        if moment.events or gap is not None:
            with self._lock:
                if gap is not None:
                    self._events.append(gap.record())
                    self.count += 1
                for event in moment.events:
                    self._events.append(event.record())
                    self.count += 1
                    if event.kind == "slip":
                        self._slip = (event.time, event.phase or "gross")
                    elif event.kind == "release":
                        self._slip = None

    def forget(self) -> None:
        """Forget the events: a recording starts from another place."""
        with self._lock:
            self._events.clear()
            self._slip, self._gaps = None, GapWatch()

    def warn(self, sentence: str) -> None:
        """Keep a warning, once."""
        with self._lock:
            if sentence not in self._warnings:
                self._warnings.append(sentence)

    def end(self, why: str) -> None:
        """Note that no more moments come, and why."""
        self.ended = why

    def hello(self) -> dict[str, object]:
        """Return what a page has to know first."""
        with self._lock:
            events = list(self._events)
        return {
            "records": self.records,
            "name": self.name,
            "shape": self.shape,
            "unit": self.unit,
            "rate": self.rate,
            "duration": self.duration,
            "events": events,
            "count": self.count,
            "drawn": self.drawn,
            "graph": self.inside.record() if self.inside else None,
        }

    @property
    def newest(self) -> FrameResult | None:
        """The newest moment."""
        return self._newest

    def events_since(self, count: int) -> tuple[int, list[dict[str, object]]]:
        """Return the events after the first `count`, as far as they are kept, and their number."""
        if count == self.count:
            return count, []
        with self._lock:
            new = min(self.count - count, len(self._events))
            return self.count, list(self._events)[len(self._events) - new :]

    def picture(self, shown: FrameResult | None, skin: int = 0) -> tuple[FrameResult | None, bytes]:
        """Return the newest moment and its picture; no bytes where `shown` is the newest."""
        newest = self._newest
        if newest is None or newest is shown:
            return shown, b""
        loads = self.loads(newest)
        slip = self._slip
        going_on = slip is not None and 0 <= newest.frame.time - slip[0] < SLIPPING
        return newest, encoded(newest, loads, slip[1] if slip and going_on else None, skin)

    def loads(self, moment: FrameResult) -> Floats:
        """Return shear x, shear y and normal of a moment, (3, rows, cols), as a page shows them."""
        loads = planes(self._read(moment.frame), self.channels)
        if moment.masked is not None and moment.masked.shape == loads.shape[1:]:
            loads = np.where(moment.masked, 0.0, loads)
        return loads

    def why(self, *, again: bool = False) -> dict[str, object] | None:
        """Return every read-out of slip and twist against its level, once unless `again`."""
        newest = self._read_last
        if self._why is None or newest is None or (newest is self._told and not again):
            return None
        self._told = newest
        return {"kind": "why", "t": newest.frame.time, "reports": self._why(newest)}

    def status(self) -> dict[str, object]:
        """Return rate, losses, warnings, and whether the source has ended."""
        now, (then, before) = time.monotonic(), self._since
        self._since = (now, self.frames)
        seen = self._counters()
        with self._lock:
            warned = list(self._warnings)
        return {
            "kind": "status",
            "warnings": warned,
            "rate": round((self.frames - before) / max(now - then, 1e-3), 1),
            "frames": self.frames,
            "dropped": seen.dropped,
            "bad": seen.bad,
            "skipped": seen.skipped,
            "gaps": seen.gaps,
            "waiting": seen.waiting,
            "ended": self.ended,
            "recording": self.recording,
            "recorded": self.recorded,
        }
