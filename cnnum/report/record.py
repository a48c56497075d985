"""The record of a scene's run for a report, held against the truth, with its cost, and as JSON."""

import base64
import json
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field
from math import atan2, degrees, isfinite, pi, remainder
from typing import cast

import numpy as np

from cnnum.arrays import Floats, Shape
from cnnum.drivers.recording_file import MEMORY
from cnnum.drivers.registry import driver_options
from cnnum.errors import ArrayError
from cnnum.frame import FORCE_AXES, truth_columns
from cnnum.plan import Explanation
from cnnum.report.environment import Environment
from cnnum.report.work_precision import WorkPrecision
from cnnum.scenes.conversion import ByCalibration
from cnnum.scenes.events import Event, titled
from cnnum.scenes.frame_path import FrameResult
from cnnum.scenes.pipeline import Scene
from cnnum.scenes.scene_record import Summary
from cnnum.sharing import json_value
from cnnum.templating.checks import CheckResult

SHEAR_X, SHEAR_Y, NORMAL = FORCE_AXES


@dataclass(frozen=True, slots=True, eq=False)
class SceneRecord:
    """Everything that a report says about a run comes from here.

    Attributes
    ----------
    name : str
    needs : tuple of str
        The outputs that the scene wants.
    shape : (rows, cols)
    rate : float
        Frames per second, Hz; 0 if unknown.
    pitch : float or None
        Between taxels, m, or None if it is unknown, and then no circle can be drawn to scale.
    channels : tuple of str
        Channels of `values`: the force axes that were read.
    unit : str
        Unit of `values`: "strain", "count", "N"…
    times : (frames,) float, s
    values : (frames, rows, cols, channels) float
        The program's input; NaN in frames that were not allowed to run.
    push : int
        Sign with which a push on the skin, or a pull along an axis, reads in `values`: −1 for
        strain, which counts tension as positive.
    outputs : dict of str to (frames,) or (frames, rows, cols) float
        The program's outputs; NaN where the program did not run.
    events : tuple of Event
    truth : dict of str to (frames,) float
        Ground truth by name; empty if the source has none, NaN in frames without.
    seconds : (frames,) float, s
        From a frame in host memory to its events; NaN where the program did not run.
    explanation : Explanation
    summary : Summary
    environment : Environment
    """

    name: str
    needs: tuple[str, ...]
    shape: Shape
    rate: float
    pitch: float | None
    channels: tuple[str, ...]
    unit: str
    times: Floats
    values: Floats
    push: int
    outputs: dict[str, Floats]
    events: tuple[Event, ...]
    truth: dict[str, Floats]
    seconds: Floats
    explanation: Explanation
    summary: Summary
    environment: Environment

    @property
    def frames(self) -> int:
        """Number of frames."""
        return len(self.times)

    def channel(self, name: str) -> Floats | None:
        """Return (frames, rows, cols) of a force axis, or None if it was not read."""
        if name not in self.channels:
            return None
        return self.values[..., self.channels.index(name)]

    def maps(self) -> dict[str, Floats]:
        """Return the outputs that are maps."""
        return {name: values for name, values in self.outputs.items() if values.ndim == 3}

    def at(self, name: str, frame: int) -> float:
        """Return the ground truth of that name at a frame; NaN where there is none."""
        values = self.truth.get(name)
        return float("nan") if values is None else float(values[frame])


