"""The array at a port: by its USB numbers, and by listening to its packets."""

import time
from collections.abc import Sequence
from dataclasses import dataclass

from cnnum.drivers.codecs.scan import Scan
from cnnum.drivers.codecs.wire import Asked, Decoding, Wire, protocol_names, wire
from cnnum.drivers.serial_port import PortInfo, SerialPort
from cnnum.errors import PortError

KNOWN_USB = {
    "1a86:55d3": "PaXini's converter has this USB bridge: try the protocol 'paxini'",
    "16d0:14cc": "Robotiq's TSF-85 has these USB numbers: try the protocol 'robotiq-tsf85'",
    "04b4:f232": "older hubs of Robotiq's TSF-85 have these USB numbers: try 'robotiq-tsf85'",
}
"""USB numbers to a hint."""

LISTEN = 0.4
"""s that is listened at each rate."""

ENOUGH = 3
"""Scans that must come before a protocol is believed."""

SHARE = 0.8
"""Of the bytes that must belong to them."""


@dataclass(frozen=True, slots=True)
class Guess:
    """The array that seems to be at a port.

    Attributes
    ----------
    port : PortInfo
    protocol : str
        Empty where nothing is known.
    baud : int
        Bits a second at which it was heard; 0 where nothing was.
    said : str
        In words.
    """

    port: PortInfo
    protocol: str
    baud: int
    said: str


@dataclass(slots=True)
class _Ear:
    """A protocol that listens."""

    name: str
    decoder: Decoding
    scans: list[Scan]

    def hear(self, data: bytes) -> None:
        self.scans += self.decoder.feed(data)

    def share(self, heard: int) -> float:
        """Return the share of the bytes that belongs to good packets."""
        if len(self.scans) < ENOUGH:
            return 0.0
        return 1.0 - self.decoder.discarded / max(heard, 1)


def guess(port: PortInfo, *, seconds: float = LISTEN) -> Guess:
    """Return the array that seems to be at a port; nothing is written to it.

    An array that must be asked for its scans, or made to send, stays silent: only its USB numbers
    give a hint of it.
    """
    hint = KNOWN_USB.get(port.usb, "")
    wires = {name: wire(name, Asked()) for name in protocol_names()}
    heard_any = 0
    for baud in sorted({known.baud for known in wires.values()}, reverse=True):
        try:
            heard, ears = _listen(port.path, baud, wires, seconds)
        except PortError as error:
            return Guess(port, "", 0, str(error))
        heard_any = max(heard_any, heard)
        best = max(ears, key=lambda ear: ear.share(heard))
        if best.share(heard) >= SHARE:
            return Guess(port, best.name, baud, f"sends {best.scans[-1].kind}")
    if heard_any:
        return Guess(
            port, "", 0, f"sends {heard_any} bytes that are no known scans. {hint}".strip()
        )
    return Guess(port, "", 0, hint or "silent: it may wait to be asked, or be no array")


def _listen(
    path: str, baud: int, wires: dict[str, Wire], seconds: float
) -> tuple[int, Sequence[_Ear]]:
    ears = [_Ear(name, known.decoder(), []) for name, known in wires.items() if not known.request]
    heard, end = 0, time.monotonic() + seconds
    with SerialPort(path, baud) as port:
        while time.monotonic() < end:
            data = port.read()
            heard += len(data)
            for ear in ears:
                ear.hear(data)
    return heard, ears


def guesses(paths: Sequence[str], ports: Sequence[PortInfo]) -> list[Guess]:
    """Return a guess for every port, those of `paths` first."""
    named = [PortInfo(path, "as given") for path in paths]
    return [guess(port) for port in (*named, *ports)]
