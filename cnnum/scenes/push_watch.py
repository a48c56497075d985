"""Notices wrong orders and signs of axes, a rest that was held, and a `push` of the wrong sign."""

import inspect
import logging
from collections.abc import Sequence

import numpy as np

from cnnum.arrays import Floats
from cnnum.frame import FORCE_AXES, Frame
from cnnum.programs import Program
from cnnum.programs.machine import BEGINS, ENOUGH
from cnnum.recordings.checking import DENIED, Order, best_order, pad_pressed, scores, sentence_of

RESTING, LEAST = 0.1, 8
"""s of rest at the begin, and the fewest frames of it."""

ORDER_EVERY = 0.02
"""s between looks."""

TOUCH = 20.0
"""Times the noise at rest from which a frame is under a load."""

LOOKS, AGREE = 8, 2
"""Looks that are taken together, and how often in a row they must show the same order."""

SURE = 0.85
"""Score of another order from which it is said: a pull, a twist and a load that rolls have patterns
of their own, and none of them is an order."""


class OrderWatch:
    """Looks at some frames of a scene under a load, and says once that an order seems wrong.

    Parameters
    ----------
    channels : sequence of str
        Channels of the frames; nothing is done unless they are those of three axes.
    pads : int
        Pads side by side in the columns.
    """

    __slots__ = (
        "_able",
        "_agreed",
        "_away",
        "_last",
        "_order",
        "_pads",
        "_rest",
        "_resting",
        "_start",
        "said",
    )

    def __init__(self, channels: Sequence[str], pads: int = 1) -> None:
        self._pads = pads
        self._able = tuple(channels) == FORCE_AXES
        self.said = False
        self.begin()

    def begin(self) -> None:
        """Begin anew with the next frame; a message that was said is not said again."""
        self._rest: tuple[Floats, float] | None = None
        self._resting: list[Floats] = []
        self._away: list[Floats] = []
        self._order: Order | None = None
        self._agreed = 0
        self._start = self._last = -np.inf

    @property
    def looked(self) -> float:
        """When it looked last, s; -inf where it looks at every frame, and inf where at none."""
        if self.said or not self._able:
            return np.inf
        return -np.inf if self._rest is None else self._last

    def look(self, frame: Frame) -> None:
        """Take in a good frame."""
        if self.said or not self._able:
            return
        if self._rest is None:
            self._rests(frame)
            return
        if frame.time - self._last < ORDER_EVERY:
            return
        self._last = frame.time
        rest, noise = self._rest
        away = frame.values - rest
        if not np.abs(away).max() > TOUCH * noise:
            return
        self._away.append(away)
        if len(self._away) < LOOKS:
            return
        order, presses = None, np.stack(self._away)
        if float(np.median(scores(pad_pressed(presses, self._pads)))) < DENIED:
            order, value, present = best_order(presses, frame.unit, self._pads)
            order = None if order == Order() or value < SURE else order
            self._agreed = self._agreed + 1 if order is not None and order == self._order else 0
            if order is not None and self._agreed >= AGREE - 1:
                from cnnum.drivers.own_data.proposed_shape import toml_text

                self.said = True
                said, _, cure = sentence_of(order, value, present)
                keys = ", ".join(f"{key} = {toml_text(value)}" for key, value in cure.items())
                logging.getLogger("cnnum").warning(
                    "%s In a layout, a descriptor or [frames] of the scene that is %s; 'cnnum "
                    "check' looks at a whole recording.",
                    said,
                    keys,
                )
        self._order = order
        self._away = []

    def _rests(self, frame: Frame) -> None:
        if not self._resting:
            self._start = frame.time
        self._resting.append(frame.values)
        if len(self._resting) < LEAST or frame.time - self._start < RESTING:
            return
        held = np.stack(self._resting)
        size = float(np.abs(held).max())
        noise = max(float(held.std(axis=0).mean()), 1e-9 * max(size, 1e-300))
        self._rest, self._resting = (held.mean(axis=0), noise), []


