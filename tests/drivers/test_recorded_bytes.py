"""Raw bytes, calibration and scene in a recording: written, kept by recover, read by others."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

from cnnum.cli.root import main
from cnnum.drivers.codecs.wire import wire
from cnnum.drivers.registry import open_driver
from cnnum.drivers.serial_array import SerialOptions
from cnnum.recordings.reader import look
from cnnum.tactile.taxel import Calibration


def invoke(*arguments: object) -> Any:
    result = CliRunner().invoke(main, [str(argument) for argument in arguments])
    assert result.exit_code == 0, result.output
    return result


@pytest.fixture(scope="module")
def simulated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("attached")
    scene = folder / "press.toml"
    scene.write_text(
        'name = "press"\nneeds = ["contact"]\n[array]\ndriver = "simulated"\nshape = [3, 3]\n'
        'script = [{kind = "press", load = 1.0, duration = 0.2}]\n'
    )
    path = folder / "press.mcap"
    invoke("record", scene, path)
    return path


def test_calibration_and_scene_travel_with_the_frames(simulated: Path) -> None:
    with simulated.open("rb") as file:
        reader = make_reader(file)
        held = {one.name: one.data.decode() for one in reader.iter_attachments()}
        summary = reader.get_summary()
    assert summary is not None
    assert summary.statistics is not None
    assert summary.statistics.attachment_count == len(summary.attachment_indexes) == 2
    assert held["scene.toml"] == simulated.with_name("press.toml").read_text()
    known = Calibration.from_text(held["calibration.toml"], simulated)
    with open_driver("mcap", {"path": str(simulated)}) as driver:
        ids = {frame.calibration for frame in driver.frames()}
    assert ids == {known.identity}
    assert len(known.identity) == 12


@pytest.mark.parametrize("suffix", [".npz", ".csv"])
def test_the_id_of_a_calibration_is_the_same_in_every_kind_of_file(
    simulated: Path, suffix: str
) -> None:
    other = simulated.with_suffix(suffix)
    invoke("recover", simulated, other)
    ids = set()
    for path, driver in ((simulated, "mcap"), (other, "npz" if suffix == ".npz" else "file")):
        with open_driver(driver, {"path": str(path)}) as source:
            ids |= {frame.calibration for frame in source.frames()}
    assert len(ids) == 1
    assert "" not in ids


def test_a_damaged_attachment_is_left_out_and_costs_no_frame(simulated: Path) -> None:
    data = bytearray(simulated.read_bytes())
    data[data.index(b"press") + 2] ^= 1
    path = simulated.with_name("damaged.mcap")
    path.write_bytes(data)
    contents = look(path)
    assert [one.name for one in contents.held] == ["calibration.toml"]
    assert contents.frames == look(simulated).frames


def recorded(device: Any, link: Path, frames: Callable[..., bytes], *more: str) -> Path:
    """Record 50 frames from a port, with noise between them."""
    device.write(frames())
    path = link.with_name("port.mcap")
    arguments = ["record", "serial", path, "--set", f"port={link}", "--frames", "50", *more]
    said = json.loads(invoke(*arguments, "--json").stdout.splitlines()[-1])
    assert said["frames"] == 50
    return path


@pytest.fixture
def stream() -> Callable[..., bytes]:
    from cnnum.drivers.serve import packets

    def made() -> bytes:
        with open_driver("simulated", {"shape": [3, 3], "script": PRESS_SCRIPT}) as driver:
            data = list(packets(list(driver.frames())[:50], 500.0))
        return b"noise" + b"?".join(data)

    return made


PRESS_SCRIPT = [{"kind": "press", "load": 1.0, "duration": 0.6}]


def test_the_bytes_of_a_port_are_kept_and_decode_to_the_same_frames(
    device: Any, link: Path, stream: Callable[..., bytes]
) -> None:
    path = recorded(device, link, stream)
    contents = look(path)
    data = b"".join(part for _, part in contents.raw())
    assert data.startswith(b"noise")
    assert stream().startswith(data)
    scans = wire("open").decoder().feed(data)
    frames = [frame for frame, _ in contents.stored()]
    assert len(frames) == contents.frames == 50
    for scan, frame in zip(scans, frames, strict=False):
        assert (scan.values == frame.values).all()
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        seen = [
            (channel.topic, bytes(message.data))
            for _, channel, _, message in reader.iter_decoded_messages(topics=["/raw"])
        ]
    assert b"".join(part for _, part in seen) == data
    assert {topic for topic, _ in seen} == {"/raw"}


def test_recover_keeps_the_bytes_and_the_files(
    device: Any, link: Path, stream: Callable[..., bytes]
) -> None:
    path = recorded(device, link, stream)
    torn = path.with_name("torn.mcap")
    torn.write_bytes(path.read_bytes()[:-300])
    invoke("recover", torn, link.with_name("whole.mcap"))
    whole = look(link.with_name("whole.mcap"))
    assert whole.whole
    assert list(whole.raw()) == list(look(path).raw())
    assert whole.frames == 50


def test_without_raw_there_are_frames_alone(
    device: Any, link: Path, stream: Callable[..., bytes]
) -> None:
    path = recorded(device, link, stream, "--no-raw")
    assert list(look(path).raw()) == []
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    assert [channel.topic for channel in summary.channels.values()] == ["/taxels"]


def test_early_bytes_are_bounded_and_forgotten_once_frames_are_taken(
    device: Any, link: Path, stream: Callable[..., bytes]
) -> None:
    device.write(stream())
    with SerialOptions(str(link), timeout=2.0).open() as array:
        next(array.frames())
        came: list[bytes] = []
        array.tap(lambda data, _: came.append(data))
        assert b"noise" not in b"".join(came)
