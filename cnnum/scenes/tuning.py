"""A level and constants for one's own array, learned from quiet and labelled recordings.

What is chosen on some recordings is reported on those left out, one after the other. A level goes
by the quiet strengths alone, constants by the events found at that level.
"""

import csv
import inspect
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from math import ceil, isfinite, log, nan
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from cnnum.arrays import Floats
from cnnum.drivers.own_data.proposed_shape import toml_text
from cnnum.drivers.recording_file import array_of
from cnnum.engine import Engine
from cnnum.errors import SceneError, name_error, unreadable
from cnnum.plan import Plan
from cnnum.programs import Program
from cnnum.programs.library import get_program, program_names
from cnnum.programs.parameters import RATE
from cnnum.programs.reports import HOLD, latched
from cnnum.recordings.recording import Recording
from cnnum.safety.files import write_whole
from cnnum.safety.reading import LARGEST, read_text
from cnnum.safety.values import is_real, shown
from cnnum.scenes.arrangement import bound, program_of
from cnnum.scenes.conversion import unit_of
from cnnum.scenes.events import EVENT_RULES, EventRule
from cnnum.scenes.pipeline import Passage, Scene
from cnnum.scenes.scene_file import SceneSpec, read_scene, scene_names, scene_table

LEVELS = {"flow": "still", "drift": "sure"}
"""Events whose level is another parameter than `level`."""

MULTIPLES = {"look": (0.5, 2.0), "still": (0.5, 2.0), "floor": (0.25,)}
"""Constants that are tried, one at a time, and by what the shipped value is multiplied: how far
back changes are looked at, the slowest movement, and the least load."""

SLACK = 0.2
"""s around a labelled event that count neither as quiet nor against it: people label so well."""

TAIL = 10
"""Quiet seconds with the largest strengths, on which the rate of rarer reports is extrapolated."""

LEAST, ENOUGH = 1.0, 2
"""Quiet time, s, and frames of a recording at least."""

SAME_RATE = 0.01
"""Share by which the rates of two recordings may differ if one plan runs both: no time of a program
is that exact."""

BATCH, CURVE = 32, 60
"""Recordings side by side, and levels of a curve."""

CONFIDENCE = 0.95
TEN_MINUTES = 600.0

COLUMNS = ("recording", "begin", "end")
"""Required columns of a label file; `kind` is optional."""


@dataclass(frozen=True, slots=True)
class Label:
    """Time span of an event in a recording.

    Attributes
    ----------
    recording : str
        Path, name or stem of the file, or its number from 0.
    begin, end : float, s
        After the first frame.
    kind : str
        Kind of the event. Spans of other kinds than the tuned one count neither as quiet nor as
        events.
    """

    recording: str
    begin: float
    end: float
    kind: str = ""


