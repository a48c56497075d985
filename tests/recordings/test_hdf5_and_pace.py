"""Recordings as HDF5, and at a pace."""

import time
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from cnnum.drivers.registry import open_driver
from cnnum.drivers.timing import Paced
from cnnum.recordings.recording import Recording

h5py = pytest.importorskip("h5py")


@pytest.fixture
def kept() -> Recording:
    values = np.random.default_rng(5).normal(size=(300, 2, 3, 3))
    slip = np.arange(300) % 7
    return Recording(
        values,
        rate=100.0,
        unit="N",
        truth={"slip": slip},
        quality=slip % 2,
        saturated=values[..., 0] > 1.0,
    )


def test_hdf5_holds_every_frame_and_its_facts(kept: Recording, tmp_path: Path) -> None:
    path = kept.save(tmp_path / "grip.h5")
    with h5py.File(path) as file:
        np.testing.assert_array_equal(file["values"][:], kept.values)
        np.testing.assert_array_equal(file["time"][:], kept.times)
        np.testing.assert_array_equal(file["truth/slip"][:], kept.truth["slip"])
        np.testing.assert_array_equal(file["quality"][:], kept.quality)
        np.testing.assert_array_equal(file["saturated"][:], kept.saturated)
        assert list(file["log_time"][:3]) == [0, 10_000_000, 20_000_000]
        assert list(file.attrs["channels"]) == ["shear_x", "shear_y", "normal"]
        assert (file.attrs["unit"], file.attrs["rate"]) == ("N", 100.0)


def test_hdf5_is_read_again_with_a_layout(kept: Recording, tmp_path: Path) -> None:
    path = kept.save(tmp_path / "grip.hdf5")
    path.with_suffix(".toml").write_text(
        'shape = [2, 3]\nchannels = ["x", "y", "z"]\ntime = "time"\nunit = "N"\n'
        'truth = ["truth/slip"]\n'
    )
    with open_driver("file", {"path": str(path)}) as driver:
        frames = list(driver.frames())
        assert driver.rate == pytest.approx(100.0)
    np.testing.assert_array_equal(np.stack([frame.values for frame in frames]), kept.values)


def test_frames_come_at_their_times(kept: Recording, tmp_path: Path) -> None:
    path = kept.save(tmp_path / "grip.npz")
    with open_driver("npz", {"path": str(path)}) as driver:
        begin, got = time.monotonic(), []
        for frame in Paced(driver, 4.0, 1.0, 2.0).frames():
            got.append(frame)
        took = time.monotonic() - begin
    assert [frame.sequence for frame in got] == list(range(100, 201))
    assert all(b.time > a.time for a, b in pairwise(got))
    # a second at four times its pace; a busy machine is later, never earlier
    assert took >= 0.25
    with open_driver("npz", {"path": str(path)}) as driver:
        assert len(list(Paced(driver).frames())) == 300
