"""Hands: each skin gives what its scene gives alone, whatever the others do."""

import asyncio
import itertools
import json
import threading
import time
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner

import cnnum
from cnnum.cli import main
from cnnum.drivers.driver import Counting
from cnnum.errors import ArrayError, SceneError, UnknownNameError
from cnnum.frame import Quality
from cnnum.scenes.abreast import Calm
from cnnum.scenes.pipeline import Passage
from cnnum.scenes.scene_file import read_hand
from cnnum.stream import Abreast

HAND = """
needs = ["slip"]
[array]
driver = "simulated"
shape = [4, 4]
rate = 50.0
script = [
    {kind = "hold", duration = 0.4},
    {kind = "press", duration = 0.3, load = 0.5},
    {kind = "pull", duration = 0.5, speed = 2e-3, direction = 0.0},
    {kind = "release", duration = 0.2},
    {kind = "hold", duration = 0.2},
]
[program]
name = "slip"
[skin.thumb]
[skin.index.array]
seed = 1
start = [0.5e-3, 0.0]
[skin.ring.array]
seed = 3
offset = 2e-3
[skin.palm]
needs = ["contact"]
program.name = "contact"
[skin.palm.array]
shape = [5, 6]
seed = 2
"""


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    path = tmp_path_factory.mktemp("hand") / "hand.toml"
    path.write_text(HAND)
    return path


@pytest.fixture(scope="module")
def hand(place):
    return cnnum.load_hand(place)


@pytest.fixture(scope="module")
def frames(hand):
    return {name: list(hand[name].driver.frames()) for name in hand}


def answer(moment):
    """Everything that a frame gives, to be compared to the bit."""
    values = None if moment.values is None else moment.values.tobytes()
    outputs = {name: np.asarray(of).tobytes() for name, of in moment.outputs.items()}
    return moment.number, values, outputs, moment.events, str(moment.error), moment.masked is None


def test_equal_skins_share_a_launch(hand):
    assert list(hand) == ["thumb", "index", "ring", "palm"]
    assert hand.launches == 2
    assert hand["thumb"].plan is hand["ring"].plan is not hand["palm"].plan


def test_a_hand_gives_what_each_skin_gives_alone(hand):
    steps = list(hand.results())
    for name in hand:
        alone = [answer(moment) for moment in hand[name].results()]
        assert [answer(step[name]) for step in steps] == alone
        kinds = {e.kind for s in steps for n, e in s.events if n == name}
        assert kinds >= set(hand[name].spec.needs)
    assert all(len(step.skins) == 4 for step in steps)
    assert np.allclose([step.time for step in steps], np.arange(len(steps)) / 50.0)


def again(frames, times):
    """Return frames of several grasps: from the second on, none is larger than those before."""
    count = len(frames)
    return [replace(frames[n % count], sequence=n, time=n / 50.0) for n in range(times * count)]


def spoilt(frame, rng):
    """Return a frame as it is, or bad, repeated, saturated, after a gap, or with a fault."""
    kind = rng.integers(60)
    if kind < 4:
        flags = (Quality.CORRUPT, Quality.REPEATED, Quality.DROPPED_BEFORE, Quality.SATURATED)
        return replace(frame, quality=flags[kind])
    if kind < 7:
        values = np.array(frame.values)
        values[rng.integers(4), rng.integers(4)] = (np.nan, 0.0, 1.9)[kind - 4]
        return replace(frame, values=values)
    return frame


@pytest.mark.parametrize("seed", [1, 2])
def test_what_befalls_one_skin_leaves_the_others_alone(hand, frames, seed):
    """Skins miss steps, are tared, and have bad frames, each at its own times."""
    hand.begin()
    rng = np.random.default_rng(seed)
    waiting = {name: [spoilt(frame, rng) for frame in again(frames[name], 3)] for name in hand}
    way = {name: Passage(alone(hand[name])) for name in hand}
    at = dict.fromkeys(hand, 0)
    wrong, seen = 0, []
    while any(waiting.values()):
        ready = [name for name in hand if waiting[name] and rng.random() < 0.8]
        for name in ready:
            if rng.random() < 0.01:
                hand.tare(name)
                way[name]._scene.tare()
        given = {name: waiting[name].pop(0) for name in ready}
        if not given:
            continue
        step = hand.push(given)
        single = {name: way[name].step(at[name], given[name]) for name in hand if name in given}
        wrong += step.events != tuple((name, e) for name, of in single.items() for e in of.events)
        seen.append((step, {name: answer(moment) for name, moment in single.items()}))
        for name in given:
            at[name] += 1
    # results are read only now: what came after has changed none of them
    for step, expected in seen:
        wrong += list(step.skins) != list(expected)
        wrong += sum(answer(step[name]) != own for name, own in expected.items())
    assert wrong == 0
    assert any(step.events for step, _ in seen)
    assert min(at.values()) == 240