@dataclass(frozen=True, slots=True)
class Outcome:
    """What a level finds, and what it reports by mistake.

    Attributes
    ----------
    events, found, false : int
    delays : tuple of float, s
        From the label to the report, of the events that were found.
    seconds : float, s
        Quiet time.
    """

    events: int = 0
    found: int = 0
    false: int = 0
    delays: tuple[float, ...] = ()
    seconds: float = 0.0

    def __add__(self, other: "Outcome") -> "Outcome":
        return Outcome(*(mine + more for mine, more in zip(self._parts, other._parts, strict=True)))

    @property
    def _parts(self) -> tuple[Any, ...]:
        return self.events, self.found, self.false, self.delays, self.seconds

    @property
    def share(self) -> float:
        """Events found over all; NaN without any."""
        return self.found / self.events if self.events else nan

    @property
    def delay(self) -> float:
        """Median delay, s; NaN if nothing was found."""
        return float(np.median(self.delays)) if self.delays else nan

    @property
    def rate(self) -> float:
        """False reports in ten minutes."""
        return self.false * TEN_MINUTES / self.seconds

    @property
    def bound(self) -> float:
        """Upper bound of that rate at 95 % (Poisson): of no report in T, 3/T."""
        from scipy.special import gammaincinv

        return float(gammaincinv(self.false + 1.0, CONFIDENCE)) * TEN_MINUTES / self.seconds

    def record(self) -> dict[str, object]:
        """Return a JSON object."""
        known = {"share": self.share, "delay_s": self.delay}
        return {
            "events": self.events, "found": self.found, "false": self.false,
            "quiet_s": self.seconds, "false_in_ten_minutes": self.rate,
            "at_most": self.bound, **{k: v for k, v in known.items() if v == v},
        }  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class Strengths:
    """The strength of an event over a recording, with what is known of it.

    Attributes
    ----------
    values : (frames,) float
        0 where the program reports nothing at any level.
    times : (frames,) float, s
        After the first frame.
    quiet : (frames,) bool
    labels : tuple of Label
        The events that are sought.
    hold : int
        Frames for which a strength may be low before a report ends.
    """

    values: Floats
    times: Floats
    quiet: np.ndarray[Any, np.dtype[np.bool_]]
    labels: tuple[Label, ...]
    hold: int

    @property
    def seconds(self) -> float:
        """Quiet time, s."""
        return float(np.mean(self.quiet)) * (float(self.times[-1]) - float(self.times[0]))

    def peaks(self) -> Floats:
        """Return the largest strength of every quiet second."""
        seconds = np.floor(self.times[self.quiet]).astype(np.int64)
        starts = np.flatnonzero(np.diff(seconds, prepend=-1))
        return np.maximum.reduceat(self.values[self.quiet], starts) if len(starts) else np.zeros(0)

    def flags(self, level: float) -> np.ndarray[Any, np.dtype[np.bool_]]:
        """Return whether the event is reported at a level, frame by frame, as its program does."""
        return latched(self.values, level, HOLD * level, self.hold)

    def outcome(self, level: float) -> Outcome:
        """Return the reports at a level against the labels."""
        flags = self.flags(level)
        begins = np.flatnonzero(flags & ~np.concatenate([[False], flags[:-1]]))
        delays: list[float] = []
        for label in self.labels:
            near = (self.times >= label.begin - SLACK) & (self.times <= label.end + SLACK)
            if (at := np.flatnonzero(flags & near)).size:
                delays.append(max(0.0, float(self.times[at[0]]) - label.begin))
        return Outcome(
            len(self.labels), len(delays), int(self.quiet[begins].sum()), tuple(delays),
            self.seconds,
        )  # fmt: skip


Constants = tuple[tuple[str, float], ...]
"""Names and values other than the shipped ones."""


@dataclass(frozen=True, slots=True, eq=False)
class Tuned:
    """Tuned level and constants of an event, with their performance.

    Attributes
    ----------
    event, program, parameter : str
        The event, its program, and the parameter that is its level.
    level : float
    constants : mapping of str to float
        Those that differ from the shipped ones.
    asked : float
        Accepted false reports per ten minutes.
    extrapolated : bool
        Whether the recordings are too short for that rate, so that the level is extrapolated from
        the largest quiet strengths.
    shipped : Outcome
        Outcome of the unchanged program on all recordings.
    left_out : Outcome or None
        Cross-validated outcome: on each recording, with the level chosen without it. None for a
        single recording.
    seen : Outcome
        Outcome on the recordings from which the level was chosen.
    shipped_level : float
        Level of the unchanged program; NaN if the program does not state it.
    curves : mapping of str to sequence of (float, Outcome)
        Levels and their outcomes, for the "shipped" and the "tuned" constants.
    toml : str
        Text of the tuned scene file.
    """

    event: str
    program: str
    parameter: str
    level: float
    constants: Mapping[str, float]
    asked: float
    extrapolated: bool
    shipped: Outcome
    left_out: Outcome | None
    seen: Outcome
    shipped_level: float
    curves: Mapping[str, Sequence[tuple[float, Outcome]]]
    toml: str

    def save(self, path: str | Path, *, force: bool = False) -> Path:
        """Write the scene.

        Raises
        ------
        SceneError
            If there is such a file, or it cannot be written.
        """
        write_whole(Path(path), self.toml.encode(), error=SceneError, force=force)
        return Path(path)

    def record(self) -> dict[str, object]:
        """Return a JSON object."""
        known = {"shipped_level": self.shipped_level}
        return {
            "kind": "tuned", "event": self.event, "program": self.program,
            "parameter": self.parameter, "level": self.level, "constants": dict(self.constants),
            "asked": self.asked, "extrapolated": self.extrapolated,
            **{k: v for k, v in known.items() if v == v},
            "shipped": self.shipped.record(), "seen": self.seen.record(),
            "left_out": None if self.left_out is None else self.left_out.record(),
        }  # fmt: skip

    def __str__(self) -> str:
        return "\n".join(self.sentences())

    def sentences(self) -> Iterator[str]:
        """Yield sentences on the choice, the confidence in its rate, and the events it finds."""
        changed = "".join(f", {name} = {value:.4g}" for name, value in self.constants.items())
        yield f"{self.event}: {self.parameter} = {self.level:.4g}{changed}."
        judged = self.seen if self.left_out is None else self.left_out
        how = (
            "on the one recording that it was chosen by"
            if self.left_out is None
            else "on recordings left out of the choice"
        )
        yield (
            f"{judged.false} false report{'s' * (judged.false != 1)} in "
            f"{judged.seconds / 60.0:.1f} quiet minutes {how}: with {CONFIDENCE:.0%} confidence "
            f"at most {judged.bound:.2g} in ten minutes ({self.asked:g} asked)."
        )
        if judged.events:
            yield (
                f"{judged.found} of {judged.events} events found{_after(judged.delay)}; "
                f"{self.shipped.found} with the shipped level, and {self.shipped.false} false."
            )
        else:
            yield f"No {self.event} is labelled, so it is not known what the level finds."
        if self.extrapolated:
            needed = 3.0 * TEN_MINUTES / self.asked / 60.0
            yield (
                f"The level is extrapolated: only {needed:.0f} quiet minutes without a report "
                "would show that rate."
            )


