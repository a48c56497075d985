"""Messages in MCAP files and bags: of others by a layout, and our own after other programs."""

import json
import re
import warnings
import zlib

import numpy as np
import pytest
from foreign_files import rosbag2
from mcap.writer import CompressionType, Writer

import cnnum
from cnnum.drivers import open_driver
from cnnum.drivers.own_data.proposal import propose
from cnnum.errors import CnnumError, RecordingWarning
from cnnum.frame import Quality
from cnnum.recordings.reader import look

NS = 10_000_000
LAYOUT = 'shape = [2, 2]\nchannels = ["x", "y", "z"]\ntopic = "/skin"\n'
VALUES = np.random.default_rng(3).normal(100.0, 5.0, (60, 2, 2, 3))
FORMS = {
    "chunks": {},
    "no chunks": {"use_chunking": False},
    "no checksums": {"enable_crcs": False, "enable_data_crcs": False},
    "packed": {"compression": CompressionType.ZSTD},
    "lz4": {"compression": CompressionType.LZ4},
    "no index": {"use_statistics": False, "use_summary_offsets": False, "repeat_channels": False},
}


def made(path, fill, order=None, **form):
    """An MCAP file of 60 messages."""
    with path.open("wb") as file:
        writer = Writer(file, **form)
        writer.start()
        send = fill(writer)
        for n in range(60) if order is None else order:
            send(n, 10**18 + n * NS)
        writer.finish()
    return path


def as_json(writer):
    schema = writer.register_schema("Touch", "jsonschema", b"{}")
    channel = writer.register_channel("/skin", "json", schema)
    other = writer.register_channel("/other", "json", schema)

    def send(n, when):
        content = {"header": {"stamp": {"sec": 5, "nanosec": n * NS}}, "data": VALUES[n].tolist()}
        writer.add_message(channel, when, json.dumps(content).encode(), when)
        writer.add_message(other, when, b'{"data": [1, 2]}', when)

    return send


def read(path, layout):
    path.with_suffix(".toml").write_text(layout)
    return cnnum.load_recording(path)


@pytest.mark.parametrize("form", FORMS)
def test_json_in_every_form_of_mcap(form, tmp_path):
    path = made(tmp_path / "a.mcap", as_json, **FORMS[form])
    for time in ("", 'time = "header.stamp"\n'):
        recording = read(path, LAYOUT + 'values = "data"\n' + time)
        assert np.array_equal(recording.values, VALUES)
        assert recording.times == pytest.approx(np.arange(60) / 100.0, abs=1e-9)


def test_a_layout_that_names_no_field_means_values(tmp_path):
    """All numbers of a message were taken, and its time with them."""
    lines = [{"t": n / 100.0, "values": one.tolist()} for n, one in enumerate(VALUES)]
    (tmp_path / "a.jsonl").write_text("\n".join(map(json.dumps, lines)))
    assert np.array_equal(read(tmp_path / "a.jsonl", LAYOUT + 'time = "t"\n').values, VALUES)


SPOILT = {
    "a field that is missing": (lambda one: {"header": one["header"]}, "has no field 'data'"),
    "a list that is cut off": (lambda one: one | {"data": [1.0]}, "has the shape (1,)"),
    "a word": (lambda one: one | {"data": "none"}, "does not contain numbers of one shape"),
    "null": (lambda one: one | {"data": None}, "has the shape ()"),
    "a time that is missing": (lambda one: {"data": one["data"]}, "no 'header'"),
}


@pytest.mark.parametrize("suffix", [".mcap", ".jsonl"])
@pytest.mark.parametrize("what", SPOILT)
@pytest.mark.parametrize("bad", [(0,), (7, 8, 30)])
def test_messages_without_their_field_are_bad_frames_that_are_said(what, suffix, bad, tmp_path):
    """One such message refused the whole file."""
    spoil, said = SPOILT[what]
    lines = [
        {"header": {"stamp": {"sec": 5, "nanosec": n * NS}}, "data": VALUES[n].tolist()}
        for n in range(60)
    ]
    lines = [spoil(one) if n in bad else one for n, one in enumerate(lines)]
    path = tmp_path / f"a{suffix}"
    if suffix == ".jsonl":
        path.write_text("\n".join(map(json.dumps, lines)) + "\n")
    else:

        def fill(writer):
            schema = writer.register_schema("Touch", "jsonschema", b"{}")
            channel = writer.register_channel("/skin", "json", schema)
            return lambda n, at: writer.add_message(channel, at, json.dumps(lines[n]).encode(), at)

        made(path, fill)
    proposal = propose(path)
    assert proposal.table["values"] == "data"
    if suffix == ".jsonl":
        assert proposal.table["time"] == "header.stamp"
    assert proposal.table["shape"] == (2, 2)
    layout = LAYOUT if suffix == ".mcap" else LAYOUT.replace('topic = "/skin"\n', "")
    pattern = rf"^{len(bad)} of 60 messages are bad.*{re.escape(said)}"
    with pytest.warns(RecordingWarning, match=pattern):
        recording = read(path, layout + 'values = "data"\ntime = "header.stamp"\n')
    good = [n for n in range(60) if n not in bad]
    if "time" in what:
        np.testing.assert_array_equal(recording.values, VALUES[good])
    else:
        assert np.isnan(recording.values).all(axis=(1, 2, 3)).nonzero()[0].tolist() == list(bad)
        np.testing.assert_array_equal(recording.values[good], VALUES[good])
    assert recording.rate == pytest.approx(100.0)


