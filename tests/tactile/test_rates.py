"""Time is seconds: a signal gives the same events at every rate, and rest bears real sensors.

No program, scene or view has a constant of frames that means a time: each of the few whole numbers
of frames left is what a mean needs.
"""

import ast
import logging
import re
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter

import cnnum
from cnnum.drivers import open_driver
from cnnum.errors import ArrayError, ProgramError, RecordingWarning, SceneError
from cnnum.frame import contradicted, unit_fault
from cnnum.recordings.checking import checked
from cnnum.scenes.events import EVENT_RULES, EventDetector, rules_that_fit
from cnnum.tactile.indenters import Touch, readings

ROOT = Path(__file__).parents[2]
CHANNELS = (*cnnum.frame.FORCE_AXES, "picture")
RATES = (10.0, 50.0, 200.0, 1000.0)

COUNTED = {
    "templates/tactile/shared/rest.py:QUIET": "frames that make noise known to a fifth",
    "templates/tactile/shared/loads.py:BREAK": "a ratio",
    "templates/tactile/shared/loads.py:JUMP": "a ratio",
    "templates/tactile/shared/rest.py:CALM": "a ratio",
    "templates/tactile/shared/rest.py:MANY": "readings of a frame",
    "templates/tactile/texture.py:SAMPLES": "T of (6.3), each of a time",
    "templates/tactile/texture.py:APART": "s, next to it",
    "cnnum/scenes/hand.py:DEPTH": "frames that wait in a queue",
    "cnnum/scenes/pipeline.py:EARLY": "frames of two steps",
    "cnnum/scenes/pipeline.py:TIMED": "frames of a median step",
    "cnnum/scenes/bad_taxels.py:JUMP": "a ratio",
    "cnnum/scenes/push_watch.py:TOUCH": "a ratio",
    "cnnum/scenes/exporting.py:APART": "an amount of work",
    "cnnum/scenes/like_frames.py:MOST": "an amount of work",
    "cnnum/scenes/exporting.py:MOST": "an amount of work",
    "cnnum/scenes/exporting.py:SHORT": "the length of a test vector",
    "cnnum/scenes/exporting.py:LONG": "the length of a test vector",
    "cnnum/scenes/tuning.py:LEAST": "s, next to it",
    "cnnum/scenes/tuning.py:ENOUGH": "frames of two steps",
    "cnnum/live/sink.py:PICTURES": "a second",
}
"""What is counted is no time."""


def numbers_in_frames(path):
    """Yield the numbers at the top of a module whose first sentence speaks of frames or scans."""
    body = ast.parse(path.read_text(encoding="utf-8")).body
    for node, after in zip(body, [*body[1:], None], strict=True):
        text = getattr(getattr(after, "value", None), "value", None)
        if not isinstance(node, ast.Assign) or not isinstance(text, str):
            continue
        values = [n.value for n in ast.walk(node.value) if isinstance(n, ast.Constant)]
        whole = [v for v in values if type(v) in (int, float) and v > 1 and v == int(v)]
        if not whole:
            continue
        first = re.split(r"[.;](?:\s|$)", text)[0].lower()
        if re.search(r"\b(frames?|scans?|samples?)\b", first) and not re.match(r"s\b|hz\b", first):
            yield from (n.id for n in ast.walk(node.targets[0]) if isinstance(n, ast.Name))


def test_no_constant_in_frames_means_a_time():
    """One that counts frames says what for, above; one in seconds or Hz begins with its unit."""
    found = set()
    for folder in ("templates/tactile", "cnnum/scenes", "cnnum/programs", "cnnum/live"):
        for path in sorted((ROOT / folder).rglob("*.py")):
            found |= {f"{path.relative_to(ROOT)}:{name}" for name in numbers_in_frames(path)}
    assert found == set(COUNTED)


ROWS, COLS = np.mgrid[:8, :8].astype(float)
NOISE = 2e-5
"""Of every frame, in strain; loads are 1,000 times as large."""


def rises(t, begin, lasts):
    return np.clip((t - begin) / lasts, 0.0, 1.0)[:, None, None]


def bump(row=3.5, col=3.5, width=5.12):
    return np.exp(-((ROWS - row) ** 2 + (COLS - col) ** 2) / width)


