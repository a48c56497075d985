"""Codecs under damage: any bytes at all, then good packets, which all arrive.

`make arrays` tries each protocol a million times; `CNNUM_CODEC_INPUTS` is that number.
"""

import importlib.util
import os
import random
import re
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cnnum.drivers.codecs.stream import Scan
from cnnum.drivers.codecs.wire import protocol_names

spec = importlib.util.spec_from_file_location(
    "wires", Path(__file__).parents[1] / "drivers" / "wires.py"
)
assert spec is not None
assert spec.loader is not None
wires: Any = importlib.util.module_from_spec(spec)
spec.loader.exec_module(wires)

INPUTS = int(os.environ.get("CNNUM_CODEC_INPUTS", "5000"))

SMALL = {"3d-vitac": (4, 4), "xela": (4, 4)}
"""Shapes of the protocols that are text: damage hits their structure more often."""

GOOD = 3
"""Packets after the damage: the last of them has none after it that would confirm it."""


def flip(data: bytes, rng: random.Random) -> bytes:
    at = rng.randrange(len(data))
    return data[:at] + bytes([data[at] ^ 1 << rng.randrange(8)]) + data[at + 1 :]


def cut(data: bytes, rng: random.Random) -> bytes:
    return data[: rng.randrange(len(data))]


def torn(data: bytes, rng: random.Random) -> bytes:
    return data[rng.randrange(len(data)) :]


def hole(data: bytes, rng: random.Random) -> bytes:
    first, last = sorted(rng.randrange(len(data)) for _ in range(2))
    return data[:first] + data[last:]


def stuffed(data: bytes, rng: random.Random) -> bytes:
    at = rng.randrange(len(data))
    return data[:at] + rng.randbytes(rng.randrange(1, 9)) + data[at:]


def swapped(data: bytes, rng: random.Random) -> bytes:
    at = rng.randrange(len(data))
    return data[at:] + data[:at]


def anything(data: bytes, rng: random.Random) -> bytes:
    return rng.randbytes(rng.randrange(len(data)))


DAMAGES: list[Callable[[bytes, random.Random], bytes]] = [
    flip, cut, torn, hole, stuffed, swapped, anything,
]  # fmt: skip


class Bench:
    """A protocol with a store of good packets."""

    def __init__(self, name: str) -> None:
        small = SMALL.get(name)
        self.name, self.known = name, wires.spoken(name, small)
        self.sent = [wires.drawn(name, n, seed=7, small=small) for n in range(8)]
        self.data = [self.known.encode(scan) for scan in self.sent]
        self.numbers = [self._alone(n) for n in range(len(self.data))]

    def _alone(self, number: int) -> bytes:
        """Return the numbers of a packet that is read by itself, which are those sent."""
        decoder = self.known.decoder()
        (scan,) = decoder.feed(self.data[number]) + decoder.flush()
        assert wires.same(self.sent[number], scan)
        return bytes(scan.values.tobytes())

    def survives(self, rng: random.Random) -> bool:
        """Return whether the good packets after one damaged one all arrive."""
        decoder, first = self.known.decoder(), rng.randrange(len(self.data) - GOOD)
        damaged = rng.choice(DAMAGES)(self.data[rng.randrange(len(self.data))], rng)
        if self.name in wires.TEXT:  # a line that runs into the next spoils it
            damaged += b"\n\n"
        good = range(first, first + GOOD)
        got = decoder.feed(damaged)
        if self.known.request:  # an answer to a request comes alone
            decoder.flush()
            got = [scan for n in good for scan in decoder.feed(self.data[n])]
        else:
            stream = b"".join(self.data[n] for n in good)
            at = rng.randrange(len(stream))
            got += decoder.feed(stream[:at]) + decoder.feed(stream[at:]) + decoder.flush()
        came = [scan.values.tobytes() for scan in got[-GOOD - 1 :]]
        return all(self.numbers[n] in came for n in good) and self._counted(decoder)

    @staticmethod
    def _counted(decoder: Any) -> bool:
        return bool(decoder.pending == 0) if hasattr(decoder, "pending") else True


@pytest.mark.parametrize("name", protocol_names())
def test_damaged_bytes_raise_nothing_and_hide_no_packet(faults, name: str) -> None:
    """Damaged bytes in any protocol raise nothing, and every good packet after them arrives."""
    bench, rng = Bench(name), random.Random(f"bytes of {name}")
    for trial in faults.trials(short=60, full=INPUTS):
        try:
            if not bench.survives(rng):
                faults.lose(f"{name} {trial}: a packet after the damage did not arrive")
        except Exception as error:
            faults.lose(f"{name} {trial}: {type(error).__name__}: {error}")


PACKETS = {0.0: 400, 0.01: 1500, 1.0: 400}
"""Good packets, by the share of them that comes after a damaged one."""

NEAR = 2.0
"""Percent by which a share may differ from the page's: each machine has an exp of its own."""


