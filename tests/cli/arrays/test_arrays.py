"""`cnnum probe`, `record` and `replay`: an array's frames, kept and given back."""

import csv
import os
import tty
from threading import Thread
from types import SimpleNamespace

import numpy as np
import pytest

from cnnum import Frame, Quality
from cnnum.cli.commands import probe
from cnnum.cli.commands.probe import ENOUGH, ProbeFigures
from cnnum.drivers import open_driver
from cnnum.drivers.codecs.wire import wire
from cnnum.drivers.serve import packets, write_all
from cnnum.frame import FORCE_AXES


def frame(number: int, values: np.ndarray, quality: Quality = Quality.GOOD) -> Frame:
    return Frame(values, FORCE_AXES, "count", number, number / 100.0, quality)


def noisy(count: int) -> list[Frame]:
    rng = np.random.default_rng(1)
    values = rng.normal(100.0, 2.0, (count, 3, 4, 3))
    values[:, 1, 2, 0], values[:, 2, 3, 2] = 0.0, 77.0
    return [frame(n, v) for n, v in enumerate(values)]


def test_figures_find_dead_and_stuck_cells_and_the_noise():
    figures = ProbeFigures()
    for scan in noisy(400):
        figures.add(scan)
    assert figures.dead == [(1, 2, "shear_x")]
    assert figures.stuck == [(2, 3, "normal")]
    assert figures.rate == pytest.approx(100.0, rel=1e-12)
    for spread in figures.spread.values():
        # the median of a dozen estimates from 400 scans: 2/√800 = 0.07 each
        assert spread == pytest.approx(2.0, abs=0.2)


def test_figures_find_noisy_cells_drift_and_the_way_of_an_axis():
    rng = np.random.default_rng(2)
    values = rng.normal(0.0, 1.0, (600, 3, 4, 3))
    values[:, 0, 1, 1] *= 20.0
    values[..., 2] += 0.1 * np.arange(600)[:, None, None] / 100.0  # 0.1 a second is 6 a minute
    values[300:400, 2, 2, 0] -= 500.0
    figures = ProbeFigures()
    for n, one in enumerate(values):
        figures.add(frame(n, one))
    assert (0, 1, "shear_y") in figures.noisy
    assert set(figures.noisy) <= {(0, 1, "shear_y"), (2, 2, "shear_x")}
    # a slope over 6 s of noise 1: σ·√12/(T·√n)·60 = 1.4 a cell, less in the median of a dozen
    assert figures.drift["normal"] == pytest.approx(6.0, abs=1.5)
    by, row, col = figures.moved["shear_x"]
    assert (row, col) == (2, 2)
    assert by == pytest.approx(-500.0, abs=10.0)


def test_probe_draws_what_it_found(call, records, tmp_path):
    picture = tmp_path / "cells.png"
    result = call("probe", "simulated", "--frames", 60, "--set", "shape=[3, 5]", "--json",
                  "--picture", picture)  # fmt: skip
    assert result.exit_code == 0, result.stderr
    (record,) = records(result.stdout)
    assert set(record["drift_per_min"]) == set(record["moved"]) == set(record["channels"])
    assert picture.read_bytes().startswith(b"\x89PNG")
    refused = call("probe", "simulated", "--frames", 60, "--picture", tmp_path / "no" / "a.png")
    assert refused.exit_code == 2
    assert "there is no folder" in refused.stderr


def test_figures_leave_out_repeats_bad_scans_and_few_of_them():
    figures, scans = ProbeFigures(), noisy(ENOUGH - 1)
    for scan in scans:
        figures.add(scan)
    figures.add(frame(98, np.full((3, 4, 3), 1e9), Quality.CORRUPT))
    figures.add(frame(99, scans[-1].values, Quality.REPEATED))
    assert (figures.scans, figures.bad, figures.repeated) == (ENOUGH - 1, 1, 1)
    assert (figures.dead, figures.stuck) == ([], [])
    assert max(figures.spread.values()) < 10.0


def test_probe_of_the_simulated_array(call, records):
    result = call("probe", "simulated", "--frames", 60, "--set", "shape=[3, 5]", "--json")
    assert result.exit_code == 0, result.stderr
    (record,) = records(result.stdout)
    assert (record["shape"], record["unit"], record["frames"]) == ([3, 5], "V", 60)
    assert record["rate_hz"] == pytest.approx(200.0, rel=1e-6)
    assert (record["dead"], record["stuck"], record["dropped"]) == ([], [], 0)
    text = call("probe", "demo", "--frames", 60, "--set", "noise=0", "--set", "offset=0").stdout
    assert "200.00 Hz" in text
    assert "dead cells" in text


