"""Events: reports of a flag that rises or falls, with where, which way and how much."""

import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from cnnum.arrays import Floats
from cnnum.errors import SceneError, name_error
from cnnum.programs import Program
from cnnum.renamed import warn_of
from cnnum.safety.values import checked_name, shown

Outputs = Mapping[str, NDArray[np.float64]]


def titled(phase: str | None, kind: str) -> str:
    """Return the name of an event for people, such as "gross slip"."""
    name = f"{phase} {kind}" if phase else kind
    return name.replace("_", " ")


@dataclass(frozen=True, slots=True, repr=False)
class Event:
    """Beginning or end of something in a scene, such as a contact or a slip.

    Attributes
    ----------
    time : float
        Time on the clock of the frames, s.
    kind : str
        "contact", "release", "edge", "slip", "twist"…
    frame : int
        Number of the frame, from 0.
    phase : str or None
        "incipient" or "gross" for a slip.
    where : (row, column) or None
        Position in cells.
    place : (x, y) or None
        Position to the right and downwards, mm, for arrays whose taxels have positions.
    direction : float or None
        Angle from x (to the right, along columns) towards y (downwards, along rows), rad.
    strength : float or None
        In `unit`.
    unit : str or None
        Unit of the strength: "N", "count"…, "score" (a pure number), or "share" (0 to 1).
    sense : int or None
        For a twist, +1 from x towards y and −1 the other way. For a squeeze, +1 outwards.
    after_gap : float or None
        For the first event of a kind after frames were lost or rejected, the length of the gap in
        s; the longest one if there were several since the last event of that kind.
    gap_end : float or None
        End of that gap on the clock of the frames, s.
    load_is_bound : bool
        Whether the strength is a lower bound of a load, because a taxel was at an end of its range.
    saturated : bool
        Whether a taxel was at an end of its range: place, direction and strength may be wrong.
    motion : str or None
        "slide" or "pivot" for a gross slip. For a pivot, `sense` is that of the rotation, and
        `where` its centre if known.
    rest_held : bool
        Whether the stream seems to have begun with the object held. The load at that time is then
        missing from loads and ratios, so the event may be wrong.
    """

    time: float
    kind: str
    frame: int
    phase: str | None = None
    where: tuple[float, float] | None = None
    direction: float | None = None
    strength: float | None = None
    sense: int | None = None
    after_gap: float | None = None
    gap_end: float | None = None
    unit: str | None = None
    load_is_bound: bool = False
    place: tuple[float, float] | None = None
    saturated: bool = False
    rest_held: bool = False
    motion: str | None = None

    @property
    def t(self) -> float:
        """The old name of `time`."""
        warn_of("Event.t", "Event.time")
        return self.time

    @property
    def title(self) -> str:
        """Phase, if there is one, and kind."""
        return titled(self.phase, self.kind)

    def record(self) -> dict[str, object]:
        """Return the event as a JSON object; missing values are left out."""
        values: dict[str, object] = {
            "t": round(self.time, 6),
            "kind": self.kind,
            "phase": self.phase,
            "motion": self.motion,
            "where": self.where and [round(number, 3) for number in self.where],
            "place_mm": self.place and [round(number, 3) for number in self.place],
            "direction": None if self.direction is None else round(self.direction, 4),
            "strength": self.strength,
            "unit": self.unit,
            "sense": self.sense,
            "frame": self.frame,
            "after_gap": None if self.after_gap is None else round(self.after_gap, 6),
            "gap_end": None if self.gap_end is None else round(self.gap_end, 6),
            "load_is_bound": True if self.load_is_bound else None,
            "saturated": True if self.saturated else None,
            "rest_held": True if self.rest_held else None,
        }
        return {name: value for name, value in values.items() if value is not None}

    def __repr__(self) -> str:
        return f"Event({', '.join(f'{name}={value!r}' for name, value in self.record().items())})"

    def __str__(self) -> str:
        parts = [f"{self.time:8.3f} s  {self.title}"]
        if self.motion == "pivot":
            parts[0] += " that pivots"
        if self.place:
            parts.append(f"at x {self.place[0]:.1f} mm, y {self.place[1]:.1f} mm")
        elif self.where:
            parts.append(f"at row {self.where[0]:.1f}, column {self.where[1]:.1f}")
        if self.direction is not None:
            parts.append(f"towards {math.degrees(self.direction):.0f}°")
        if self.sense:
            parts.append(self.turn())
        return ", ".join([*parts, *self.further()])

    def turn(self, arrow: str = "") -> str:
        """Return the sense as text, or with an arrow between the axes."""
        onwards = (self.sense or 0) > 0
        if self.kind == "grasp_squeeze":
            return "outwards" if onwards else "inwards"
        first, last = ("x", "y") if onwards else ("y", "x")
        return f"{first}{arrow}{last}" if arrow else f"from {first} to {last}"

    def further(self) -> list[str]:
        """Return the strength and the preceding gap as text, as far as they are known."""
        parts: list[str] = []
        if self.strength is not None:
            least = "at least " if self.load_is_bound else ""
            parts.append(f"strength {least}{self.strength:.3g} {self.unit or ''}".rstrip())
        if self.after_gap is not None:
            parts.append(f"after a gap of {self.after_gap:.3f} s")
        if self.saturated:
            parts.append("saturated")
        if self.rest_held:
            parts.append("the rest was held")
        return parts


