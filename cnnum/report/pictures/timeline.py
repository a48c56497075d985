"""The story of a scene in time: true events, reported ones, and the loads and radii."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from cnnum.arrays import Floats
from cnnum.report.pictures.svg import Scale, at, box, line, path, picture, polyline, round_up, text
from cnnum.report.record import SceneRecord
from cnnum.report.verdicts import LANES, Lane, Verdict, held, spans

LEFT, RIGHT = 40.0, 12.0
LANE = 40.0
PANEL, GAP = 84.0, 34.0


@dataclass(frozen=True, slots=True, eq=False)
class Curve:
    """One line of a panel."""

    name: str
    values: Floats
    style: str
    filled: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class Panel:
    """Curves that share an axis."""

    title: str
    unit: str
    curves: tuple[Curve, ...]


def timeline(record: SceneRecord, verdicts: tuple[Verdict, ...], width: float) -> str:
    """Return the picture.

    Parameters
    ----------
    record : SceneRecord
    verdicts : tuple of Verdict
    width : float
        Width of the picture in its own units; text keeps its size.
    """
    time = Scale(float(record.times[0]), _end(record), LEFT, width - RIGHT)
    parts: list[str] = []
    y = 4.0
    for lane in _lanes(record):
        parts += _lane(record, lane, verdicts, time, y)
        y += LANE
    top = y + 6.0
    y = top
    for panel in panels(record):
        y += GAP - 12.0
        parts += _panel(record, panel, time, y)
        y += PANEL + 12.0
    marks = [
        line(time(v.truth.time), 16.0, time(v.truth.time), y - 12.0, "mark")
        for v in verdicts
        if v.truth
    ]
    parts = [*marks, *parts, *_time_axis(time, y - 12.0, width)]
    label = f"Events, loads and radii of the scene {record.name} over time"
    return picture(width, y + 28.0, parts, label, "chart")


def panels(record: SceneRecord) -> tuple[Panel, ...]:
    """Return the loads and radii of the ground truth."""
    truth = record.truth
    found: list[Panel] = []
    if "normal_force" in truth:
        load = Curve("normal load P", truth["normal_force"], "load", filled=True)
        found.append(Panel("Normal load P", "N", (load,)))
    if "shear_x" in truth and "shear_y" in truth:
        shear = np.hypot(truth["shear_x"], truth["shear_y"])
        found.append(Panel("Shear force Q", "N", (Curve("Q", shear, "shear", filled=True),)))
    if "torque" in truth:
        torque = Curve("T", 1e3 * truth["torque"], "torque", filled=True)
        found.append(Panel("Torque T", "mN m", (torque,)))
    if "contact_radius" in truth and "stick_radius" in truth:
        radii = (
            Curve("stick radius c", 1e3 * truth["stick_radius"], "stick", filled=True),
            Curve("contact radius a", 1e3 * truth["contact_radius"], "contact"),
        )
        found.append(Panel("Radius of contact (line), stick (area)", "mm", radii))
    return tuple(found)


def _end(record: SceneRecord) -> float:
    first, last = float(record.times[0]), float(record.times[-1])
    return last if last > first else first + 1.0


def _lanes(record: SceneRecord) -> tuple[Lane, ...]:
    """Return a lane for each kind of event: those with a truth first, then the others that came."""
    known = {(lane.kind, lane.phase) for lane in LANES} | {(lane.ends, "") for lane in LANES}
    came = dict.fromkeys((event.kind, event.phase or "") for event in record.events)
    others = (
        Lane(kind, phase, kind, "", kind) for kind, phase in came if (kind, phase) not in known
    )
    return (*(lane for lane in LANES if lane.want in record.needs), *others)


def _lane(
    record: SceneRecord, lane: Lane, verdicts: tuple[Verdict, ...], time: Scale, y: float
) -> Iterator[str]:
    mine = [v for v in verdicts if _belongs(v, lane)]
    yield text(LEFT, y + 11.0, lane.title, "title")
    yield line(time.start, y + 25.0, time.end, y + 25.0, "grid")
    for first, after in spans(record, lane):
        x1, x2 = _edges(record, first, after, time)
        title = f"{lane.title}, true from {record.times[first]:.3f} s"
        yield box(x1, y + 17.0, x2 - x1, 8.0, f"bar {_hue(lane)}", title)
    for first, after in held(record.outputs.get(lane.flag)):
        x1, x2 = _edges(record, first, after, time)
        yield box(x1, y + 26.5, x2 - x1, 3.0, "flag", f"{lane.title}, as the program saw it")
    for verdict in mine:
        if verdict.reported is not None:
            yield from _marker(time(verdict.reported.time), y + 27.0, verdict, time.end)
    for event in record.events if not (record.truth and lane.truth) else ():
        if event.kind in (lane.kind, lane.ends) and (event.phase or "") == lane.phase:
            yield _triangle(time(event.time), y + 27.0, "reported", str(event))


def _belongs(verdict: Verdict, lane: Lane) -> bool:
    return verdict.title == lane.title or bool(lane.ends and verdict.title == lane.ends)


def _hue(lane: Lane) -> str:
    return f"is-{lane.phase or lane.kind}"


def _edges(record: SceneRecord, first: int, after: int, time: Scale) -> tuple[float, float]:
    last = min(after, record.frames - 1)
    x1 = time(float(record.times[first]))
    return x1, max(time(float(record.times[last])), x1 + 1.5)


def _marker(x: float, y: float, verdict: Verdict, end: float) -> Iterator[str]:
    assert verdict.reported is not None
    style = "reported" if verdict.passed else "reported wrong"
    delay = "" if verdict.delay is None else f", {verdict.delay:+d} frames"
    title = f"{verdict.title} reported at {verdict.reported.time:.3f} s{delay}: {verdict.text}"
    yield _triangle(x, y, style, title)
    words = f"{verdict.delay or 0:+d}".replace("-", "−").replace("+0", "0")
    words = words if verdict.passed else verdict.text
    last = x > end - 120.0
    yield text(x - 7.0 if last else x + 7.0, y + 9.5, words, "tick", "end" if last else "")


def _triangle(x: float, y: float, style: str, title: str) -> str:
    shape = f"M{at(x)} {at(y)}l4.5 8h-9z"
    return f'<path class="{style}" d="{shape}"><title>{title}</title></path>'


def _panel(record: SceneRecord, panel: Panel, time: Scale, y: float) -> Iterator[str]:
    low = min(0.0, *(float(np.nanmin(c.values, initial=0.0)) for c in panel.curves))
    high = max(float(np.nanmax(c.values, initial=0.0)) for c in panel.curves)
    bottom = -round_up(-low) if low < -0.02 * max(high, 1e-12) else 0.0
    scale = Scale(bottom, round_up(high), y + PANEL, y)
    yield text(LEFT, y - 8.0, f"{panel.title}, {panel.unit}", "title")
    for tick in scale.ticks(3):
        yield line(time.start, scale(tick), time.end, scale(tick), "axis" if tick == 0 else "grid")
        yield text(LEFT - 6.0, scale(tick) + 4.0, f"{tick:g}", "tick", "end")
    for curve in panel.curves:
        yield from _curve(record, curve, time, scale)


def _curve(record: SceneRecord, curve: Curve, time: Scale, scale: Scale) -> Iterator[str]:
    every = max(1, int(record.frames / (2.0 * (time.end - time.start))))
    points = [
        (time(t), scale(value))
        for t, value in zip(record.times[::every], curve.values[::every], strict=True)
        if np.isfinite(value)
    ]
    if curve.filled and points:
        ground = scale(0.0)
        around = [(points[0][0], ground), *points, (points[-1][0], ground)]
        yield f'<path class="area {curve.style}" d="{path(around)}Z"/>'
    yield polyline(points, f"curve {curve.style}")


def _time_axis(time: Scale, y: float, width: float) -> Iterator[str]:
    for tick in time.ticks(10 if width > 500 else 5):
        yield line(time(tick), y, time(tick), y + 4.0, "axis")
        yield text(time(tick), y + 16.0, f"{tick:g}", "tick", "middle")
    yield text(time.end, y + 27.0, "time, s", "tick", "end")
