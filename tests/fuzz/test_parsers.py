"""Files and bytes of every format, damaged: they are read, or refused in one sentence."""

import tempfile
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import strategies as st

import cnnum
from cnnum.drivers import open_driver
from cnnum.drivers.own_data.proposal import propose
from cnnum.drivers.serial_packet import Geometry, Packet, StreamDecoder, decode, encode
from cnnum.errors import RecordingWarning
from cnnum.frame import Frame
from cnnum.recordings.layout import Layout
from cnnum.recordings.mcap_chunks import ChunkMaker, beginning
from cnnum.scenes.scene_file import read_scene
from cnnum.tactile.array_calibration import read_array_calibration
from cnnum.tactile.taxel import Calibration, Coupling, Taxel
from cnnum.templating.files import load_entry

ROOT = Path(__file__).parents[2]

NUMBERS = ["-1", "0", "1e999", "nan", "-inf", "9" * 400, "0.5e-320", "12_3", "0x10", "1979-05-27"]
WORDS = [*NUMBERS, "", "true", '"a"', "[]", "[[1, 2], [3]]", "{a = 1}", "\0", "\x1a", "ä", "\ud7ff"]
EDITS = st.lists(
    st.tuples(
        st.sampled_from(["cut", "flip", "drop", "repeat", "insert", "swap", "word", "line"]),
        st.floats(0.0, 1.0),
        st.floats(0.0, 1.0),
        st.integers(0, 255),
        st.sampled_from(WORDS),
    ),
    max_size=4,
)


def damaged(data: bytes, edits) -> bytes:
    """Bytes after some edits at places that are shares of their length."""
    for kind, at, to, byte, word in edits:
        first, last = sorted(int(share * len(data)) for share in (at, to))
        short = min(last, first + 40)
        if kind == "cut":
            data = data[:first]
        elif kind == "flip" and first < len(data):
            data = data[:first] + bytes([data[first] ^ (byte or 1)]) + data[first + 1 :]
        elif kind == "drop":
            data = data[:first] + data[short:]
        elif kind == "repeat":
            data = data[:short] + data[first:short] * (byte % 8) + data[short:]
        elif kind == "insert":
            data = data[:first] + bytes([byte]) * (byte % 9) + data[first:]
        elif kind == "swap":
            data = data[:first] + data[short:last] + data[first:short] + data[last:]
        elif kind == "word":
            data = replaced(data, at, word.encode())
        elif kind == "line":
            lines = data.split(b"\n")
            del lines[min(int(at * len(lines)), len(lines) - 1)]
            data = b"\n".join(lines)
    return data


def replaced(data: bytes, at: float, word: bytes) -> bytes:
    """Bytes with one of the words between blanks, equal signs and commas replaced."""
    parts = data.replace(b"=", b" = ").replace(b",", b" , ").split(b" ")
    parts[min(int(at * len(parts)), len(parts) - 1)] = word
    return b" ".join(parts)


def through_file(read: Callable[[Path], object], suffix: str) -> Callable[[bytes], object]:
    """A parser of bytes that go through a file."""

    def call(data: bytes) -> object:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / f"case{suffix}"
            path.write_bytes(data)
            return read(path)

    return call


def all_frames(driver: str) -> Callable[[Path], object]:
    def read(path: Path) -> object:
        with open_driver(driver, {"path": str(path)}) as opened:
            return [frame.values.sum() for frame, _ in zip(opened.frames(), range(1000))]  # noqa: B905

    return read


def mcap() -> bytes:
    layout = Layout((1, 2), ("normal",), "V", 100.0, ())
    maker, data = ChunkMaker(layout), beginning()
    for first in (0, 4):
        for n in range(first, first + 4):
            values = np.full((1, 2, 1), 0.1 * n)
            maker.add(Frame(values, ("normal",), "V", n, n / 100.0), 10**18 + n)
        data += maker.end()
    return data


def archive(suffix: str) -> bytes:
    frames = np.linspace(0.0, 1.0, 48).reshape(4, 2, 2, 3)
    with tempfile.TemporaryDirectory() as folder:
        path = cnnum.Recording(frames, rate=100.0).save(Path(folder) / f"one{suffix}")
        return Path(path).read_bytes()


LAYOUTS = {
    "text table": ('shape = [1, 2]\nchannels = ["z"]\nvalues = "t{n}"\ntime = "t"\n', ".csv"),
    "blocks": ('shape = [2, 2]\nchannels = ["z"]\nblock = true\ntime = "Time"\n', ".txt"),
    "lines of JSON": ('shape = [1, 2]\nchannels = ["z"]\nvalues = "d"\ntime = "t"\n', ".jsonl"),
    "messages": ('shape = [1, 2]\nchannels = ["z"]\ntopic = "/a"\nvalues = "d"\n', ".mcap"),
    "packets": ('shape = [4, 4]\nprotocol = "xela"\nrate = 100.0\n', ".log"),
}
TEXTS = {
    "text table": b"# a log\nt,t0,t1\n2024-05-03 12:00:00.25,1,NA\n2024-05-03 12:00:00.5,2,3,\n",
    "blocks": b"ROWS 2\nTime 0.1\n1,2\n3,4\n\nTime 0.2\n1,2\n3,5\n\nTime 0.3\n1,2\n3,5\n",
    "lines of JSON": b"".join(b'{"t": %d, "d": [1, 2.5]}\n' % n for n in range(4)),
    "packets": b'{"message": 1, "1": {"sensor": 1, "time": 1.0, "taxels": 16, "data": "%s"}}\n'
    % b",".join(b"8000" for _ in range(48)),
}