def touches(name: str, count: int) -> list[Any]:
    """Scans of presses that come, move a little and go, each in a time of its own, with noise."""
    known = wires.spoken(name, SMALL.get(name))
    shape, channels, unit, kind = wires.FORMS[name]
    rows, cols = SMALL.get(name) or shape
    rest, full = (known.form.rest, known.form.full) if known.form else (0.0, 1.0)
    rng = np.random.default_rng(3)
    load, at = np.zeros(count), np.zeros((count, 2))
    n = 0
    while n < count:
        free, rise, hold, fall = (int(rng.integers(*span)) for span in PHASES)
        top = rng.uniform(0.1, 1.0)
        up, down = np.linspace(0, top, rise + 1)[1:], np.linspace(top, 0, fall + 1)[1:]
        press = np.concatenate([np.zeros(free), up, np.full(hold, top), down])[: count - n]
        end = n + len(press)
        load[n:end] = press
        drift = np.outer(np.arange(len(press)), rng.normal(0.0, 0.05, 2))
        at[n:end] = rng.uniform((0.0, 0.0), (rows, cols)) + drift
        n = end
    row, col = np.mgrid[:rows, :cols]
    found: list[Any] = []
    for number in range(count):
        away = (row - at[number, 0]) ** 2 + (col - at[number, 1]) ** 2
        pressed = load[number] * np.exp(-away / 8.0)[..., np.newaxis]
        noise = rng.normal(0.0, 1 / 400, (rows, cols, len(channels)))
        values = rest + (full - rest) * (pressed + noise)
        if kind in ("u1", "u2"):
            values = np.clip(np.rint(values), 0, 255 if kind == "u1" else 65_535)
        found.append(Scan(values, channels, unit, sequence=number, time_us=10_000 * number))
    return found


PHASES = ((5, 40), (1, 15), (3, 60), (1, 15))
"""Scans without a load, of its rise, its top and its fall: some rise from one to the next."""


def damaged(name: str, share: float) -> tuple[float, float, float]:
    """Good packets lost, wrong frames handed on, and those that are far off: percent of the good.

    Far off is what differs from every good one, in some number, by more than a 16th of a strong
    load.
    """
    rng, known = random.Random(f"{share} of {name}"), wires.spoken(name, SMALL.get(name))
    sent = touches(name, PACKETS[share])
    packets = [known.encode(scan) for scan in sent]
    alone = [known.decoder() for _ in packets]
    good = [each.feed(data) + each.flush() for each, data in zip(alone, packets, strict=True)]
    decoder, got = known.decoder(), list[Any]()
    for number, packet in enumerate(packets):
        bad = b""
        if rng.random() < share:
            bad = rng.choice(DAMAGES)(packets[max(0, number - 1)], rng)
            bad += b"\n\n" if name in wires.TEXT else b""
        if known.request:
            got += (decoder.feed(bad) + decoder.flush(lost=False)) if bad else []
            got += decoder.feed(packet) + decoder.flush(lost=False)
        else:
            got += decoder.feed(bad + packet)
    came = Counter(scan.values.tobytes() for scan in got + decoder.flush())
    wanted = Counter(scan.values.tobytes() for (scan,) in good)
    wrong = [scan.values for scan in got if scan.values.tobytes() not in wanted]
    every = np.stack([scan.values for (scan,) in good])
    large = (known.form.full - known.form.rest) / 16 if known.form else 0.0
    far = sum(np.abs(every - one).max(axis=(1, 2, 3)).min() > large for one in wrong)
    counts = (wanted - came).total(), len(wrong), far
    return tuple(100.0 * count / len(sent) for count in counts)  # type: ignore[return-value]


def on_the_page() -> dict[str, list[float]]:
    """The shares that the page has for each protocol."""
    page = (Path(__file__).parents[2] / "docs" / "arrays.md").read_text()
    rows = re.findall(r"^\| `([\w-]+)` ((?:\| [\d.]+ % )+)\|$", page, flags=re.MULTILINE)
    return {name: [float(one) for one in re.findall(r"[\d.]+", cells)] for name, cells in rows}


@pytest.mark.parametrize("name", protocol_names())
def test_what_damage_costs_is_what_the_page_says(name: str) -> None:
    """With a check nothing is lost or wrong; without one, the page has the measured shares."""
    stated = on_the_page().get(name)
    assert damaged(name, 0.0) == (0.0, 0.0, 0.0)
    found = [*damaged(name, 0.01), *damaged(name, 1.0)]
    if wires.spoken(name, None).verified:
        assert stated is None
        assert max(found) <= 1.0
    else:
        assert stated is not None
        assert found == pytest.approx(stated, abs=NEAR)


def test_the_page_has_all_protocols_without_a_check() -> None:
    unverified = {name for name in protocol_names() if not wires.spoken(name, None).verified}
    assert set(on_the_page()) == unverified
    assert {len(shares) for shares in on_the_page().values()} == {6}


if __name__ == "__main__":
    for each in on_the_page():
        shares = [*damaged(each, 0.01), *damaged(each, 1.0)]
        print(f"| `{each}` | " + " | ".join(f"{share:.1f} %" for share in shares) + " |")