EVERY = 0.01
"""s between two looks."""

LASTS = 1.1
"""s, all together, for which pulls are seen until something is said of them. A taxel or a line that
reads too low for a second is no touch."""

CLEAR = 20.0
"""Peak of a pull over the noise at rest: a touch, and no drift."""

OUTWEIGHS = 2.0
"""Peak of the pulls over that of the pushes. Around a push under a cover, strain is a pull of 0.2
times its peak. Around a pull along the skin, it is a pull of as much as the push."""

MOVES = 6.0
"""Change of a mean reading during the rest, over the noise of one reading, from which it moves."""

MARKED = (
    " If something slid or was held already, events have the mark 'rest_held' until it is let go."
)

ALL = "tactile"

HELD = ("slip", "twist", "mindlin_slip", "grasp_code")
"""Programs that may begin with a held object: its release reads as a pull rightly."""


def _flat(maps: Floats) -> Floats:
    """Return (skins, taxels) numbers of (skins, rows, cols)."""
    return maps.reshape(len(maps), -1)


def moved_in(seen: Floats) -> float:
    """Return the largest change of a reading from the first half of (frames, …) to the last."""
    half = len(seen) // 2
    return float(np.abs(np.median(seen[:half], 0) - np.median(seen[-half:], 0)).max())