@dataclass(slots=True, eq=False)
class SceneRecorder:
    """Collects the results of a scene as they come.

    Attributes
    ----------
    scene : Scene
    """

    scene: Scene
    _moments: list[FrameResult] = field(default_factory=list[FrameResult])

    def add(self, moment: FrameResult) -> None:
        """Add the next result."""
        self._moments.append(moment)

    def record(self) -> SceneRecord:
        """Return the record so far."""
        scene, moments = self.scene, self._moments
        explanation = scene.plan.explain()
        calibrated = isinstance(scene.conversion, ByCalibration)
        return SceneRecord(
            name=scene.spec.name,
            needs=scene.spec.needs,
            shape=scene.shape,
            rate=scene.driver.rate,
            pitch=_pitch(scene),
            channels=scene.plan.schedule.channels_read,
            unit="strain" if calibrated else scene.driver.unit,
            times=np.array([moment.frame.time for moment in moments]),
            values=_values(scene, moments),
            push=_push(scene, calibrated),
            outputs=_outputs(moments),
            events=tuple(event for moment in moments for event in moment.events),
            truth=truth_columns([moment.frame.truth for moment in moments]),
            seconds=np.array([m.seconds if m.outputs else np.nan for m in moments]),
            explanation=explanation,
            summary=scene.summary(),
            environment=Environment.here(explanation.device),
        )


def _pitch(scene: Scene) -> float | None:
    if scene.grid is not None:
        return scene.grid.pitch
    spec = scene.spec
    if spec.driver == MEMORY:
        return None
    options = driver_options(spec.driver, spec.driver_options, base=spec.base)
    return cast(float | None, getattr(options, "pitch", None))


def _push(scene: Scene, calibrated: bool) -> int:
    push = scene.spec.parameters.get("push", -1 if calibrated else 1)
    return -1 if isinstance(push, int | float) and push < 0 else 1


def _values(scene: Scene, moments: list[FrameResult]) -> Floats:
    channels = scene.plan.schedule.channels_read
    values = np.full((len(moments), *scene.shape, len(channels)), np.nan)
    for number, moment in enumerate(moments):
        if moment.values is not None:
            values[number] = moment.values
    return values


def _outputs(moments: list[FrameResult]) -> dict[str, Floats]:
    none: dict[str, Floats] = {}
    known = next((moment.outputs for moment in moments if moment.outputs), none)
    result = {name: np.full((len(moments), *np.shape(v)), np.nan) for name, v in known.items()}
    for number, moment in enumerate(moments):
        for name, value in moment.outputs.items():
            result[name][number] = value
    return result


MAX_DELAY = 5
"""Frames that a report may be early or late."""

MAX_TURN = pi / 18
"""rad, 10°: how far a reported direction may be from the true one."""

MATCH_WITHIN = 0.6
"""s, beyond which a report and a true event are held for two different things."""


@dataclass(frozen=True, slots=True)
class Lane:
    """A kind of event, and the column of the ground truth that holds while it lasts.

    Attributes
    ----------
    kind, phase : str
        Kind and phase of the event that begins it; only slip has a phase.
    want : str
        The wants of a scene that expects it.
    truth : str
        Column of the ground truth.
    flag : str
        Output of the program.
    ends : str
        Kind of the event when it ends; none where empty.
    early, late : float
        s, that a report may be early or late where that is more than `MAX_DELAY` frames.
    """

    kind: str
    phase: str
    want: str
    truth: str
    flag: str
    ends: str = ""
    early: float = 0.0
    late: float = 0.0

    @property
    def title(self) -> str:
        """Name for people."""
        return titled(self.phase, self.kind)


LANES = (
    Lane("contact", "", "contact", "contact", "contact", ends="release"),
    Lane("slip", "incipient", "slip", "incipient", "incipient_slip"),
    # a pattern that moves is seen after some 0.1 mm; a shear that turns before half of it slips
    Lane("slip", "gross", "slip", "slip", "gross_slip", late=0.3),
    Lane("twist", "", "twist", "twist_slip", "twist", early=0.5, late=0.3),
)


@dataclass(frozen=True, slots=True)
class TrueEvent:
    """Something that really began or ended.

    Attributes
    ----------
    kind, phase : str
    frame : int
    time : float, s
    direction : float or None
        rad; of a gross slip that of the sliding, of an incipient one that of the shear force.
    sense : int or None
        For a twist, +1 from x towards y and −1 the other way.
    """

    kind: str
    phase: str
    frame: int
    time: float
    direction: float | None = None
    sense: int | None = None

    @property
    def title(self) -> str:
        """Name for people."""
        return titled(self.phase, self.kind)


