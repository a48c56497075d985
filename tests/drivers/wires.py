"""A scan for each protocol, drawn at random, and streams of them with noise between."""

import random

import numpy as np

from cnnum.drivers.codecs.stream import Scan
from cnnum.drivers.codecs.wire import Asked, Wire, wire
from cnnum.frame import FORCE_AXES

PTS = (*FORCE_AXES, "dx", "dy", "dz")
FLUX = ("temperature", "flux_x", "flux_y", "flux_z")

# name: shape, channels, unit, range of the numbers drawn
FORMS = {
    "open": ((3, 4), FORCE_AXES, "V", "f4"),
    "pts2": ((3, 6), PTS, "N", "f4"),
    "xela": ((8, 8), FORCE_AXES, "count", "u2"),
    "paxini": ((5, 6), FORCE_AXES, "N", "tenths"),
    "paxini-board": ((5, 6), FORCE_AXES, "N", "tenths"),
    "robotiq-tsf85": ((7, 4), ("normal",), "count", "u2"),
    "flexitac": ((12, 32), ("normal",), "count", "u1"),
    "3d-vitac": ((16, 16), ("normal",), "count", "u1"),
    "anyskin": ((1, 5), FLUX, "uT", "f4"),
    "anyskin-text": ((1, 5), FLUX, "uT", "f4"),
    "m0404s": ((4, 4), ("normal",), "count", "u2"),
    "m1616": ((16, 16), ("normal",), "count", "u2"),
    "velostat": ((16, 16), ("normal",), "count", "u1"),
}
UNCHECKED = {"flexitac", "m1616", "velostat", "anyskin", "robotiq-tsf85"}
"""Only the bytes after it show that a packet of these is whole."""

TEXT = {"3d-vitac", "anyskin-text", "xela"}
ASKED = {"paxini", "velostat"}


def spoken(name: str, shape: tuple[int, int] | None = None) -> Wire:
    return wire(name, Asked(shape=shape or FORMS[name][0]))


def drawn(name: str, number: int, seed: int = 0, small: tuple[int, int] | None = None) -> Scan:
    shape, channels, unit, kind = FORMS[name]
    shape = small or shape
    rng = np.random.default_rng([seed, number])
    whole = (*shape, len(channels))
    if kind == "f4":
        values = rng.normal(0.0, 50.0, whole).astype(np.float32).astype(float)
    elif kind == "tenths":
        values = 0.1 * np.stack(
            [rng.integers(low, high, shape) for low, high in ((-128, 128), (-128, 128), (0, 256))],
            axis=-1,
        )
    else:
        values = rng.integers(0, 256 if kind == "u1" else 65_536, whole).astype(float)
    return Scan(values, channels, unit, sequence=number, time_us=2000 * number)


def same(sent: Scan, got: Scan) -> bool:
    """Text and tenths are rounded on the way: nine digits are written."""
    close = np.allclose(sent.values, got.values, rtol=1e-8, atol=1e-12)
    return bool(close) and (sent.channels, sent.unit) == (got.channels, got.unit)


def noise(rng: random.Random, name: str) -> bytes:
    """Bytes that belong to nothing; in a protocol of lines they end with one."""
    data = rng.randbytes(rng.randrange(1, 40))
    if name in TEXT:
        return data.replace(b"\n", b"#").replace(b"\r", b"#") + b"\n"
    return data


def chunks(data: bytes, size: int) -> list[bytes]:
    return [data[at : at + size] for at in range(0, len(data), size)]