def scans(normal, x=0.0, y=0.0):
    zero = np.zeros_like(normal)
    return 0.02 * np.stack([x + zero, y + zero, -normal], axis=-1)


def grip(t):
    """A press in 0.3 s, a pull, a slide of 2 cells in 0.5 s, and the release."""
    load = rises(t, 1.0, 0.3) * (1.0 - rises(t, 4.7, 0.3))
    shape = load * bump(col=3.0 + 2.0 * rises(t, 3.0, 0.5))
    return scans(shape, 0.5 * shape * rises(t, 2.0, 0.8))


def punch(t):
    """A flat square of four cells that comes down and is lifted."""
    side = [
        0.5 * (np.tanh((x + 2) / 0.35) - np.tanh((x - 2) / 0.35)) for x in (ROWS - 3.5, COLS - 3.5)
    ]
    return scans(rises(t, 1.0, 0.3) * (1.0 - rises(t, 3.7, 0.3)) * side[0] * side[1])


def slide(t):
    """A rough face that is pulled until it slides, at 6 cells a second."""
    x = COLS - 6.0 * 0.6 * rises(t, 3.0, 0.6)
    face = 1.0 + 0.5 * np.sin(2 * np.pi * x / 3.1 + 0.4) * np.cos(2 * np.pi * ROWS / 4.3)
    shape = rises(t, 1.0, 0.3) * face * bump(width=9.0)
    return scans(
        shape, 0.6 * shape * rises(t, 2.0, 1.0) * np.where(t > 3.0, 0.75, 1.0)[:, None, None]
    )


def turn(t):
    """A body that turns on the skin."""
    shape = rises(t, 1.0, 0.3) * bump(width=9.0)
    twisted = 0.45 * shape * rises(t, 2.0, 1.5)
    return scans(shape, -twisted * (ROWS - 3.5), twisted * (COLS - 3.5))


def ridges(t):
    """Ridges of 8 cells that move by 2 cells a second for 2.5 s."""
    wave = 1.0 + 0.6 * np.sin(2 * np.pi * (COLS - 5.0 * rises(t, 2.0, 2.5)) / 8.0)
    shape = rises(t, 1.0, 0.3) * wave
    return scans(shape, 0.4 * shape * rises(t, 2.0, 0.2))


def sphere(t):
    """A sphere that is pressed, and pulled as far as friction holds."""
    load = readings(Touch(2.0, (0.2, -0.1), 0.99 * 0.6, 0.7, 0.6), 8, 2.0 / 3.0, "strain")
    load *= 0.02 / np.abs(load).max()
    way = [rises(t, 1.0, 0.3)] * 3
    way[0] = way[1] = way[0] * rises(t, 2.0, 1.0)
    return np.stack([load[..., n] * way[n] for n in range(3)], axis=-1)


SIGNALS = {
    "on_off": (grip, 5.5, 0.02),
    "contact": (grip, 5.5, 0.02),
    "edges": (punch, 4.5, 0.02),
    "tactile": (slide, 4.5, 0.05),
    "slip": (slide, 4.5, 0.05),
    "localize": (grip, 5.5, 0.02),
    "edge_enhancement": (grip, 5.5, 0.02),
    "texture": (ridges, 5.5, 0.1),
    "receptors": (grip, 5.5, 0.03),
    "active_contour": (grip, 5.5, 0.02),
    "grasp_code": (grip, 5.5, 0.1),
    "mindlin_slip": (sphere, 4.0, 0.05),
    "twist": (turn, 4.5, 0.03),
    "tactile_flow": (ridges, 5.5, 0.05),
    "motion_direction": (grip, 5.5, 0.05),
}
"""Of each program a signal that has its events, its length (s), and by how much (s) the times of
an event may differ from those at 200 Hz, beside two frames: what the noise of frames decides."""


def events(engine, name, rate, frames, **parameters):
    program = cnnum.get_program(name).bind(rate=rate, **parameters)
    rules = rules_that_fit(EVENT_RULES, program.trace(frames.shape[1:3]).outputs)
    needs = dict.fromkeys(output for rule in rules for output in rule.needs)
    stream = engine.compile(program, frames.shape[1:3], list(needs)).stream()
    detector, found = EventDetector(rules), []
    for number, frame in enumerate(frames):
        found += detector.update(number / rate, number, stream.push(frame))
    return [(event.title, event.time) for event in found]