def _after(delay: float) -> str:
    return f", {delay:.2f} s after the label in the median" if isfinite(delay) else ""


def level_for(peaks: Floats, seconds: float, asked: float) -> tuple[float, bool]:
    """Return the level that quiet strengths exceed at a rate.

    Parameters
    ----------
    peaks : (seconds,) float
        The largest strength of every quiet second.
    seconds : float
    asked : float
        False reports in ten minutes.

    Returns
    -------
    level : float
        The strength that as many seconds reach as are accepted, straight over the logarithm of
        their number. For rarer ones the largest strengths go on as an exponential tail, whose scale
        is their mean excess. 0 where no strength exceeds 0.
    extrapolated : bool
    """
    largest = np.sort(peaks[peaks > 0.0])[::-1]
    accepted = asked * seconds / TEN_MINUTES
    if not largest.size:
        return 0.0, accepted < 1.0
    if accepted >= 1.0:
        counts = np.log(np.arange(1, len(largest) + 1))
        return float(np.interp(log(accepted), counts, largest)), False
    count = min(TAIL, len(largest) - 1)
    if not count:
        return 2.0 * float(largest[0]), True
    base = float(largest[count])
    scale = float(largest[:count].mean()) - base
    return max(float(largest[0]), base + scale * log(count / accepted)), True


def read_labels(path: Path) -> tuple[Label, ...]:
    """Read labels from a CSV file with the columns recording, begin, end and, if given, kind.

    Raises
    ------
    SceneError
        If it cannot be read, or a column or a number is missing.
    """
    try:
        text = read_text(path, most=LARGEST)
    except OSError as error:
        raise unreadable(SceneError, f"The labels '{path}'", error) from None
    except UnicodeDecodeError as error:
        raise SceneError(f"The labels '{path}' cannot be read: {error}.") from None
    rows = csv.DictReader(text.lstrip("\ufeff").splitlines(), skipinitialspace=True)
    for column in COLUMNS:
        if column not in (rows.fieldnames or ()):
            raise SceneError(
                f"The labels '{path}' have no column '{column}': expected {', '.join(COLUMNS)} "
                "and, if there are several, kind."
            )
    result: list[Label] = []
    for row in rows:
        try:
            begin, end = float(row["begin"]), float(row["end"])
        except (TypeError, ValueError):
            raise SceneError(
                f"The labels '{path}', line {rows.line_num}: begin and end must be times in s, got "
                f"{shown(row['begin'])} and {shown(row['end'])}."
            ) from None
        result.append(Label(row["recording"] or "", begin, end, row.get("kind") or ""))
    return tuple(result)