def by_layout(name: str) -> Callable[[Path], object]:
    """Reads a file of others by its layout, and then looks for one."""
    layout, _ = LAYOUTS[name]

    def read(path: Path) -> object:
        path.with_suffix(".toml").write_text(layout)
        try:
            return cnnum.load_recording(path)
        finally:
            propose(path)

    return read


def others_mcap() -> bytes:
    from io import BytesIO

    from mcap.writer import Writer

    data = BytesIO()
    writer = Writer(data, use_chunking=False)
    writer.start()
    schema = writer.register_schema("s", "jsonschema", b"{}")
    channel = writer.register_channel("/a", "json", schema)
    for n in range(4):
        writer.add_message(channel, 10**18 + n * 10_000_000, b'{"d": [1, 2]}', n)
    writer.finish()
    return data.getvalue()


def template(suffix: str) -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"one{suffix}"
        plain = cnnum.get_template("EDGE")
        cnnum.save_template(plain, path)
        return path.read_bytes()


def packets() -> bytes:
    geometry = Geometry(2, 2, 3, cell=3)
    values = np.arange(12, dtype="<u2").reshape(2, 2, 3)
    return b"".join(encode(Packet(geometry, values, n, 10 * n)) for n in range(3))


def stream(data: bytes) -> object:
    decoder = StreamDecoder()
    found = [decoder.feed(data[at : at + 7]) for at in range(0, len(data), 7)]
    return found, decoder.flush()


def calibration() -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "taxels.toml"
        Taxel(Coupling.nominal()).calibration(200e-6).save(path)
        return path.read_bytes()


ARRAY = b'offset = 3.0\ngain = [[1.0, 2.0], [0.5, 1.0]]\nunit = "N"\n'
TEM = (
    b"NEIGHBORHOOD 1\n\nFEEDBACK\n0 1 0\n1 2 1\n0 1 0\n\nCONTROL\n0 0 0\n0 4 0\n0 0 0\n\n"
    b"NONLIN_D x-u#\n0 a 0\na 0 a\n0 a 0\na 1 2 -1 -1 1 1\n\nCURRENT -0.5\n"
)
LIBRARY = (
    b"%Setting: IniState:P, BoundCond: 'Zeroflux'\nMINE_A = [0 1 0; 1 2 1; 0 1 0];\n"
    b"MINE_B = [0 0 0; 0 4 0; 0 0 0];\nMINE_Ib = -1;\nMINE_d = [0 1 2 -1 1 1 -1];\n"
)

PARSERS = {
    "template TOML": (
        lambda: (ROOT / "templates/delayed/delayed_wave.toml").read_bytes(),
        through_file(load_entry, ".toml"),
    ),
    "plain template TOML": (lambda: template(".toml"), through_file(cnnum.load_template, ".toml")),
    "tem": (lambda: TEM, through_file(cnnum.load_template, ".tem")),
    "temlib.m": (lambda: LIBRARY, through_file(cnnum.load_template, ".m")),
    "CNNSim": (lambda: template(".cnnsim"), through_file(cnnum.load_template, ".cnnsim")),
    "scene TOML": (
        lambda: (ROOT / "cnnum/scenes/slip.toml").read_bytes(),
        through_file(lambda path: read_scene(str(path)), ".toml"),
    ),
    "csv": (lambda: archive(".csv"), through_file(cnnum.load_recording, ".csv")),
    "npz": (lambda: archive(".npz"), through_file(cnnum.load_recording, ".npz")),
    **{
        name: (lambda name=name: TEXTS[name], through_file(by_layout(name), LAYOUTS[name][1]))
        for name in TEXTS
    },
    "messages": (others_mcap, through_file(by_layout("messages"), ".mcap")),
    "mcap": (mcap, through_file(all_frames("mcap"), ".mcap")),
    "serial packet": (lambda: packets()[: len(packets()) // 3], decode),
    "serial stream": (packets, stream),
    "taxel calibration": (calibration, through_file(Calibration.load, ".toml")),
    "array calibration": (lambda: ARRAY, through_file(read_array_calibration, ".toml")),
}


@pytest.mark.parametrize("name", PARSERS)
def test_damaged_files_are_read_or_refused(name, fuzz):
    seed, parse = PARSERS[name]
    data = seed()
    with warnings.catch_warnings():  # a recording that was not closed is whole, but for its index
        warnings.simplefilter("ignore", RecordingWarning)
        parse(data)  # so that damage is near a file that the parser knows
    fuzz(EDITS.map(lambda edits: damaged(data, edits)), parse)


@pytest.mark.parametrize("name", PARSERS)
def test_any_bytes_are_read_or_refused(name, fuzz):
    _, parse = PARSERS[name]
    texts = st.lists(st.sampled_from(WORDS) | st.text(max_size=8), max_size=12)
    as_bytes = st.tuples(texts, st.sampled_from([" ", "\n", "", " = ", ","])).map(
        lambda case: case[1].join(case[0]).encode()
    )
    fuzz(st.binary(max_size=200) | as_bytes, parse, short=15)