class PushWatch:
    """Looks at some frames of a scene, and says once each what does not fit.

    Where readings fall far below rest, either a touch reads as a pull, or the rest was a touch that
    is over. In the first case taxels are less even than they were at rest, in the second more.

    Parameters
    ----------
    program : Program
        With its parameters.
    channels : sequence of str
        The channels of the frames; nothing is done unless the normal load is among them.
    """

    def __init__(self, program: Program, channels: Sequence[str]) -> None:
        known = inspect.signature(program.function).parameters
        able = "push" in known and "normal" in channels
        self._channel = channels.index("normal") if able else None
        self._held = program.name in HELD
        self._name = program.name
        given = dict(program.parameters)
        default = known["push"].default if able else 1.0
        value = given.get("push", default)
        self._push = float(value) if isinstance(value, int | float) else 1.0
        rest = given.get("rest", known["rest"].default if "rest" in known else BEGINS)
        self._time = float(rest) if isinstance(rest, int | float) else BEGINS
        self.said = False
        self._said_of_rest = False
        self.begin()

    def begin(self) -> None:
        """Begin anew with the next frame; a message that was said is not said again."""
        self._first: list[Floats] = []
        self._began = self._looked = 0.0
        self._rest: Floats | None = None
        self._noise = self._size = self._uneven = 0.0
        self._wrong = self._back = self._pushed = 0.0

    @property
    def looked(self) -> float:
        """When it looked last, s; -inf where it looks at every frame, and inf where at none."""
        if self._channel is None:
            return np.inf
        if self._rest is None:
            return -np.inf
        return np.inf if self.said or self._held else self._looked

    def look(self, values: Floats, time: float) -> None:
        """Take in the (rows, cols, channels) values of a good frame, and its time, s."""
        if self._channel is None:
            return
        if self._rest is None:
            self._learn(values[..., self._channel], time)
        elif not self.said and not self._held and time - self._looked >= EVERY:
            normal = values[..., self._channel]
            loads = self._push * (normal - self._rest)
            apart = float(normal.max() - normal.min())
            self._judge(float(loads.max()), -float(loads.min()), apart, time)

    @staticmethod
    def look_at(watches: "Sequence[PushWatch]", values: Floats, times: Sequence[float]) -> None:
        """Take in (skins, rows, cols, channels) values; all know their rest, and it is time."""
        first, rests = watches[0], [watch._rest for watch in watches if watch._rest is not None]
        normal: Floats = np.asarray(values[..., first._channel])
        loads = _flat(first._push * (normal - np.stack(rests)))
        apart = np.ptp(_flat(normal), axis=1)
        figures = np.stack([loads.max(axis=1), loads.min(axis=1), apart], axis=1)
        for watch, time, (push, least, apart) in zip(watches, times, figures.tolist(), strict=True):
            watch._judge(push, -least, apart, time)

    def _learn(self, normal: Floats, time: float) -> None:
        """Take in a frame at rest."""
        if not self._first:
            self._began = time
        self._first.append(np.array(normal))
        count = len(self._first)
        if count < ENOUGH or time - self._began < self._time:
            return
        seen = np.stack(self._first)
        self._first, self._looked = [], time
        self._rest = np.asarray(np.median(seen, axis=0))
        steps = np.square(np.diff(seen, axis=0)).mean(axis=(1, 2))
        size = float(np.abs(self._rest).max())
        self._noise = max(float(np.sqrt(0.5 * np.median(steps))), 1e-6 * size)
        self._uneven = float(np.ptp(self._rest))
        moved = moved_in(seen)
        if moved > MOVES * self._noise and not self._said_of_rest:
            self._said_of_rest = True
            marked = "" if self._name not in (*HELD, ALL) else MARKED
            logging.getLogger("cnnum").warning(
                "The first %.2g s define the rest, but readings moved by %.3g in them (%.3g "
                "times the noise): begin without motion, or tare once nothing touches.%s",
                time - self._began,
                moved,
                moved / self._noise,
                marked,
            )

    def _judge(self, push: float, pull: float, apart: float, time: float) -> None:
        """Add up the time of pulls that no push outweighs, and say what they mean."""
        since, self._looked = min(time - self._looked, 0.1), time
        if push > CLEAR * self._noise:
            self._pushed = max(self._pushed, push)
        if not (pull > CLEAR * self._noise and pull > OUTWEIGHS * max(push, self._pushed, 0.0)):
            return
        if apart > self._uneven:
            self._wrong += since
        else:
            self._back += since
        if max(self._wrong, self._back) < LASTS:
            return
        self.said = True
        said = self.sentence() if self._wrong > self._back else self.released()
        logging.getLogger("cnnum").warning("%s", said)

    def sentence(self) -> str:
        """Return the message of a wrong sign."""
        return (
            f"The normal load of the array falls where it is touched, as a pull: the parameter "
            f"'push' of program '{self._name}' is {self._push:g} and seems the wrong way round; "
            f"set program.parameters.push={-self._push:g} if these are pushes."
        )

    def released(self) -> str:
        """Return the message of a rest that was a touch."""
        return (
            "The readings are far below those at the start, and more even: the rest at the "
            "start was a touch. The rest is learned again when nothing has moved for 10 s, "
            "or at once by a tare."
        )


NO_FRICTION = 12.0
"""Change of the shear, over the change of the whole load, that no friction holds: some load is
hidden in the rest. A pull alone raises as many normal readings as it lowers. Scenes that begin
without contact stay below 7, all but those on a bonded layer, whose strain shows little of the
load; those that begin with a held object reach 23 and more."""

SEEN = 0.05
"""s for which that must be seen, or a fall below rest, until it is said."""

OPEN = 0.3
"""s for which readings far below rest must stand still until the object counts as let go."""