@dataclass(frozen=True, slots=True, eq=False)
class _Take:
    """A recording as its program sees it.

    Attributes
    ----------
    name : str
    program : Program
        With the facts of the array.
    channels : tuple of str
    parts : tuple of (frames, rows, cols, channels) float
        Good frames, parted where the rest is learned anew.
    times : (frames,) float, s
        After the first frame.
    """

    name: str
    program: Program
    channels: tuple[str, ...]
    parts: tuple[Floats, ...]
    times: Floats

    @property
    def rate(self) -> float:
        """Frames per second that the program assumes."""
        return float(cast(float, dict(self.program.parameters)[RATE]))


@dataclass(frozen=True, slots=True, eq=False)
class _Dial:
    """What is tuned: a program, the rule of its event, and the parameter that is its level."""

    program: Program
    rule: EventRule
    parameter: str
    spec: SceneSpec

    @property
    def known(self) -> Mapping[str, Any]:
        """Parameters of the program, with the scene's values."""
        return {**_known(self.program), **self.spec.parameters}

    @property
    def least(self) -> float:
        """The lowest level: programs that count in noise take none below 1."""
        return 1.0 if self.parameter == "level" and self.known["level"] >= 1.0 else 1e-6

    @property
    def open(self) -> dict[str, object]:
        """Parameters with which the flag says where a strength counts."""
        hold: dict[str, object] = {"hold_time": 0.0} if "hold_time" in self.known else {}
        return {self.parameter: self.least, **hold}

    def grid(self, tried: Mapping[str, Sequence[float]] | None) -> list[Constants]:
        """Return the constants that are tried; the scene's own come first."""
        values = tried
        if values is None:
            values = {
                name: [m * float(self.known[name]) for m in multiples]
                for name, multiples in MULTIPLES.items()
                if name in self.known and name != self.parameter
            }
        for name, numbers in values.items():
            if name not in self.known or name == self.parameter:
                raise name_error("parameter", name, [n for n in self.known if n != self.parameter])
            if not all(is_real(number) for number in numbers):
                raise SceneError(f"'{name}' must be tried at numbers, got {shown(list(numbers))}.")
        return [(), *(((name, float(v)),) for name, tries in values.items() for v in tries)]


def tune(
    recordings: Sequence[str | Path | Recording],
    scene: str | Path = "slip",
    *,
    event: str = "",
    labels: str | Path | Sequence[Label] = (),
    false_reports: float = 2.0,
    constants: Mapping[str, Sequence[float]] | None = None,
    changes: Mapping[str, object] | None = None,
    engine: Engine | None = None,
    trust: bool = False,
) -> Tuned:
    """Tune the level of an event, and a few constants, on your own recordings.

    Parameters
    ----------
    recordings : sequence of str, Path or Recording
        Recordings that begin at rest, as the scene requires. Time outside all labels counts as
        quiet.
    scene : str or Path
        A TOML file, or the name of a packaged scene, whose program and parameters are used.
    event : str
        One of the scene's events with a level, such as "slip"; the first such event by default.
    labels : str, Path or sequence of Label
        A CSV file with the columns recording, begin, end (s after the first frame) and kind, or the
        same as objects. Without labels only the level is learned.
    false_reports : float
        Accepted false reports per ten minutes.
    constants : mapping of str to sequence of float, optional
        Parameter values to try, one parameter at a time. The default is `look`, `still` and
        `floor`, as far as the program has them.
    changes : mapping of str to object, optional
        Values that override those of the scene, by dotted key.
    engine : Engine, optional
        The default is the scene's own; "numba" builds the program of every constant faster.
    trust : bool
        As in `load_scene`.

    Returns
    -------
    Tuned
        Its `save` writes the scene, and `str` summarises the evidence.

    Raises
    ------
    SceneError
        If no time is quiet, a label is outside its recording, a recording states no rate, or the
        program has no level for that event.
    CnnumError
        If a recording or the scene has a fault.
    """
    if not (is_real(false_reports) and 1e-3 <= false_reports <= 1e3):
        raise SceneError(
            "'false_reports' must be a number of reports in ten minutes, 0.001 to 1000, got "
            f"{shown(false_reports)}."
        )
    if not recordings:
        raise SceneError("Expected at least one recording to tune on, got none.")
    sources = list(recordings)
    arrays = [None if isinstance(s, Recording) else array_of(Path(s)) for s in sources]
    given = {**({"array": arrays[0]} if arrays[0] else {}), **(changes or {})}
    dial = _dial(read_scene(scene, changes=given, trust=trust), event)
    spec = dial.spec
    how = {"device": spec.device, "precision": spec.precision, "fallback": spec.fallback}
    used = engine or Engine(spec.engine, **how)
    said = read_labels(Path(labels)) if isinstance(labels, str | Path) else tuple(labels)
    takes = [_take(dial, s, a, used) for s, a in zip(sources, arrays, strict=True)]
    known = _labels_of(said, sources, takes)
    sought = any(label.kind in ("", dial.rule.kind) for _, label in known)
    every = {
        tried: [
            _marked(dial, tried, values, takes[n], [label for place, label in known if place == n])
            for n, values in enumerate(_played(dial, tried, takes, used))
        ]
        for tried in (dial.grid(constants) if sought else [()])
    }
    quiet = [series.seconds for series in every[()]]
    if sum(quiet) < LEAST:
        raise SceneError(
            f"The recordings have {sum(quiet):.2g} s of quiet time, expected at least {LEAST:g} s: "
            f"add one in which no {dial.rule.kind} happens."
        )
    usual, asked = _shipped_level(dial, takes[0], used), float(false_reports)
    numbers = range(len(takes))
    choice = _chosen(every, numbers, asked, usual)
    left_out = None
    if all(sum(quiet) - own >= LEAST for own in quiet):
        left_out = Outcome()
        for n in numbers:
            without = _chosen(every, [m for m in numbers if m != n], asked, usual)
            left_out += every[without.constants][n].outcome(without.level)
    result = Tuned(
        event=dial.rule.kind, program=spec.program_name, parameter=dial.parameter,
        level=choice.level, constants=dict(choice.constants), asked=asked,
        extrapolated=choice.extrapolated, seen=choice.outcome, left_out=left_out,
        shipped=sum((series.outcome(usual) for series in every[()]), Outcome()),
        shipped_level=usual,
        curves={
            "shipped": _curve(every[()], dial.least),
            "tuned": _curve(every[choice.constants], dial.least),
        },
        toml="",
    )  # fmt: skip
    text = _toml([*result.sentences()], scene, changes or {}, arrays[0], dial, choice)
    return replace(result, toml=text)