def test_lines_of_json_that_are_cut_off_or_torn_are_said(tmp_path):
    lines = [json.dumps({"t": n / 100.0, "data": VALUES[n].tolist()}) for n in range(60)]
    lines[20], lines[30] = lines[20][:40], '{"status": "ok"}'
    path = tmp_path / "a.jsonl"
    path.write_text("\n".join(lines)[:-30])
    assert propose(path).table["time"] == "t"
    with pytest.warns(RecordingWarning, match=r"3 of 60 messages are bad.*line 21: expected JSON"):
        recording = read(path, LAYOUT.replace('topic = "/skin"\n', 'values = "data"\ntime = "t"\n'))
    np.testing.assert_array_equal(recording.values, np.delete(VALUES[:59], [20, 30], axis=0))


def test_a_message_with_all_frames_is_one_sentence(tmp_path):
    path = tmp_path / "a.json"
    path.write_text(json.dumps({"time": list(range(60)), "data": VALUES.tolist()}))
    with pytest.raises(CnnumError, match=r"all frames in one message, 'data' .*numpy\.savez"):
        propose(path)


def test_a_bad_message_that_is_there_twice_is_a_repeat(tmp_path):
    """It was a frame of its own, at the time of the one before, so that the rate was 101.7 Hz."""

    def fill(writer):
        schema = writer.register_schema("Touch", "jsonschema", b"{}")
        channel = writer.register_channel("/skin", "json", schema)

        def send(n, when):
            data = json.dumps({"data": None if n == 0 else VALUES[n].tolist()}).encode()
            for _ in range(2):
                writer.add_message(channel, when, data, when)

        return send

    with pytest.warns(RecordingWarning, match="2 of 120 messages are bad"):
        recording = read(made(tmp_path / "a.mcap", fill), LAYOUT + 'values = "data"\n')
    assert int((recording.quality & int(Quality.REPEATED) != 0).sum()) == 60
    assert recording.rate == pytest.approx(100.0, rel=1e-6)


def test_any_order_is_sorted_and_said(tmp_path):
    order = np.random.default_rng(1).permutation(60).tolist()
    path = made(tmp_path / "a.mcap", as_json, order, use_chunking=False)
    with pytest.warns(RecordingWarning, match="sorted by their log times"):
        assert np.array_equal(read(path, LAYOUT + 'values = "data"\n').values, VALUES)


def test_messages_that_are_there_twice_are_repeats(tmp_path):
    path = made(tmp_path / "a.mcap", as_json, np.repeat(np.arange(60), 2).tolist())
    recording = read(path, LAYOUT + 'values = "data"\n')
    assert recording.quality.tolist() == [0, 2] * 60
    assert recording.rate == pytest.approx(100.0)


def as_protobuf(writer):
    pytest.importorskip("mcap_protobuf", reason="the extra 'bags' is not installed")
    from google.protobuf import descriptor_pb2, descriptor_pool, message_factory

    described = descriptor_pb2.FileDescriptorProto(name="t.proto", package="t", syntax="proto3")
    vector, touch = described.message_type.add(), described.message_type.add()
    vector.name, touch.name = "V", "Touch"
    for n, name in enumerate("xyz", 1):
        vector.field.add(name=name, number=n, type=1, label=1)
    touch.field.add(name="taxels", number=1, type=11, label=3, type_name=".t.V")
    pool = descriptor_pool.DescriptorPool()
    pool.Add(described)
    kind = message_factory.GetMessageClass(pool.FindMessageTypeByName("t.Touch"))
    files = descriptor_pb2.FileDescriptorSet(file=[described]).SerializeToString()
    schema = writer.register_schema("t.Touch", "protobuf", files)
    channel = writer.register_channel("/skin", "protobuf", schema)

    def send(n, when):
        message = kind()
        for x, y, z in VALUES[n].reshape(-1, 3).tolist():
            message.taxels.add(x=x, y=y, z=z)
        writer.add_message(channel, when, message.SerializeToString(), when)

    return send