@dataclass(frozen=True, slots=True)
class EventRule:
    """Which outputs of a program become which event.

    Attributes
    ----------
    kind : str
        Kind of the event when the flag rises.
    flag : str
        Output that says whether it holds; of a map the largest value counts.
    ends : str
        Kind of the event when the flag falls; none where empty.
    phase : str
    where, direction : (str, str) or None
        Outputs: row and column, x and y.
    strength, sense : str
        Outputs; none where empty.
    unit : str
        Unit of the strength.
    load : bool
        Whether the strength is a load. While taxels stand at an end of their range it is a lower
        bound, and the end of the event is not reported: they are pressed.
    steady : float, s
        How long a change of the flag must last before it is reported: of flags that go by the
        present frame alone, and flicker where two readings are as likely.
    shape : bool
        Whether the flag goes by the shape of the load, which is not known then: the event is
        reported from other frames alone.
    pivots, centred : str
        Outputs, which say whether a slip turns rather than slides, and whether its centre is known;
        `sense` and `where` hold in these cases only.
    on, off : float
        The event begins where the flag's value is above `on`, and ends where it is no longer above
        `off`, which is `on` or less: a value that wavers between them changes nothing.
    own : bool
        Whether the rule is a user's, with a unit of its own, and not one of `EVENT_RULES`.
    """

    kind: str
    flag: str
    ends: str = ""
    phase: str = ""
    where: tuple[str, str] | None = None
    direction: tuple[str, str] | None = None
    strength: str = ""
    sense: str = ""
    unit: str = ""
    load: bool = False
    steady: float = 0.0
    shape: bool = False
    pivots: str = ""
    centred: str = ""
    on: float = 0.0
    off: float = 0.0
    own: bool = False

    @property
    def needs(self) -> tuple[str, ...]:
        """Outputs that the rule reads."""
        pairs = (*(self.where or ()), *(self.direction or ()))
        names = (self.flag, *pairs, self.strength, self.sense, self.pivots, self.centred)
        return tuple(name for name in names if name)

    @property
    def plain(self) -> "EventRule":
        """The rule without what only some programs know of a slip."""
        if not self.pivots:
            return self
        return replace(self, pivots="", centred="", where=None, sense="")

    def event(
        self, kind: str, t: float, frame: int, outputs: Outputs, *, saturated: bool = False
    ) -> Event:
        """Return the event of a flag that has just changed."""
        began = kind == self.kind
        pair = self.direction if began else None
        strong = bool(self.strength) and began
        pivots = bool(self.pivots) and _number(outputs, self.pivots) > 0.0
        placed = not self.centred or _number(outputs, self.centred) > 0.0
        sense = int(np.sign(_number(outputs, self.sense))) if self.sense and began else None
        return Event(
            time=t,
            kind=kind,
            frame=frame,
            phase=self.phase or None,
            where=self._place(outputs) if placed else None,
            direction=pair and math.atan2(_number(outputs, pair[1]), _number(outputs, pair[0])),
            strength=_number(outputs, self.strength) if strong else None,
            unit=(self.unit or None) if strong else None,
            sense=sense if pivots or not self.pivots else None,
            motion=("pivot" if pivots else "slide") if self.pivots else None,
            load_is_bound=saturated and strong and self.load,
            saturated=saturated,
        )

    def _place(self, outputs: Outputs) -> tuple[float, float] | None:
        """Return row and column: those of its outputs, or where a map is largest."""
        if self.where is not None:
            return _number(outputs, self.where[0]), _number(outputs, self.where[1])
        flag = np.asarray(outputs[self.flag])
        if flag.ndim != 2:
            return None
        row, col = np.unravel_index(int(np.argmax(flag)), flag.shape)
        return float(row), float(col)

    @property
    def levels(self) -> tuple[float, float, float]:
        """Levels above which the event begins and goes on, and how long a change must last."""
        return self.on, self.off, max(self.steady, 0.0)

    def state_at_end(self, *, now: bool, held: bool) -> bool:
        """Return the state of the flag while taxels stand at an end of their range."""
        return held if self.shape or (self.load and held) else now