def kinds_that_are_too_quick(name, rate):
    """Return the events of outputs that are made for more than half of a rate."""
    graph = cnnum.get_program(name).bind(rate=rate).trace((8, 8))
    rules = rules_that_fit(EVENT_RULES, graph.outputs)
    quick = [rule for rule in rules if 2.0 * graph.quickest.get(rule.flag, 0.0) > rate]
    return {kind.replace("_", " ") for rule in quick for kind in (rule.kind, rule.ends)}


def test_every_program_with_events_has_a_signal():
    known = {
        name
        for name in cnnum.program_names()
        if rules_that_fit(EVENT_RULES, cnnum.get_program(name).trace((8, 8), CHANNELS).outputs)
    }
    assert known == set(SIGNALS)


@pytest.mark.one_in(4)
@pytest.mark.parametrize("name", SIGNALS)
def test_the_same_signal_gives_the_same_events_at_every_rate(fast, name, caplog):
    made, lasts, late = SIGNALS[name]
    parameters = {"friction": 0.6, "depth": 2.0 / 3.0} if made is sphere else {}
    found = {}
    for rate in RATES:
        signal = made(np.arange(round(lasts * rate)) / rate)
        signal += NOISE * np.random.default_rng(0).normal(size=signal.shape)
        caplog.clear()
        found[rate] = events(fast, name, rate, signal, **parameters)
        said = "are too few for" in caplog.text
        assert said == bool(kinds_that_are_too_quick(name, rate)), (name, rate, caplog.text)
    assert found[1000.0]
    for rate in RATES:
        quick = kinds_that_are_too_quick(name, rate)
        some, wanted = (
            sorted(one for one in found[each] if one[0] not in quick) for each in (rate, 200.0)
        )
        assert [kind for kind, _ in some] == [kind for kind, _ in wanted], (name, rate)
        for (_, at), (_, right) in zip(some, wanted, strict=True):
            assert at == pytest.approx(right, abs=late + 2.0 / rate), (name, rate)


@pytest.mark.parametrize("name", ["slip", "twist", "contact", "tactile", "receptors"])
def test_a_stream_asks_for_its_rate(fast, name):
    plan = fast.compile(cnnum.get_program(name), (4, 4))
    with pytest.raises(ProgramError, match="the frame rate of the stream is not known"):
        plan.stream()
    with plan.stream(rate=50.0) as stream:
        assert stream.plan.rate == 50.0
    bound = fast.compile(cnnum.get_program(name).bind(rate="60 Hz"), (4, 4))
    assert bound.stream().plan.rate == 60.0
    with pytest.raises(ProgramError, match="for 60 frames per second, got a stream of 50"):
        bound.stream(rate=50.0)


def test_a_program_of_ones_own_has_the_rate_too(fast):
    @cnnum.program
    def halves(frame):
        memory = frame.memory("late")
        return {"late": memory.mean(frame.normal, 1.0 - 2.0 ** (-10.0 / frame.rate)).max()}

    def late(rate):
        stream = fast.compile(halves, (2, 2), channels=("normal",)).stream(rate=rate)
        out = [stream.push(np.ones((2, 2, 1)))["late"] for _ in range(round(0.2 * rate))]
        return float(out[-1])

    assert late(50.0) == pytest.approx(late(1000.0), abs=1e-5) == 0.75
    with pytest.raises(ProgramError, match="the frame rate of the stream is not known"):
        fast.compile(halves, (2, 2), channels=("normal",)).stream()

    @cnnum.program
    def outer(frame):
        return cnnum.get_program("slip").bind(rate=60.0)(frame)

    with pytest.raises(ProgramError, match="bound to 60 Hz inside a program of 50 Hz"):
        outer.bind(rate=50.0).trace((4, 4))
    assert outer.trace((4, 4)).rate == 60.0


def counts(rate, seconds, shape=(4, 4), seed=5):
    rng = np.random.default_rng(seed)
    values = rng.normal(16_000.0, 3.0, (round(seconds * rate), *shape, 3))
    return values, np.arange(len(values)) / rate


