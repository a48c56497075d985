"""The key frames side by side, with one scale for all of them."""

from collections.abc import Iterator
from html import escape
from math import atan2, degrees, hypot, isfinite

from cnnum.report.key_frames import KeyFrame, key_frames
from cnnum.report.pictures.frame_picture import CELL, MapScale, arrow, frame_picture
from cnnum.report.pictures.svg import picture, plain, text
from cnnum.report.record import SceneRecord
from cnnum.sharing.colours import STEPS


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
