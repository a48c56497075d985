"""The virtual array: every protocol over a pseudo-terminal, with faults on request."""

import json
import os
import resource
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import islice, pairwise
from pathlib import Path
from threading import Event, Thread
from typing import Any

import numpy as np
import pytest

from cnnum.drivers.codecs.wire import Asked, protocol_names, wire
from cnnum.drivers.serial_array import SerialOptions
from cnnum.drivers.serial_port import PortInfo, guess
from cnnum.drivers.serve import scan_of
from cnnum.drivers.virtual import LineFaults, Spoiler, VirtualArray, VirtualLine
from cnnum.errors import PortError, SceneError
from cnnum.frame import FORCE_AXES, Frame
from cnnum.scenes.pipeline import load_scene
from cnnum.scenes.scene_record import Histogram

LINE_SECONDS = float(os.environ.get("CNNUM_LINE_SECONDS", "3"))
LONG = 60.0  # s from which on a line shows its latency and whether memory grows
PROMISED_US = 2000.0  # from the arrival of a frame to its events, 99 % of them
FLAT_KIB = 8192  # a leak of one frame of 1,536 B in ten would be 45 MiB in five minutes
WAIT = 30.0  # s that a thread or a process may take before a test gives up


def frames(count: int = 16) -> list[Frame]:
    values = np.random.default_rng(3).normal(size=(count, 8, 8, 3))
    return [Frame(one, FORCE_AXES, "N", n, n / 100.0) for n, one in enumerate(values)]


@contextmanager
def offered(
    link: Path, protocol: str = "open", rate: float = 500.0, **faults: Any
) -> Iterator[VirtualArray]:
    line = VirtualLine(link)
    known = wire(protocol, Asked())
    array = VirtualArray(known, line, frames(), rate, LineFaults(**faults))
    stop = Event()
    thread = Thread(target=array.run, args=(stop,))
    thread.start()
    try:
        yield array
    finally:
        stop.set()
        thread.join(WAIT)
        line.close()
        assert not thread.is_alive()


def options(link: Path, **changes: Any) -> SerialOptions:
    return SerialOptions(str(link), **{"timeout": 2.0, "backoff": 0.01, **changes})


def accounted(seen: Any) -> bool:
    parts = (seen.frames, seen.repeated, seen.dropped, seen.skipped, seen.waiting)
    return bool(seen.sent == sum(parts))


@pytest.mark.parametrize("protocol", [name for name in protocol_names() if name != "xela"])
def test_every_serial_protocol_is_offered_and_read(tmp_path: Path, protocol: str) -> None:
    with offered(tmp_path / "tty", protocol) as array:
        with options(tmp_path / "tty", protocol=protocol).open() as driver:
            got = list(islice(driver.frames(), 20))
        form = array.wire.form
    assert len(got) == 20
    if form is not None:
        assert (driver.shape, driver.channels, driver.unit) == (
            form.shape, form.channels, form.unit,
        )  # fmt: skip
    assert all(b.time >= a.time for a, b in pairwise(got))
    assert any(not np.array_equal(got[0].values, frame.values) for frame in got[1:])


def test_an_array_that_is_asked_sends_as_often_as_it_is_asked(tmp_path: Path) -> None:
    with offered(tmp_path / "tty", "paxini", rate=200.0) as array:
        with options(tmp_path / "tty", protocol="paxini").open() as driver:
            assert len(list(islice(driver.frames(), 25))) == 25
        # opening the port drops the bytes that wait, maybe an answer; one is on its way
        assert array.counts.scans <= 25 + 10


def flipped_scans(faults: LineFaults, count: int) -> set[int]:
    """Return the numbers of the scans whose packets these faults damage: they are repeatable."""
    spoiler, packet = Spoiler(faults), wire("open").encode(scan_of(frames(1)[0], 100.0))
    return {n for n in range(count) if not spoiler.drops() and spoiler.flipped(packet)}


def test_flipped_bits_cost_their_own_packets_only(faults, tmp_path: Path) -> None:
    """With 1 % of the packets damaged, every good one arrives and every bad one is counted."""
    for trial in faults.trials(short=1, full=4):
        with (
            offered(tmp_path / "tty", rate=2000.0, flips=0.01, seed=trial) as array,
            options(tmp_path / "tty").open() as driver,
        ):
            got = [frame.sequence for frame in islice(driver.frames(), 2000)]
        seen = driver.counters  # nothing comes any more
        spoiled = flipped_scans(LineFaults(flips=0.01, seed=trial), array.counts.scans)
        if array.counts.untaken or not accounted(seen):
            faults.lose(f"trial {trial}: {array.counts}, {seen}")
        elif {*range(got[0], got[-1] + 1)} - spoiled != {*got}:
            faults.lose(f"trial {trial}: {sorted({*range(got[0], got[-1] + 1)} - {*got})} lost")
        elif len(spoiled & {*range(got[0], got[0] + (seen.sent or 0))}) != seen.dropped:
            faults.lose(f"trial {trial}: {len(spoiled)} were damaged, {seen}")