def test_probe_of_a_port_counts_what_is_lost(call, records, tmp_path):
    """One packet is cut out and one has a wrong byte: two scans are missing, one of them bad."""
    sent = list(packets(noisy(40), 100.0))
    sent[10] = b""
    sent[20] = sent[20][:-30] + bytes([sent[20][-30] ^ 0xFF]) + sent[20][-29:]
    master, slave = os.openpty()
    tty.setraw(slave)
    # bytes before the port was opened are thrown away, so the array sends until it is heard
    done = []

    def send() -> None:
        import time

        time.sleep(0.5)
        write_all(master, b"".join(sent))
        done.append(True)

    thread = Thread(target=send)
    thread.start()
    options = ("--set", f"port={os.ttyname(slave)}", "--set", "timeout=5")
    result = call("probe", "serial", *options, "--frames", 38, "--json")
    thread.join(20)
    os.close(master)
    os.close(slave)
    assert result.exit_code == 0, result.stderr
    (record,) = records(result.stdout)
    assert done
    assert (record["frames"], record["dropped"], record["bad_frames"]) == (38, 2, 1)


@pytest.mark.parametrize("suffix", ["npz", "mcap"])
def test_a_recording_is_given_back_bit_for_bit(call, records, tmp_path, suffix):
    path = tmp_path / f"taps.{suffix}"
    result = call("record", "simulated", path, "--frames", 50, "--set", "seed=7", "--json")
    assert result.exit_code == 0, result.stderr
    (record,) = records(result.stdout)
    assert (record["kind"], record["frames"]) == ("recording", 50)
    assert record["bytes"] == path.stat().st_size
    with (
        open_driver("simulated", {"seed": 7}) as array,
        open_driver(suffix, {"path": path}) as tape,
    ):
        for sent, got in zip(array.frames(), tape.frames(), strict=False):
            np.testing.assert_array_equal(got.values, sent.values)
            assert (got.time, got.sequence, got.quality) == (sent.time, sent.sequence, sent.quality)
            assert got.truth == sent.truth
        assert (tape.shape, tape.unit, tape.rate) == (array.shape, array.unit, array.rate)
        volts = np.ones((8, 8, 4))
        np.testing.assert_array_equal(
            tape.calibration.to_strain(volts), array.calibration.to_strain(volts)
        )
        assert tape.counters.frames == tape.total_frames == 50


def test_a_recording_as_csv(call, tmp_path):
    path = tmp_path / "taps.csv"
    assert call("record", "simulated", path, "--frames", 5).exit_code == 0
    with path.open(newline="") as file:
        header, *rows = list(csv.reader(file))
    assert header[:4] == ["sequence", "time (s)", "quality", "r0_c0_left (V)"]
    with open_driver("simulated") as array:
        for row, sent in zip(rows, array.frames(), strict=False):
            assert [float(cell) for cell in row[3 : 3 + 256]] == sent.values.ravel().tolist()
    assert len(rows) == 5


@pytest.mark.parametrize("suffix", ["npz", "mcap", "csv"])
def test_nothing_is_overwritten_and_no_draft_is_left(call, tmp_path, suffix):
    path = tmp_path / f"taps.{suffix}"
    path.write_text("precious")
    refused = call("record", "simulated", path, "--frames", 2)
    assert refused.exit_code == 2
    assert "--force" in refused.stderr
    assert path.read_text() == "precious"
    assert call("record", "simulated", path, "--frames", 2, "--force").exit_code == 0
    beside = ["taps.calibration.toml"] if suffix == "csv" else []
    assert sorted(item.name for item in tmp_path.iterdir()) == [*beside, path.name]
    assert path.read_bytes() != b"precious"


def test_what_came_before_an_error_is_kept(call, tmp_path):
    """The contact leaves the array in the middle: the frames until then are in the file."""
    script = 'script=[{kind="press", load=1.0, duration=0.2}, {kind="pull", speed=0.1, duration=1}]'
    path = tmp_path / "gone.npz"
    result = call("record", "simulated", path, "--set", script)
    assert result.exit_code == 2
    assert "left the array" in result.stderr
    with open_driver("npz", {"path": path}) as tape:
        assert 30 <= tape.total_frames < 240
    assert [item.name for item in tmp_path.iterdir()] == ["gone.npz"]


@pytest.mark.parametrize("suffix", ["npz", "mcap"])
def test_replay_counts_what_the_recording_lacks(tmp_path, suffix):
    from cnnum.cli.commands.record import Recorder

    path, scans = tmp_path / f"gaps.{suffix}", noisy(4)
    with open_driver("simulated") as array:
        recorder = Recorder(path, array)
    for number, quality in ((0, 0), (1, 0), (5, Quality.DROPPED_BEFORE), (5, Quality.REPEATED)):
        recorder.add(frame(number, scans[0].values, Quality(quality)))
    assert recorder.finish().frames == 4
    with open_driver(suffix, {"path": path}) as tape:
        assert [scan.sequence for scan in tape.frames()] == [0, 1, 5, 5]
        assert (tape.counters.dropped, tape.counters.repeated, tape.counters.frames) == (3, 1, 3)


@pytest.mark.parametrize(("verified", "rows"), [(True, 0), (False, 1), (None, 0)])
def test_probe_says_where_frames_cannot_be_verified(verified, rows):
    driver = SimpleNamespace() if verified is None else SimpleNamespace(verified=verified)
    said = probe._unverified(driver)
    assert len(said) == rows
    assert all("cannot be verified" in text for _, text in said)


@pytest.mark.parametrize(("name", "verified"), [("open", True), ("m1616", False), ("xela", False)])
def test_a_protocol_knows_whether_its_packets_carry_a_check(name, verified):
    assert wire(name).verified == verified