def as_ros2(writer):
    pytest.importorskip("rosbags", reason="the extra 'bags' is not installed")
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    kind = "std_msgs/msg/Float64MultiArray"
    text, _ = store.generate_msgdef(kind, ros_version=2)
    schema = writer.register_schema(kind, "ros2msg", text.encode())
    channel = writer.register_channel("/skin", "cdr", schema)
    empty = store.types["std_msgs/msg/MultiArrayLayout"]([], 0)

    def send(n, when):
        message = store.types[kind](empty, VALUES[n].ravel())
        writer.add_message(channel, when, bytes(store.serialize_cdr(message, kind)), when)

    return send


@pytest.mark.parametrize(("fill", "field"), [(as_protobuf, "taxels"), (as_ros2, "data")])
def test_protobuf_and_ros_2(fill, field, tmp_path):
    recording = read(made(tmp_path / "a.mcap", fill), LAYOUT + f'values = "{field}"\n')
    assert np.array_equal(recording.values, VALUES)


def test_a_bag_of_ros_1(tmp_path):
    pytest.importorskip("rosbags", reason="the extra 'bags' is not installed")
    from rosbags.rosbag1 import Writer as Writer1
    from rosbags.typesys import Stores, get_typestore

    store, kind = get_typestore(Stores.ROS1_NOETIC), "geometry_msgs/msg/WrenchStamped"
    types = store.types
    path = tmp_path / "a.bag"
    with Writer1(path) as writer:
        connection = writer.add_connection("/wrench", kind, typestore=store)
        for n in range(60):
            force = types["geometry_msgs/msg/Vector3"](*map(float, VALUES[n, 0, 0]))
            stamp = types["builtin_interfaces/msg/Time"](5, n * NS)
            message = types[kind](
                types["std_msgs/msg/Header"](n, stamp, "pad"),
                types["geometry_msgs/msg/Wrench"](force, force),
            )
            writer.write(connection, 10**18 + n * NS, store.serialize_ros1(message, kind))
    layout = 'shape = [1, 1]\ntopic = "/wrench"\nvalues = "wrench.force"\ntime = "header.stamp"\n'
    recording = read(path, layout)
    assert np.array_equal(recording.values[:, 0, 0], VALUES[:, 0, 0])
    assert recording.rate == pytest.approx(100.0)


def bag(path, messages, version):
    """A bag of some of the messages; of ROS 1 a file, of ROS 2 a folder."""
    pytest.importorskip("rosbags", reason="the extra 'bags' is not installed")
    from rosbags.rosbag1 import Writer as Writer1
    from rosbags.rosbag2 import Writer as Writer2
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC if version == 1 else Stores.ROS2_HUMBLE)
    kind, write = "std_msgs/msg/Float64MultiArray", store.serialize_ros1
    if version == 2:
        write = store.serialize_cdr
    empty = store.types["std_msgs/msg/MultiArrayLayout"]([], 0)
    with Writer1(path) if version == 1 else Writer2(path, version=9) as writer:
        connection = writer.add_connection("/skin", kind, typestore=store)
        for n in messages:
            message = store.types[kind](empty, VALUES[n].ravel())
            writer.write(connection, 10**18 + n * NS, write(message, kind))


@pytest.mark.parametrize(
    "kind", ["one of ROS 1", "parts of ROS 1", "several of ROS 2", "one of ROS 2 without metadata"]
)
def test_a_folder_of_bags_is_one_recording(kind, call, tmp_path):
    folder = tmp_path / "bags"
    version = 1 if "ROS 1" in kind else 2
    if kind.startswith("one of ROS 2"):
        bag(folder, range(60), 2)
        (folder / "metadata.yaml").unlink()
    elif kind.startswith("one"):
        folder.mkdir()
        bag(folder / "a.bag", range(60), 1)
    else:
        folder.mkdir()
        for name, part in (("b", range(25, 60)), ("c", range(25))):
            bag(folder / (name + ".bag" * (version == 1)), part, version)
    done = call("layout", folder, "--set", "shape=[2, 2]", "--write")
    assert done.exit_code == 0
    assert "shape = [2, 2]" in done.stdout
    for read_as in (folder, tmp_path / "own.mcap"):
        recording = cnnum.load_recording(read_as) if read_as.exists() else None
        if recording is None:
            assert call("recover", folder, read_as).exit_code == 0
            recording = cnnum.load_recording(read_as)
        np.testing.assert_array_equal(recording.values, VALUES)
        assert recording.times == pytest.approx(np.arange(60) / 100.0, abs=1e-9)
    checked = call("check", folder)
    assert "The rate is 100 Hz" in checked.stdout
    scene = tmp_path / "s.toml"
    scene.write_text(
        'needs = ["contact"]\n[array]\ndriver = "simulated"\n[program]\nname = "contact"\n'
        'parameters = { push = 1.0 }\n[engine]\nname = "numba"\n'
    )
    assert "60 handed on" in call("replay", folder, "--scene", scene).stdout


