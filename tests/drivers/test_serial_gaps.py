"""A run's report of an unplug: every scan is accounted for, and events carry the gap."""

import json
import logging
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from threading import Thread
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from cnnum.cli.root import main
from cnnum.drivers.serve import packets
from cnnum.errors import OtherArrayError
from cnnum.frame import FORCE_AXES, Frame
from cnnum.scenes.frame_path import FrameResult
from cnnum.scenes.pipeline import Scene, load_scene

RATE = 100.0
SCENE = """
name = "gaps"
needs = ["contact"]
[array]
driver = "serial"
port = "{port}"
timeout = 1.0
reconnects = 200
backoff = 0.02
longest_backoff = 0.05
{more}
[program]
name = "contact"
[engine]
name = "numba"
"""


def frame(n: int, pressed: bool = False, shape: tuple[int, int] = (4, 5)) -> Frame:
    values = np.random.default_rng(n).normal(0.0, 1e-5, (*shape, 3))
    values[1:3, 1:3, 2] -= 0.02 * pressed
    return Frame(values.astype(np.float32).astype(np.float64), FORCE_AXES, "strain", n, n / RATE)


def reading(scan: Frame, value: float) -> Frame:
    """The frame with a value at taxel (2, 3)."""
    values = scan.values.copy()
    values[2, 3, 1] = value
    return replace(scan, values=values)


def rest(count: int, first: int = 0) -> list[Frame]:
    return [frame(n) for n in range(first, first + count)]


def pressed(count: int, first: int = 0) -> list[Frame]:
    return [frame(n, True) for n in range(first, first + count)]


def sent(device: Any, frames: list[Frame]) -> None:
    device.write(b"".join(packets(frames, RATE)))


def scene_file(link: Path, more: str = "") -> Path:
    path = link.parent / "gaps.toml"
    path.write_text(SCENE.format(port=link, more=more))
    return path


def accounted(scene: Scene) -> bool:
    seen = scene.summary()
    whole = seen.handed_on + seen.dropped + seen.skipped + seen.refused
    return seen.sent == whole and seen.frames == seen.handed_on + seen.refused + seen.repeated


def replugged(device: Any, plug: Callable[[], Any], frames: list[Frame]) -> Any:
    """Unplug an array and plug one in that sends these frames; return it."""
    device.unplug()
    again = plug()
    sent(again, frames)
    return again


def run(
    scene: Scene, count: int, at: int = -1, do: Callable[[], object] = list
) -> list[FrameResult]:
    """Run some frames, and do something after one of them."""
    results, got = scene.results(), []
    for moment in results:
        got.append(moment)
        if moment.number == at:
            do()
        if len(got) == count:
            results.close()
    return got


def test_an_unplug_is_accounted_for_and_events_carry_it(
    device: Any, link: Path, plug: Callable[[], Any]
) -> None:
    sent(device, rest(80))
    scene, again = load_scene(scene_file(link)), []

    def swap() -> None:
        again.append(replugged(device, plug, [*rest(40), *pressed(30, 40), *rest(40, 70)]))

    got = run(scene, 190, 79, swap)
    again[0].unplug()
    seen = scene.summary()
    assert accounted(scene)
    away = got[80].frame.time - got[79].frame.time
    assert seen.longest_gap == away > 0.0
    assert (seen.handed_on, seen.dropped) == (190, round(away * RATE) - 1)
    touch, release = [event for moment in got for event in moment.events]
    assert (touch.kind, release.kind) == ("contact", "release")
    # one flag: its first event reaches over the gap, its second begins with the first
    assert (touch.after_gap, touch.gap_end) == (away, got[80].frame.time)
    assert release.after_gap is None
    assert touch.record()["after_gap"] == round(away, 6)


def test_unplugs(faults: Any, link: Path, plug: Callable[[], Any]) -> None:
    """After an unplug and a replug every scan is accounted for, and the next event says so."""
    for trial in faults.trials(short=2, full=20):
        before = int(np.random.default_rng(trial).integers(60, 100))
        plugged = [plug()]
        sent(plugged[0], rest(before))
        scene = load_scene(scene_file(link))

        def swap(plugged: list[Any] = plugged) -> None:
            plugged.append(replugged(plugged[0], plug, [*rest(40), *pressed(20, 40)]))

        got = run(scene, before + 60, before - 1, swap)
        plugged[1].unplug()
        away = got[before].frame.time - got[before - 1].frame.time
        gaps = [event.after_gap for moment in got for event in moment.events]
        if not accounted(scene) or scene.summary().dropped != round(away * RATE) - 1:
            faults.lose(f"trial {trial}: {scene.summary()}")
        elif gaps != [away]:
            faults.lose(f"trial {trial}: events after a gap of {away} s say {gaps}")