def _dial(spec: SceneSpec, event: str) -> _Dial:
    """Return what is tuned in a scene.

    Raises
    ------
    SceneError
        If no event, or not that one, has a level.
    """
    whole = program_of(spec)
    for want in [event] if event else [*spec.own, *spec.needs]:
        parameter, name, program = LEVELS.get(want, "level"), spec.program, whole
        if parameter not in _known(program) and want in program_names():
            name, program = want, get_program(want)  # `tactile` has the events of several
        known = _known(program)
        own = [rule for rule in spec.events if rule.kind == want]
        rules = own or [rule for rule in EVENT_RULES.get(want, ()) if rule.phase != "incipient"]
        if parameter in known and rules and rules[0].strength:
            kept = {key: value for key, value in spec.parameters.items() if key in known}
            needs = spec.needs if program is whole else (want,)
            needs = needs if own or want in needs else (*needs, want)
            spec = replace(spec, program=name, parameters=kept, needs=needs)
            return _Dial(program, rules[0], parameter, spec)
    said = f"'{event}'" if event else f"any of '{', '.join(spec.needs)}'"
    raise SceneError(
        f"Scene '{spec.name}' has no level of {said}: expected slip, twist, flow, drift, or an "
        "event of 'receptors' or 'on_off', in a scene of their program."
    )


def _known(program: Program) -> Mapping[str, Any]:
    """Return the parameters of a program, with their defaults."""
    signature = inspect.signature(program.function).parameters
    return {name: p.default for name, p in signature.items() if p.default is not p.empty}