class HeldWatch:
    """Notices that a stream began with the object held, as loads and slips then miss what it held.

    Parameters
    ----------
    program : Program
        With its parameters.
    channels : sequence of str
        The channels of the frames; nothing is done unless they hold all axes.

    Attributes
    ----------
    held : bool
        Whether the present rest seems to be that of a held object.
    """

    def __init__(self, program: Program, channels: Sequence[str]) -> None:
        self._able = program.name in (*HELD, ALL) and all(axis in channels for axis in FORCE_AXES)
        self._places = [channels.index(axis) for axis in FORCE_AXES] if self._able else []
        given, known = dict(program.parameters), inspect.signature(program.function).parameters

        def number(name: str, usual: float) -> float:
            value = given.get(name, known[name].default if name in known else usual)
            return float(value) if isinstance(value, int | float) else usual

        self._push, self._gain = number("push", -1.0), number("shear_gain", 1.0)
        self._time = number("rest", BEGINS)
        self.said = self.held = False
        self.begin()

    def begin(self) -> None:
        """Begin anew with the next frame; a message that was said is not said again."""
        self.held = False
        self._first: list[Floats] = []
        self._rest: Floats | None = None
        self._noise = self._began = self._looked = self._uneven = 0.0
        self._hidden = self._still = 0.0
        self._last: Floats | None = None

    @property
    def marks(self) -> bool:
        """Whether an event of the last frame may be that of a hidden load."""
        return self.held or self._hidden > 0.0

    @property
    def looked(self) -> float:
        """When it looked last, s; -inf where it looks at every frame, and inf where at none."""
        if not self._able:
            return np.inf
        return -np.inf if self._rest is None else self._looked

    def look(self, values: Floats, time: float) -> bool:
        """Take in a good frame and its time, s; return whether a held object was just let go."""
        if not self._able:
            return False
        if self._rest is None:
            self._learn(values, time)
            return False
        if not time - self._looked >= EVERY:
            return False
        away = self._push * (values - self._rest)
        # as `look_at`, whose calls for several skins take longer for one; sums are of equal rows
        x, y, normal = (away[..., place].ravel() for place in self._places)
        shear, cells = self._gain * float(np.hypot(x.sum(), y.sum())), values[..., self._places[2]]
        load, push, least = float(normal.sum()), float(normal.max()), float(normal.min())
        apart = float(cells.max() - cells.min())
        return self._judge(normal, time, load, push, least, shear, apart)

    @staticmethod
    def look_at(
        watches: "Sequence[HeldWatch]", values: Floats, times: Sequence[float]
    ) -> list[bool]:
        """Take in (skins, rows, cols, channels) values; all know their rest, and it is time."""
        first, rests = watches[0], [watch._rest for watch in watches if watch._rest is not None]
        away: Floats = first._push * (values - np.stack(rests))
        x, y, normal = (_flat(away[..., place]) for place in first._places)
        shear = first._gain * np.hypot(x.sum(axis=1), y.sum(axis=1))
        apart = np.ptp(_flat(values[..., first._places[2]]), axis=1)
        parts = normal.sum(axis=1), normal.max(axis=1), normal.min(axis=1), shear, apart
        rows: list[list[float]] = np.stack(parts, axis=1).tolist()
        return [
            watch._judge(loads, time, *row)
            for watch, loads, time, row in zip(watches, normal, times, rows, strict=True)
        ]

    def _judge(
        self,
        normal: Floats,
        time: float,
        load: float,
        push: float,
        least: float,
        shear: float,
        apart: float,
    ) -> bool:
        """Add up the time of hidden loads, and return whether a held object was just let go."""
        since, self._looked = min(time - self._looked, 0.1), time
        clear, pull = CLEAR * self._noise * float(normal.size) ** 0.5, -least
        below = pull > CLEAR * self._noise and pull > OUTWEIGHS * max(push, 0.0)
        # a touch that reads as a pull makes taxels less even, one that ends makes them more so
        falls = below and apart <= self._uneven
        hidden = falls or (not below and shear > NO_FRICTION * max(load, 0.0) + clear)
        self._hidden = self._hidden + since if hidden else 0.0
        if self._hidden >= SEEN and not self.held:
            self.held = True
            self._say()
        return self.held and self._let_go(normal, since, falls=falls)

    def _let_go(self, normal: Floats, since: float, *, falls: bool) -> bool:
        """Return whether readings far below rest stand still, as when nothing touches any more."""
        last, self._last = self._last, normal
        moved = last is None or float(np.abs(normal - last).max()) > CLEAR * self._noise
        self._still = 0.0 if moved or not falls else self._still + since
        return self._still >= OPEN

    def _learn(self, values: Floats, time: float) -> None:
        if not self._first:
            self._began = time
        self._first.append(np.array(values))
        if len(self._first) < ENOUGH or time - self._began < self._time:
            return
        seen = np.stack(self._first)
        self._first, self._looked = [], time
        rest: Floats = np.median(seen, axis=0)
        steps = np.square(np.diff(seen[..., self._places[2]], axis=0)).mean(axis=(1, 2))
        self._noise = max(
            float(np.sqrt(0.5 * np.median(steps))), 1e-6 * float(np.abs(rest).max()), 1e-300
        )
        self._rest, self._uneven = rest, float(np.ptp(rest[..., self._places[2]]))
        # what moves during the rest slides or is being touched; `PushWatch` says so
        self.held = moved_in(seen[..., self._places[2]]) > MOVES * self._noise

    def _say(self) -> None:
        if self.said:
            return
        self.said = True
        logging.getLogger("cnnum").warning(
            "The stream seems to begin with the object held: shear changes under a load that is "
            "part of the rest, so loads, ratios, slips and twists miss what was held. Events "
            "have the mark 'rest_held' until the object is let go, when the rest is learned "
            "again; start without contact, or tare once nothing touches."
        )


