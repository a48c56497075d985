"""A serial array over a real pseudo-terminal: damage, cuts, an unplug, a plug again."""

import errno
import time
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from threading import Thread
from typing import Any

import numpy as np
import pytest

from cnnum.drivers.serial_array import SerialArray, SerialOptions
from cnnum.drivers.serial_port import open_error
from cnnum.drivers.serve import packets
from cnnum.errors import CodecError, PortError
from cnnum.frame import FORCE_AXES, Frame, Quality

RATE = 500.0
WAIT = 20.0  # s that a thread may take before a test gives up; none comes near it


def frame(n: int, time_s: float | None = None) -> Frame:
    values = np.random.default_rng(n).normal(size=(4, 5, 3)).astype(np.float32)
    when = n / RATE if time_s is None else time_s
    return Frame(values.astype(np.float64), FORCE_AXES, "V", n, when)


def frames(count: int, first: int = 0) -> list[Frame]:
    return [frame(n) for n in range(first, first + count)]


def options(link: Path, **changes: object) -> SerialOptions:
    quick = {"timeout": 1.0, "reconnects": 2, "backoff": 0.02, "longest_backoff": 0.05}
    return SerialOptions(str(link), **{**quick, **changes})  # type: ignore[arg-type]


def take(array: SerialArray, count: int) -> list[Frame]:
    source = array.frames()
    return [next(source) for _ in range(count)]


def test_frames_arrive_as_they_were_sent(device: Any, link: Path) -> None:
    sent = frames(100)
    device.write(b"".join(packets(sent, RATE)))
    with options(link).open() as array:
        got = take(array, 100)
        assert (array.shape, array.channels, array.unit) == ((4, 5), FORCE_AXES, "V")
        assert array.rate == pytest.approx(RATE, rel=1e-12)
        assert (array.counters.frames, array.counters.dropped, array.counters.bad) == (100, 0, 0)
    for one, other in zip(got, sent, strict=True):
        np.testing.assert_array_equal(one.values, other.values)
        assert (one.sequence, one.quality) == (other.sequence, Quality.GOOD)
        # the wire has whole µs
        assert one.time == pytest.approx(other.time, abs=1e-6)


def test_corrupted_and_cut_packets_are_counted_and_overcome(device: Any, link: Path) -> None:
    data = list(packets(frames(30), RATE))
    data[7] = data[7][:100] + bytes([data[7][100] ^ 0x40]) + data[7][101:]
    data[12] = data[12][:150]
    data[20] = b"\xc3NUM" + data[20][4:20]
    device.write(b"noise" + b"".join(data))
    with options(link).open() as array:
        got = take(array, 27)
        seen = array.counters
    assert [f.sequence for f in got] == [n for n in range(30) if n not in {7, 12, 20}]
    late = [f.sequence for f in got if f.quality & Quality.DROPPED_BEFORE]
    assert late == [8, 13, 21]
    assert (seen.frames, seen.bad, seen.dropped, seen.resyncs) == (27, 2, 3, 4)
    assert seen.discarded == 5 + len(data[7]) + 150 + 20


def test_an_unplug_ends_in_one_sentence_after_the_frames_before_it(device: Any, link: Path) -> None:
    device.write(b"".join(packets(frames(10), RATE)))
    with options(link).open() as array:
        source = array.frames()
        got = [next(source) for _ in range(10)]
        device.unplug()
        begin = time.monotonic()
        with pytest.raises(PortError, match=r"went away.*2 attempts to find it again failed"):
            next(source)
        # two attempts after 0.02 and 0.04 s; the rest is room for a slow machine
        assert time.monotonic() - begin < WAIT / 2
    assert len(got) == 10


def test_plugged_in_again_it_goes_on_and_states_the_gap(
    device: Any, link: Path, plug: Callable[[], Any]
) -> None:
    device.write(b"".join(packets(frames(10), RATE)))
    with options(link, reconnects=200).open() as array:
        source = array.frames()
        before = [next(source) for _ in range(10)]
        device.unplug()
        again = plug()
        # the device has started anew: its count and its clock begin at 0
        again.write(b"".join(packets(frames(10), RATE)))
        after = [next(source) for _ in range(10)]
        seen = array.counters
        again.unplug()
    assert after[0].quality == Quality.DROPPED_BEFORE
    assert [f.quality for f in after[1:]] == [Quality.GOOD] * 9
    merged = [*before, *after]
    # as many scans as the period makes of the time away, less the one that came
    away = after[0].time - before[-1].time
    assert (seen.gaps, seen.frames, seen.dropped) == (1, 20, round(away * RATE) - 1)
    assert seen.sent == seen.frames + seen.dropped == after[-1].sequence + 1
    assert all(b.time > a.time and b.sequence > a.sequence for a, b in pairwise(merged))