def _take(dial: _Dial, source: object, array: Mapping[str, object] | None, engine: Engine) -> _Take:
    """Return a recording as the program sees it, processed as the scene processes frames."""
    spec = dial.spec
    if array is not None:
        options = {key: value for key, value in array.items() if key != "driver"}
        spec = replace(spec, driver=str(array["driver"]), driver_options=options)
    needs = (dial.rule.flag, dial.rule.strength)
    spec = replace(spec, parameters={**spec.parameters, **dial.open}, needs=needs, events=())
    name = f"'{source}'" if array is not None else "in memory"
    parts, times = list[list[NDArray[np.float32]]](), list[float]()
    with Scene.of(spec, engine, source if isinstance(source, Recording) else None) as scene:
        measured = unit_of(scene.conversion, scene.driver)
        program = bound(program_of(spec), spec, scene.driver, scene.grid, measured)
        scene.orders.said = True  # `cnnum check` looks for another order of the axes, at a price
        way = Passage(scene)
        for number, frame in enumerate(scene.driver.frames()):
            moment = way.step(number, frame)
            if moment.values is None:
                continue
            if way.path.stream.frames == 1:  # the first one, or the rest is learned anew
                parts.append([])
            parts[-1].append(np.array(moment.values, dtype=np.float32))
            times.append(frame.time - way.first)
        channels = scene.plan.schedule.channels_read
    if len(times) < ENOUGH:
        raise SceneError(
            f"The recording {name} has {len(times)} good frames, expected at least {ENOUGH}."
        )
    return _Take(name, program, channels, tuple(map(np.stack, parts)), np.array(times))


def _played(
    dial: _Dial, constants: Constants, takes: Sequence[_Take], engine: Engine
) -> list[Floats]:
    """Return the strengths of every recording: 0 where nothing is reported at any level.

    The flag at the lowest level and without a hold says where that is. Recordings of one rate run
    side by side.
    """
    outputs = (dial.rule.flag, dial.rule.strength)
    places = [(n, m) for n, take in enumerate(takes) for m in range(len(take.parts))]
    done: dict[tuple[int, int], Floats] = {}
    while places:
        first = takes[places[0][0]]
        same = [
            place
            for place in places
            if takes[place[0]].parts[0].shape[1:] == first.parts[0].shape[1:]
            and abs(takes[place[0]].rate / first.rate - 1.0) < SAME_RATE
        ]
        same = sorted(same, key=lambda place: len(takes[place[0]].parts[place[1]]))[-BATCH:]
        places = [place for place in places if place not in same]
        program = first.program.bind(**{**dict(constants), **dial.open})
        shape = first.parts[0].shape[1:3]
        plan = engine.compile(program, shape, outputs, channels=first.channels)
        done.update(zip(same, _side_by_side(plan, dial.rule, [
            takes[n].parts[m] for n, m in same
        ]), strict=True))  # fmt: skip
    return [
        np.concatenate([done[n, m] for m in range(len(take.parts))]) for n, take in enumerate(takes)
    ]


def _side_by_side(plan: Plan, rule: EventRule, parts: Sequence[Floats]) -> list[Floats]:
    """Return the strength of streams in one batch; one that is over repeats its last frame."""
    stream, longest = plan.stream((len(parts),)), max(map(len, parts))
    result = np.zeros((longest, len(parts)))
    for n in range(longest):
        outputs = stream.push(np.stack([part[min(n, len(part) - 1)] for part in parts]))
        result[n] = np.where(outputs[rule.flag] > rule.on, outputs[rule.strength], 0.0)
    return [result[: len(part), place] for place, part in enumerate(parts)]


def _labels_of(
    labels: Sequence[Label], sources: Sequence[object], takes: Sequence[_Take]
) -> list[tuple[int, Label]]:
    """Return the labels with the numbers of their recordings.

    Raises
    ------
    SceneError
        If there is no such recording, or a label is outside it.
    """
    result: list[tuple[int, Label]] = []
    for label in labels:
        fitting = [n for n, source in enumerate(sources) if label.recording in _names(n, source)]
        if len(fitting) != 1:
            known = "', '".join(str(_names(n, source)[-1]) for n, source in enumerate(sources))
            raise SceneError(
                f"A label names the recording {shown(label.recording)}, which is "
                f"{'ambiguous' if fitting else 'unknown'}: expected one of '{known}'."
            )
        last = float(takes[fitting[0]].times[-1])
        if not 0.0 <= label.begin <= label.end <= last + SLACK:
            raise SceneError(
                f"The label from {label.begin:g} to {label.end:g} s is outside the recording "
                f"{shown(label.recording)}, which lasts {last:.4g} s: expected "
                "0 ≤ begin ≤ end, in s after its first frame."
            )
        result.append((fitting[0], label))
    return result


def _names(number: int, source: object) -> tuple[str, ...]:
    """Return what a label may call a recording; the last one is for people."""
    if isinstance(source, Recording):
        return (str(number),)
    path = Path(str(source))
    return str(path), path.stem, path.name


