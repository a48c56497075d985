"""Sinks for Rerun, Foxglove and ROS 2: their calls, seen by stand-ins, and files of the libraries.

`pip install .[foxglove]` lets the tests of a real file and a real server of Foxglove run.
"""

import array
import json
import socket
import sys
from collections import Counter
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from cnnum.cli.root import main
from cnnum.live.foxglove_sink import FoxgloveSink
from cnnum.scenes.pipeline import load_scene

SCENE = """
name = "slide"
needs = ["contact"]
[array]
driver = "simulated"
rate = 240.0
shape = [8, 8]
start = [0.0024, 0.0018]
script = [{kind = "press", load = 1.0, duration = 0.5}]
"""
PRESSED = 5, 5
"""Row and column of the start: 1.2 and 1.6 pitches of 1.5 mm from the middle."""


class Stream:
    """Keeps all that is logged, with its time."""

    def __init__(self, name: str) -> None:
        self.name, self.target, self.closed = name, "", False
        self.logged: list[tuple[str, dict[str, Any], Any]] = []
        self.now: dict[str, Any] = {}

    def set_time(self, timeline: str, **value: Any) -> None:
        (self.now[timeline],) = value.values()

    def log(self, path: str, what: Any) -> None:
        self.logged.append((path, dict(self.now), what))

    def save(self, path: Path) -> None:
        self.target = path.suffix
        path.write_bytes(b"RRF2")

    def connect_grpc(self, address: str) -> None:
        self.target = address

    def disconnect(self) -> None:
        self.closed = True


@pytest.fixture
def streams(monkeypatch: pytest.MonkeyPatch) -> list[Stream]:
    made: list[Stream] = []

    def stream(name: str) -> Stream:
        made.append(Stream(name))
        return made[-1]

    stand_in = SimpleNamespace(
        RecordingStream=stream,
        DepthImage=lambda image: image,
        Arrows2D=lambda **arrows: arrows,
        Scalars=float,
        TextLog=json.loads,
    )
    monkeypatch.setitem(sys.modules, "rerun", stand_in)
    return made


def run(tmp_path: Path, target: str, option: str = "--rerun") -> Any:
    scene = tmp_path / "slide.toml"
    scene.write_text(SCENE)
    arguments = ["run", str(scene), "--set", "engine.name=numba", option, target]
    return CliRunner().invoke(main, arguments)


@pytest.mark.parametrize("target", ["slide.rrd", "rerun+http://127.0.0.1:9876/proxy"])
def test_pictures_and_events_are_logged(tmp_path: Path, streams: list[Stream], target: str) -> None:
    address = "://" in target
    done = run(tmp_path, target if address else str(tmp_path / target))
    assert done.exit_code == 0, done.output
    (stream,) = streams
    asked = target if address else ".rrd"
    assert (stream.name, stream.target, stream.closed) == ("cnnum slide", asked, True)
    assert address or (tmp_path / target).read_bytes() == b"RRF2"
    counts = Counter(path for path, _, _ in stream.logged)
    times = [now["time"] for path, now, _ in stream.logged if path == "load"]
    assert min(np.diff(times)) >= 1 / 60 - 1e-9
    assert counts["array/normal"] == counts["array/shear"] == counts["load"] == len(times) > 25
    (event, *_) = [what for path, _, what in stream.logged if path == "events"]
    assert event["kind"] == "contact"
    last = {path: what for path, _, what in stream.logged}
    assert last["array/normal"].shape == (8, 8)
    assert last["load"] == pytest.approx(last["array/normal"].sum(), rel=1e-6)
    places, arrows = last["array/shear"]["origins"], last["array/shear"]["vectors"]
    assert places[9].tolist() == [1.5, 1.5]
    assert 0 < np.hypot(*arrows.T).max() <= 0.46 + 1e-12