def played(folder, values, hertz, needs="contact", more="", times=None, **parameters):
    """Return the events of counts, as a user plays them."""
    recording = cnnum.Recording(np.round(values), rate=hertz, times=times)
    recording.save(folder / "sig.npz", force=True)
    lines = "".join(f"{key} = {value!r}\n" for key, value in {"push": 1.0, **parameters}.items())
    text = (
        f'needs = ["{needs}"]\n[array]\ndriver = "npz"\npath = "sig.npz"\n'
        f'{more}\n[program]\nname = "{needs}"\n[program.parameters]\n{lines}'
    )
    (folder / "sig.toml").write_text(text.replace("'", '"'))
    scene = cnnum.load_scene(folder / "sig.toml")
    return scene, [(event.kind, event.time) for event in scene.events()]


@pytest.mark.parametrize("rate", [10.0, 60.0, 1000.0])
def test_a_slow_press_is_felt_at_every_rate(tmp_path, rate):
    """40 counts a second, noise 3: six times the noise after 0.45 s, and the way to 200 goes on."""
    values, t = counts(rate, 7.0)
    values[:, 1:3, 1:3, 2] += np.clip((t - 2.0) * 40.0, 0.0, 200.0)[:, None, None]
    _, found = played(tmp_path, values, rate, reads="force")
    assert [kind for kind, _ in found] == ["contact"]
    assert 2.2 <= found[0][1] <= 2.5 + 2.0 / rate


@pytest.mark.parametrize(("tau", "lasts"), [(1.0, 10.0), (3.0, 15.0), (10.0, 15.0)])
def test_a_sensor_that_zeroes_itself_is_not_touched_twice(tmp_path, tau, lasts):
    rate = 60.0
    values, t = counts(rate, lasts + 35.0)
    load, zero = 300.0 * ((t >= 5.0) & (t < 5.0 + lasts)), np.zeros(len(t))
    for n in range(1, len(t)):
        zero[n] = zero[n - 1] + (load[n] - zero[n - 1]) / (tau * rate)
    values[:, 1:3, 1:3, 2] += (load - zero)[:, None, None]
    _, found = played(tmp_path, values, rate, reads="force")
    assert [kind for kind, _ in found] == ["contact", "release"]


@pytest.mark.parametrize("rate", RATES)
def test_an_array_that_zeroes_itself_is_touched_once(fast, rate):
    """Its load fades through the noise, by time constants of 0.2 to 20 s, and then it reads too
    low: contact, and release. A taxel that rises or falls alone is none that has broken.
    """
    taus = (0.2, 0.6, 1.5, 4.0, 20.0) if rate < 1000.0 else (0.6, 1.5)
    cases = [
        (tau, load, lasts, noise, cells)
        for tau in taus
        for load, lasts, noise in ((40.0, 0.005, 2.0), (300.0, 0.3, 2.0), (3000.0, 0.1, 0.4))
        for cells in (np.s_[1:2, 1:2], np.s_[1:3, 1:3])
    ]
    t = np.arange(round(15.0 * rate)) / rate
    values = np.random.default_rng(7).normal(size=(len(t), len(cases), 4, 5, 3))
    for at, (tau, load, lasts, noise, cells) in enumerate(cases):
        press = load * np.clip((t - 2.0) / lasts, 0.0, 1.0) * np.clip((9.0 - t) / lasts, 0.0, 1.0)
        stays = np.exp(-1.0 / (tau * rate))
        zero = lfilter([1.0 - stays], [1.0, -stays], press)
        values[:, at] = 2000.0 + noise * values[:, at]
        values[:, at, *cells, 2] += (press - zero)[:, None, None]
    program = cnnum.get_program("contact").bind(rate=rate, push=1.0, reads="force")
    stream = fast.compile(program, (4, 5), ["contact"]).stream((len(cases),))
    flags = np.array([stream.push(np.round(frame))["contact"].ravel() for frame in values]) > 0
    for case, flag in zip(cases, flags.T, strict=True):
        changes = np.flatnonzero(np.diff(flag.astype(int))) / rate
        assert len(changes) == 2, (case, changes)
        assert 2.0 - 1.0 / rate <= changes[0] <= 2.1 + 2.0 / rate, case


