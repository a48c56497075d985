"""Hands: each skin gives what its scene gives alone, whatever the others do."""

import asyncio
import time
from dataclasses import replace

import numpy as np
import pytest

import cnnum
from cnnum.drivers.driver import Counting
from cnnum.errors import SceneError, UnknownNameError
from cnnum.frame import Quality
from cnnum.scenes.pipeline import Passage
from cnnum.scenes.scene_file import read_hand

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
    waiting = {name: [spoilt(frame, rng) for frame in frames[name]] for name in hand}
    way = {name: Passage(alone(hand[name])) for name in hand}
    at = dict.fromkeys(hand, 0)
    wrong = 0
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
        for name, frame in given.items():
            wrong += answer(step[name]) != answer(way[name].step(at[name], frame))
            at[name] += 1
    assert wrong == 0
    assert min(at.values()) == 80


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
