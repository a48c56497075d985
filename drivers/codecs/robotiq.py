"""Robotiq TSF-85: 7×4 static taxels at 60 Hz, one dynamic channel and inertia at up to 1 kHz.

Facts of the wire: the maker's public repository ``robotiq/tactile_sensors``. A packet is 0x9A, a
byte that is not used, a command, a length, and parts: a byte that names the sensor (high nibble)
and the finger (bits 2 and 3), then big-endian numbers. Since firmware 1.1.7 a packet may hold parts
of both fingers. The time of a finger is a u64 in µs. Before, packets had at most 60 bytes of data,
and the time was a u16 in ms.
"""

import struct

import numpy as np

from cnnum.drivers.codecs.stream import MORE, Decoder, Found, Neighbours, Scan, Skip, to_marker
from cnnum.drivers.codecs.wire import Asked, Form, Wire
from cnnum.errors import CodecError, SceneError

START, HEAD = b"\x9a", 4
READ, AUTOSEND, AUTOSEND_ALONE = 0x61, 0x58, 0x59
COMMANDS = (READ, AUTOSEND, AUTOSEND_ALONE)
STATIC, DYNAMIC, TIMESTAMP = 0x10, 0x20, 0x70
PARTS = {0x10: 56, 0x20: 2, 0x30: 6, 0x40: 6, 0x50: 6, 0x60: 2}
"""Number of bytes per number, by type of sensor."""

CLOCKS = {8: 1, 2: 1000}
"""Bytes of a time to the µs of its unit: since firmware 1.1.7, and before."""

Parts = list[tuple[int, int, bytes]]
"""Type, finger and bytes of each part of a packet."""

INERTIA = {0x30: "acceleration", 0x40: "turning", 0x50: "field"}
SHAPE = (7, 4)
FINGERS = 4

FULL = 4000.0
"""Counts of a strong load."""


def tsf85(options: Asked) -> Wire:
    """Return the protocol; `address` 1 to 4 is the finger.

    Raises
    ------
    SceneError
        If there is no such finger, or the rate is below 4 Hz or above 1 kHz.
    """
    finger = options.address - 1
    if not 0 <= finger < FINGERS:
        raise SceneError(f"'address' must be a finger from 1 to {FINGERS}, got {options.address}.")
    if options.rate and not 4 <= options.rate <= 1000:
        raise SceneError(f"'rate' must be 4 to 1000 Hz for the TSF-85, got {options.rate:g}.")
    period = round(1000 / options.rate) if options.rate else 1
    return Wire(
        "Robotiq's TSF-85",
        115_200,
        lambda: Decoder(Tsf85(finger), Neighbours(FULL)),
        lambda scan: encode(scan, finger),
        greeting=command(AUTOSEND, bytes([period])),
        farewell=command(AUTOSEND, b"\0"),
        form=Form(SHAPE, ("normal",), "count", 0.0, FULL),
        verified=False,
    )


def command(code: int, data: bytes) -> bytes:
    """Return a command's packet."""
    return START + bytes([0, code, len(data)]) + data