@pytest.mark.parametrize(("lasts", "low"), [(0.1, 300.0), (1.0, 300.0), (3.0, 300.0), (1.0, 60.0)])
@pytest.mark.parametrize("rate", [60.0, 500.0])
def test_readings_that_are_low_for_a_while_are_no_touch(tmp_path, caplog, rate, lasts, low):
    values, t = counts(rate, 9.0)
    values[:, 1:3, 1:3, 2] -= (low * ((t >= 2.0) & (t < 2.0 + lasts)))[:, None, None]
    values[:, 0, 0:2, 2] += (200.0 * (t >= 7.0))[:, None]  # and a touch afterwards is one
    with caplog.at_level(logging.WARNING, "cnnum"):
        _, found = played(tmp_path, values, rate, reads="force")
    assert [kind for kind, _ in found] == ["contact"]
    assert found[0][1] == pytest.approx(7.0, abs=0.05)
    assert lasts > 1.0 or "wrong way round" not in caplog.text


def test_a_rest_that_was_a_touch_is_learned_anew_and_said(tmp_path, caplog):
    values, t = counts(50.0, 26.0)
    values[:, 1:3, 1:3, 2] += (300.0 * ((t < 3.0) | (t >= 20.0)))[:, None, None]
    with caplog.at_level(logging.WARNING, "cnnum"):
        _, found = played(tmp_path, values, 50.0, reads="force")
    assert [(kind, round(at)) for kind, at in found] == [("contact", 20)]
    assert "rest at the start was a touch" in caplog.text
    assert "wrong way round" not in caplog.text
    # a tare says it at once: the next touch is felt 12 s earlier
    values[:, 1:3, 1:3, 2] += (300.0 * ((t >= 6.0) & (t < 8.0)))[:, None, None]
    more = "[frames]\ntare = [4.0]\n"
    _, found = played(tmp_path, values, 50.0, reads="force", more=more)
    assert [(kind, round(at)) for kind, at in found] == [
        ("contact", 6), ("release", 8), ("contact", 20),
    ]  # fmt: skip


def test_a_scene_tares_on_command(tmp_path):
    values, t = counts(50.0, 6.0)
    values[:, 1:3, 1:3, 2] += (300.0 * (t >= 2.0))[:, None, None]  # an offset that stays
    scene, _ = played(tmp_path, values, 50.0, reads="force")
    kinds = []
    for moment in scene.results():
        kinds += [(event.kind, round(event.time, 1)) for event in moment.events]
        if moment.number == 150:
            scene.tare()
    assert kinds == [("contact", 2.0), ("release", 3.0)]


@pytest.mark.parametrize("number", [0, 1, 3])
@pytest.mark.parametrize("cells", [np.s_[1, 1], np.s_[:]], ids=["a taxel", "all"])
def test_one_outlier_at_the_start_blinds_nothing(fast, number, cells):
    """In a stream, too, which no scene looks after."""
    values, t = counts(100.0, 6.0)
    values[:, 1:3, 1:3, 2] += (60.0 * ((t >= 3.0) & (t < 5.0)))[:, None, None]
    values[(number, *(cells if isinstance(cells, tuple) else (cells,)))] += 5_000.0
    found = events(fast, "contact", 100.0, values, push=1.0, reads="force")
    assert [kind for kind, _ in found] == ["contact", "release"]
    assert [at for _, at in found] == pytest.approx([3.0, 5.0], abs=0.05)


@pytest.mark.parametrize("step", [10.0, 1000.0])
def test_times_alone_at_long_steps_have_their_unit_said_at_once(tmp_path, caplog, step):
    """With the rate, too, they are an honest slow recording, whose rest is no contact."""
    values, _ = counts(1.0, 50.0, shape=(8, 8))
    times = step * np.arange(50)
    with pytest.warns(RecordingWarning, match=f"in {'ms' if step < 1000.0 else 'us'}, convert"):
        cnnum.Recording(values, times=times)
    with caplog.at_level(logging.WARNING, "cnnum"):
        _, found = played(tmp_path, values, 1.0 / step, times=times)
    assert (found, caplog.text) == ([], "")


def test_a_rest_that_moves_is_said(tmp_path, caplog):
    values, t = counts(200.0, 2.0)
    values[..., 2] += np.clip(t, 0.0, 0.4)[:, None, None] * 200.0
    with caplog.at_level(logging.WARNING, "cnnum"):
        played(tmp_path, values, 200.0, needs="slip")
    assert "readings moved by" in caplog.text