def test_a_folder_that_cannot_be_one_recording_is_one_sentence(call, tmp_path):
    folder = tmp_path / "bags"
    folder.mkdir()
    commands = ("layout", "check", "recover")
    for command in commands:
        done = call(command, folder)
        assert done.exit_code == 2
        assert done.stderr.count("\n") == 1
        assert command == "recover" or "*.bag, *.db3, metadata.yaml" in done.stderr
    made(folder / "x.mcap", as_json)
    assert "name 'x.mcap' in it" in call("check", folder).stderr
    bag(folder / "a.bag", range(5), 1)
    bag(folder / "b", range(5), 2)
    said = "contains bags of ROS 1 and of ROS 2 ('a.bag', 'b'): name one of them"
    for command in ("layout", "check"):
        done = call(command, folder)
        assert (done.exit_code, done.stderr.count("\n")) == (2, 1)
        assert said in done.stderr or "There is no layout" in done.stderr


def test_the_topic_on_the_command_line(call, records, tmp_path):
    path = made(tmp_path / "a.mcap", as_json)
    path.with_suffix(".toml").write_text(LAYOUT.replace("/skin", "/other") + 'values = "data"\n')
    scene = tmp_path / "s.toml"
    scene.write_text(
        'needs = ["contact"]\n[array]\ndriver = "simulated"\n[engine]\nname = "numba"\n'
        '[program]\nname = "contact"\n[program.parameters]\npush = 1.0\nreads = "force"\n'
    )
    done = call("replay", path, "--topic", "/skin", "--scene", scene, "--json")
    assert done.exit_code == 0, done.stderr
    assert records(done.stdout)[-1]["frames"] == 60


FAULTS = {
    "no such topic": ('topic = "/skim"\nvalues = "data"\n', r"'/skim'; it has '/skin', '/other'"),
    "no such field": (
        'topic = "/skin"\nvalues = "dada"\n',
        r"no field 'dada'.*it has header, data",
    ),
    "no numbers": ('topic = "/skin"\nvalues = "header.stamp.sec"\n', r"must contain"),
}


@pytest.mark.parametrize("name", FAULTS)
def test_faults_name_what_is_there(name, tmp_path):
    keys, said = FAULTS[name]
    path = made(tmp_path / "a.mcap", as_json)
    with pytest.raises(CnnumError, match=said):
        read(path, "shape = [2, 2]\n" + keys)


def test_messages_of_others_without_a_layout_say_how_to_get_one(tmp_path):
    path = made(tmp_path / "a.mcap", as_json)
    with pytest.raises(CnnumError, match=r"'cnnum layout a\.mcap --topic /skin' proposes one"):
        cnnum.load_recording(path)


@pytest.fixture
def own(tmp_path):
    """A recording of ours, and its messages as the MCAP library reads them."""
    from mcap.reader import make_reader

    whole = cnnum.Recording(VALUES, rate=100.0, unit="N", truth={"slip": np.arange(60) % 5})
    with whole.save(tmp_path / "own.mcap").open("rb") as file:
        return whole, list(make_reader(file).iter_messages())


def repacked(path, every, order, **form):
    """Our messages as another program packs them, or merges files."""
    with path.open("wb") as file:
        writer = Writer(file, **form)
        writer.start()
        schema, channel, _ = every[0]
        number = writer.register_schema(schema.name, schema.encoding, schema.data)
        number = writer.register_channel(
            channel.topic, channel.message_encoding, number, channel.metadata
        )
        for n in order:
            one = every[n][2]
            writer.add_message(number, one.log_time, one.data, one.publish_time, one.sequence)
        writer.finish()
    return path