def alone(scene):
    """Return a scene as another one, with its own watches."""
    return type(scene).of(scene.spec, beside=(scene,))


class Array(Counting):
    """Frames as a live array gives them, `late` s apart by the host's clock."""

    live, limits = True, None

    def __init__(self, driver, frames, late):
        super().__init__()
        self._driver, self._frames, self._late = driver, frames, late

    def __getattr__(self, name):
        return getattr(self._driver, name)

    def frames(self):
        for frame in self._frames:
            time.sleep(self._late)
            self.count()
            yield replace(frame, monotonic_ns=time.monotonic_ns())


def live(hand, frames, late, **options):
    """Return a hand of live arrays."""
    skins = {name: alone(hand[name]) for name in ("thumb", "index", "ring")}
    for name, scene in skins.items():
        scene.driver = Array(scene.driver, frames[name], late)
    return cnnum.Hand(skins, **options)


def test_live_arrays_lose_no_frame(hand, frames):
    with live(hand, frames, 1e-4, deadline=1e-9) as fast:
        seen = [(name, step[name].frame.sequence) for step in fast.results() for name in step.skins]
        done = fast.summary()
    assert fast.launches == 1
    for name in fast:
        assert [number for of, number in seen if of == name] == list(range(80))
    assert (done.dropped, done.skipped, done.waiting) == (0, 0, 0)
    assert done.missed == done.steps > 0  # no step takes a nanosecond
    assert 0.0 < done.p50_us <= done.p99_us


def test_the_newest_frame_alone_and_the_others_counted(hand, frames):
    with live(hand, frames, 2e-4, deadline=10.0) as fast:
        count = 0
        for step in fast.results(newest=True):
            count += len(step.skins)
            time.sleep(5e-3)
        done = fast.summary()
    assert done.skipped > 0 == done.dropped
    assert count + done.skipped == 3 * 80
    assert done.missed == 0


def test_frames_that_wait_too_long_are_lost_and_counted(hand, frames, monkeypatch):
    monkeypatch.setattr("cnnum.scenes.hand.DEPTH", 8)
    with live(hand, frames, 1e-4) as fast:
        steps = []
        for step in fast.results():
            steps.append(step)
            time.sleep(2e-3)
        done = fast.summary()
    flagged = [m for s in steps for m in s.skins.values() if m.frame.quality]
    assert done.dropped > 0
    assert flagged
    assert sum(len(step.skins) for step in steps) + done.dropped == 3 * 80


def test_a_thread_and_a_coroutine(hand, frames):
    seen = []
    with live(hand, frames, 1e-3) as fast:
        fast.start(seen.append)
        with pytest.raises(SceneError, match="has been started"):
            fast.start(seen.append)
        time.sleep(0.05)
        done = fast.stop()
    assert 0 < len(seen) == done.steps <= 3 * 80

    async def follow():
        with live(hand, frames, 1e-3) as fast:
            async for step in fast.stream():
                if step.number == 5:
                    return step
        return None

    assert asyncio.run(follow()).number == 5


def test_an_error_of_an_array_is_raised(hand, frames):
    with live(hand, frames, 1e-4) as fast:
        fast["index"].driver.frames = broken
        with pytest.raises(OSError, match="unplugged"):
            list(fast.results())
        fast["ring"].driver.frames = broken
        with pytest.raises(SceneError, match="live"):
            list(fast.results())


def broken():
    raise OSError("unplugged")
    yield


def test_what_is_no_hand(place, tmp_path, hand):
    with pytest.raises(SceneError, match="load_hand"):
        cnnum.load_scene(place)
    with pytest.raises(SceneError, match="not a hand"):
        cnnum.load_hand("demo")
    with pytest.raises(SceneError, match="at least one skin"):
        cnnum.Hand({})
    with pytest.raises(SceneError, match="given twice"):
        cnnum.Hand({"a": hand["thumb"], "b": hand["thumb"]})
    with pytest.raises(SceneError, match="deadline"):
        cnnum.Hand({"a": hand["thumb"]}, deadline=-1.0)
    hand["thumb"].take_tare()
    with pytest.raises(UnknownNameError, match="toe"):
        hand.tare("thumb", "toe")
    assert not hand["thumb"].take_tare()
    other = tmp_path / "other.toml"
    other.write_text('needs = ["contact"]\n[skin]\nthumb = 3\n')
    with pytest.raises(SceneError, match="thumb"):
        cnnum.load_hand(other)