class Tsf85:
    """The format; a scan is complete with the static taxels of its finger.

    Between two scans, the dynamic channel and the inertia continue: the scan carries their latest
    numbers, and the largest magnitude of the dynamic channel since the previous scan.

    There is no checksum, so a packet is accepted if its parts fill it and another one follows. If
    none follows, its taxels must continue the previous ones, and nothing else of it is kept.

    Parameters
    ----------
    finger : int
        From 0.
    """

    def __init__(self, finger: int = 0) -> None:
        self._finger = finger
        self._extras: dict[str, float] = {}
        self._peak = 0.0
        self._clock = 8
        self._time: int | None = None

    def look(self, data: bytearray, *, locked: bool, ended: bool) -> Found | Skip | None:
        """Return the scan, gap or wait at the front of `data`."""
        before = to_marker(data, START, ended=ended)
        if before is not None:
            return before
        if len(data) < HEAD:
            return MORE
        if data[2] not in COMMANDS or not data[3]:
            return Skip(1)
        size = HEAD + data[3]
        if len(data) < size:
            return MORE
        parts = self._parts(bytes(data[HEAD:size]))
        after = bytes(data[size : size + HEAD + 1])
        if parts is None:
            return Skip(1, bad=locked)
        if not begins(after):
            return Found(size, self._aside(parts), alone=True)
        if len(after) <= HEAD and not ended:
            return MORE
        return Found(size, self._scan(parts))

    def _parts(self, data: bytes) -> "Parts | None":
        """Return the parts, with the time that the firmware sent last, or with the other one."""
        for clock in sorted(CLOCKS, key=lambda width: width != self._clock):
            parts = parts_of(data, clock)
            if parts is not None:
                return parts
        return None

    def _aside(self, parts: "Parts") -> Scan | None:
        """Return the scan, and keep nothing of it."""
        kept = self._extras, self._peak, self._clock, self._time
        self._extras = dict(self._extras)
        try:
            return self._scan(parts)
        finally:
            self._extras, self._peak, self._clock, self._time = kept

    def _scan(self, parts: "Parts") -> Scan | None:
        values = None
        for kind, finger, data in parts:
            if kind == TIMESTAMP:
                self._keep_time(finger, data)
            elif finger == self._finger:
                if kind == STATIC:
                    values = np.frombuffer(data, ">u2").astype(float).reshape(*SHAPE, 1)
                else:
                    self._note(kind, data)
        if values is None:
            return None
        peak, self._peak = self._peak, 0.0
        extras = {**self._extras, "device_dynamic_peak": peak}
        unit = CLOCKS[self._clock]
        time = None if self._time is None else unit * self._time
        wrap = unit << 8 * self._clock
        return Scan(values, ("normal",), "count", time_us=time, time_wrap=wrap, extras=extras)

    def _keep_time(self, finger: int, data: bytes) -> None:
        """Take in a time: the finger's own, or that of an older firmware, which has but one."""
        if len(data) == 2 or finger == self._finger:
            self._clock, self._time = len(data), int.from_bytes(data, "big")

    def _note(self, kind: int, data: bytes) -> None:
        numbers = struct.unpack(f">{len(data) // 2}h", data)
        if kind == DYNAMIC:
            self._extras["device_dynamic"] = float(numbers[0])
            self._peak = max(self._peak, abs(float(numbers[0])))
        elif kind in INERTIA:
            named = zip("xyz", numbers, strict=True)
            self._extras |= {f"device_{INERTIA[kind]}_{axis}": float(n) for axis, n in named}
        else:
            self._extras["device_temperature"] = float(numbers[0])


def begins(data: bytes) -> bool:
    """Return whether the bytes available can be the beginning of a packet."""
    known = {0: START, 2: COMMANDS, 3: range(1, 256)}
    good = all(data[at] in values for at, values in known.items() if at < len(data))
    return good and (len(data) <= HEAD or data[HEAD] & 0xF0 in (*PARTS, TIMESTAMP))


def parts_of(data: bytes, clock: int) -> Parts | None:
    """Return type, finger and bytes of each part, or None if they do not fill the packet.

    Parameters
    ----------
    data : bytes
    clock : int
        Bytes of a time.
    """
    parts: Parts = []
    at = 0
    while at < len(data):
        kind, finger = data[at] & 0xF0, data[at] >> 2 & 3
        size = clock if kind == TIMESTAMP else PARTS.get(kind)
        if size is None or at + 1 + size > len(data):
            return None
        parts.append((kind, finger, data[at + 1 : at + 1 + size]))
        at += 1 + size
    return parts


def encode(scan: Scan, finger: int = 0) -> bytes:
    """Return the packet of a scan, as firmware 1.1.8 sends it: dynamic channel, time, taxels.

    Raises
    ------
    CodecError
        If the scan does not have 7×4 taxels of one axis.
    """
    if scan.values.shape != (*SHAPE, 1):
        raise CodecError(f"The TSF-85 has 7×4 taxels of one axis, got {scan.values.shape}.")
    counts = np.clip(np.rint(np.asarray(scan.values, np.float64)), 0, 65_535).astype(">u2")
    dynamic = int(scan.extras.get("device_dynamic", 0.0)) & 0xFFFF
    own = finger << 2
    data = bytes([STATIC | own]) + counts.tobytes()
    data += bytes([DYNAMIC | own]) + dynamic.to_bytes(2, "big")
    data += bytes([TIMESTAMP | own]) + (scan.time_us or 0).to_bytes(8, "big")
    return command(AUTOSEND, data)