@pytest.mark.parametrize(
    ("option", "target", "sentence"),
    [
        ("--rerun", "slide.txt", "ends in .rrd"),
        ("--rerun", "slide.rrd", "pip install '.[rerun]'"),
        ("--foxglove", "slide.txt", "ends in .mcap"),
        ("--foxglove", "ws://127.0.0.1:x", "an address to serve at"),
        ("--foxglove", "ws://[::1", "an address to serve at"),
        ("--foxglove", "ws://:8765", "an address to serve at"),
        ("--foxglove", "slide.mcap", "pip install '.[foxglove]'"),
    ],
)
def test_a_wrong_target_and_a_missing_library_are_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, option: str, target: str, sentence: str
) -> None:
    for name in ("rerun", "foxglove"):
        monkeypatch.setitem(sys.modules, name, None)
    done = run(tmp_path, target, option)
    assert done.exit_code == 2
    assert sentence in done.stderr
    assert not (tmp_path / target).exists()


def test_a_file_of_the_library_itself(tmp_path: Path) -> None:
    pytest.importorskip("rerun")
    done = run(tmp_path, str(tmp_path / "slide.rrd"))
    assert done.exit_code == 0, done.output
    assert (tmp_path / "slide.rrd").read_bytes()[:3] == b"RRF"


def seen(messages: list[tuple[str, int, Any]]) -> None:
    """Hold what Foxglove gets, (topic, ns, message), against the scene."""
    counts = Counter(topic for topic, _, _ in messages)
    assert counts["/array/normal"] == counts["/array/shear"] == counts["/load"] > 25
    texts = [json.loads(message.message) for topic, _, message in messages if topic == "/events"]
    assert texts[0]["kind"] == "contact"
    (begun, *_) = [ns for topic, ns, _ in messages if topic == "/events"]
    assert begun == pytest.approx(1e9 * texts[0]["t"], abs=1e3)
    grids, updates, held = (
        [message for own, _, message in messages if own == topic]
        for topic in ("/array/normal", "/array/shear", "/load")
    )
    loads = [(own if isinstance(own, dict) else json.loads(own))["load"] for own in held]
    which = int(np.argmax(loads))
    grid, shear = grids[which], updates[which].entities[0]
    assert (grid.column_count, grid.row_stride, grid.cell_stride) == (8, 32, 4)
    normal = np.frombuffer(grid.data, "<f4").reshape(8, 8)
    assert normal.sum() == pytest.approx(loads[which], rel=1e-6)
    assert loads[which] > 0.0
    row, col = PRESSED
    assert np.unravel_index(np.argmax(normal), (8, 8)) == (7 - row, col)  # its rows go up
    strongest = max(shear.arrows, key=lambda arrow: arrow.shaft_length + arrow.head_length)
    assert 0.0 < strongest.shaft_length + strongest.head_length <= 0.46 + 1e-9
    # shear is the same towards the press from all sides: up and down are not swapped
    outward, middle = np.zeros(2), np.array([col + 0.5, 7.5 - row])
    for arrow in shear.arrows:
        turn = 2.0 * np.arctan2(arrow.pose.orientation.z, arrow.pose.orientation.w)
        place = np.array([arrow.pose.position.x, arrow.pose.position.y])
        outward += (place - middle) * [np.cos(turn), np.sin(turn)] * arrow.shaft_length
    assert outward[0] * outward[1] > 0.0


class Built(SimpleNamespace):
    """A message of the stand-in, by its fields."""


class Messages:
    LogLevel = SimpleNamespace(Info=2)
    PackedElementFieldNumericType = SimpleNamespace(Float32=7)
    Timestamp = staticmethod(lambda sec, nsec: (sec, nsec))

    def __getattr__(self, name: str) -> Any:
        return Built