def test_tables_of_a_skin_stand_over_the_common_ones(place, tmp_path):
    path = tmp_path / "hand.toml"
    (tmp_path / "palm.toml").write_text(
        'needs = ["edge"]\n[array]\ndriver = "npz"\npath = "a.npz"\n[program.parameters]\nx = 1\n'
    )
    path.write_text(
        'needs = ["slip"]\n[array]\ndriver = "simulated"\nseed = 7\nrate = 50.0\n'
        "[program.parameters]\ndepth = 0.5\nunit = 2.0\n"
        "[skin.a.array]\nseed = 8\n[skin.a.program.parameters]\nunit = 3.0\n"
        '[skin.b]\nneeds = ["contact"]\n[skin.b.array]\ndriver = "xela"\nport = "COM1"\n'
        '[skin.c]\nscene = "palm.toml"\n[skin.c.array]\npath = "b.npz"\n[skin.d]\nscene = "demo"\n'
    )
    read = read_hand(path, changes={"array.rate": 9.0, "skin.a.array.noise": 0.0})
    a, b, c, d = (read[name] for name in "abcd")
    assert dict(a.driver_options) == {"seed": 8, "rate": 9.0, "noise": 0.0}
    assert (a.name, a.needs, dict(a.parameters)) == ("a", ("slip",), {"depth": 0.5, "unit": 3.0})
    assert (b.driver, b.needs) == ("xela", ("contact",))
    assert dict(b.driver_options) == {"port": "COM1", "rate": 9.0}
    assert (c.needs, c.driver_options["path"]) == (("edge",), "b.npz")
    assert dict(c.parameters) == {"x": 1}
    assert d.usual == ("depth", "unit")


def endless(hand, frames, late):
    """Return a hand of arrays that give frames for longer than any test waits."""
    return live(hand, {name: again(frames[name], 250) for name in frames}, late)


def reading():
    """Return the threads that read arrays."""
    return [t.name for t in threading.enumerate() if t.name in ("cnnum-thumb", "cnnum-ring")]


def within(seconds, work):
    """Return what a function returns; fail where it hangs."""
    done = []
    thread = threading.Thread(target=lambda: done.append(work()), daemon=True)
    thread.start()
    thread.join(seconds)
    assert done, f"it was not done within {seconds:g} s"
    return done[0]


def test_a_stop_right_after_the_start_counts(hand, frames):
    """The thread may begin after `stop`, which must not be forgotten then."""
    for _ in range(3):
        fast = endless(hand, frames, 1e-3)
        fast.start(lambda step: None)
        within(3.0, fast.stop)
    assert not reading()


def test_an_error_of_a_callback_ends_the_pass(hand, frames):
    """Its traceback holds what was at work, which must end all the same."""
    fast = endless(hand, frames, 1e-3)
    with pytest.raises(ZeroDivisionError) as held:
        fast.run(lambda step: 1 / 0)
    assert held.tb is not None
    assert not reading()
    fast = endless(hand, frames, 1e-3)

    def left_alone():
        with fast:
            fast.start(lambda step: 1 / 0)
            time.sleep(0.3)

    with pytest.raises(ZeroDivisionError):  # though nobody calls `stop`
        left_alone()
    assert not reading()


def test_stop_waits_for_a_callback_that_has_called_it(hand, frames):
    fast, seen = endless(hand, frames, 1e-3), []

    def callback(step):
        fast.stop()
        time.sleep(0.2)
        seen.append(step.number)

    fast.start(callback)
    time.sleep(0.1)
    assert fast.stop().steps == 1
    assert seen == [0]


def test_a_cancelled_coroutine_leaves_no_reader(hand, frames):
    async def main():
        async def follow():
            async for _ in endless(hand, frames, 1e-3).stream():
                pass

        task = asyncio.create_task(follow())
        await asyncio.sleep(0.2)
        task.cancel()
        with pytest.raises(asyncio.CancelledError):
            await task

    within(4.0, lambda: asyncio.run(main()) or True)
    assert not reading()


def test_an_error_of_an_array_is_raised_while_others_go_on(hand, frames):
    """Even where the hand falls behind, so that a frame of some other skin always waits."""
    fast = endless(hand, frames, 1e-4)
    fast["index"].driver.frames = broken

    def slow(step):
        time.sleep(2e-3)
        assert step.number < 100

    with pytest.raises(OSError, match="unplugged"):
        fast.run(slow, newest=True)