@dataclass(frozen=True, slots=True)
class Verdict:
    """One row of the comparison.

    Attributes
    ----------
    truth : TrueEvent or None
        None for a report of something that was not there.
    reported : Event or None
        None for an event that was missed.
    delay : int or None
        Frames from the truth to the report; negative if it came early.
    turn : float or None
        rad, reported minus true direction, within ±π.
    passed : bool
    text : str
        The verdict in words.
    """

    truth: TrueEvent | None
    reported: Event | None
    delay: int | None
    turn: float | None
    passed: bool
    text: str

    @property
    def title(self) -> str:
        """Its subject."""
        if self.truth is not None:
            return self.truth.title
        assert self.reported is not None
        return self.reported.title

    @property
    def frame(self) -> int:
        """Frame at which it is listed."""
        known = self.truth or self.reported
        assert known is not None
        return known.frame


def spans(record: SceneRecord, lane: Lane) -> list[tuple[int, int]]:
    """Return the first frame and the frame after the last of every time that a lane holds."""
    return held(record.truth.get(lane.truth))


def held(values: np.ndarray | None) -> list[tuple[int, int]]:
    """Return (first, after the last) of every run of frames in which values are above 0."""
    if values is None:
        return []
    holds = np.concatenate(([False], np.nan_to_num(values) > 0.0, [False]))
    edges = np.flatnonzero(holds[1:] != holds[:-1])
    return [(int(first), int(after)) for first, after in edges.reshape(-1, 2)]


def true_events(record: SceneRecord) -> tuple[TrueEvent, ...]:
    """Return the true events among those that the scene wants, in order of time.

    A phase that the scene's program does not report is not among it.
    """
    result = (
        event
        for lane in LANES
        if lane.want in record.needs and lane.flag in record.outputs
        for event in _events_of(record, lane)
    )
    return tuple(sorted(result, key=lambda event: event.frame))


def _events_of(record: SceneRecord, lane: Lane) -> Iterator[TrueEvent]:
    for first, after in spans(record, lane):
        yield TrueEvent(
            kind=lane.kind,
            phase=lane.phase,
            frame=first,
            time=float(record.times[first]),
            direction=_direction(record, lane, first),
            sense=int(np.sign(record.at("twist_rate", first))) if lane.kind == "twist" else None,
        )
        if lane.ends and after < record.frames:
            yield TrueEvent(lane.ends, "", after, float(record.times[after]))


def _direction(record: SceneRecord, lane: Lane, frame: int) -> float | None:
    if lane.phase == "gross":
        angle = record.at("slip_direction", frame)
    elif lane.phase == "incipient":
        angle = atan2(record.at("shear_y", frame), record.at("shear_x", frame))
    else:
        return None
    return angle if isfinite(angle) else None


def compare(record: SceneRecord) -> tuple[Verdict, ...]:
    """Return every true event with its report, and every report without one, in order of time.

    Reports of kinds that the ground truth does not know are left alone. Without any ground truth
    there is nothing to compare.
    """
    if not record.truth:
        return ()
    kinds = {(lane.kind, lane.phase) for lane in LANES} | {(lane.ends, "") for lane in LANES}
    truths = true_events(record)
    reports = [event for event in record.events if (event.kind, event.phase or "") in kinds]
    pairs = _pairs(truths, reports)
    rows = [_verdict(truth, pairs.get(index)) for index, truth in enumerate(truths)]
    used = {id(event) for event in pairs.values()}
    rows += [_verdict(None, event) for event in reports if id(event) not in used]
    return tuple(sorted(rows, key=lambda row: row.frame))