@pytest.mark.parametrize("form", FORMS)
def test_our_recordings_are_read_after_other_programs(form, own, tmp_path):
    whole, every = own
    path = repacked(tmp_path / "b.mcap", every, range(60), **FORMS[form])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert cnnum.load_recording(path) == whole


@pytest.mark.parametrize("form", ["chunks", "no chunks", "no checksums"])
def test_our_recordings_in_another_order_and_twice(form, own, tmp_path, call):
    whole, every = own
    order = np.random.default_rng(2).permutation(60).tolist()
    path = repacked(tmp_path / "b.mcap", every, order, chunk_size=2000, **FORMS[form])
    with pytest.warns(RecordingWarning, match="sorted by their log times"):
        assert cnnum.load_recording(path) == whole
    # two copies one after the other, and message by message
    for twice in ([*range(60), *range(60)], np.repeat(np.arange(60), 2).tolist()):
        path = repacked(tmp_path / "c.mcap", every, twice, **FORMS[form])
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RecordingWarning)
            with open_driver("mcap", {"path": str(path)}) as driver:
                frames = [frame for frame in driver.frames() if not frame.repeated]
        assert (driver.counters.frames, driver.counters.repeated) == (60, 60)
        assert np.array_equal(np.stack([frame.values for frame in frames]), VALUES)
        out = tmp_path / f"{len(twice)}-{twice[1]}.npz"
        assert call("recover", path, out).exit_code == 0
        assert cnnum.load_recording(out).quality.tolist() == [0, 2] * 60


@pytest.mark.parametrize("form", ["no chunks", "no checksums"])
def test_the_whole_messages_of_a_file_that_was_cut_off(form, own, tmp_path):
    whole, every = own
    path = repacked(tmp_path / "b.mcap", every, range(60), chunk_size=2000, **FORMS[form])
    data = path.read_bytes()
    path.write_bytes(data[: len(data) // 2])
    contents = look(path)
    assert 15 < contents.frames < 45
    assert contents.unreadable > 0
    frames = np.stack([frame.values for frame, _ in contents.stored()])
    assert np.array_equal(frames, whole.values[: len(frames)])
    assert zlib.crc32(path.read_bytes()) == zlib.crc32(data[: len(data) // 2])


@pytest.mark.filterwarnings("default::cnnum.errors.RecordingWarning")
@pytest.mark.parametrize("suffix", [".mcap", ".npz", ".h5", ".csv"])
def test_recover_makes_a_recording_of_messages_of_others(call, records, tmp_path, suffix):
    """A damaged one, too: what is left comes, and what is lost is counted and said."""
    path = made(tmp_path / "others.mcap", as_json, chunk_size=2048)
    path.with_suffix(".toml").write_text(LAYOUT + 'values = "data"\n')
    whole = call("recover", path, tmp_path / f"whole{suffix}", "--json")
    (said,) = records(whole.stdout)
    assert (said["frames"], said["unreadable_bytes"], said["whole"]) == (60, 0, True)
    again = cnnum.load_recording(tmp_path / f"whole{suffix}")
    np.testing.assert_array_equal(again.values, cnnum.load_recording(path).values)
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 0xFF
    path.write_bytes(data)
    with pytest.warns(RecordingWarning, match=r"is damaged: \d+ bytes in 1 places"):
        left = len(cnnum.load_recording(path))
    assert 40 <= left < 60
    torn = call("recover", path, tmp_path / f"torn{suffix}", "--json")
    assert torn.exit_code == 0
    assert "the messages in them are missing" in torn.stderr
    (said,) = records(torn.stdout)
    assert (said["frames"], said["damaged_places"], said["whole"]) == (left, 1, False)
    assert said["missing"] == 60 - left
    assert len(cnnum.load_recording(tmp_path / f"torn{suffix}")) == left


def test_recover_asks_for_a_layout_of_others(call, tmp_path):
    path = made(tmp_path / "others.mcap", as_json)
    done = call("recover", path)
    assert done.exit_code == 2
    assert "'cnnum layout others.mcap --topic /skin' proposes one" in done.stderr
    assert not (tmp_path / "others.recovered.mcap").exists()


def test_recover_reads_a_bag(call, records, tmp_path):
    pytest.importorskip("rosbags")
    path = rosbag2(tmp_path)
    assert call("layout", path, "--write").exit_code == 0
    (said,) = records(call("recover", path, tmp_path / "own.mcap", "--json").stdout)
    own = cnnum.load_recording(tmp_path / "own.mcap")
    np.testing.assert_array_equal(own.values, cnnum.load_recording(path).values)
    assert said["frames"] == len(own) > 100