def test_foxglove_gets_its_own_schemas(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    logged: list[tuple[str, int, Any]] = []
    closed: list[str] = []

    class Channel:
        def __init__(self, topic: str, **options: Any) -> None:
            self._topic = topic

        def log(self, message: Any, log_time: int) -> None:
            logged.append((self._topic, log_time, message))

    def serve(*, name: str, host: str, port: int, context: object) -> Any:
        if port == 1:
            raise OSError("in use")
        return SimpleNamespace(stop=lambda: closed.append(f"{name} {host} {port}"))

    library = SimpleNamespace(Context=object, Channel=Channel, start_server=serve)
    names = ("GridChannel", "SceneUpdateChannel", "LogChannel")
    monkeypatch.setitem(sys.modules, "foxglove", library)
    monkeypatch.setitem(sys.modules, "foxglove.messages", Messages())
    monkeypatch.setitem(
        sys.modules, "foxglove.channels", SimpleNamespace(**dict.fromkeys(names, Channel))
    )
    done = run(tmp_path, "ws://127.0.0.1:1", "--foxglove")
    assert (done.exit_code, logged) == (2, [])
    assert "No server can begin at 'ws://127.0.0.1:1': in use" in done.stderr
    done = run(tmp_path, "ws://127.0.0.1", "--foxglove")
    assert done.exit_code == 0, done.output
    assert closed == ["cnnum slide 127.0.0.1 8765"]
    seen(logged)


def test_a_file_of_foxglove_itself(tmp_path: Path) -> None:
    pytest.importorskip("foxglove")
    decoder = pytest.importorskip("mcap_protobuf.decoder")
    from mcap.reader import make_reader

    done = run(tmp_path, str(tmp_path / "slide.mcap"), "--foxglove")
    assert done.exit_code == 0, done.output
    with (tmp_path / "slide.mcap").open("rb") as file:
        reader, messages = make_reader(file, decoder_factories=[decoder.DecoderFactory()]), []
        schemas = set[str]()
        for schema, channel, message in reader.iter_messages():
            own = schema.encoding == "protobuf"
            schemas.add(schema.name)
            decode = decoder.DecoderFactory().decoder_for("protobuf", schema) if own else json.loads
            messages.append((channel.topic, message.log_time, decode(message.data)))
    assert schemas == {"foxglove.Grid", "foxglove.SceneUpdate", "foxglove.Log", "cnnum.Load"}
    seen(messages)


def test_a_server_of_foxglove_itself(tmp_path: Path) -> None:
    """A client on this machine finds the topics and the schemas of the file."""
    pytest.importorskip("foxglove")
    client = pytest.importorskip("websockets.sync.client")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        address = f"ws://127.0.0.1:{free.getsockname()[1]}"
    (tmp_path / "slide.toml").write_text(SCENE)
    scene = load_scene(tmp_path / "slide.toml", changes={"engine.name": "numba"})
    found = dict[str, str]()
    with (
        scene,
        FoxgloveSink(scene, address) as sink,
        client.connect(address, subprotocols=["foxglove.sdk.v1"]) as link,
    ):
        for moment in scene.results():
            sink.add(moment)
        while len(found) < 4:
            text = link.recv(timeout=30.0)
            for own in json.loads(text).get("channels", ()) if isinstance(text, str) else ():
                found[own["topic"]] = own["schemaName"]
    assert found == {
        "/array/normal": "foxglove.Grid",
        "/array/shear": "foxglove.SceneUpdate",
        "/events": "foxglove.Log",
        "/load": "cnnum.Load",
    }


class Ros:
    """A stand-in of rclpy's interface, as cnnum uses it; it keeps what is published."""

    def __init__(self) -> None:
        self.published: list[tuple[str, Any]] = []
        self.ended, self.fault = list[str](), ""

    def Context(self) -> Any:
        return SimpleNamespace(try_shutdown=lambda: self.ended.append("context"))

    def init(self, *, context: Any) -> None:
        assert context is not None
        if self.fault:
            raise RuntimeError(self.fault)

    def create_node(self, name: str, *, context: Any) -> Any:
        if " " in name:
            raise ValueError("node name must not contain blanks")
        clock = SimpleNamespace(now=lambda: SimpleNamespace(nanoseconds=1_700_000_000_250_000_000))

        def publisher(kind: Any, topic: str, depth: int) -> Any:
            return SimpleNamespace(publish=lambda message: self.published.append((topic, message)))

        return SimpleNamespace(
            create_publisher=publisher,
            get_clock=lambda: clock,
            destroy_node=lambda: self.ended.append("node"),
        )


@pytest.fixture
def ros(monkeypatch: pytest.MonkeyPatch) -> Ros:
    stand_in = Ros()

    def image(**fields: Any) -> Any:
        stamp = SimpleNamespace(sec=0, nanosec=0)
        return SimpleNamespace(header=SimpleNamespace(stamp=stamp, frame_id=""), **fields)

    monkeypatch.setitem(sys.modules, "rclpy", stand_in)
    monkeypatch.setitem(sys.modules, "sensor_msgs.msg", SimpleNamespace(Image=image))
    monkeypatch.setitem(sys.modules, "std_msgs.msg", SimpleNamespace(String=SimpleNamespace))
    return stand_in


def node(tmp_path: Path, *options: str) -> Any:
    (tmp_path / "slide.toml").write_text(SCENE)
    words = ["ros", str(tmp_path / "slide.toml"), "--set", "engine.name=numba", "--json"]
    return CliRunner().invoke(main, [*words, *options])


def test_a_node_publishes_every_frame_and_event(tmp_path: Path, ros: Ros) -> None:
    """Its messages are whole by the definitions of ROS 2, which rosbags has."""
    store = pytest.importorskip("rosbags.typesys")
    types = store.get_typestore(store.Stores.ROS2_HUMBLE)
    done = node(tmp_path, "--speed", "100", "--name", "finger")
    assert done.exit_code == 0, done.output
    assert ros.ended == ["node", "context"]
    told = [json.loads(line) for line in done.stdout.splitlines()]
    images = [message for topic, message in ros.published if topic == "finger/taxels"]
    events = [json.loads(message.data) for topic, message in ros.published if "events" in topic]
    assert len(images) == told[-1]["frames"] > 100
    assert [(event["t"], event["kind"]) for event in events] == [
        (line["t"], line["kind"]) for line in told[:-1]
    ]
    begin = 1_700_000_000_250_000_000
    assert events[0]["stamp"] - begin == pytest.approx(1e9 * events[0]["t"], abs=2e6)
    image, make = images[-1], types.types
    assert isinstance(image.data, array.array)
    stamp = make["builtin_interfaces/msg/Time"](**vars(image.header.stamp))
    header = make["std_msgs/msg/Header"](stamp, image.header.frame_id)
    fields = vars(image) | {"header": header, "data": np.asarray(image.data)}
    raw = types.serialize_cdr(make["sensor_msgs/msg/Image"](**fields), "sensor_msgs/msg/Image")
    again = types.deserialize_cdr(raw, "sensor_msgs/msg/Image")
    assert (again.height, again.width, again.encoding, again.step) == (8, 8, "64FC3", 192)
    every = np.array([np.frombuffer(own.data.tobytes(), "<f8") for own in images])
    values = np.abs(every.reshape(-1, 8, 8, 3)[..., 2])
    assert np.array_equal(every[-1], np.frombuffer(again.data.tobytes(), "<f8"))
    passed = again.header.stamp.sec * 10**9 + again.header.stamp.nanosec - begin
    assert passed == pytest.approx(1e9 * (len(images) - 1) / 240.0, abs=2.0)
    assert np.unravel_index(np.argmax(values), values.shape)[1:] == PRESSED


def test_without_ros_or_with_a_wrong_name_a_sentence_says_so(
    tmp_path: Path, ros: Ros, monkeypatch: pytest.MonkeyPatch
) -> None:
    done = node(tmp_path, "--name", "a b")
    assert done.exit_code == 2
    assert "ROS 2 makes no node 'a b': node name must not contain blanks" in done.stderr
    assert ros.ended == ["context"]
    ros.fault = "ROS_DOMAIN_ID is not an integral number"
    done = node(tmp_path)
    assert done.exit_code == 2
    assert f"ROS 2 makes no node 'cnnum': {ros.fault}" in done.stderr
    monkeypatch.setitem(sys.modules, "rclpy", None)
    done = node(tmp_path)
    assert done.exit_code == 2
    assert "'rclpy' comes with it" in done.stderr