def _pairs(truths: tuple[TrueEvent, ...], reports: list[Event]) -> dict[int, Event]:
    """Return a report for each truth, the nearest pairs first; none is used twice."""
    near = sorted(
        (abs(event.time - truth.time), i, j)
        for i, truth in enumerate(truths)
        for j, event in enumerate(reports)
        if (event.kind, event.phase or "") == (truth.kind, truth.phase)
    )
    pairs: dict[int, Event] = {}
    taken: set[int] = set()
    for distance, i, j in near:
        if distance <= MATCH_WITHIN and i not in pairs and j not in taken:
            pairs[i] = reports[j]
            taken.add(j)
    return pairs


def _verdict(truth: TrueEvent | None, event: Event | None) -> Verdict:
    if truth is None:
        return Verdict(None, event, None, None, False, "false report")
    if event is None:
        return Verdict(truth, None, None, None, False, "missed")
    delay = event.frame - truth.frame
    turn = None
    if truth.direction is not None and event.direction is not None:
        turn = remainder(event.direction - truth.direction, 2 * pi)
    faults = tuple(_faults(truth, event, delay, turn))
    return Verdict(truth, event, delay, turn, not faults, "; ".join(faults) or "passed")


def _faults(truth: TrueEvent, event: Event, delay: int, turn: float | None) -> Iterator[str]:
    lane = next((lane for lane in LANES if lane.title == truth.title), LANES[0])
    off = event.time - truth.time
    if abs(delay) > MAX_DELAY and not -lane.early <= off <= lane.late:
        yield f"{abs(delay)} frames {'late' if delay > 0 else 'early'}"
    if truth.direction is not None and turn is None:
        yield "no direction"
    if turn is not None and abs(turn) > MAX_TURN:
        yield f"direction off by {abs(degrees(turn)):.0f}°"
    if truth.sense is not None and event.sense != truth.sense:
        yield "wrong sense" if event.sense else "no sense"


@dataclass(frozen=True, slots=True)
class PlanCost:
    """The measured time of a frame under a plan.

    Attributes
    ----------
    label : str
        Name of the plan in a report.
    explanation : Explanation
    frames : int
        Measured.
    p50_us, p99_us : float
        From a frame in host memory to its events, µs.
    """

    label: str
    explanation: Explanation
    frames: int
    p50_us: float
    p99_us: float

    @classmethod
    def of_record(cls, label: str, record: SceneRecord) -> "PlanCost":
        """Return the cost of a run that was recorded.

        Raises
        ------
        ArrayError
            If no frame of it ran.
        """
        return _cost(label, record.explanation, record.seconds)

    @classmethod
    def measure(cls, scenes: Mapping[str, Scene]) -> tuple["PlanCost", ...]:
        """Run scenes to their ends and return the cost of the frames of each.

        They run in turns, a frame each, so that a machine that is slower for a while is so for all.

        Parameters
        ----------
        scenes : mapping of str to Scene
            By the name of their plans; their arrays have as many frames.

        Raises
        ------
        CnnumError
            From the array.
        """
        turns = zip(*(scene.results() for scene in scenes.values()), strict=True)
        seconds = np.array([[m.seconds if m.outputs else np.nan for m in turn] for turn in turns])
        named = zip(scenes.items(), seconds.reshape(-1, len(scenes)).T, strict=True)
        return tuple(_cost(label, scene.plan.explain(), own) for (label, scene), own in named)


def _cost(label: str, explanation: Explanation, seconds: Floats) -> PlanCost:
    ran = 1e6 * seconds[np.isfinite(seconds)]
    if ran.size == 0:
        raise ArrayError(f"The plan '{label}' ran for no frame; a cost needs at least one.")
    low, high = np.percentile(ran, (50, 99)).tolist()
    return PlanCost(label, explanation, int(ran.size), low, high)


FORMAT = 1
"""Number of this layout."""

