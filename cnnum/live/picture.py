"""A picture: one frame with its results, as the few bytes that the page draws.

Little-endian: number u32, flags u32, time f64 (s), wait f32 (ms), load f32. Then shear x, shear y
and normal of all taxels (f32). Then a mark a taxel (u8): bit 0 contact, bit 1 bump, bit 2 edge.
"""

import struct
import time
from collections.abc import Callable

import numpy as np

from cnnum.arrays import Floats
from cnnum.frame import FORCE_AXES, Frame, Quality
from cnnum.scenes.pipeline import FrameResult

HEAD = struct.Struct("<IIdff")

CONTACT, INCIPIENT, GROSS, TWIST, BAD, DROPPED, SATURATED = (1 << n for n in range(7))

MARKS = {"contact_map": 1, "bump_contact": 2, "edges": 4}
"""Fields of a program that mark taxels, by the bit of their mark."""

FLAGS = {"contact": CONTACT, "gross_slip": GROSS, "twist": TWIST}
"""Outputs of a program that are a flag, by their bit."""

Read = Callable[[Frame], Floats]


def planes(values: Floats, channels: tuple[str, ...]) -> Floats:
    """Return shear x, shear y and normal, (3, rows, cols); a missing axis is 0.

    An array with no axis of these names shows its first channel as the normal.
    """
    found = np.zeros((3, *values.shape[:2]))
    for at, name in enumerate(FORCE_AXES):
        if name in channels:
            found[at] = values[..., channels.index(name)]
    if not set(FORCE_AXES) & set(channels):
        found[2] = values[..., 0]
    return np.nan_to_num(found, posinf=0.0, neginf=0.0)


def encoded(moment: FrameResult, loads: Floats, slip: str | None = None) -> bytes:
    """Return the bytes of a picture.

    Parameters
    ----------
    moment : FrameResult
    loads : (3, rows, cols) float
        As `planes` returns them.
    slip : str, optional
        Phase of the slip that goes on: "incipient" or "gross".
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
    wait = (time.monotonic_ns() - frame.monotonic_ns) * 1e-6 if frame.monotonic_ns else 0.0
    said = outputs.get("load_normal")
    load = float(np.abs(loads[2]).sum()) if said is None else float(said)
    head = HEAD.pack(moment.number & 0xFFFFFFFF, flags, frame.time, wait, load)
    return head + loads.astype("<f4").tobytes() + marks.tobytes()


def _holds(value: Floats | None) -> bool:
    return value is not None and bool(np.asarray(value).any())
