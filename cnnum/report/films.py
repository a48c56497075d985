"""The film of a scene: its load and shear frame by frame, with the program's flags below."""

from collections.abc import Iterator
from dataclasses import replace
from importlib import import_module
from math import hypot
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cnnum.arrays import Floats
from cnnum.errors import ReportError
from cnnum.live.feeds import ENOUGH, FIRST
from cnnum.pictures import film_kind, pillow, write_film
from cnnum.report.charts import plain, round_up
from cnnum.report.pictures import DETECTED, FAINT, MapScale
from cnnum.report.record import LANES, NORMAL, SHEAR_X, SHEAR_Y, SceneRecord
from cnnum.safety.files import written
from cnnum.sharing import LIGHT, STEPS, scale

RATE = 25.0
"""Pictures a second, at most; a quicker array shows the newest frame of each picture's time."""

WIDTH, LINE, MARGIN = 480, 20, 8
"""px: least width of a picture, and height and margin of a line of text."""

INK, PAPER, SOFT = (22, 25, 29), (251, 251, 249), (89, 98, 107)


def write_scene_film(path: Path, record: SceneRecord, *, force: bool = False) -> None:
    """Write a film of a scene's run, as long as the run: .gif, .mp4 or .webm.

    The colour of a taxel is its normal load (orange: a pull), or the first channel of an array
    without one, and an arrow its shear, both less the rest of the first frames, as on the live
    page. Lines surround what the program holds for contact and stick.

    Raises
    ------
    UnknownNameError, ReportError
        If the suffix is another one; if there is no frame or such a file, or it cannot be written.
    MissingExtraError
        If Pillow, or PyAV for .mp4 and .webm, is not installed.
    """
    suffix = film_kind(path)
    if not record.frames:
        raise ReportError(f"'{path}' would be a film of no frame: run the scene for longer.")
    rate = min(RATE, record.rate or RATE)
    begin, end = float(record.times[0]), float(record.times[-1])
    moments = begin + np.arange(int((end - begin) * rate) + 1) / rate
    shown = np.searchsorted(record.times, moments + 1e-9, side="right") - 1
    first = max(int((record.times < begin + FIRST).sum()), ENOUGH)
    rested = record.values - median(record.values[:first])
    painter = _Painter(replace(record, values=rested))
    with written(path, force=force) as file:
        write_film(file, suffix, (painter.picture(n) for n in shown.tolist()), rate)


def median(values: Floats) -> Floats:
    """Return the medians over frames, 0 where no frame has a number."""
    known = np.isfinite(values).any(axis=0)
    return np.where(known, np.nanmedian(np.where(known, values, 0.0), axis=0), 0.0)


class _Painter:
    """Draws the frames of a record, all on one scale."""

    def __init__(self, record: SceneRecord) -> None:
        self._record, self._scale = record, MapScale.of(record)
        self._image, self._draw = pillow("films of a scene"), import_module("PIL.ImageDraw")
        self._font = import_module("PIL.ImageFont").load_default(13)
        rows, cols = record.shape
        self._side = max(WIDTH // cols, 4)
        self._size = max(self._side * cols, WIDTH), self._side * rows + 2 * LINE + MARGIN
        name = NORMAL if NORMAL in record.channels else record.channels[0]
        heat = record.channel(name)
        assert heat is not None
        self._heat: Floats = heat * (record.push if name == NORMAL else 1)
        self._top = round_up(float(np.nanmax(np.abs(heat), initial=0.0))) or 1.0
        self._colours = np.array([_rgb(colour) for colour in scale(LIGHT)], np.uint8)
        self._key = self._described(name)

    def _described(self, name: str) -> str:
        unit = self._record.unit
        key = f"{name.replace('_', ' ')}: darkest at {plain(self._top, 2)} {unit}".strip()
        if self._scale.shear:
            key += (
                f"; shear: an arrow of one taxel is {plain(self._scale.shear, 2)} {unit}".rstrip()
            )
        return key

    def picture(self, frame: int) -> NDArray[np.uint8]:
        """Return the picture of a frame, (height, width, 3)."""
        record, side = self._record, self._side
        values = self._heat[frame]
        share = np.clip(np.nan_to_num(values) / self._top, -1.0, 1.0)
        cells = self._colours[np.rint((share + 1.0) * STEPS / 2).astype(int)]
        cells[~np.isfinite(values)] = SOFT
        sheet = self._image.new("RGB", self._size, PAPER)
        enlarged = cells.repeat(side, axis=0).repeat(side, axis=1)
        sheet.paste(self._image.fromarray(enlarged), (0, 0))
        pen = self._draw.Draw(sheet)
        self._outlines(pen, frame)
        self._arrows(pen, frame)
        below = side * values.shape[0] + MARGIN // 2
        words = [f"{record.times[frame]:.3f} s", *self._flags(frame)]
        pen.text((MARGIN, below), "   ".join(words), INK, self._font)
        pen.text((MARGIN, below + LINE), self._key, SOFT, self._font)
        return np.asarray(sheet)

    def _flags(self, frame: int) -> Iterator[str]:
        if not np.isfinite(self._record.values[frame]).any():
            yield "bad frame"
        for lane in LANES:
            flags = self._record.outputs.get(lane.flag)
            if flags is not None and flags.ndim == 1 and flags[frame] > 0.0:
                yield lane.title

    def _outlines(self, pen: Any, frame: int) -> None:
        side = self._side
        for width, name in enumerate(reversed(DETECTED), 2):
            values = self._record.maps().get(name)
            if values is None:
                continue
            around = np.pad(np.nan_to_num(values[frame]) > 0.5, 1)
            for row, col in np.argwhere(around[1:, 1:] != around[:-1, 1:]).tolist():
                pen.line((col * side, row * side, (col + 1) * side, row * side), INK, width)
            for row, col in np.argwhere(around[1:, 1:] != around[1:, :-1]).tolist():
                pen.line((col * side, row * side, col * side, (row + 1) * side), INK, width)

    def _arrows(self, pen: Any, frame: int) -> None:
        record, side = self._record, self._side
        x, y = record.channel(SHEAR_X), record.channel(SHEAR_Y)
        if x is None or y is None or not self._scale.shear:
            return
        unit = record.push * side / self._scale.shear
        for row, col in np.ndindex(*record.shape):
            dx, dy = unit * float(x[frame, row, col]), unit * float(y[frame, row, col])
            length = hypot(dx, dy)
            if not length > FAINT * side:
                continue
            tail = side * (col + 0.5), side * (row + 0.5)
            tip, head = (tail[0] + dx, tail[1] + dy), min(0.24 * side, 0.45 * length) / length
            barbs = [
                (tip[0] + head * (-0.87 * dx - s * dy), tip[1] + head * (-0.87 * dy + s * dx))
                for s in (0.5, -0.5)
            ]
            pen.line((*tail, *tip), INK, 2)
            pen.line((*barbs[0], *tip, *barbs[1]), INK, 2)


def _rgb(colour: str) -> tuple[int, ...]:
    return tuple(bytes.fromhex(colour[1:]))