class Old:
    """A recording whose times are those of a clock that began long ago."""

    live = False

    def __init__(self, driver, frames, **changes):
        self._driver, self._frames, self._changes = driver, frames, changes

    def __getattr__(self, name):
        return getattr(self._driver, name)

    def frames(self):
        for frame in self._frames:
            yield replace(frame, time=frame.time + 1e6, **self._changes)


def test_a_recording_beside_a_live_array_begins_with_it(hand, frames):
    """Its frames come when they are due after its first one, and of a wall clock on its own."""
    skins = live(hand, {name: frames[name][:20] for name in hand}, 1e-3).skins
    skins["ring"].driver = Old(skins["thumb"].driver, frames["ring"][:20], wall_ns=10**18)
    mixed = cnnum.Hand({"thumb": skins["thumb"], "ring": skins["ring"]})
    steps = within(5.0, lambda: list(mixed.results()))
    assert sum("ring" in step for step in steps) == 20
    assert all(abs(step.time) < 5.0 for step in steps)


def test_a_step_that_fails_keeps_the_numbers_of_what_was_done(hand, frames):
    hand.begin()
    for n in range(3):
        hand.push({name: frames[name][n] for name in hand})
    with pytest.raises(ArrayError):
        hand.push({"thumb": frames["thumb"][3], "palm": frames["thumb"][3]})
    step = hand.push({name: frames[name][4] for name in ("thumb", "palm")})
    assert (step["thumb"].number, step["palm"].number) == (4, 3)
    with pytest.raises(SceneError, match="at least one"):
        hand.push({})


def test_changes_make_no_skin(place):
    with pytest.raises(UnknownNameError, match=r"thum.*thumb"):
        cnnum.load_hand(place, changes={"skin.thum.needs": ["slip"]})


def test_ordinary_frames_are_looked_at_together(hand, frames, monkeypatch):
    """What is quick has to be taken: nothing else would tell that each skin goes alone."""
    looked, shared = [], []
    look, push = Calm.look, Abreast.push

    def counted_look(self, lanes, values, times):
        calm = look(self, lanes, values, times)
        looked.append(int(calm.sum()))
        return calm

    def counted_push(self, lanes, values, sizes):
        outputs, alone = push(self, lanes, values, sizes)
        shared.append(len(lanes) - len(alone))
        return outputs, alone

    monkeypatch.setattr(Calm, "look", counted_look)
    monkeypatch.setattr(Abreast, "push", counted_push)
    hand.begin()
    grasps = {name: again(frames[name], 3) for name in ("thumb", "index", "ring")}
    for n in range(240):
        hand.push({name: grasps[name][n] for name in grasps})
    # rest is learned from the first frames, and those of the first touch are the largest so far
    assert sum(looked) > 0.9 * 3 * 240
    assert sum(shared) > 0.4 * 3 * 240


def test_the_shell_runs_a_hand_and_records_each_skin(place, hand, tmp_path):
    def call(*arguments):
        return CliRunner().invoke(main, [str(part) for part in arguments])

    result = call("run", place, "--json")
    assert result.exit_code == 0, result.stderr
    *events, summary = [json.loads(line) for line in result.stdout.splitlines()]
    assert {record["skin"] for record in events} == {"thumb", "index", "ring", "palm"}
    want = [(name, event.kind, event.frame) for name, event in hand.events()]
    assert [(r["skin"], r["kind"], r["frame"]) for r in events] == want
    assert {name: of["frames"] for name, of in summary["skins"].items()} == dict.fromkeys(hand, 80)

    recorded = call("record", place, tmp_path / "Grasp ä.npz", "--frames", 40)
    assert recorded.exit_code == 0, recorded.stderr
    for name in hand:
        frames = [step[name].values for step in itertools.islice(hand.frames(), 40)]
        loaded = cnnum.load_recording(tmp_path / f"Grasp ä-{name}.npz")
        np.testing.assert_array_equal(loaded.values, np.array(frames))
    again = call("record", place, tmp_path / "Grasp ä.npz")
    assert again.exit_code == 2
    assert "already exists" in again.stderr


def test_what_is_for_one_scene_is_refused_for_a_hand(place, tmp_path):
    for option, value in (("--save", "a.npz"), ("--trace", "a.html")):
        result = CliRunner().invoke(main, ["run", str(place), option, str(tmp_path / value)])
        assert (result.exit_code, list(tmp_path.iterdir())) == (2, [])
        assert f"{option} is for one scene" in result.stderr
    with pytest.raises(SceneError, match="opened, got 3"):
        cnnum.Hand({"a": 3})