LEVELS = 32_767
MISSING = -32_768
MAP_BYTES = 1_500_000
"""Size of all maps before base64; a longer recording keeps every second frame, or third…"""


@dataclass(frozen=True, slots=True, eq=False)
class ReportData:
    """The parts of a report.

    Attributes
    ----------
    record : SceneRecord
    checks : tuple of CheckResult
    work_precision : tuple of WorkPrecision
    plans : tuple of PlanCost
    """

    record: SceneRecord
    checks: tuple[CheckResult, ...] = ()
    work_precision: tuple[WorkPrecision, ...] = ()
    plans: tuple[PlanCost, ...] = ()

    @property
    def verdicts(self) -> tuple[Verdict, ...]:
        """Reported events against the ground truth."""
        return compare(self.record)


def to_json(data: ReportData) -> str:
    """Return the data as JSON that may stand inside a script element."""
    text = json.dumps(as_tree(data), ensure_ascii=False, separators=(",", ":"), allow_nan=False)
    return text.replace("<", "\\u003c")


def as_tree(data: ReportData) -> dict[str, object]:
    """Return the data as values of JSON.

    Series have seven digits; maps are scaled 16-bit integers in base64. NaN is null, or the integer
    that "missing" names.
    """
    record, every = data.record, stride(data.record)
    maps = {"values": record.values, **record.maps()}
    series = {name: v for name, v in record.outputs.items() if v.ndim == 1}
    return {
        "cnnum_report": FORMAT,
        "environment": {
            **asdict(record.environment),
            "versions": dict(record.environment.versions),
        },
        "scene": {
            "name": record.name,
            "needs": list(record.needs),
            "shape": list(record.shape),
            "rate_hz": record.rate,
            "pitch_m": record.pitch,
            "channels": list(record.channels),
            "unit": record.unit,
            "push": record.push,
            "frames": record.frames,
        },
        "t": numbers(record.times),
        "seconds": numbers(record.seconds),
        "truth": {name: numbers(values) for name, values in record.truth.items()},
        "outputs": {name: numbers(values) for name, values in series.items()},
        "maps": {"every": every, **{name: packed(v[::every]) for name, v in maps.items()}},
        "events": [event.record() for event in record.events],
        "verdicts": [json_value(asdict(verdict)) for verdict in data.verdicts],
        "explanation": json_value(asdict(record.explanation)),
        "summary": json_value(asdict(record.summary)),
        "checks": [json_value(asdict(check)) for check in data.checks],
        "work_precision": [json_value(asdict(point)) for point in data.work_precision],
        "plans": [json_value(asdict(plan)) for plan in data.plans],
    }


def stride(record: SceneRecord) -> int:
    """Return the distance of the frames whose maps are kept, so that a report stays light."""
    sizes = [record.values.size, *(values.size for values in record.maps().values())]
    return max(1, -(-2 * sum(sizes) // MAP_BYTES))


def numbers(values: Floats) -> list[float | int | None]:
    """Return a series with seven digits, whole numbers without a point."""
    return [number(value) for value in values.tolist()]


def number(value: float) -> float | int | None:
    """Return a number as JSON can have it."""
    if not np.isfinite(value):
        return None
    short = float(f"{value:.7g}")
    return int(short) if short.is_integer() and abs(short) < 1e15 else short


def packed(values: Floats) -> dict[str, object]:
    """Return maps as integers: value = scale · integer."""
    finite = np.isfinite(values)
    top = float(np.abs(values[finite]).max(initial=0.0))
    scale = top / LEVELS or 1.0
    whole = np.full(values.shape, MISSING, dtype="<i2")
    whole[finite] = np.rint(values[finite] / scale).astype("<i2")
    return {
        "dtype": "int16, little-endian, base64",
        "shape": list(values.shape),
        "scale": scale,
        "missing": MISSING,
        "data": base64.b64encode(whole.tobytes()).decode("ascii"),
    }
