"""Friction and roughness of a surface sliding over taxels, frame by frame (dissertation 6.5)."""

from collections.abc import Mapping
from math import ceil
from typing import Literal, get_args

import numpy as np

from cnnum.errors import ProgramError, name_error
from cnnum.programs import program
from cnnum.programs.fields import Field, length, maximum, sqrt, square, where
from cnnum.programs.machine import FrameFields
from cnnum.programs.parameters import refuse_outside
from cnnum.programs.transients import transient
from cnnum.templates.tactile.localize import DEPTH, PITCH, SHARE, near_the_end, unmix
from cnnum.templates.tactile.shared.loads import PUSH, loads_of

SAMPLES, APART = 128, 0.015
"""T of the dissertation: 128 samples, 15 ms apart; a frame is one where the time of it lies within.
Slower arrays give one a frame, and fewer."""

Rubbed = Literal["load", "strain", "stress"]
"""What the taxels read: a load as it is, or the strain or stress below a bump."""

CLEAR = 10.0
"""Normal load, in standard deviations of the noise, from which a taxel is rubbed: its ratio of
shear to normal load is then known to a tenth."""


MOVES = 1.5
"""Change of the load's pattern from a sample to the next, over its noise, from which a surface
moves over the taxels: noise of sixteen taxels alone reaches 1.5 in a sample of 500, of 64 never."""

STEADY, END = 0.05, 8
"""Share by which the ratio in the first or last eighth of a window differs from the whole's where
not all of it slides, as before friction's limit or in a release. What passes is 0.6 % of a mean."""

NOTHING = 1e-30

TIE = 1e-3
"""Frames that a sample may be early: every engine rounds its time."""


@program
def texture(
    frame: FrameFields,
    *,
    push: float = PUSH,
    window: int = SAMPLES,
    taxels: Rubbed = "load",
    bump_pitch: float = PITCH,
    bump_depth: float = DEPTH,
    ratio: float = 1.0,
) -> Mapping[str, Field]:
    """Measure friction and roughness of the surface on each taxel, over the last frames.

    Every taxel keeps its last frames in local memories, over which (6.3) and (6.4) are computed.
    The mean comes first, so that a small scatter is not the difference of large sums.

    Parameters
    ----------
    frame : FrameFields
        Shear and normal signals of each taxel, each preferably under a bump: below a flat cover, a
        load directly above a taxel causes no shear.
    push : float
        −1 for strain and stress, +1 for signals that rise under a push.
    window : int
        T, the number of samples that count: one every 15 ms on average, or all frames of that time
        for slower arrays. Each sample takes two memories per taxel.
    taxels : "load", "strain" or "stress"
        "load" for signals with equal gain for shear and normal forces. Strain and stress below
        bumps have different gains and also respond to neighbouring bumps: they are converted to the
        load of each bump, as in `localize`, by a finite element model of the cover.
    bump_pitch, bump_depth : float
        As in `localize`.
    ratio : float
        Ratio of the shear signal to the normal signal for an equal load, strain or stress: 1/β_ns.

    Returns
    -------
    mapping
        `texture_friction` (map: mean of |T|/|S_n|, (6.3); 0 where it is not known, for instance
        because the taxel was at an end of its range within the window), `texture_roughness` (map:
        100 times the standard deviation over the mean, (6.4)), `texture_frames` (map: number of
        samples in this touch, at most T + 1), `friction`, `roughness` (means over the taxels where
        they are known), `texture_known` (flag: they are known somewhere), `texture_rubs` (flag: the
        pattern of the normal load has moved in all frames of the window, and both ends of the
        window have the same ratio, which is then that of friction; it is off for a surface that
        sticks, or that is too smooth for its motion to show). Afterwards, friction and roughness
        keep the values of the last such window until the next touch.

    Raises
    ------
    ProgramError
        If the window is below 1 frame or the ratio not positive.
    UnknownNameError
        If `taxels` is unknown.
    PhysicsError
        If the bumps are too close to be separated, or the tables have no such depth.
    """
    if taxels not in get_args(Rubbed):
        raise name_error("kind of taxels", taxels, get_args(Rubbed))
    if window < 1 or not ratio > 0.0:
        raise ProgramError(
            f"'window' must be 1 frame or more and 'ratio' above 0, got {window} and {ratio}."
        )
    refuse_outside(window=(window, 1, 10_000), ratio=(ratio, 1e-30, 1e30))
    apart = max(1.0, APART * frame.rate)
    window = max(1, round(window * APART * frame.rate / apart))
    loads = frame.once(loads_of, push=push)
    x, y, normal = loads.shear_x / ratio, loads.shear_y / ratio, loads.normal
    least, noise = CLEAR * sqrt(loads.normal_noise), loads.normal_noise
    if taxels != "load":
        alone = unmix(taxels, bump_pitch, bump_depth)
        x, y, normal = transient(alone, input=[x, y, normal]).outputs
        gain = float(np.sqrt((alone.B[2, 2] ** 2).sum()))
        least, noise = maximum(SHARE * normal.max(), gain * least), gain * gain * noise
    at_end = frame.at_end
    if at_end is not None and taxels != "load":  # its neighbours' loads cannot be taken off
        at_end = near_the_end(at_end)
    rubbed = loads.contact & (normal > least)
    rubbed = rubbed if at_end is None else rubbed & ~at_end
    now = where(rubbed, length([x, y]) / normal, 0.0)
    tick = _tick(frame, apart)
    values, marks = _last(frame, now, rubbed, loads.contact, window, tick)
    count = _sum(marks)
    mean = _sum(values) / maximum(count, 1.0)
    gaps = [mark * square(value - mean) for value, mark in zip(values, marks, strict=True)]
    known = (count >= 2.0) & (mean > 0.0)
    if at_end is not None:
        known = known & _whole(frame, at_end, window * apart)
    share = where(known, 1.0, 0.0)
    deviation = sqrt(_sum(gaps) / maximum(count - 1.0, 1.0))
    moves = _moves(frame, normal, rubbed, noise, window, tick)
    rubs = known.any() & moves & _steady(values, marks, share)
    begins = loads.contact & ~frame.previous(loads.contact)
    holds = frame.memory("a whole window is held", scalar=True, logic=True).latch(rubs, ~begins)
    friction, roughness = (
        _held(frame, name, value, rubs, holds)
        for name, value in (
            ("friction", where(known, mean, 0.0)),
            ("roughness", where(known, 100.0 * deviation / where(known, mean, 1.0), 0.0)),
        )
    )
    known = friction > 0.0
    number = maximum(known.count(), 1.0)
    return {
        "texture_friction": friction,
        "texture_roughness": roughness,
        "texture_frames": count,
        "friction": friction.sum() / number,
        "roughness": roughness.sum() / number,
        "texture_known": known.any(),
        "texture_rubs": rubs,
    }