def _number(outputs: Outputs, name: str) -> float:
    """Return an output's value; of a map the largest one."""
    value = outputs[name]
    return float(value if np.ndim(value) == 0 else value.max())


EVENT_RULES: dict[str, tuple[EventRule, ...]] = {
    "contact": (
        EventRule(
            "contact",
            "contact",
            ends="release",
            where=("contact_row", "contact_column"),
            strength="load_normal",
            load=True,
        ),
    ),
    "slip": (
        EventRule(
            "slip",
            "incipient_slip",
            phase="incipient",
            direction=("slip_x", "slip_y"),
            strength="slip_strength",
            shape=True,
        ),
        EventRule(
            "slip",
            "gross_slip",
            phase="gross",
            where=("slip_row", "slip_column"),
            direction=("slip_x", "slip_y"),
            strength="slip_strength",
            sense="slip_sense",
            pivots="slip_pivots",
            centred="slip_centred",
        ),
    ),
    "twist": (
        EventRule(
            "twist",
            "twist",
            where=("twist_row", "twist_column"),
            strength="twist_strength",
            sense="twist_sense",
        ),
    ),
    "edge": (
        EventRule("edge", "edge_count", where=("edge_row", "edge_column"), shape=True, steady=0.1),
    ),
    "bump": (
        EventRule(
            "bump",
            "bump_count",
            ends="bump_release",
            where=("bump_row", "bump_column"),
            strength="bump_normal",
            load=True,
        ),
    ),
    "texture": (EventRule("texture", "texture_rubs", strength="friction"),),
    "grasp": (
        EventRule("grasp_slip", "grasp_slip", direction=("grasp_x", "grasp_y"), steady=0.1),
        EventRule("grasp_tilt", "grasp_tilt", direction=("grasp_x", "grasp_y"), steady=0.1),
        EventRule("grasp_twist", "grasp_twist", sense="grasp_sense", steady=0.1),
        EventRule("grasp_squeeze", "grasp_squeeze", sense="grasp_sense", steady=0.1),
    ),
    "outline": (
        EventRule(
            "outline",
            "contour_holds",
            ends="outline_lost",
            where=("contour_row", "contour_column"),
        ),
    ),
    "onset": (EventRule("onset", "comes", where=("on_row", "on_column"), strength="on_strength"),),
    "offset": (
        EventRule("offset", "goes", where=("off_row", "off_column"), strength="off_strength"),
    ),
    "flow": (
        EventRule(
            "flow", "flows", ends="flow_end", direction=("flow_x", "flow_y"), strength="flow_speed"
        ),
    ),
    "drift": (
        EventRule(
            "drift",
            "drifts",
            ends="drift_end",
            direction=("motion_x", "motion_y"),
            strength="motion_strength",
        ),
    ),
    **{
        event: (
            EventRule(
                event,
                f"{channel}_active",
                ends=f"{event}_end",
                where=(f"{channel}_row", f"{channel}_column"),
                direction=("stretch_x", "stretch_y") if channel == "sa2" else None,
                strength=f"{channel}_strength",
            ),
        )
        for event, channel in (
            ("pressure", "sa1"),
            ("motion", "ra1"),
            ("vibration", "pc"),
            ("stretch", "sa2"),
        )
    },
}
"""The events that a scene can want: name to rules. Of slip, `tactile` reports the gross phase; a
program that detects incipient slip has an output for it."""


