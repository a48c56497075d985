"""The server of the live page: who is let in, and that a slow page costs the source nothing."""

import asyncio
import json
import time
from collections.abc import Coroutine
from itertools import count
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import numpy as np
import pytest
from click.testing import CliRunner

from cnnum.cli.root import main
from cnnum.errors import PortError, SceneError
from cnnum.frame import FORCE_AXES, Frame, Quality
from cnnum.live.feeds import ArrayFeed, RecordingFeed
from cnnum.live.hub import CONTACT, DROPPED, HEAD, Hub, encoded, planes
from cnnum.live.server import Gate, Place, serving, static
from cnnum.recordings.recording import Recording
from cnnum.scenes.frame_path import FrameResult
from cnnum.scenes.pipeline import load_scene

websockets = pytest.importorskip("websockets")


GATE = pytest.mark.promise("No other machine and no page of another origin reads the live view.")


class Source:
    """An array that comes at a rate by the clock, or as fast as it is taken."""

    shape, channels, unit, rate = (8, 8), FORCE_AXES, "N", 1000.0

    def __init__(self) -> None:
        from cnnum.drivers.driver import Counters

        self.counters, self.sent, self.closed, self.late = Counters(), 0, False, 0.0

    def frames(self) -> Any:
        begin = time.monotonic()
        for number in count():
            if self.closed:
                return
            wait = begin + number / self.rate - time.monotonic()
            self.late = max(self.late, -wait)
            time.sleep(max(0.0, wait))
            self.sent += 1
            now = time.monotonic_ns()
            values = np.full((8, 8, 3), float(number % 7))
            yield Frame(values, FORCE_AXES, "N", number, number / self.rate, monotonic_ns=now)

    def close(self) -> None:
        self.closed = True


def run(work: Coroutine[Any, Any, None]) -> None:
    asyncio.run(asyncio.wait_for(work, 60.0))


def test_a_picture_holds_what_the_page_draws() -> None:
    values = np.arange(24.0).reshape(2, 4, 3)
    frame = Frame(values, FORCE_AXES, "N", 9, 1.5, Quality.DROPPED_BEFORE)
    outputs = {"contact": np.array(1.0), "contact_map": np.eye(2, 4), "load_normal": np.array(3.5)}
    data = encoded(FrameResult(7, frame, values, outputs, (), 0.0), planes(values, FORCE_AXES))
    number, flags, when, wait, load = HEAD.unpack_from(data)
    assert (number, flags, when, wait, load) == (7, CONTACT | DROPPED, 1.5, 0.0, 3.5)
    shown = np.frombuffer(data, "<f4", 24, HEAD.size).reshape(3, 2, 4)
    np.testing.assert_array_equal(shown, np.moveaxis(values, -1, 0))
    assert list(data[HEAD.size + 96 :]) == [1, 0, 0, 0, 0, 1, 0, 0]


def test_an_array_without_force_axes_shows_its_first_channel() -> None:
    values = np.stack([np.full((2, 2), 5.0), np.full((2, 2), np.nan)], axis=-1)
    shown = planes(values, ("left", "right"))
    assert shown[2].tolist() == [[5.0, 5.0], [5.0, 5.0]]
    assert not shown[:2].any()


@GATE
@pytest.mark.parametrize(
    ("headers", "path", "let_in"),
    [
        ({"Host": "127.0.0.1:8765"}, "/stream", True),
        ({"Host": "localhost:8765", "Origin": "http://localhost:8765"}, "/stream", True),
        ({"Host": "localhost:8765", "Origin": "http://evil.example"}, "/stream", False),
        ({"Host": "127.0.0.1:8765", "Origin": "http://127.0.0.1:9999"}, "/stream", False),
        ({"Host": "127.0.0.1:8765", "Origin": "null"}, "/stream", False),
        ({"Host": "evil.example:8765", "Origin": "http://evil.example:8765"}, "/stream", False),
        ({}, "/stream", False),
    ],
)
def test_only_the_page_itself_reads_the_stream(
    headers: dict[str, str], path: str, let_in: bool
) -> None:
    assert (Gate(Place()).refusal(headers, path) == "") == let_in


