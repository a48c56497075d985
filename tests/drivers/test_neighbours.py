"""Scans without a check: a jump that the next scan takes back is refused, all else passes."""

import os
import time
from pathlib import Path

import numpy as np
import pytest

from cnnum.drivers.codecs.stream import ENOUGH, LAST, PART, U16, Neighbours, Scan
from cnnum.drivers.registry import open_driver
from cnnum.drivers.timing import FrameClock

from .wires import drawn, spoken

pytestmark = pytest.mark.promise(
    "A frame without a check that jumps away from its neighbours is refused; all others pass."
)
RECORDINGS = Path(os.environ.get("CNNUM_RECORDINGS", "")) / "uskin_grasp"
FULL = 1000.0
LOAD = 200.0
"""More than four times the usual step, and more than the part of a strong load that counts."""


def scan(load, *, noise=1.0, seed=0, shape=(4, 4), **more):
    rng = np.random.default_rng([seed, int(abs(load))])
    return Scan(load + noise * rng.normal(size=(*shape, 1)), ("normal",), "count", **more)


def passed(loads, **options):
    """The numbers of the scans that passed, and how many were refused."""
    near, found, refused = Neighbours(FULL), [], 0
    sent = [scan(load, seed=n, **options) for n, load in enumerate([*[0.0] * 20, *loads])]
    for one in sent:
        now, bad = near.take(one)
        found += [next(n for n, s in enumerate(sent) if s.values is f.values) for f in now]
        refused += bad
    assert found == sorted(found)
    return [n - 20 for n in found if n >= 20], refused + near.lost()


@pytest.mark.parametrize(
    ("loads", "refused"),
    [
        ([0, LOAD, 0, 0], [1]),
        ([0, LOAD, -LOAD, 0, 0], [1, 2]),
        ([0, LOAD, LOAD, 0, 0], []),
        ([LOAD, 2 * LOAD, 3 * LOAD, 3 * LOAD], []),
        ([LOAD] * 3 + [0] * 3 + [LOAD] * 3, []),
        ([0, 0.9 * FULL / PART, 0, 0], []),
        ([0, 0, LOAD], [2]),
    ],
)
def test_a_jump_that_is_taken_back_is_refused(loads, refused):
    good, count = passed(loads)
    assert count == len(refused)
    assert good == [n for n in range(len(loads)) if n not in refused]


def test_what_goes_on_for_long_is_no_damage():
    """Vibration from scan to scan passes once it is half of what was seen."""
    good, refused = passed([LOAD * (n % 2) for n in range(100)])
    assert refused <= LAST // 2
    assert good[-(100 - LAST) :] == list(range(LAST, 100))


def test_numbers_that_are_always_new_pass():
    """Where each scan is far from the last one, no step is unusual."""
    near, rng = Neighbours(FULL), np.random.default_rng(1)
    sent = [Scan(rng.uniform(0, 9e4, (4, 4, 1)), ("normal",), "count") for _ in range(200)]
    assert [one for each in sent for one in near.take(each)[0]] == sent
    assert not near.agree(sent[-1])  # such steps say nothing


@pytest.mark.parametrize("name", ["time_us", "sequence"])
@pytest.mark.parametrize("wrong", [1 << 15, -900, 40_000])
def test_a_clock_or_a_count_that_jumps_and_comes_back_is_damage(name, wrong):
    near, found = Neighbours(FULL), []
    wraps = {"time_wrap": U16, "sequence_wrap": U16}
    for n in range(60):
        number = {name: (65_500 + n + (wrong if n == 40 else 0)) % U16}  # it wraps on the way
        now, _ = near.take(scan(0.0, seed=n, **number, **wraps))
        found += now
    assert len(found) == 59
    assert all((getattr(one, name) - 65_500) % U16 < 60 for one in found)


def test_a_restart_of_the_device_goes_on():
    near, found = Neighbours(FULL), []
    for n in [*range(1000, 1030), *range(30)]:
        found += near.take(scan(0.0, seed=n, time_us=2000 * n, sequence=n))[0]
    assert len(found) == 60


def test_another_array_and_the_first_scans_pass_at_once():
    near = Neighbours(FULL)
    for n in range(ENOUGH):
        one = scan(LOAD * (n % 3), seed=n)
        assert near.take(one) == ([one], 0)
    other = scan(0.0, shape=(2, 2))
    assert near.take(other) == ([other], 0)


def test_a_scan_that_waited_has_the_time_at_which_it_came():
    near, clock = Neighbours(FULL), FrameClock()
    for n in range(20):
        (one,), _ = near.take(scan(0.0, seed=n))
        clock.frame(one)
    began = time.monotonic_ns()
    assert near.take(scan(LOAD)) == ([], 0)
    came = time.monotonic_ns()
    time.sleep(0.02)
    (held, _), _ = near.take(scan(LOAD, seed=1)), None
    frame = clock.frame(held[0], time.monotonic_ns())
    assert began <= frame.monotonic_ns <= came


@pytest.mark.skipif(not RECORDINGS.is_dir(), reason="no recordings; set CNNUM_RECORDINGS")
def test_scans_of_real_grasps_pass():
    """The page says how many do not."""
    passed = refused = 0
    for trial in sorted(RECORDINGS.glob("*/meta_data.csv")):
        for pad in (1, 2):
            near = Neighbours(spoken("xela").form.full - spoken("xela").form.rest)
            with open_driver("uskin-csv", {"path": trial.parent, "pad": pad}) as driver:
                for frame in driver.frames():
                    now, bad = near.take(Scan(frame.values, frame.channels, frame.unit))
                    passed, refused = passed + len(now), refused + bad
    assert (passed, refused) == (2363, 3)


@pytest.mark.parametrize("name", ["m1616", "flexitac", "anyskin", "robotiq-tsf85", "velostat"])
def test_a_decoder_counts_a_refused_scan_as_bad(name):
    """A number that damage changed is counted, and the scans around it pass."""
    known, sent = spoken(name), drawn(name, 0)
    still = Scan(np.full(sent.values.shape, 7.0), sent.channels, sent.unit)
    spike = np.array(still.values)
    spike[0, 0, 0] += known.form.full / 2
    decoder, got = known.decoder(), []
    for n in range(40):
        values = spike if n == 30 else still.values
        each = Scan(values, sent.channels, sent.unit, sequence=n, time_us=2000 * n)
        got += decoder.feed(known.encode(each))
        got += decoder.flush(lost=False) if known.request else []
    got += decoder.flush()
    assert len(got) == 39
    assert {one.values.max() for one in got} == {7.0}
    assert (decoder.good, decoder.bad) == (39, 1)


@pytest.mark.parametrize("name", ["m1616", "flexitac", "anyskin", "robotiq-tsf85"])
def test_a_packet_before_damage_is_believed_by_its_neighbours(name):
    """Without the next packet in its place, a scan that goes on from the last one counts."""
    known, sent = spoken(name), drawn(name, 0)
    still = known.encode(Scan(np.full(sent.values.shape, 7.0), sent.channels, sent.unit))
    other = known.encode(
        Scan(np.full(sent.values.shape, known.form.full / 2), sent.channels, sent.unit)
    )
    for last, kept in ((still, 21), (other, 20)):
        decoder = known.decoder()
        got = decoder.feed(still * 20) + decoder.feed(b"\1\2\3" + last + b"\1" * len(still))
        assert len(got + decoder.flush()) == kept
