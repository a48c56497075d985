"""Pictures of a scene as SVG: single frames, key frames side by side, and the story in time."""

from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from html import escape
from math import atan2, degrees, hypot, isfinite

import numpy as np
from numpy.typing import NDArray

from cnnum.arrays import Floats
from cnnum.report.charts import Scale, at, box, line, path, picture, plain, polyline, round_up, text
from cnnum.report.record import (
    LANES,
    NORMAL,
    SHEAR_X,
    SHEAR_Y,
    Lane,
    SceneRecord,
    Verdict,
    held,
    spans,
)
from cnnum.sharing import STEPS, step

SHOWN = ("contact", "incipient slip", "gross slip", "twist")


@dataclass(frozen=True, slots=True)
class KeyFrame:
    """A frame that is shown, and its content."""

    title: str
    frame: int


def key_frames(record: SceneRecord) -> tuple[KeyFrame, ...]:
    """Return the frames before a contact, in each of its phases, and while it is let go.

    They follow the ground truth; without one, the reported events.
    """
    chosen = _by_truth(record) if record.truth else _by_events(record)
    unique = {key.frame: key for key in sorted(chosen, key=lambda key: key.frame)}
    return tuple(unique.values())


def _by_truth(record: SceneRecord) -> list[KeyFrame]:
    times = {lane.title: spans(record, lane) for lane in LANES}
    contacts = times["contact"]
    if not contacts:
        return [KeyFrame("no contact", record.frames // 2)]
    start, end = contacts[0]
    result = [KeyFrame("before", start // 2)] if start > 1 else []
    slips = [first for name in SHOWN[1:] for first, _ in times[name][:1]]
    result.append(KeyFrame("contact", (start + min([end, *slips])) // 2))
    for name in SHOWN[1:]:
        for first, after in times[name][:1]:
            result.append(KeyFrame(name, (first + after) // 2))
    if end < record.frames:
        result.append(KeyFrame("release", max(start, end - max(2, round(0.15 * record.rate)))))
    return result


def _by_events(record: SceneRecord) -> list[KeyFrame]:
    result = [KeyFrame("before", 0)]
    for event in record.events[:7]:
        result.append(KeyFrame(event.title, min(event.frame, record.frames - 1)))
    return result


CELL = 10.0
"""Side of a taxel's square in the picture's units."""

DETECTED = {"contact_map": "in-contact", "stick_map": "in-stick"}
"""Maps of a program that are outlined, and how."""

FAINT = 0.12
"""Share of the longest arrow below which none is drawn: it would be a dot."""


@dataclass(frozen=True, slots=True)
class MapScale:
    """The scale of colours and of arrows' lengths, the same in all pictures of a report.

    Attributes
    ----------
    normal : float
        Value at the ends of the colour scale, symmetric about 0.
    shear : float
        Value of an arrow as long as the pitch.
    """

    normal: float
    shear: float

    @classmethod
    def of(cls, record: SceneRecord) -> "MapScale":
        """Return the scale that holds all frames of a record."""
        normal, x, y = (record.channel(name) for name in (NORMAL, SHEAR_X, SHEAR_Y))
        top = 0.0 if normal is None else float(np.nanmax(np.abs(normal), initial=0.0))
        long = 0.0
        if x is not None and y is not None:
            long = float(np.nanmax(np.hypot(x, y), initial=0.0))
        return cls(round_up(top), round_up(long))


def frame_picture(record: SceneRecord, frame: int, scale: MapScale, label: str) -> str:
    """Return a frame as an SVG element of equal squares, seen from above.

    The solid circle is the true contact, the dashed one the true stick region. The same lines
    around cells are the program's results.
    """
    rows, cols = record.shape
    parts = [
        *_heat(record, frame, scale),
        *_detected(record, frame),
        _taxels(rows, cols),
        *_circles(record, frame),
        *_arrows(record, frame, scale),
    ]
    return picture(CELL * cols, CELL * rows, parts, label, "map")


def _heat(record: SceneRecord, frame: int, scale: MapScale) -> Iterator[str]:
    normal = record.channel(NORMAL)
    if normal is None:
        rows, cols = record.shape
        yield f'<rect class="k32" width="{CELL * cols}" height="{CELL * rows}"/>'
        return
    squares: dict[int, list[str]] = defaultdict(list)
    for (row, col), value in np.ndenumerate(normal[frame]):
        if isfinite(value):
            place = f"M{at(CELL * col)} {at(CELL * row)}h10v10h-10z"
            squares[step(record.push * value, scale.normal)].append(place)
    for kind, places in sorted(squares.items()):
        yield f'<path class="k{kind}" d="{"".join(places)}"/>'


def _detected(record: SceneRecord, frame: int) -> Iterator[str]:
    for name, style in DETECTED.items():
        values = record.maps().get(name)
        if values is not None:
            held = np.nan_to_num(values[frame]) > 0.5
            yield f'<path class="detected {style}" d="{"".join(_edges(held))}"/>'


def _edges(held: NDArray[np.bool_]) -> Iterator[str]:
    """Yield the sides of cells that are held where the neighbour is not."""
    rows, cols = held.shape
    around = np.pad(held, 1)
    for row in range(rows + 1):
        for col in range(cols + 1):
            here = around[row + 1, col + 1]
            if here != around[row, col + 1]:
                yield f"M{at(CELL * col)} {at(CELL * row)}h10"
            if here != around[row + 1, col]:
                yield f"M{at(CELL * col)} {at(CELL * row)}v10"


def _taxels(rows: int, cols: int) -> str:
    places = (
        f"M{at(CELL * (c + 0.5))} {at(CELL * (r + 0.5))}h0"
        for r in range(rows)
        for c in range(cols)
    )
    return f'<path class="taxel" d="{"".join(places)}"/>'


def _arrows(record: SceneRecord, frame: int, scale: MapScale) -> Iterator[str]:
    x, y = record.channel(SHEAR_X), record.channel(SHEAR_Y)
    if x is None or y is None:
        return
    places: list[str] = []
    for (row, col), along in np.ndenumerate(x[frame]):
        unit = record.push * CELL / scale.shear
        dx, dy = unit * along, unit * float(y[frame, row, col])
        if hypot(dx, dy) > FAINT * CELL:
            places.append(arrow(CELL * (col + 0.5), CELL * (row + 0.5), dx, dy))
    if places:
        yield f'<path class="arrow" d="{"".join(places)}"/>'


def arrow(x: float, y: float, dx: float, dy: float) -> str:
    """Return the path of an arrow whose tail is at (x, y)."""
    tip_x, tip_y = x + dx, y + dy
    head = min(2.4, 0.45 * hypot(dx, dy)) / hypot(dx, dy)
    left = (-0.87 * dx - 0.5 * dy) * head, (-0.87 * dy + 0.5 * dx) * head
    right = (-0.87 * dx + 0.5 * dy) * head, (-0.87 * dy - 0.5 * dx) * head
    return (
        f"M{_two(x)} {_two(y)}L{_two(tip_x)} {_two(tip_y)}l{_two(left[0])} {_two(left[1])}"
        f"M{_two(tip_x)} {_two(tip_y)}l{_two(right[0])} {_two(right[1])}"
    )


def _two(value: float) -> str:
    return f"{value:.2f}"


def _circles(record: SceneRecord, frame: int) -> Iterator[str]:
    if record.pitch is None:
        return
    unit = CELL / record.pitch
    rows, cols = record.shape
    x = CELL * cols / 2 + unit * record.at("x", frame)
    y = CELL * rows / 2 + unit * record.at("y", frame)
    for name, style in (("contact_radius", "outline"), ("stick_radius", "stick-outline")):
        radius = unit * record.at(name, frame)
        if isfinite(x + y) and radius > 0.3:
            circle = f'cx="{_two(x)}" cy="{_two(y)}" r="{_two(radius)}"'
            yield f'<circle class="halo" {circle}/><circle class="{style}" {circle}/>'


def filmstrip(record: SceneRecord, scale: MapScale) -> str:
    """Return the key frames as figures with captions."""
    figures = "".join(_figure(record, key, scale) for key in key_frames(record))
    style = "film six" if figures.count("<figure>") == 6 else "film"
    return f'<div class="{style}">{figures}</div>'


def colour_bar(record: SceneRecord, scale: MapScale) -> str:
    """Return the key to colours, arrows and outlines, with units."""
    factor, unit = shown_unit(record)
    top = plain(factor * scale.normal, 2)
    squares = [
        f'<rect class="k{n}" x="{10 + 3 * n}" y="18" width="3.2" height="12"/>'
        for n in range(STEPS + 1)
    ]
    parts = [
        text(10.0, 12.0, _bar_title(record, unit), "title"),
        *squares,
        text(10.0, 43.0, f"−{top}", "tick"),
        text(107.5, 43.0, "0", "tick", "middle"),
        text(205.0, 43.0, top, "tick", "end"),
    ]
    return picture(215.0, 48.0, parts, f"Colour scale from −{top} to {top} {unit}", "key")


def arrow_key(record: SceneRecord, scale: MapScale) -> str:
    """Return the arrow that stands for a round shear, as long as in the pictures."""
    factor, unit = shown_unit(record)
    length = f"{plain(factor * scale.shear, 2)} {'× ' * (factor > 1)}{unit}".strip()
    shaft = f'<path class="arrow" d="{arrow(1.0, 5.0, CELL, 0.0)}"/>'
    drawn = picture(CELL + 2.0, CELL, [shaft], f"Arrow for {length}", "glyph")
    return f"{drawn} shear{' strain' * (record.unit == 'strain')} of {escape(length)}"


def shown_unit(record: SceneRecord) -> tuple[float, str]:
    """Return the factor and the unit in which values are shown."""
    return (1e3, "10⁻³") if record.unit == "strain" else (1.0, record.unit)


def _bar_title(record: SceneRecord, unit: str) -> str:
    return f"compressive strain, {unit}" if record.unit == "strain" else f"normal axis, {unit}"


def _figure(record: SceneRecord, key: KeyFrame, scale: MapScale) -> str:
    when = f"{record.times[key.frame]:.3f} s"
    drawn = frame_picture(record, key.frame, scale, f"Frame {key.frame}: {key.title}, {when}")
    facts = "".join(f"<span>{escape(fact)}</span>" for fact in _facts(record, key.frame))
    caption = (
        f"<b>{escape(key.title)}</b> <span>{when} · frame {key.frame}</span>"
        f'<span class="facts">{facts}</span>'
    )
    return f"<figure>{drawn}<figcaption>{caption}</figcaption></figure>"


def _facts(record: SceneRecord, frame: int) -> Iterator[str]:
    load, torque = record.at("normal_force", frame), record.at("torque", frame)
    x, y = record.at("shear_x", frame), record.at("shear_y", frame)
    if isfinite(load) and load > 0:
        yield f"P {load:.2f} N"
        if isfinite(x + y) and hypot(x, y) > 5e-3:
            yield f"Q {hypot(x, y):.2f} N at {degrees(atan2(y, x)):.0f}°"
        if isfinite(torque) and abs(torque) > 5e-6:
            yield f"T {plain(1e3 * torque, 2)} mN m"
    contact, stick = record.at("contact_radius", frame), record.at("stick_radius", frame)
    if isfinite(contact + stick) and contact > 0:
        yield f"c/a {stick / contact:.2f}"


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
    result: list[Panel] = []
    if "normal_force" in truth:
        load = Curve("normal load P", truth["normal_force"], "load", filled=True)
        result.append(Panel("Normal load P", "N", (load,)))
    if "shear_x" in truth and "shear_y" in truth:
        shear = np.hypot(truth["shear_x"], truth["shear_y"])
        result.append(Panel("Shear force Q", "N", (Curve("Q", shear, "shear", filled=True),)))
    if "torque" in truth:
        torque = Curve("T", 1e3 * truth["torque"], "torque", filled=True)
        result.append(Panel("Torque T", "mN m", (torque,)))
    if "contact_radius" in truth and "stick_radius" in truth:
        radii = (
            Curve("stick radius c", 1e3 * truth["stick_radius"], "stick", filled=True),
            Curve("contact radius a", 1e3 * truth["contact_radius"], "contact"),
        )
        result.append(Panel("Radius of contact (line), stick (area)", "mm", radii))
    return tuple(result)


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
        x1, x2 = _time_edges(record, first, after, time)
        title = f"{lane.title}, true from {record.times[first]:.3f} s"
        yield box(x1, y + 17.0, x2 - x1, 8.0, f"bar {_hue(lane)}", title)
    for first, after in held(record.outputs.get(lane.flag)):
        x1, x2 = _time_edges(record, first, after, time)
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


def _time_edges(record: SceneRecord, first: int, after: int, time: Scale) -> tuple[float, float]:
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