@GATE
def test_other_machines_need_a_token() -> None:
    with pytest.raises(SceneError, match="can be reached from other machines"):
        Place("0.0.0.0")
    gate = Gate(Place("0.0.0.0", token="secret"))
    at = {"Host": "192.168.1.5:8765", "Origin": "http://192.168.1.5:8765"}
    assert gate.refusal(at, "/stream?token=secret") == ""
    assert "token" in gate.refusal(at, "/stream")
    assert "token" in gate.refusal(at, "/stream?token=wrong")
    assert "another origin" in gate.refusal({**at, "Origin": "http://a"}, "/stream?token=secret")


@GATE
@pytest.mark.parametrize("token", ["a&b", "a=b#c", "50% +/?", "τ°", " ", "%41"])
def test_the_address_that_is_printed_is_let_in(token: str) -> None:
    place = Place(token=token)
    address = urlsplit(place.address(8765))
    gate, at = Gate(place), {"Host": "127.0.0.1:8765"}
    assert gate.refusal(at, f"/stream?{address.query}") == ""
    assert "token" in gate.refusal(at, f"/stream?{address.query}x")
    assert address.netloc == "127.0.0.1:8765"


@GATE
def test_a_token_that_is_no_text_is_refused() -> None:
    with pytest.raises(SceneError, match="must be text"):
        Place(token="\udcff")


UPGRADE = "Upgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"
UPGRADE += "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n"
LOCAL = "Host: 127.0.0.1\r\n"
MALFORMED = {
    "open bracket": ("/", "Host: [::1\r\n"),
    "open bracket, socket": ("/stream", "Host: [::1\r\n" + UPGRADE),
    "two hosts": ("/", LOCAL * 2),
    "two hosts, socket": ("/stream", LOCAL * 2 + UPGRADE),
    "two upgrades": ("/stream", LOCAL + UPGRADE + "Upgrade: websocket\r\n"),
    "two origins": ("/stream", LOCAL + UPGRADE + "Origin: http://127.0.0.1\r\n" * 2),
    "path of a bracket": ("//[", LOCAL),
    "path of a bracket, socket": ("//[", LOCAL + UPGRADE),
    "long port": ("/", f"Host: 127.0.0.1:{'9' * 4000}\r\n"),
    "long length": ("/", LOCAL + f"Content-Length: {'9' * 5000}\r\n"),
    "long version": ("/stream", LOCAL + UPGRADE.replace("13", "9" * 5000)),
    "no host": ("/", ""),
    "no text": ("/\xff", LOCAL + "X: \xff\r\n"),
}


def test_malformed_requests_and_commands_are_refused_in_silence(
    faults: Any, capfd: pytest.CaptureFixture[str], caplog: pytest.LogCaptureFixture
) -> None:
    """Malformed requests and commands to the live view are refused, and print nothing."""
    from websockets.asyncio.client import connect

    async def work() -> None:
        async with serving(ArrayFeed("a", Source()), Place(port=0)) as (_, _, port):
            for name, (path, headers) in faults.each(list(MALFORMED.items()), short=ALL):
                reader, writer = await asyncio.open_connection("127.0.0.1", port)
                writer.write(f"GET {path} HTTP/1.1\r\n{headers}\r\n".encode("latin-1"))
                head = await asyncio.wait_for(reader.read(200), 5.0)
                assert b" 101 " not in head, name
                assert b" 500 " not in head, name
                writer.close()
            async with connect(f"ws://127.0.0.1:{port}/stream", proxy=None) as page:
                for text in faults.each(SENT, short=ALL):
                    await page.send(text)
                for _ in range(5):
                    await asyncio.wait_for(page.recv(), 5.0)

    run(work())
    said = capfd.readouterr()
    assert "Traceback" not in said.err + caplog.text
    assert not caplog.records


COMMANDS = [
    f'{{"{key}": {value}}}'
    for key in ("seek", "speed", "paused")
    for value in ("9" * 4000, "-" + "9" * 4000, "1e999", "NaN", '"x"', "[]", "true", "null")
]
SENT = [*COMMANDS, "9" * 4000, f'{{"seek": {"9" * 4000}}}', "[" * 4000, "{", "null", b"\xff"]
ALL = 1000


