"""The sink for Rerun: its calls, seen by a stand-in for the library, and a real file of it."""

import json
import sys
from collections import Counter
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from cnnum.cli.root import main

SCENE = """
name = "slide"
needs = ["contact"]
[array]
driver = "simulated"
rate = 240.0
shape = [8, 8]
script = [{kind = "press", load = 1.0, duration = 0.5}]
"""


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


def run(tmp_path: Path, target: str) -> Any:
    scene = tmp_path / "slide.toml"
    scene.write_text(SCENE)
    arguments = ["run", str(scene), "--set", "engine.name=numba", "--rerun", target]
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


def test_a_wrong_target_and_a_missing_library_are_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "rerun", None)
    for target, sentence in (
        ("slide.txt", "ends in .rrd"),
        ("slide.rrd", "pip install '.[rerun]'"),
    ):
        done = run(tmp_path, target)
        assert done.exit_code == 2
        assert sentence in done.stderr


def test_a_file_of_the_library_itself(tmp_path: Path) -> None:
    pytest.importorskip("rerun")
    done = run(tmp_path, str(tmp_path / "slide.rrd"))
    assert done.exit_code == 0, done.output
    assert (tmp_path / "slide.rrd").read_bytes()[:3] == b"RRF"
