"""Codecs under damage: any bytes at all, then good packets, which all arrive.

`make arrays` tries each protocol a million times; `CNNUM_CODEC_INPUTS` is that number.
"""

import importlib.util
import os
import random
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

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


BETWEEN = 400
"""Good packets, each between two damaged ones."""


def between(name: str) -> tuple[int, int]:
    """Good packets that are lost, and wrong frames that are handed on: percent of the good."""
    bench, rng = Bench(name), random.Random(f"both sides of {name}")
    decoder, got, sent = bench.known.decoder(), list[Any](), Counter[bytes]()
    for _ in range(BETWEEN):
        number = rng.randrange(len(bench.data))
        damaged = rng.choice(DAMAGES)(bench.data[rng.randrange(len(bench.data))], rng)
        damaged += b"\n\n" if name in wires.TEXT else b""
        sent[bench.numbers[number]] += 1
        if bench.known.request:
            got += decoder.feed(damaged) + decoder.flush()
            got += decoder.feed(bench.data[number]) + decoder.flush()
        else:
            got += decoder.feed(damaged + bench.data[number])
    came = Counter(scan.values.tobytes() for scan in got + decoder.flush())
    wrong = sum(count for values, count in came.items() if values not in sent)
    return round(100 * (sent - came).total() / BETWEEN), round(100 * wrong / BETWEEN)


@pytest.mark.parametrize("name", protocol_names())
def test_what_damage_on_both_sides_costs_is_what_the_page_says(name: str) -> None:
    """With a check nothing is lost or wrong; without one, the page has the measured shares."""
    lost, wrong = between(name)
    page = (Path(__file__).parents[2] / "docs" / "arrays.md").read_text()
    if wires.spoken(name, None).verified:
        assert lost <= 1
        assert wrong <= 1
        assert f"| `{name}` | {lost} %" not in page
    else:
        assert f"| `{name}` | {lost} % | {wrong} % |" in page