_TEXTS = ("kind", "flag", "ends", "phase", "strength", "unit", "sense")
_PAIRS = ("where", "direction")
_NUMBERS = ("on", "off", "steady")


def event_rule(table: Mapping[str, object], label: str) -> EventRule:
    """Return the rule of an event that a user writes down.

    Parameters
    ----------
    table : mapping
        `kind` and `flag`, and of the others what the event has: `ends`, `phase`, `where` and
        `direction` (two outputs each), `strength`, `unit`, `sense`, `on`, `off`, and `steady` in s.
    about : str
        Where it stands, for errors.

    Raises
    ------
    SceneError
        If a key is missing, unknown, or of another type.
    """
    known = (*_TEXTS, *_PAIRS, *_NUMBERS)
    for key in table:
        if key not in known:
            raise SceneError(f"{label}: {name_error('key of an event', key, known)}")
    result: dict[str, Any] = {}
    for key, value in table.items():
        if key in _TEXTS:
            result[key] = checked_name(f"{label}: '{key}'", value, SceneError)
        elif key in _PAIRS:
            several = isinstance(value, list | tuple)
            two = list(cast("Sequence[object]", value)) if several else []
            if len(two) != 2:
                raise SceneError(f"{label}: '{key}' must name two outputs, got {shown(value)}.")
            result[key] = tuple(checked_name(f"{label}: '{key}'", name, SceneError) for name in two)
        else:
            real = isinstance(value, int | float) and not isinstance(value, bool)
            if not (real and math.isfinite(cast("float", value))):
                raise SceneError(f"{label}: '{key}' is a number, got {shown(value)}.")
            result[key] = float(cast("float", value))
    for key in ("kind", "flag"):
        if not result.get(key):
            raise SceneError(f"{label}: '{key}' is missing: an event needs a kind and a flag.")
    on = result.setdefault("on", 0.0)
    if result.setdefault("off", on) > on:
        raise SceneError(f"{label}: 'off' is {result['off']:g}, above 'on', which is {on:g}.")
    if result.get("steady", 0.0) < 0.0:
        raise SceneError(
            f"{label}: 'steady' must be a time of at least 0 s, got {result['steady']:g}."
        )
    return EventRule(**result, own=True)


def rules_that_fit(events: Iterable[str], outputs: Collection[str]) -> tuple[EventRule, ...]:
    """Return the rules of events that a program with these outputs can follow."""
    given = set(outputs)
    rules = [rule for event in events for rule in EVENT_RULES.get(event, ())]
    known = (rule if set(rule.needs) <= given else rule.plain for rule in rules)
    return tuple(rule for rule in known if set(rule.needs) <= given)


_NO_GAP = (0.0, 0.0)

LASTED = 1.0 - 1e-9
"""Part of its time that a change must have lasted: the times of frames are rounded."""