def _held(frame: FrameFields, name: str, value: Field, rubs: Field, holds: Field) -> Field:
    """Return a map, or after the last window in which the surface slid that window's own."""
    last = frame.memory(f"{name} while it slid")
    last.store(where(rubs, value, last.value))
    return where(holds & ~rubs, last.value, value)


def _whole(frame: FrameFields, at_end: Field, frames: float) -> Field:
    """Return the taxels that were within their range in the whole window.

    Samples beyond it are missing where the load is highest, so that the others are a choice.
    """
    left = frame.memory("frames until its window is whole")
    count = where(at_end, float(ceil(frames) + 1), maximum(left.value - 1.0, 0.0))
    left.store(count)
    return count < 0.5


def _steady(values: list[Field], marks: list[Field], share: Field) -> Field:
    """Return a flag: both ends of the window have its ratio, over the taxels that know theirs."""
    end = max(1, len(values) // END)
    whole, new, old = (
        (share * _sum(values[part])).sum() / maximum((share * _sum(marks[part])).sum(), 1.0)
        for part in (slice(None), slice(0, end), slice(-end, None))
    )
    return maximum(abs(new - whole), abs(old - whole)) < STEADY * whole


def _tick(frame: FrameFields, apart: float) -> Field | None:
    """Return a flag of the frames that are samples; None where all are."""
    if apart < 1.0 + TIE:
        return None
    since = frame.memory("frames since the last sample", scalar=True)
    now = since.value + 1.0
    tick = frame.first | (now > apart - TIE)
    since.store(where(frame.first, 0.0, now - where(tick, apart, 0.0)))
    return tick


def _sampled(frame: FrameFields, value: Field, tick: Field | None) -> Field:
    """Return a value at the last sample before this frame; 0 before the stream began."""
    memory = frame.memory("sample before", scalar=value.scalar)
    memory.store(value if tick is None else where(tick, value, memory.value))
    return memory.value


def _moves(
    frame: FrameFields,
    normal: Field,
    rubbed: Field,
    noise: Field,
    window: int,
    tick: Field | None,
) -> Field:
    """Return a flag: the pattern of the load has changed by more than its noise all the time.

    A load that grows or falls keeps its pattern, and is scaled to this frame's.
    """
    share = where(rubbed, normal, 0.0)
    whole = share.sum()
    before, then = _sampled(frame, share, tick), _sampled(frame, whole, tick)
    change = share - before * (whole / maximum(then, NOTHING))
    both = rubbed & (before > 0.0)  # a taxel that has just been touched is no movement
    power = where(both, square(change), 0.0).sum()
    most = (2.0 * MOVES**2) * noise * where(both, 1.0, 0.0).sum()
    lasts, sliding = (
        frame.memory("samples that it moves", scalar=True),
        (power > most) & (then > 0.0),
    )
    count = where(sliding, lasts.value + 1.0, 0.0)
    lasts.store(count if tick is None else where(tick, count, lasts.value))
    return lasts.value > float(window) - 0.5 if tick is not None else count > float(window)


def _last(
    frame: FrameFields, value: Field, mark: Field, touched: Field, window: int, tick: Field | None
) -> tuple[list[Field], list[Field]]:
    """Return a value and its mark on this frame and this touch's samples before, newest first."""
    values, marks = [value], [where(mark, 1.0, 0.0)]
    for _ in range(window):
        values.append(where(touched, _sampled(frame, values[-1], tick), 0.0))
        marks.append(where(touched, _sampled(frame, marks[-1], tick), 0.0))
    return values, marks


def _sum(values: list[Field]) -> Field:
    """Return the sum, by halves, which rounds less."""
    if len(values) == 1:
        return values[0]
    half = len(values) // 2
    return _sum(values[:half]) + _sum(values[half:])