@pytest.mark.promise(
    "Malformed requests and commands to the live view are refused, and print nothing."
)
def test_commands_of_any_number_leave_a_recording_playing(tmp_path: Path) -> None:
    path = tmp_path / "short.npz"
    Recording(np.zeros((50, 8, 8, 3)), rate=100.0, unit="strain").save(path)
    array = {"driver": "npz", "path": str(path)}
    changes = {"array": array, "engine.name": "numba"}
    feed = RecordingFeed(load_scene("demo", changes=changes))
    feed.start()
    for text in COMMANDS:
        feed.command(json.loads(text))
    feed.command({"paused": False, "speed": 1.0, "seek": 0})
    end = time.monotonic() + 30.0
    while feed.hub.frames < 1 and time.monotonic() < end:
        time.sleep(0.01)
    assert feed.hub.frames
    assert feed.hub.ended == ""
    feed.stop()


@pytest.mark.promise("A driver that fails is told to the page, whatever its error.")
def test_the_page_is_told_of_any_error_of_a_driver(caplog: pytest.LogCaptureFixture) -> None:
    class Broken(Source):
        def frames(self) -> Any:
            yield from ()
            raise ZeroDivisionError("of my\ndriver")

    feed = ArrayFeed("broken", Broken())
    feed.start()
    feed._thread.join(10.0)
    assert "has failed (ZeroDivisionError: of my driver)" in feed.hub.status()["ended"]
    assert [record.getMessage() for record in caplog.records] == ["The source has failed."]


@GATE
def test_only_the_pages_own_files_are_served() -> None:
    assert static("/")[0] == static("/view.js?token=x")[0] == 200
    for path in ("/../server.py", "/static/index.html", "//etc/passwd", "/view.css/../hub.py"):
        assert static(path)[0] == 404


@GATE
def test_a_page_of_another_origin_is_refused_on_the_wire() -> None:
    from websockets.asyncio.client import connect
    from websockets.exceptions import InvalidStatus

    async def work() -> None:
        async with serving(ArrayFeed("a", Source()), Place(port=0)) as (_, _, port):
            address = f"ws://127.0.0.1:{port}/stream"
            async with connect(address, proxy=None) as page:
                assert json.loads(await page.recv())["kind"] == "hello"
            with pytest.raises(InvalidStatus) as refused:
                async with connect(address, origin="http://evil.example", proxy=None):
                    pass
            assert refused.value.response.status_code == 403
            with pytest.raises(PortError, match=f"port {port}"):
                async with serving(ArrayFeed("b", Source()), Place(port=port)):
                    pass

    run(work())


def test_sixty_pictures_a_second_cost_a_quick_source_nothing() -> None:
    from websockets.asyncio.client import connect

    source, seen = Source(), [0, 0]

    async def work() -> None:
        async with serving(ArrayFeed("quick", source), Place(port=0)) as (_, _, port):
            address = f"ws://127.0.0.1:{port}/stream"
            quick: dict[str, Any] = {"proxy": None, "close_timeout": 0.1}
            # the second page is open and takes nothing: its pictures are left out
            async with connect(address, **quick) as page, connect(address, **quick):
                end = time.monotonic() + 2.0
                first = source.sent
                while time.monotonic() < end:
                    message = await page.recv()
                    seen[0] += isinstance(message, bytes)
                seen[1] = source.sent - first

    run(work())
    pictures, sent = seen
    print(f"{pictures / 2:.0f} pictures/s from a source at {sent / 2:.0f} Hz")
    # 60 and 1000; half of them on a machine that has more to do
    assert 60 <= pictures <= 130
    assert sent > 1000
    assert pictures < sent / 4