class WatchesAbreast:
    """The watches of several skins with one program, which look at their frames together.

    Parameters
    ----------
    skins : sequence of (HeldWatch, PushWatch, OrderWatch)
    """

    def __init__(self, skins: Sequence[tuple[HeldWatch, PushWatch, OrderWatch]]) -> None:
        self._skins = tuple(skins)
        self._looked = np.full((len(skins), 3), -np.inf)
        self._least: Floats | None = None  # of each watch over all skins, when they are known

    def anew(self, lane: int) -> None:
        """Take in that the watches of a skin have looked, or have begun anew, by themselves."""
        self._looked[lane] = [watch.looked for watch in self._skins[lane]]
        self._least = None

    def look(
        self, lanes: Sequence[int], frames: Sequence[Frame], values: Floats, times: Floats
    ) -> list[int]:
        """Take in good frames, and return the skins whose held object was just let go.

        Parameters
        ----------
        lanes : sequence of int
            Skins, each once.
        frames : sequence of Frame
        values : (frames, rows, cols, channels read) float
        times : (frames,) float, s
        """
        if self._least is None:
            self._least = self._looked.min(axis=0)
        if not (times.max() - self._least >= PERIODS).any():
            return []
        due = times[:, np.newaxis] - self._looked[lanes] >= PERIODS
        if not due.any():
            return []
        released = list[int]()
        known = np.isfinite(self._looked[lanes])
        own = [self._skins[lane] for lane in lanes]
        at: list[float] = times.tolist()
        for place in np.flatnonzero(due[:, 0] & ~known[:, 0]).tolist():
            own[place][0].look(values[place], at[place])
        for place in np.flatnonzero(due[:, 1] & ~known[:, 1]).tolist():
            own[place][1].look(values[place], at[place])
        for place in np.flatnonzero(due[:, 2]).tolist():
            own[place][2].look(frames[place])
        if places := np.flatnonzero(due[:, 0] & known[:, 0]).tolist():
            watches = [own[place][0] for place in places]
            gone = HeldWatch.look_at(watches, values[places], [at[place] for place in places])
            released = [lanes[place] for place, go in zip(places, gone, strict=True) if go]
        if places := np.flatnonzero(due[:, 1] & known[:, 1]).tolist():
            others = [own[place][1] for place in places]
            PushWatch.look_at(others, values[places], [at[place] for place in places])
        for place in np.flatnonzero(due.any(axis=1)).tolist():
            self.anew(lanes[place])
        return released


PERIODS = np.array([EVERY, EVERY, ORDER_EVERY])
"""s between looks of the three watches of a skin."""