def test_a_silent_array_is_given_up(device: Any, link: Path) -> None:
    device.write(b"".join(packets(frames(3), RATE)))
    with options(link, timeout=0.2, reconnects=1).open() as array:
        assert len(take(array, 3)) == 3
        with pytest.raises(PortError, match=r"No good packet came.*for 0\.2 s.*1 attempts"):
            next(array.frames())


def test_no_packet_at_all_is_reported_on_opening(device: Any, link: Path) -> None:
    device.write(b"this is another protocol\n" * 20)
    with pytest.raises(PortError, match=r"No good packet came.*speaks the open protocol"):
        options(link, timeout=0.2).open()


def test_latest_passes_over_what_is_old_and_counts_it(device: Any, link: Path) -> None:
    device.write(b"".join(packets(frames(200), RATE)))
    with options(link, mode="latest").open() as array:
        device.written()
        deadline = time.monotonic() + WAIT
        while array.counters.skipped < 199 and time.monotonic() < deadline:
            time.sleep(0.01)
        assert take(array, 1)[0].sequence == 199
        seen = array.counters
    assert (seen.frames, seen.skipped, seen.dropped) == (1, 199, 0)


def test_a_full_queue_drops_the_oldest_and_counts_it(device: Any, link: Path) -> None:
    device.write(b"".join(packets(frames(50), RATE)))
    with options(link, depth=10).open() as array:
        device.written()
        deadline = time.monotonic() + WAIT
        while array.counters.dropped < 40 and time.monotonic() < deadline:
            time.sleep(0.01)
        assert [f.sequence for f in take(array, 10)] == list(range(40, 50))
        assert (array.counters.frames, array.counters.dropped) == (10, 40)


def test_closing_ends_the_frames(device: Any, link: Path) -> None:
    device.write(b"".join(packets(frames(5), RATE)))
    array = options(link).open()
    source = array.frames()
    assert [next(source).sequence for _ in range(5)] == [0, 1, 2, 3, 4]
    Thread(target=lambda: (time.sleep(0.1), array.close())).start()
    assert list(source) == []
    array.close()


def test_a_port_in_use_is_reported(device: Any, link: Path) -> None:
    device.write(b"".join(packets(frames(5), RATE)))
    with options(link).open(), pytest.raises(PortError, match="in use by another program"):
        options(link).open()


def test_a_port_that_is_not_there_is_reported(tmp_path: Path) -> None:
    with pytest.raises(PortError, match=r"no port '.*gone': plug the array in; ports here"):
        options(tmp_path / "gone").open()


@pytest.mark.parametrize(
    ("code", "sentence"),
    [
        (errno.ENOENT, "ports here: 'COM1', 'COM2'"),
        (errno.EACCES, "join the group 'dialout'"),
        (errno.EBUSY, "in use by another program"),
        (errno.EIO, "does not open as a serial port"),
    ],
)
def test_each_system_error_has_its_sentence(code: int, sentence: str) -> None:
    error = open_error("COM9", OSError(code, "as the system says it"), ["COM1", "COM2"])
    assert sentence in str(error)
    assert "COM9" in str(error)


def test_serving_keeps_to_the_rate(device: Any, link: Path) -> None:
    begin = time.monotonic()
    device.serve(frames(21), 100.0)
    with options(link).open() as array:
        assert len(take(array, 21)) == 21
        # 20 periods of 10 ms; a slow machine is later, never earlier
        assert time.monotonic() - begin >= 0.2


def test_whole_cells_are_rounded_and_clipped(device: Any, link: Path) -> None:
    values = np.array([[[-1.0, 2.4, 70_000.0]]])
    device.write(b"".join(packets([Frame(values, FORCE_AXES, "count", 0, 0.0)], RATE, "<u2")))
    with options(link).open() as array:
        assert take(array, 1)[0].values.tolist() == [[[0.0, 2.0, 65_535.0]]]


def test_what_the_protocol_has_no_code_for_is_refused() -> None:
    furlongs = Frame(np.zeros((1, 1, 3)), FORCE_AXES, "furlong", 0, 0.0)
    with pytest.raises(CodecError, match="got 'furlong'"):
        next(packets([furlongs], RATE))
