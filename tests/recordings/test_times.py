"""The rate of frames by their times, and the scans that pauses and losses leave out."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import cnnum
from cnnum.recordings.times import numbered, rate_of

RATES = st.floats(1.0, 2000.0)
SEEDS = st.integers(0, 2**32 - 1)


@given(RATES, SEEDS, st.floats(0.5, 1e6))
def test_a_pause_changes_no_rate_and_is_a_gap(rate, seed, periods):
    rng = np.random.default_rng(seed)
    count, at = 400, int(rng.integers(2, 398))
    times = np.arange(count) / rate
    times[at:] += periods / rate
    # a pause of a few scans counts as whole ones
    assert rate_of(times) == pytest.approx(rate, rel=1e-6 if periods > 4.0 else 0.5 / 399)
    jumps = np.diff(numbered(times, 1.0))
    assert jumps[at - 1] == pytest.approx(1.0 + periods, abs=0.51 + 1e-6 * periods)
    assert (np.delete(jumps, at - 1) == 1).all()


@given(RATES, SEEDS, st.floats(0.0, 0.3))
def test_lost_scans_change_no_rate_and_are_counted(rate, seed, share):
    kept = np.random.default_rng(seed).random(600) >= share
    kept[[0, -1]] = True
    sequence = np.flatnonzero(kept)
    times = sequence / rate
    assert rate_of(times) == pytest.approx(rate, rel=1e-6)
    assert np.array_equal(numbered(times, 1.0), sequence)


@given(RATES, SEEDS, st.sampled_from([0.0, 1.7e9]))
def test_a_late_host_loses_no_scan(rate, seed, epoch):
    """Each frame is late by chance, some by far; those behind it come at once."""
    rng = np.random.default_rng(seed)
    late = rng.exponential(0.15, 500)
    late[rng.integers(50, 100) + 150 * np.arange(3)] += 20.0
    times = epoch + np.maximum.accumulate((np.arange(500) + late) / rate)
    # the clock's float64 has 0.24 µs at times from 1970, and a mean over 500 steps is no better
    assert rate_of(times) == pytest.approx(rate, rel=0.02)
    assert np.array_equal(numbered(times, 1.0), np.arange(500))


@given(st.floats(5.0, 3000.0), st.sampled_from([1.0, 0.1, 0.01, 1e-3]))
def test_a_coarse_clock_gives_the_rate(rate, digit):
    """Steps of a clock in ms are 1 and 2 at 900 Hz; several frames have one time at 3 kHz."""
    count = max(1000, int(12 * rate * digit))
    times = np.floor(np.arange(count) / rate / digit + 1e-6) * digit
    # a digit at either end is not known, and a few long steps could be lost scans
    assert rate_of(times) == pytest.approx(rate, rel=2.5 * digit * rate / count + 10 / count)


@pytest.mark.parametrize("times", [[0.0], [1.0, 1.0], [0.0, np.nan, 1.0], [0.0, 1e-9]])
def test_times_that_give_no_rate(times):
    assert rate_of(np.array(times)) == 0.0


def test_numbers_that_jump_are_losses(tmp_path):
    """Also where only the numbers say so; flags that are given stay as they are."""
    scans = np.array([0, 1, 2, 9, 10])
    values = np.zeros((5, 1, 1, 1))
    found = cnnum.Recording(values, rate=10.0, sequence=scans, times=scans / 10.0)
    assert found.quality.tolist() == [0, 0, 0, 1, 0]
    kept = cnnum.Recording(values, rate=10.0, sequence=scans, quality=[0] * 5)
    assert kept.quality.tolist() == [0] * 5
    for suffix in (".csv", ".h5", ".npz", ".mcap"):
        found.save(tmp_path / f"a{suffix}")
        assert cnnum.load_recording(tmp_path / f"a{suffix}").quality.tolist() == [0, 0, 0, 1, 0]