@dataclass(slots=True)
class EventDetector:
    """Follows flags from frame to frame and says which have changed.

    Attributes
    ----------
    longest_gap : float
        s, the longest time between two frames with a missing one between them; 0 without.
    """

    rules: tuple[EventRule, ...]
    longest_gap: float = field(init=False, default=0.0)
    _held: list[bool] = field(init=False)
    _since: dict[int, float] = field(init=False, default_factory=dict[int, float])
    _levels: tuple[tuple[str, float, float], ...] = field(init=False)
    _above: list[bool] = field(init=False)
    _steady: tuple[int, ...] = field(init=False)
    _gaps: list[tuple[float, float]] = field(init=False)
    _last: float | None = field(init=False, default=None)
    _missed: bool = field(init=False, default=False)

    def __post_init__(self) -> None:
        self._held = [False] * len(self.rules)
        self._above = [False] * len(self.rules)
        self._levels = tuple((rule.flag, rule.on, rule.off) for rule in self.rules)
        self._steady = tuple(n for n, rule in enumerate(self.rules) if rule.steady > 0.0)
        self._gaps = [_NO_GAP] * len(self.rules)

    @property
    def idle(self) -> bool:
        """Whether no gap ends with the next frame."""
        return not self._missed

    def miss(self) -> None:
        """Take in that a frame before the next one was lost or refused."""
        self._missed = True

    def update(
        self, t: float, frame: int, outputs: Outputs, *, saturated: bool = False
    ) -> tuple[Event, ...]:
        """Return the events of one frame, in the order of the rules.

        Parameters
        ----------
        time : float, s
        frame : int
        outputs : mapping
        saturated : bool
            Whether a taxel stands at an end of its range because of a load.
        """
        if self._missed:
            self._note_gap(t)
        self._last = t
        held = self._held
        now = [
            _number(outputs, flag) > (off if was else on)
            for (flag, on, off), was in zip(self._levels, self._above, strict=True)
        ]
        self._above = now if not self._steady else now.copy()
        if saturated:
            states = zip(self.rules, now, held, strict=True)
            now = [rule.state_at_end(now=on, held=was) for rule, on, was in states]
        for place in self._steady:
            now[place] = self._lasting(place, t, now=now[place])
        if now == held:
            return ()
        self._held = now
        changed = enumerate(zip(self.rules, held, now, strict=True))
        return tuple(
            self._after_gap(
                place,
                rule.event(rule.kind if on else rule.ends, t, frame, outputs, saturated=saturated),
            )
            for place, (rule, was, on) in changed
            if on != was and (on or rule.ends)
        )

    def calm(self) -> tuple[list[bool], list[bool], list[float], float]:
        """Return what `FlagsAbreast` keeps instead of it."""
        since = [self._since.get(place, math.nan) for place in range(len(self.rules))]
        return self._above, self._held, since, math.nan if self._last is None else self._last

    def went_on(self, above: list[bool], since: list[float], last: float) -> None:
        """Take that back, after frames in which no event began or ended."""
        self._above, self._last = above, None if math.isnan(last) else last
        self._since = {place: at for place, at in enumerate(since) if not math.isnan(at)}

    def _lasting(self, place: int, t: float, *, now: bool) -> bool:
        """Return the state of a flag whose changes must last."""
        held = self._held[place]
        if now == held:
            self._since.pop(place, None)
            return held
        since = self._since.setdefault(place, t)
        if t - since < self.rules[place].steady * LASTED:
            return held
        del self._since[place]
        return now

    def _note_gap(self, t: float) -> None:
        """Keep the gap that ends now for the next event of each flag, unless a longer one waits."""
        self._missed = False
        if self._last is None:  # nothing was seen before it: no memory reaches over it
            return
        gap = (t - self._last, t)
        self.longest_gap = max(self.longest_gap, gap[0])
        self._gaps = [max(waiting, gap) for waiting in self._gaps]

    def _after_gap(self, place: int, event: Event) -> Event:
        (length, end), self._gaps[place] = self._gaps[place], _NO_GAP
        return replace(event, after_gap=length, gap_end=end) if length > 0.0 else event