def _marked(
    dial: _Dial, constants: Constants, values: Floats, take: _Take, labels: Sequence[Label]
) -> Strengths:
    """Return a recording's strengths with its labels."""
    quiet = np.ones(len(values), np.bool_)
    for label in labels:
        quiet &= (take.times < label.begin - SLACK) | (take.times > label.end + SLACK)
    sought = tuple(label for label in labels if label.kind in ("", dial.rule.kind))
    hold_time = float({**dial.known, **dict(constants)}.get("hold_time", 0.0))
    hold = ceil(hold_time * take.rate - 0.5)
    return Strengths(values, take.times, quiet, sought, hold)


@dataclass(frozen=True, slots=True)
class _Choice:
    constants: Constants
    level: float
    extrapolated: bool
    outcome: Outcome


def _chosen(
    every: Mapping[Constants, Sequence[Strengths]],
    on: Sequence[int],
    asked: float,
    usual: float,
) -> _Choice:
    """Return the constants that find most events at the level of the asked rate."""
    best: _Choice | None = None
    for constants, series in every.items():
        some = [series[n] for n in on]
        seconds = sum(strengths.seconds for strengths in some)
        peaks = np.concatenate([strengths.peaks() for strengths in some])
        level, extrapolated = level_for(peaks, seconds, asked)
        level = float(f"{level or usual:.4g}")  # where quiet says nothing, as shipped
        outcome = sum((strengths.outcome(level) for strengths in some), Outcome())
        if best is None or outcome.found > best.outcome.found:
            best = _Choice(constants, level, extrapolated, outcome)
    assert best is not None
    return best


def _curve(series: Sequence[Strengths], least: float) -> list[tuple[float, Outcome]]:
    """Return levels over the range of the strengths, each with its outcome."""
    highest = max(float(strengths.values.max()) for strengths in series)
    if highest <= least:
        return []
    low = max(least, 1e-3 * highest)
    return [
        (level, sum((strengths.outcome(level) for strengths in series), Outcome()))
        for level in np.geomspace(low, highest, CURVE).tolist()
    ]


def _shipped_level(dial: _Dial, take: _Take, engine: Engine) -> float:
    """Return the level of the program as the scene has it."""
    level = float(dial.known[dial.parameter])
    if level > 0.0:
        return level
    program = take.program.bind(**{dial.parameter: level})
    plan = engine.compile(
        program, take.parts[0].shape[1:3], (f"{dial.rule.kind}_level",), channels=take.channels
    )
    return float(plan(take.parts[0][0])[f"{dial.rule.kind}_level"])


def _toml(
    tuned: Sequence[str], scene: str | Path, changes: Mapping[str, object],
    array: Mapping[str, object] | None, dial: _Dial, choice: _Choice,
) -> str:  # fmt: skip
    """Return the scene with its level, and why it is that, as TOML."""
    table = scene_table(scene, changes)
    if array is not None and str(scene) in scene_names():
        table["array"] = dict(array)
    parameters = {**dial.spec.parameters, **dict(choice.constants), dial.parameter: choice.level}
    parameters.pop("false_reports", None)  # the level is given
    place, _, function = (program := dial.spec.program_name).rpartition(":")
    if place.endswith(".py"):  # the scene may be written to another folder
        program = f"{(dial.spec.base / place).absolute()}:{function}"
    table |= {
        "name": f"{dial.spec.name}, tuned", "needs": list(dial.spec.needs),
        "program": {"name": program, "parameters": parameters},
    }  # fmt: skip
    lines = [f"# {sentence}" for sentence in tuned]
    lines += [f"{key} = {toml_text(v)}" for key, v in table.items() if not isinstance(v, dict)]
    for key, value in table.items():
        if isinstance(value, dict):
            lines += _table(key, cast("dict[str, object]", value))
    return "\n".join(lines) + "\n"


def _table(name: str, table: Mapping[str, object]) -> list[str]:
    plain = {key: value for key, value in table.items() if not isinstance(value, dict)}
    lines = ["", f"[{name}]", *(f"{key} = {toml_text(value)}" for key, value in plain.items())]
    for key, value in table.items():
        if isinstance(value, dict):
            lines += _table(f"{name}.{key}", cast("dict[str, object]", value))
    return lines