def test_an_array_that_counts_on_states_what_was_lost(
    device: Any, link: Path, plug: Callable[[], Any]
) -> None:
    sent(device, rest(20))
    scene, again = load_scene(scene_file(link)), []

    def swap() -> None:
        # its clock has run on for longer than the host's
        again.append(replugged(device, plug, rest(10, 1_000_020)))

    run(scene, 30, 19, swap)
    again[0].unplug()
    assert accounted(scene)
    assert scene.summary().dropped == 1_000_000


def test_damaged_and_repeated_and_refused_scans_are_accounted_for(device: Any, link: Path) -> None:
    wrong = reading(frame(33), 1e22)
    frames = [*rest(33), wrong, *rest(16, 34)]
    data = list(packets([*frames[:40], *frames[39:]], RATE))
    data[10] = data[10][:100] + bytes([data[10][100] ^ 0x40]) + data[10][101:]
    device.write(b"".join(data))
    scene = load_scene(scene_file(link))
    run(scene, 50)
    seen = scene.summary()
    assert accounted(scene)
    assert (seen.sent, seen.handed_on, seen.dropped, seen.skipped) == (51, 48, 1, 1)
    assert (seen.refused, seen.bad_frames, seen.repeated) == (1, 2, 1)


@pytest.mark.parametrize("mode", ["every", "latest"])
def test_scans_that_nobody_took_are_accounted_for(device: Any, link: Path, mode: str) -> None:
    sent(device, rest(200))
    scene = load_scene(scene_file(link, f'mode = "{mode}"\ndepth = 50'))
    device.written()
    deadline = time.monotonic() + 20.0
    while scene.driver.counters.sent != 200 and time.monotonic() < deadline:
        time.sleep(0.01)
    got = run(scene, 1)
    seen = scene.summary()
    assert accounted(scene)
    assert seen.sent == 200
    if mode == "every":  # a full queue has lost the oldest; the rest waits when the run ends
        assert (seen.dropped, seen.skipped, got[0].frame.sequence) == (150, 49, 150)
    else:
        assert (seen.dropped, seen.skipped, got[0].frame.sequence) == (0, 199, 199)


@pytest.mark.parametrize("replug", [True, False], ids=["replugged", "same port"])
def test_another_array_is_named_at_once(
    device: Any, link: Path, plug: Callable[[], Any], replug: bool
) -> None:
    sent(device, rest(20))
    scene = load_scene(scene_file(link, "").rename(link.parent / "other.toml"))
    others = [frame(n, shape=(8, 8)) for n in range(5)]
    plugged = [device]

    def swap() -> None:
        if replug:
            device.unplug()
            plugged.append(plug())
        sent(plugged[-1], others)

    begin = time.monotonic()
    with pytest.raises(OtherArrayError, match=r"8×8 taxels .* in place of 4×5 taxels"):
        run(scene, 1000, 19, swap)
    assert time.monotonic() - begin < 1.0  # the time-out; it took 0.1
    plugged[-1].unplug()
    assert accounted(scene)


def test_the_command_ends_with_its_summary(
    device: Any, link: Path, plug: Callable[[], Any]
) -> None:
    sent(device, rest(20))
    plugged = []

    def swap() -> None:
        device.written()
        time.sleep(0.3)
        device.unplug()
        plugged.append(plug())
        sent(plugged[0], [frame(n, shape=(8, 8)) for n in range(5)])

    thread = Thread(target=swap)
    thread.start()
    result = CliRunner().invoke(main, ["run", str(scene_file(link)), "--json"])
    thread.join()
    plugged[0].unplug()
    assert result.exit_code == 2
    (said,) = result.stderr.splitlines()
    assert "Another array answers" in said
    *_, summary = map(json.loads, result.stdout.splitlines())
    parts = ("handed_on", "dropped", "skipped", "refused")
    assert summary["sent"] == sum(summary[part] for part in parts) == 20


def test_a_bad_frame_is_named_once_and_a_bad_cell_with_its_cure(
    device: Any, link: Path, caplog: pytest.LogCaptureFixture
) -> None:
    frames = rest(300)
    frames[20:] = [reading(each, np.nan) for each in frames[20:]]
    sent(device, frames)
    scene = load_scene(scene_file(link))
    with caplog.at_level(logging.WARNING, "cnnum"):
        run(scene, 300)
    first, cure = [record.getMessage() for record in caplog.records]
    assert "Frame 20 is bad and was skipped: taxel (2, 3) reads nan strain" in first
    assert "taxels [2, 3] have dropped out" in cure
    # bad until it is known that the taxel stays so, and without it from then on
    summary = scene.summary()
    assert 0 < summary.refused <= 20
    assert summary.refused + summary.masked == 280
    assert accounted(scene)