class FlagsAbreast:
    """The flags of several skins with one program: says in which of them an event begins or ends.

    What `EventDetector.update` keeps of frames without an event lies here in one array for all
    skins. A frame with one goes through it, with `settle` before it.

    Parameters
    ----------
    detectors : sequence of EventDetector
        With rules that read the same flags.
    """

    def __init__(self, detectors: Sequence[EventDetector]) -> None:
        self._detectors, shape = tuple(detectors), (len(detectors), len(detectors[0].rules))
        self._flags = [rule.flag for rule in detectors[0].rules]
        levels = [[rule.levels for rule in detector.rules] for detector in detectors]
        self._on, self._off, steady = np.array(levels).reshape(*shape, 3).transpose(2, 0, 1)
        self._steady = steady if steady.any() else None
        self._above, self._held = np.zeros(shape, np.bool_), np.zeros(shape, np.bool_)
        self._since, self._last = np.full(shape, np.nan), np.zeros(len(detectors))
        self._given: Floats = np.zeros(shape)
        self._known: Floats | None = None  # the levels, while `_above` stays

    def _levels(self) -> Floats:
        """Return above which level each flag is on."""
        if self._known is None:
            self._known = np.where(self._above, self._off, self._on)
        return self._known

    @staticmethod
    def able(detectors: Sequence[EventDetector]) -> bool:
        """Return whether the rules of all read the same flags, and there is one at least."""
        flags = [[rule.flag for rule in detector.rules] for detector in detectors]
        return bool(flags[0]) and all(own == flags[0] for own in flags)

    def look(self, lanes: NDArray[np.intp], times: Floats, outputs: Outputs) -> list[int]:
        """Take in the frames in which no event begins or ends, and return the other skins.

        Parameters
        ----------
        lanes : (frames,) int
            Skins, each once.
        times : (frames,) float, s
        outputs : mapping of str to (skins, …) float
        """
        count = len(self._last)
        for place, name in enumerate(self._flags):
            of = outputs[name]
            self._given[:, place] = of if of.ndim == 1 else of.reshape(count, -1).max(axis=1)
        every = self._given > self._levels()
        whole = len(lanes) == count
        if self._steady is None and whole and not (every != self._held).any():
            if (every != self._above).any():
                self._above, self._known = every, None
            self._last = times
            return []
        now = every if whole else every[lanes]
        changed = now != self._held[lanes]
        self._known = None
        if self._steady is None and not changed.any():
            self._above[lanes], self._last[lanes] = now, times
            return []
        since, begun = self._since[lanes], times[:, np.newaxis]
        if self._steady is not None:
            since = np.where(changed, np.where(np.isnan(since), begun, since), np.nan)
            changed &= ~(begun - since < self._steady[lanes] * LASTED)
        calm = ~changed.any(axis=1)
        own = lanes[calm]
        self._above[own], self._since[own], self._last[own] = now[calm], since[calm], times[calm]
        return [] if len(own) == len(lanes) else lanes[~calm].tolist()

    def take(self, lane: int) -> None:
        """Take what the skin's own detector keeps."""
        self._known = None
        self._above[lane], self._held[lane], self._since[lane], last = self._detectors[lane].calm()
        self._last[lane] = last

    def settle(self, lane: int) -> None:
        """Give what is kept of a skin back to its own detector."""
        own = (part[lane].tolist() for part in (self._above, self._since, self._last))
        self._detectors[lane].went_on(*own)


SCORE = "score"
"""Unit of the strength of slip and twist, a pure number: see `docs/events.md`."""

LOADS: Mapping[str, Mapping[str, str]] = {
    "load_normal": {"": "unit"},
    "bump_normal": {"": "unit", "tactile": "bump_unit"},
}
"""Outputs that are loads: by program, or of any, the parameter that makes them newtons. Without it
they are in the unit of the array's values."""

SHARES: Mapping[str, str] = {"mindlin_slip": "share"}
"""Programs whose strength is the share of the contact that slides: 0 to 1."""


OTHERS: Mapping[str, str] = {"flow_speed": "cells/s", "motion_strength": "share"}
"""Outputs with a unit of their own."""


def with_units(
    rules: Sequence[EventRule], program: Program, measured: str
) -> tuple[EventRule, ...]:
    """Return rules that say the unit of their strength.

    Parameters
    ----------
    rules : sequence of EventRule
    program : Program
        With its parameters: where the one of `LOADS` is given, that load is in newtons.
    measured : str
        Unit of the values that the program sees.
    """
    return tuple(
        rule if rule.own else replace(rule, unit=_unit(rule.strength, program, measured))
        for rule in rules
    )


def _unit(strength: str, program: Program, measured: str) -> str:
    if not strength:
        return ""
    if strength not in LOADS:
        return OTHERS.get(strength, SHARES.get(program.name, SCORE))
    of = LOADS[strength]
    return "N" if of.get(program.name, of[""]) in dict(program.parameters) else measured