def test_a_rate_that_contradicts_the_times_is_refused(tmp_path):
    values, t = counts(60.0, 3.0)
    with pytest.raises(ArrayError, match=r"is 600 Hz, but its times give 60 frames per second"):
        cnnum.Recording(values, rate=600.0, times=t)
    with pytest.raises(SceneError, match=r"'program.parameters.rate' is 600 Hz, .* has 60"):
        played(tmp_path, values, 60.0, needs="slip", rate=600.0)


@pytest.mark.parametrize("rate", RATES)
def test_only_times_that_contradict_do(rate):
    rng = np.random.default_rng(1)
    t = np.arange(200) / rate
    assert contradicted(rate, t) is None
    assert contradicted(rate, t + 0.3 / rate * rng.uniform(size=200)) is None
    assert contradicted(rate, np.concatenate([t, t + 3600.0])) is None  # a pause
    assert contradicted(rate, np.repeat(t[::10], 10) + 1e-6 * np.arange(200)) is None  # bursts
    for factor in (10.0, 2.0, 0.5, 0.1):
        assert contradicted(factor * rate, t) == pytest.approx(rate)
    assert contradicted(10.0 * rate, np.concatenate([t, t + 3600.0])) == pytest.approx(rate)


def test_times_in_another_unit_are_named():
    t = np.arange(50) / 60.0
    assert unit_fault(t) == unit_fault(np.zeros(9)) == ""
    for unit, scale in (("ms", 1e3), ("us", 1e6), ("ns", 1e9)):
        for rate in (10.0, 60.0, 1000.0):
            assert f"time_unit = '{unit}'" in unit_fault(scale * np.arange(50) / rate)
    assert "a larger one" in unit_fault(1e-6 * t)
    assert unit_fault(np.floor(np.arange(500) / 100.0)) == ""  # a clock in whole seconds


def test_a_file_whose_times_cannot_be_right_says_the_line(tmp_path, caplog):
    rows = "\n".join(f"{16.7 * n:.1f},{n}" for n in range(20))
    (tmp_path / "a.csv").write_text(f"t,z\n{rows}\n")
    (tmp_path / "a.toml").write_text(
        'shape = [1, 1]\nchannels = ["z"]\ntime = "t"\nvalues = ["z"]\n'
    )
    with caplog.at_level(logging.WARNING, "cnnum"):
        cnnum.load_recording(tmp_path / "a.csv")
    assert "a.csv', line 3: the times 't' are 16.7 s from frame to frame" in caplog.text
    assert "if they are in ms, set time_unit = 'ms'" in caplog.text


SLOW = {  # an honest 0.1 Hz: what of a file says that its unit is s
    "a unit": (lambda n: f"{10 * n}", 'time_unit = "s"'),
    "a rate": (lambda n: f"{10 * n}", "rate = 0.1"),
    "times of day": (lambda n: f"12:{n // 6:02d}:{n % 6}0", ""),
}


@pytest.mark.parametrize("said_by", SLOW)
def test_a_slow_stream_whose_unit_is_said_is_not_questioned(said_by, tmp_path, caplog):
    time, key = SLOW[said_by]
    loads = np.random.default_rng(0).integers(0, 99, (40, 4))
    rows = "\n".join(f"{time(n)},{','.join(map(str, row))}" for n, row in enumerate(loads))
    (tmp_path / "a.csv").write_text(f"t,p0,p1,p2,p3\n{rows}\n")
    layout = 'shape = [2, 2]\nchannels = ["z"]\nvalues = "p{n}"\ntime = "t"\n'
    (tmp_path / "a.toml").write_text(layout + key)
    with open_driver("file", {"path": str(tmp_path / "a.csv")}) as driver:
        found = checked(driver.recording, timed=driver.timed)
    (rate,) = (finding for finding in found if finding.what == "rate")
    assert (rate.wrong, driver.rate) == (False, pytest.approx(0.1))
    assert caplog.text == ""
    (tmp_path / "a.toml").write_text(layout)
    with open_driver("file", {"path": str(tmp_path / "a.csv")}) as driver:
        assert driver.timed == (key == "")
    assert ("time_unit = 'ms'" in caplog.text) == bool(key)
