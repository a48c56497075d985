"""`cnnum run`, `plan` and `replay` over a short scene: a press, a hold and a release."""

import os
import pty
import signal
import subprocess
import sys
from contextlib import suppress

import numpy as np
import pytest

import cnnum
from cnnum.drivers import open_driver

SCENE = """
name = "tap"
needs = ["contact"]

[array]
driver = "simulated"
script = [
    {kind = "hold", duration = 0.3},
    {kind = "press", load = 1.0, duration = 0.2},
    {kind = "hold", duration = 0.2},
    {kind = "release", duration = 0.2},
    {kind = "hold", duration = 0.1},
]

[program]
name = "contact"

[program.parameters]  # of the simulated cover
depth = 0.6667
unit = 1.305
"""
FRAMES = 200
NEAR = 5 / 200  # s: five frames, within which an event must follow the ground truth


@pytest.fixture
def scene(tmp_path):
    path = tmp_path / "tap.toml"
    path.write_text(SCENE)
    return path


def touched(script_from) -> tuple[float, float]:
    """When the ground truth says that contact begins, and when it has ended."""
    with open_driver("simulated", script_from) as array:
        held = [(f.time, f.truth["normal_force"] > 0) for f in array.frames()]
    begin = next(t for t, touches in held if touches)
    return begin, next(t for t, touches in held if t > begin and not touches)


def test_events_then_the_summary(call, records, scene):
    import tomllib

    result = call("run", scene, "--json")
    assert result.exit_code == 0, result.stderr
    *events, summary = records(result.stdout)
    assert [event["kind"] for event in events] == ["contact", "release"]
    begin, end = touched({"script": tomllib.loads(SCENE)["array"]["script"]})
    assert events[0]["t"] == pytest.approx(begin, abs=NEAR)
    assert events[1]["t"] == pytest.approx(end, abs=NEAR)
    row, column = events[0]["where"]
    assert 0 <= row <= 7
    assert 0 <= column <= 7
    assert summary["kind"] == "summary"
    assert (summary["frames"], summary["bad_frames"], summary["dropped"]) == (FRAMES, 0, 0)
    assert 0 < summary["p50_us"] <= summary["p99_us"]
    assert summary["device"]
    assert all({"what", "why", "saves"} <= set(item) for item in summary["left_out"])


def test_in_words(call, scene):
    text = call("run", scene).stdout
    assert text.index("contact") < text.index("release") < text.index(f"{FRAMES} (0 bad")
    assert max(map(len, text.splitlines())) <= 120