def test_rate_and_bias_are_asked_for_again_after_a_replug(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("cnnum.drivers.serial_array.SETTLED", 0.02)
    with offered(tmp_path / "tty", "pts2") as array:
        asked = {"protocol": "pts2", "rate": 500.0, "bias": True, "reconnects": 200}
        with options(tmp_path / "tty", longest_backoff=0.05, **asked).open() as driver:
            for plugged in range(2):
                heard, deadline = b"", time.monotonic() + WAIT
                while b"z\n" not in heard and time.monotonic() < deadline:
                    heard += array.line.asked()
                    time.sleep(0.01)
                assert heard.endswith(b"f500\nz\n")
                if not plugged:
                    array.line.unplug()
                    array.line.plug()
            assert driver.counters.gaps >= 1  # a machine that stands still makes one more


def test_unplugs_are_recovered_from(faults, tmp_path: Path) -> None:
    """After every unplug and replug the stream goes on, and the gap is counted."""
    with offered(tmp_path / "tty", rate=400.0, unplug_every=0.25, away=0.05) as array:
        wanted = 20 if faults.full else 4
        with options(tmp_path / "tty", reconnects=100, longest_backoff=0.1).open() as driver:
            source, seen = driver.frames(), 0
            deadline = time.monotonic() + WAIT
            while seen < wanted and time.monotonic() < deadline:
                next(source)
                seen = driver.counters.gaps
        for number in faults.trials(short=4, full=20):
            if number >= seen:
                faults.lose(f"unplug {number} of {array.counts.unplugs}")
        assert accounted(driver.counters)


def test_drops_and_stalls_are_counted(tmp_path: Path) -> None:
    with (
        offered(tmp_path / "tty", rate=1000.0, drops=0.1, stall_every=0.3, stall=0.1) as array,
        options(tmp_path / "tty").open() as driver,
    ):
        got = list(islice(driver.frames(), 800))
        seen = driver.counters
    lost = got[-1].sequence - got[0].sequence + 1 - len(got)
    assert 0 < lost <= array.counts.dropped
    assert accounted(seen)
    assert array.counts.stalls >= 2


def test_another_protocol_is_distinguished_from_silence(tmp_path: Path) -> None:
    with (
        offered(tmp_path / "tty", "flexitac"),
        pytest.raises(PortError, match=r"speaks PTS 2\. \d+ bytes came that are none"),
    ):
        options(tmp_path / "tty", protocol="pts2", timeout=0.3).open()
    line = VirtualLine(tmp_path / "quiet")
    with pytest.raises(PortError, match="Nothing came that is any of its packets"):
        options(tmp_path / "quiet", timeout=0.2).open()
    line.close()


def test_what_a_stale_frame_waited_is_flagged(tmp_path: Path) -> None:
    from cnnum.frame import Quality

    with (
        offered(tmp_path / "tty", rate=200.0),
        options(tmp_path / "tty", stale=0.1).open() as driver,
    ):
        time.sleep(0.4)
        source = driver.frames()
        assert next(source).quality & Quality.STALE
        assert any(not next(source).quality & Quality.STALE for _ in range(400))


def test_xela_is_read_from_its_server(tmp_path: Path) -> None:
    pytest.importorskip("websockets")
    from websockets.sync.server import serve

    known, stop = wire("xela", Asked(shape=(8, 8))), Event()
    form = known.form
    assert form is not None

    def talk(socket: Any) -> None:
        from cnnum.drivers.codecs.stream import Scan

        socket.send('{"message": "Welcome"}')
        number = 0
        while not stop.is_set():
            scan = Scan(np.full((8, 8, 3), 33_000.0 + number), FORCE_AXES, "count", number)
            try:
                socket.send(known.encode(scan).decode().strip())
            except Exception:  # the reader has left
                return
            number += 1
            time.sleep(0.005)

    with serve(talk, "127.0.0.1", 0) as server:
        Thread(target=server.serve_forever, daemon=True).start()
        address = f"ws://127.0.0.1:{server.socket.getsockname()[1]}"
        with SerialOptions(address, protocol="xela", shape=(8, 8)).open() as driver:
            got = list(islice(driver.frames(), 10))
        stop.set()
        server.shutdown()
    assert [frame.sequence for frame in got] == list(range(got[0].sequence, got[0].sequence + 10))
    assert got[0].values[0, 0, 0] == 33_000.0 + got[0].sequence
    with pytest.raises(PortError, match="does not answer"):
        SerialOptions(address, protocol="xela").open()


@pytest.fixture
def simulated(tmp_path: Path) -> Iterator[Callable[..., Any]]:
    """Starts `cnnum simulate`, and waits until its port is there."""
    running: list[subprocess.Popen[str]] = []

    def start(*more: str) -> Any:
        link = tmp_path / "taxels"
        command = [sys.executable, "-m", "cnnum", "simulate", "--pty", "--json"]
        running.append(
            subprocess.Popen(
                [*command, "--link", str(link), *more], stdout=subprocess.PIPE, text=True
            )
        )
        assert running[-1].stdout is not None
        first = json.loads(running[-1].stdout.readline())
        assert first["port"] == str(link)
        return running[-1]

    yield start
    for process in running:
        process.kill()
        process.wait()
        if process.stdout:
            process.stdout.close()


@pytest.mark.usefixtures("opencl")  # the other engines fall behind such a line
def test_slip_runs_on_a_line_at_a_thousand_scans_a_second(
    simulated: Callable[..., Any], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """`make arrays` runs it for five minutes; a short run asserts no time and no memory."""
    process = simulated("--rate", "1000", "--set", "rate=100")
    scene_file = tmp_path / "line.toml"
    scene_file.write_text(
        f'name = "line"\nneeds = ["contact", "slip"]\n[array]\ndriver = "serial"\ndepth = 100000\n'
        f'port = "{tmp_path / "taxels"}"\n[program.parameters]\ndepth = 0.667\nunit = 1.305\n'
    )
    scene, late, kinds = load_scene(scene_file), Histogram(), set[str]()
    before, handed_on, begin = 0, 0, float("inf")
    memory, deadline = [0, 0], time.monotonic() + 6 * WAIT
    for moment in scene.results():
        arrived = moment.frame.monotonic_ns or 0
        delay = time.monotonic_ns() - arrived
        # frames that came while the program was compiled are worked off first
        if begin == float("inf"):
            assert time.monotonic() < deadline, "the program never caught up with the line"
        if begin == float("inf") and delay < 5e6:
            begin, before = time.monotonic(), scene.driver.counters.dropped
            memory[0] = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        kinds |= {event.kind for event in moment.events}
        if begin < float("inf"):
            late.add(1e-3 * delay)
            handed_on += 1
        if time.monotonic() - begin > LINE_SECONDS:
            break
    memory[1] = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    lost = scene.driver.counters.dropped - before
    with capsys.disabled():
        p50, p99 = late.quantile(0.5), late.quantile(0.99)
        print(
            f"\n{handed_on} frames in {LINE_SECONDS:g} s, {lost} lost; from arrival to events "
            f"{p50:.0f} µs, 99 %: {p99:.0f} µs; memory grew by {memory[1] - memory[0]} KiB"
        )
    assert {"contact", "slip"} <= kinds
    assert lost == 0
    if LINE_SECONDS >= LONG:
        assert p99 < PROMISED_US
        assert memory[1] - memory[0] < FLAT_KIB
    # less than the rate says on a machine that is busy: late scans are not lost
    assert handed_on > 500 * LINE_SECONDS
    assert process.poll() is None


@pytest.mark.parametrize(
    ("target", "ours"),
    [
        *((f"/dev/{name}", False) for name in ("ttyUSB0", "ttyS0", "tty.usbmodem1", "ptmx")),
        *((f"/dev/{name}", True) for name in ("pts/999999", "ttys999")),
    ],
)
def test_a_link_to_a_port_is_the_users(tmp_path: Path, target: str, ours: bool) -> None:
    """A name that the user gave to a port stays; a link that another line left is taken."""
    link = tmp_path / "array"
    link.symlink_to(target)
    if ours:
        VirtualLine(link).close()
        return
    with pytest.raises(PortError, match="not a link to a pseudo-terminal"):
        VirtualLine(link)
    assert str(link.readlink()) == target


@pytest.mark.parametrize("protocol", ["open", "pts2", "m0404s", "robotiq-tsf85", "3d-vitac"])
def test_what_sends_at_a_port_is_guessed(tmp_path: Path, protocol: str) -> None:
    with offered(tmp_path / "tty", protocol):
        found = guess(PortInfo(str(tmp_path / "tty"), "a test"))
    assert found.protocol == protocol
    assert "taxels" in found.said


def test_a_silent_port_and_one_that_is_not_there_are_reported(tmp_path: Path) -> None:
    line = VirtualLine(tmp_path / "quiet")
    assert "silent" in guess(PortInfo(str(tmp_path / "quiet"), ""), seconds=0.05).said
    line.close()
    assert "There is no port" in guess(PortInfo(str(tmp_path / "gone"), "")).said


def test_a_live_scene_has_one_pass(tmp_path: Path) -> None:
    array = {"driver": "serial", "port": str(tmp_path / "tty")}
    with offered(tmp_path / "tty"):
        scene = load_scene("contact", changes={"array": array})
        assert len(list(islice(scene.results(), 5))) == 5
        with pytest.raises(SceneError, match=r"is live.*load the scene again"):
            next(scene.results())