def test_a_place_of_a_recording_has_the_rest_of_the_whole_one(tmp_path: Path) -> None:
    """A load that is on where the recording is moved to is no rest, whichever way one comes."""
    rng = np.random.default_rng(2)
    values = 1e-5 * rng.normal(size=(160, 8, 8, 3))
    values[60:, 2:5, 2:5, 2] -= 1e-3
    path = tmp_path / "touch.npz"
    Recording(values, rate=100.0, unit="strain").save(path)
    changes = {"needs": ["load_normal", "contact"], "array": {"driver": "npz", "path": str(path)}}
    scene = load_scene("demo", changes=changes)
    wanted = {moment.number: moment.outputs for moment in scene.results()}
    feed = RecordingFeed(scene)
    feed.command({"paused": True, "seek": 1.2})
    feed.start()
    for place in (120, 150, 90, 30):
        feed.command({"seek": place / 100.0})
        deadline, shown = time.monotonic() + 20.0, None
        while (shown is None or shown.number != place) and time.monotonic() < deadline:
            time.sleep(0.01)
            shown, _ = feed.hub.picture(None)
        assert shown is not None
        assert shown.number == place
        assert (shown.outputs["contact"] > 0.0) == (place >= 60)
        for name, value in wanted[place].items():
            np.testing.assert_array_equal(shown.outputs[name], value)
    feed.stop()


def test_a_recording_stops_and_goes_where_it_is_sent(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    path = tmp_path / "short.npz"
    Recording(1e-4 * rng.normal(size=(200, 8, 8, 3)), rate=100.0, unit="strain").save(path)
    scene = load_scene("demo", changes={"array": {"driver": "npz", "path": str(path)}})
    feed = RecordingFeed(scene)
    assert feed.hub.duration == pytest.approx(1.99)
    feed.command({"paused": True, "seek": 1.5})
    feed.start()
    deadline = time.monotonic() + 20.0
    while feed.hub.frames < 1 and time.monotonic() < deadline:
        time.sleep(0.01)
    time.sleep(0.2)
    shown, data = feed.hub.picture(None)
    assert shown is not None
    assert (shown.number, feed.hub.frames) == (150, 1)
    assert HEAD.unpack_from(data)[0] == 150
    for nonsense in ({"seek": "x"}, {"speed": True}, {"seek": float("nan")}, {}):
        feed.command(nonsense)
    feed.command({"speed": 50.0, "paused": False})
    while feed.hub.frames < 50 and time.monotonic() < deadline:
        time.sleep(0.01)
    feed.stop()
    assert feed.hub.frames == 50


class Ended:
    """A feed whose last scan repeats the one before, and so has no read-outs of its own."""

    def __init__(self) -> None:
        from cnnum.drivers.driver import Counters

        self.hub = Hub(
            "ended", (8, 8), FORCE_AXES, "N", 100.0, lambda frame: frame.values, Counters,
            why=lambda moment: [{"kind": "slip", "frame": moment.number}],
        )  # fmt: skip
        self.hubs = (self.hub,)

    def start(self) -> None:
        for number in range(3):
            values = np.full((8, 8, 3), float(number))
            frame = Frame(values, FORCE_AXES, "N", number, number / 100.0)
            self.hub.offer(FrameResult(number, frame, values if number < 2 else None, {}, (), 0.0))

    def stop(self) -> None: ...

    def command(self, wanted: dict[str, Any]) -> None: ...


def test_a_page_that_comes_after_the_end_sees_the_last_picture_and_its_reasons() -> None:
    from websockets.asyncio.client import connect

    async def work() -> None:
        async with serving(Ended(), Place(port=0)) as (_, _, port):
            for _ in range(2):  # the second page is greeted as the first
                async with connect(f"ws://127.0.0.1:{port}/stream", proxy=None) as page:
                    greeting, picture, why = [await page.recv() for _ in range(3)]
                assert json.loads(greeting)["kind"] == "hello"
                assert isinstance(picture, bytes)
                assert HEAD.unpack_from(picture)[0] == 2
                assert json.loads(why)["t"] == 0.01
                assert json.loads(why)["reports"] == [{"kind": "slip", "frame": 1}]

    run(work())


def test_a_recording_is_not_recorded_again(tmp_path: Path) -> None:
    """A page without the button that was asked for would be no answer, nor a click that fails."""
    path = tmp_path / "press.npz"
    Recording(np.zeros((9, 2, 2, 3)), rate=60.0, unit="strain").save(path)
    done = CliRunner().invoke(main, ["view", str(path), "--record", str(tmp_path)])
    assert (done.exit_code, "is a recording already" in done.stderr) == (2, True), done.stderr
    done = CliRunner().invoke(main, ["view", "demo", "--record", str(tmp_path / "none")])
    assert (done.exit_code, "does not exist" in done.stderr) == (2, True), done.stderr