def test_settings_reach_the_scene(call, records, scene):
    result = call("run", scene, "--set", "array.rate=100", "--precision", "float64", "--json")
    *_, summary = records(result.stdout)
    assert (summary["frames"], summary["precision"]) == (FRAMES // 2, "float64")
    *_, summary = records(call("run", scene, "--frames", 7, "--json").stdout)
    assert summary["frames"] == 7


def test_plan_of_the_scene(call, records, scene):
    (record,) = records(call("plan", scene, "--json").stdout)
    assert record["ops"] > 0
    assert record["ops_most"] >= record["ops"]
    assert record["flops_most"] >= record["flops"] > 0
    assert record["launches"] == (1 if record["engine"] == "opencl" else 0)
    assert "normal" in record["channels_read"]
    assert record["maps_read_back"] == []
    assert record["left_out"]
    (everything,) = records(call("plan", scene, "--set", 'needs=["contact_map"]', "--json").stdout)
    assert everything["maps_read_back"] == ["contact_map"]
    text = call("plan", scene).stdout
    # those of a kind are one row, whose text goes over several lines
    words = {word for item in record["left_out"] for word in item["what"].split()[1:]}
    assert all(word in text for word in words)
    first = "__kernel" if record["engine"] == "opencl" else "0: memory age"
    assert first in call("plan", scene, "--source").stdout


@pytest.mark.parametrize("suffix", ["npz", "mcap"])
def test_replay_finds_the_same_events(call, records, scene, tmp_path, suffix):
    tape = tmp_path / f"tap.{suffix}"
    assert call("record", scene, tape).exit_code == 0
    live = records(call("run", scene, "--json").stdout)
    again = records(call("replay", tape, "--scene", scene, "--json").stdout)
    assert again[:-1] == live[:-1]
    assert len(again) == 3
    assert again[-1]["frames"] == FRAMES


def test_replay_leaves_out_what_is_before_and_after(call, records, scene, tmp_path):
    tape = tmp_path / "tap.npz"
    assert call("record", scene, tape).exit_code == 0
    options = ("--scene", scene, "--from", 0.1, "--to", 0.15, "--speed", 100)
    done = call("replay", tape, *options, "--json")
    assert done.exit_code == 0, done.output
    assert 0 < records(done.stdout)[-1]["frames"] < FRAMES / 2


@pytest.fixture
def played(call, tmp_path):
    """A function that plays a recording from a time: its frames, events and fields."""
    engine = cnnum.Engine("numba")

    def play(name, tape, begin):
        scene = cnnum.load_scene(
            name, engine=engine, changes={"array": {"driver": "npz", "path": str(tape)}}
        )
        return [
            (m.number, m.frame.time, m.events, {k: v.tobytes() for k, v in m.outputs.items()})
            for m in scene.results(begin)
        ]

    return play


def test_replay_from_a_time_has_the_rest_and_the_memories_of_the_whole(call, played, tmp_path):
    """Rest is of the first frames, and slip remembers what has stuck."""
    tape = tmp_path / "slip.npz"
    assert call("record", "slip", tape, "--frames", 430).exit_code == 0
    whole = played("slip", tape, 0.0)
    at = [number for number, _, events, _ in whole if events]
    assert at
    for number in (at[0] // 2, at[0]):
        assert played("slip", tape, whole[number][1]) == whole[number:]


def test_replay_from_a_time_has_the_tare_of_the_whole(played, tmp_path):
    tape, scene = tmp_path / "grip.npz", tmp_path / "part.toml"
    time = np.arange(200) / 200.0
    load = np.clip((time - 0.2) / 0.2, 0.0, 1.0)
    place = np.exp(-0.2 * ((np.mgrid[:8, :8] - 3.5) ** 2).sum(axis=0))
    values = 0.7 + load[:, np.newaxis, np.newaxis, np.newaxis] * place[..., np.newaxis] * [0, 0, 1]
    axes = ("shear_x", "shear_y", "normal")
    cnnum.Recording(values, rate=200.0, unit="N", channels=axes).save(tape)
    scene.write_text(
        'name = "part"\nneeds = ["contact"]\n[array]\ndriver = "npz"\n[program]\nname = "contact"\n'
        "[program.parameters]\npush = 1.0\n"
        '[calibration]\ngain = 2.0\nunit = "N"\ntare = 20\n'
    )
    whole = played(scene, tape, 0.0)
    assert any(events for _, _, events, _ in whole)
    for begin in (0.05, 0.3):
        assert played(scene, tape, begin) == whole[round(begin * 200.0) :]


def test_replay_shows_the_frames_at_both_ends(call, records, scene, tmp_path):
    """0.3 s and 0.55 s are frames of an array at 200 Hz, some of whose times are rounded down."""
    tape = tmp_path / "tap.npz"
    assert call("record", scene, tape).exit_code == 0
    done = call("replay", tape, "--scene", scene, "--from", 0.3, "--to", 0.55, "--json")
    summary = records(done.stdout)[-1]
    assert summary["frames"] == 51
    assert summary["before"] == 60
    assert summary["sent"] == summary["handed_on"] + summary["skipped"]
    whole = records(call("replay", tape, "--scene", scene, "--json").stdout)
    shown = [one for one in whole[:-1] if 0.3 <= one["t"] <= 0.55]
    assert records(done.stdout)[:-1] == shown
    assert shown
    first = call("replay", tape, "--scene", scene, "--from", 0.3, "--frames", 7, "--json")
    assert records(first.stdout)[-1]["frames"] == 7


def test_a_part_that_is_not_there_is_said(call, scene, tmp_path):
    tape = tmp_path / "tap.npz"
    assert call("record", scene, tape).exit_code == 0
    done = call("replay", tape, "--scene", scene, "--from", 7)
    assert done.exit_code == 2
    said = "No frame is left from 7 s on: the last frame of scene 'tap' comes 0.995 s after"
    assert said in done.stderr
    saved = tmp_path / "none.npz"
    asked = ("--set", "needs=['load_normal']", "--save", saved)
    done = call("replay", tape, "--scene", scene, "--from", 7, *asked)
    assert (done.exit_code, said in done.stderr, saved.exists()) == (2, True, False)
    late = tmp_path / "late.npz"
    with np.load(tape) as held:
        np.savez(late, **{**held, "time": held["time"] + 1.7e9})
    done = call("replay", late, "--scene", scene, "--from", 7)
    assert (done.exit_code, said in done.stderr) == (2, True)
    done = call("replay", tape, "--scene", scene, "--from", 7, "--to", 6)
    assert done.exit_code == 2
    assert "'--to 6' lies before '--from 7'" in done.stderr


def test_an_error_on_the_way_keeps_the_summary(call, records, scene):
    script = 'array.script=[{kind="press", load=1.0, duration=0.5}, '
    script += '{kind="pull", speed=0.1, duration=1.0}]'
    result = call("run", scene, "--set", script, "--json")
    assert result.exit_code == 2
    assert "left the array" in result.stderr
    assert records(result.stdout)[-1]["kind"] == "summary"


def test_a_recording_that_an_error_ends_is_kept_and_reported(call, records, tmp_path):
    path = tmp_path / "torn.npz"
    script = 'script=[{kind="press", load=1.0, duration=0.5}, '
    script += '{kind="pull", speed=0.1, duration=1.0}]'
    result = call("record", "simulated", path, "--set", script, "--json")
    assert result.exit_code == 2
    assert "left the array" in result.stderr
    (stated,) = records(result.stdout)
    with open_driver("npz", {"path": path}) as tape:
        assert stated["frames"] == tape.total_frames > 40
    assert [item.name for item in tmp_path.iterdir()] == ["torn.npz"]


def start(*arguments: object, **streams: object) -> subprocess.Popen:
    # a suite that was started in the background hands on that Ctrl-C or SIGHUP is ignored
    code = "import signal as s, runpy; s.signal(s.SIGINT, s.default_int_handler); "
    code += "s.signal(s.SIGHUP, s.SIG_DFL); "
    code += "runpy.run_module('cnnum', run_name='__main__', alter_sys=True)"
    # as users have it: output waits in a buffer
    environment = {key: value for key, value in os.environ.items() if key != "PYTHONUNBUFFERED"}
    return subprocess.Popen(
        [sys.executable, "-c", code, *map(str, arguments)], text=True, env=environment, **streams
    )


LONG = ("--set", 'array.script=[{kind="hold",duration=0.1},{kind="press",load=1,duration=0.2},'
        '{kind="hold",duration=100000}]')  # fmt: skip


def test_ctrl_c_ends_with_the_summary(scene, records):
    process = start("run", scene, *LONG, "--json", stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    first = process.stdout.readline()
    process.send_signal(signal.SIGINT)
    rest, said = process.communicate(timeout=60)
    assert process.returncode == 130, said
    assert "Traceback" not in said
    *events, summary = records(first + rest)
    assert events[0]["kind"] == "contact"
    assert 0 < summary["frames"] < 20_000_000


def over_and_over(tape, times):
    """Lengthen a recording, so that there is time to stop its replay."""
    with np.load(tape) as held:
        parts = dict(held)
    for name in ("values", "sequence", "time", "log_time", "quality", "truth", "saturated"):
        parts[name] = np.concatenate([parts[name]] * times)
    parts["time"] = np.arange(len(parts["time"])) / 200.0
    parts["sequence"] = np.arange(len(parts["sequence"]))
    np.savez(tape, **parts)


@pytest.mark.one_in(2)
@pytest.mark.parametrize(
    ("command", "number"),
    [
        ("run", signal.SIGTERM),
        ("run", signal.SIGHUP),
        ("replay", signal.SIGTERM),
        ("demo", signal.SIGHUP),
    ],
)
def test_other_signals_end_with_the_summary_too(scene, records, call, tmp_path, command, number):
    more = {"run": [scene, *LONG], "demo": [*LONG, "--out", tmp_path / "demo.html"]}
    if command == "replay":
        tape = tmp_path / "long.npz"
        assert call("record", scene, tape).exit_code == 0
        over_and_over(tape, 100)
        # in real time: flat out, a fast machine is through before the signal comes
        more["replay"] = [tape, "--scene", scene, "--speed", "1"]
    process = start(
        command, *more[command], "--json", stdout=subprocess.PIPE, stderr=subprocess.PIPE
    )
    first = process.stdout.readline()
    process.send_signal(number)
    rest, said = process.communicate(timeout=60)
    assert process.returncode == 130, said
    assert "Traceback" not in said
    *_, summary = records(first + rest)
    assert summary["kind"] == "summary"
    assert summary["sent"] == summary["handed_on"] + summary["skipped"] > 0


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_recording_that_is_stopped_is_whole(tmp_path, number):
    import time

    path = tmp_path / "long.npz"
    options = [option.replace("array.", "") for option in LONG]
    process = start("record", "simulated", path, *options, stdout=subprocess.PIPE)
    deadline = time.monotonic() + 60
    while not any(item.stat().st_size > 200_000 for item in tmp_path.iterdir()):
        assert time.monotonic() < deadline
        time.sleep(0.05)
    process.send_signal(number)
    process.communicate(timeout=60)
    assert process.returncode == 130
    assert [item.name for item in tmp_path.iterdir()] == ["long.npz"]
    with open_driver("npz", {"path": path}) as tape:
        assert tape.total_frames >= 40


def test_a_pipe_that_closes_is_no_error(scene, fast):
    process = start(
        "run", scene, "--engine", fast.name, *LONG, stdout=subprocess.PIPE, stderr=subprocess.PIPE
    )
    with process:
        process.stdout.readline()
        process.stdout.close()
        # the next event would break the pipe; there is none, so the summary after Ctrl-C does
        process.send_signal(signal.SIGINT)
        said = process.stderr.read()
        assert process.wait(timeout=60) == 141, said
    assert said == ""


def test_progress_goes_to_a_terminal_on_standard_error_only(scene):
    primary, secondary = pty.openpty()
    process = start("run", scene, "--frames", 150, stdout=subprocess.PIPE, stderr=secondary)
    os.close(secondary)
    shown = b""
    with suppress(OSError):  # the far end closes when the command ends
        while piece := os.read(primary, 4096):
            shown += piece
    text, _ = process.communicate(timeout=60)
    os.close(primary)
    assert process.returncode == 0
    assert b"frames" in shown
    assert "\x1b" not in text
    assert "contact" in text
