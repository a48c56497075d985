"""Taxels that drop out are masked and come back, and an array that is silent is said to be."""

import json
import logging

import numpy as np
import pytest

import cnnum
from cnnum.drivers.codecs.stream import Scan
from cnnum.drivers.codecs.wire import Asked, wire
from cnnum.drivers.codecs.wire import described_wire as wire_of
from cnnum.errors import FrameError, SceneError
from cnnum.frame import FORCE_AXES, Frame
from cnnum.scenes.bad_taxels import Dropouts, Liveness

RATE = 100.0
ROWS, COLS = np.mgrid[:8, :8].astype(float)
SHAPE = np.exp(-((ROWS - 3.5) ** 2 + (COLS - 3.5) ** 2) / 5.12)
LOST = slice(900, 960)


def grip(seed=1, frames=1400):
    """Counts of a quiet grip from 1.5 s on, pulled a little at 4 s."""
    t = np.arange(frames) / RATE
    values = np.random.default_rng(seed).normal(16_000.0, 3.0, (frames, 8, 8, 3))
    values[..., 2] += np.clip((t - 1.0) / 0.5, 0.0, 1.0)[:, None, None] * SHAPE * 600.0
    values[..., 0] += np.clip((t - 4.0) / 0.3, 0.0, 1.0)[:, None, None] * SHAPE * 150.0
    return np.round(values)


def played(folder, values, program="slip", more=""):
    cnnum.Recording(values, rate=RATE).save(folder / "grip.npz", force=True)
    events = {"slip": "slip", "twist": "twist", "contact": "contact"}[program]
    (folder / "scene.toml").write_text(
        f'needs = ["{events}"]\n[array]\ndriver = "npz"\npath = "grip.npz"\n'
        f'{more}\n[program]\nname = "{program}"\n[program.parameters]\npush = 1.0\n'
    )
    scene = cnnum.load_scene(folder / "scene.toml")
    return scene, [(event.kind, round(event.time, 2)) for event in scene.events()]


def column(values):
    values[LOST, :, 2] = 0.0
    return 8


def row_at_its_rail(values):
    values[LOST, 4] = 65_535.0
    return 8


def loaded_taxel(values):
    values[LOST, 3, 3] = 0.0
    return 1


def load_of_a_taxel(values):
    values[LOST, 3, 3] = values[0, 3, 3]
    return 1


@pytest.mark.parametrize("loses", [column, row_at_its_rail, loaded_taxel, load_of_a_taxel])
def test_a_lost_line_or_taxel_is_no_slip_and_comes_back(tmp_path, caplog, loses):
    values = grip()
    count = loses(values)
    with caplog.at_level(logging.WARNING, "cnnum"):
        scene, events = played(tmp_path, values)
    seen = scene.summary()
    assert events == []
    assert seen.dropouts == count
    # lost for 0.6 s, and 0.1 s until they have been steady
    assert seen.masked == pytest.approx(60 + 10, abs=3)
    assert caplog.text.count("have dropped out") == 1


def test_zero_scans_are_bad_frames(tmp_path):
    values = grip()
    values[900:903] = 0.0
    scene, events = played(tmp_path, values)
    assert events == []
    assert scene.summary().refused == 3


@pytest.mark.parametrize("program", ["contact", "twist"])
def test_contact_and_twist_hold_meanwhile(tmp_path, program):
    values = grip()
    column(values)
    _, events = played(tmp_path, values, program)
    assert [kind for kind, _ in events] == (["contact"] if program == "contact" else [])


EACH = [[15_000.0, 17_000.0], [0.0, 65_535.0], [12_000.0, 30_000.0]]
"""Limits of x, y and z; a reading of x that is fine for z is none of x."""


def lost_in_x(seed=1):
    """A quiet grip in which two taxels read 20,000 in x, where z may, and 14,000 in y."""
    values = grip(seed)
    values[LOST, 2, 2:4, 0] = 20_000.0
    values[LOST, 5, 2:4, 1] = 14_000.0
    return values


def of_a_layout(folder, values, limits):
    values = values * [-1.0, 1.0, 1.0]  # the layout turns x around: its limits are of the file
    np.save(folder / "grip.npy", values)
    (folder / "grip.toml").write_text(
        f'shape = [8, 8]\nchannels = ["-x", "y", "z"]\nrate = {RATE}\nlimits = '
        f"{[[-limits[0][1], -limits[0][0]], *limits[1:]]}\n"
    )
    return {"driver": "file", "path": str(folder / "grip.npy")}, {}


def of_a_scene(folder, values, limits):
    cnnum.Recording(values, rate=RATE).save(folder / "grip.npz", force=True)
    return {"driver": "npz", "path": str(folder / "grip.npz")}, {"frames.limits": limits}


@pytest.mark.parametrize("said_by", [of_a_layout, of_a_scene])
def test_every_channel_may_have_limits_of_its_own(tmp_path, said_by):
    array, more = said_by(tmp_path, lost_in_x(), EACH)
    (tmp_path / "scene.toml").write_text(
        'needs = ["slip"]\n[array]\ndriver = "npz"\n[program]\nname = "slip"\n'
        "[program.parameters]\npush = 1.0\n"
    )
    scene = cnnum.load_scene(tmp_path / "scene.toml", changes={"array": array, **more})
    masks = [one.masked for one in scene.results() if LOST.start + 5 < one.number < LOST.stop]
    assert scene.summary().dropouts == 2
    for mask in masks:
        assert np.argwhere(mask).tolist() == [[2, 2], [2, 3]]


def test_limits_of_a_descriptor_mask_taxels_of_packets_with_a_check(tmp_path):
    text = (
        'name = "m"\nshape = [2, 2]\nchannels = ["x", "z"]\nheader = "5a a5"\ncell = "u16"\n'
        "scale = 0.5\nlimits = [[100, 40000], [1, 65000]]\n"
    )
    values = np.full((2, 2, 2), 8_000.0)
    values[0, 1, 0] = 30_000.0  # 60,000 in x
    for check, comes in (("crc16-modbus", True), ("none", False)):
        (tmp_path / "m.toml").write_text(f'{text}check = "{check}"\n')
        known = wire_of(tmp_path / "m.toml", Asked())
        scans = known.decoder().feed(3 * known.encode(Scan(values, ("shear_x", "normal"), "count")))
        assert bool(scans) == comes
        assert known.limits == (((50.0, 20_000.0), (0.5, 32_500.0)) if comes else None)
    looks = Dropouts((2, 2), ((50.0, 20_000.0), (0.5, 32_500.0)))
    frame = Frame(values, ("shear_x", "normal"), "count", 0, 0.0)
    assert np.argwhere((looks.look(frame), looks.masked)[1]).tolist() == [[0, 1]]


@pytest.mark.parametrize("limits", [[[1, 2], [3, 4]], [[2, 1], [3, 4], [5, 6]], [1], "high", [[]]])
def test_limits_of_other_channels_are_refused(tmp_path, limits):
    array, more = of_a_scene(tmp_path, grip(frames=40), limits)
    (tmp_path / "scene.toml").write_text(
        'needs = ["contact"]\n[array]\ndriver = "npz"\n[program]\nname = "contact"\n'
    )
    with pytest.raises(SceneError, match=r"'frames.limits'.* the smallest and largest"):
        cnnum.load_scene(tmp_path / "scene.toml", changes={"array": array, **more})


def test_limits_are_the_scenes(tmp_path):
    """A loose column floats within the range of its converter, far below what a taxel gives."""
    values = grip()
    values[LOST, :, 2] = np.random.default_rng(2).normal(300.0, 50.0, (60, 8, 3)).round()
    scene, events = played(tmp_path, values, more="[frames]\nlimits = [1000, 60000]\n")
    assert (events, scene.summary().dropouts) == ([], 8)
    with pytest.raises(SceneError, match=r"'frames.limits' must be the smallest and largest"):
        played(tmp_path, values, more="[frames]\nlimits = [60000, 1000]\n")


def test_a_slide_after_a_dropout_is_found(tmp_path):
    values = grip(frames=1250)
    for number in range(1100, 1250):
        at = 3.5 + min(3.0, 8.0 * (number / RATE - 11.0))
        moved = np.exp(-((ROWS - 3.5) ** 2 + (COLS - at) ** 2) / 5.12) - SHAPE
        values[number, ..., 2] += 600.0 * moved
        values[number, ..., 0] += 150.0 * moved
    clean = played(tmp_path, values)[1]
    column(values)
    assert played(tmp_path, values)[1] == clean
    assert clean[0][0] == "slip"


@pytest.mark.parametrize("fault", ["frozen", "alike", "taxel"])
def test_silence_is_an_event_and_one_sentence(tmp_path, caplog, fault):
    values = grip()
    if fault == "frozen":
        values[900:1200] = values[899]
    elif fault == "alike":
        values[900:1200] = 0xFAFA
    else:
        values[900:1200, 2, 2] = values[899, 2, 2]
    with caplog.at_level(logging.WARNING, "cnnum"):
        _, events = played(tmp_path, values)
    assert [kind for kind, _ in events] == ["silent", "silent_end"]
    assert [at for _, at in events] == pytest.approx([11.0, 12.0], abs=0.02)
    assert caplog.text.count("nothing shows that the array is alive") == 1


def frame(values, number):
    return Frame(values, FORCE_AXES[: values.shape[2]], "count", number, number / RATE)


def test_an_array_coarser_than_its_noise_is_not_silent():
    watch = Liveness()
    rest = np.zeros((4, 4, 3))
    rest[..., 0] = 1.0
    for number in range(600):
        values = rest.copy()
        values[1, 1, 2] = number % 300 == 299  # a count now and then
        assert watch.look(number, frame(values, number)) == ()


def test_good_frames_are_handed_on_as_they_are():
    """Presses and releases, as sudden as they come, of one taxel or of many."""
    rng, watch = np.random.default_rng(3), Dropouts((6, 6), quiet=True)
    for number in range(600):
        values = rng.normal(16_000.0, 3.0, (6, 6, 3))
        if 100 <= number < 200:
            values[2:4, 2:5, 2] += 400.0
        if 300 <= number < 400:
            values[1, 1, 2] += 400.0
        if number >= 450:
            values[:, 3, 2] += 500.0
        given = frame(values, number)
        assert watch.look(given) is given
    assert watch.count == 0


ARRAYS = {  # shape, channels, offset, noise, load, whether in whole numbers
    "counts": ((8, 8), 3, 16_000.0, 3.0, 600.0, True),
    "counts of one axis": ((6, 9), 1, 16_000.0, 3.0, 600.0, True),
    "a mat of 8 bits": ((8, 10), 1, 12.0, 0.6, 150.0, True),
    "newtons": ((4, 4), 3, 0.0, 0.01, 2.0, False),
    "newtons of one axis": ((6, 6), 1, 0.0, 0.02, 3.0, False),
}
RATES = (10.0, 50.0, 200.0, 1000.0)


def at_rest(array, rate, seconds, rng):
    shape, channels, offset, noise, _, _ = ARRAYS[array]
    t = np.arange(round(seconds * rate)) / rate
    return t, rng.normal(offset, noise, (len(t), *shape, channels))


def looked_at(array, rate, values, **options):
    """Return what is masked in every frame, the losses, and the bad frames."""
    watch, masks, bad = Dropouts(values.shape[1:3], quiet=True, **options), [], 0
    for number, one in enumerate(np.round(values) if ARRAYS[array][5] else values):
        names = FORCE_AXES[3 - values.shape[3] :] if values.shape[3] == 1 else FORCE_AXES
        try:
            watch.look(Frame(one, names, "count", number, number / rate))
        except FrameError:
            bad += 1
        masks.append(np.zeros(one.shape[:2], bool) if watch.masked is None else watch.masked)
    return np.array(masks), watch.count, bad


def lost(array, fault, values, part, rng):
    """Put a fault into frames, and return its taxels."""
    shape, _, offset, noise, load, _ = ARRAYS[array]
    row, col = shape[0] // 2, shape[1] // 2
    cells = {"taxel": np.s_[row, col], "column": np.s_[:, col], "row": np.s_[row], "all": np.s_[:]}
    where = cells[fault.split()[0]]
    marks = np.zeros(shape, bool)
    marks[where] = True
    size = values[part][:, marks].shape
    if fault.endswith("zero"):
        values[part, marks] = 0.0
    elif fault.endswith("normal"):
        values[part, marks, -1] = 0.0
    elif fault.endswith("load"):
        values[part, marks] = rng.normal(offset, noise, size)
    else:
        values[part, marks] = rng.normal(0.3 * offset - 2.0 * load, 5.0 * noise, size)
    return marks


SUDDEN = ("taxel zero", "taxel load", "column zero", "column normal", "row zero", "all zero")
FLOATS = ("taxel floats", "row floats", "column floats")


@pytest.mark.one_in(5)
@pytest.mark.parametrize("rate", RATES)
@pytest.mark.parametrize("array", ARRAYS)
def test_lost_taxels_of_a_grip_are_masked_at_every_rate(array, rate):
    """A taxel that floats moves faster than a load can, if the rate resolves a load's rise."""
    shape = ARRAYS[array][0]
    begin, lasts = max(0.3, 10 / rate), max(0.15, 4 / rate)
    rows, cols = np.mgrid[: shape[0], : shape[1]] - np.array(shape)[:, None, None] / 2 + 0.5
    face = np.exp(-(rows**2 + cols**2) / (0.1 * min(shape) ** 2))
    for fault in (*SUDDEN, *FLOATS):
        rng = np.random.default_rng(7)
        t, values = at_rest(array, rate, begin + 0.4 + lasts + max(0.4, 8 / rate), rng)
        grown = np.clip((t - begin) / 0.1, 0.0, 1.0)[:, None, None]
        values[..., -1] += ARRAYS[array][4] * grown * face
        part = slice(round((begin + 0.3) * rate), round((begin + 0.3 + lasts) * rate))
        marks = lost(array, fault, values, part, rng)
        for bandwidth in sorted({100.0, rate / 10.0}):
            masks, count, bad = looked_at(array, rate, values, bandwidth=bandwidth)
            if fault == "all zero":
                assert (count, bad) == (0, part.stop - part.start)
                continue
            found = fault in SUDDEN or rate > 572.0 * bandwidth / 100.0
            assert bad == 0
            assert (masks[part] == (marks & found)).all(), fault
            assert count == (marks.sum() if found else 0)
            assert not masks[part.stop + round(0.1 * rate) + 2 :].any()


def random_presses(array, rate, rng):
    """One to three touches: pins, bars, plates, taps, and faces that stay or slide.

    Also the taxels under pins that lift within two frames: beside another load these read as taxels
    that are lost.
    """
    (rows, cols), channels, _, _, load, _ = ARRAYS[array]
    t, values = at_rest(array, rate, max(1.5, 40 / rate), rng)
    y, x = np.mgrid[:rows, :cols].astype(float)
    lifted = np.zeros((rows, cols), bool)
    for _ in range(rng.integers(1, 4)):
        kind = rng.choice(["pin", "face", "bar", "plate", "tap", "slide"])
        begin = rng.uniform(max(0.15, 10 / rate), t[-1] - 0.1)
        rise, fall = np.exp(rng.uniform(np.log(0.005), np.log(0.5), 2))
        end = begin + rise + rng.uniform(0.02, 1.5)
        grown = np.clip((t - begin) / rise, 0, 1) * (1 - np.clip((t - end) / fall, 0, 1))
        if kind == "tap":
            grown = np.sin(np.pi * np.clip((t - begin) / rng.uniform(0.01, 0.1), 0, 1))
        row, col = rng.uniform(-0.5, rows - 0.5), rng.uniform(-0.5, cols - 0.5)
        face = {
            "pin": (y == round(row)) & (x == round(col)), "bar": y == round(row), "plate": y >= 0
        }.get(kind)  # fmt: skip
        if face is None:
            speed = rng.uniform(-40, 40) if kind == "slide" else 0.0
            at = col + speed * np.maximum(t - begin, 0)[:, None, None]
            face = np.exp(-((y - row) ** 2 + (x - at) ** 2) / (2 * rng.uniform(0.4, 2.5) ** 2))
        else:
            lifted |= face & (kind == "pin") & (fall < 2.0 / rate)
            face = face * (1 + 0.2 * rng.normal(size=(rows, cols)))
        size = load * np.exp(rng.uniform(np.log(0.1), np.log(3.0)))
        ways = np.append(0.3 * rng.normal(size=2), 1.0)[3 - channels :] if channels > 1 else [1.0]
        values += size * (grown[:, None, None] * face)[..., np.newaxis] * ways
    return values, lifted


@pytest.mark.one_in(5)
@pytest.mark.parametrize("rate", RATES)
@pytest.mark.parametrize("array", ARRAYS)
def test_no_press_is_masked_at_any_rate(array, rate):
    for seed in range(2):
        rng = np.random.default_rng([seed, int(rate), len(array)])
        values, lifted = random_presses(array, rate, rng)
        masks, count, bad = looked_at(array, rate, values)
        assert bad == 0, seed
        assert not (np.any(masks, axis=0) & ~lifted).any(), seed
        assert count <= lifted.sum(), seed


def test_an_array_that_zeroes_itself_comes_back():
    """All taxels make one step between two frames of 1 kHz, and stay there."""
    rng = np.random.default_rng(8)
    values = rng.normal(16_000.0, 3.0, (900, 6, 6, 1))
    values[300:] += 600.0
    masks, _, bad = looked_at("counts of one axis", 1000.0, values)
    assert bad == pytest.approx(100, abs=2)
    assert not masks[410:].any()


@pytest.mark.parametrize("said_by", ["scene", "layout"])
def test_the_bandwidth_is_that_of_the_scene_or_layout(tmp_path, said_by):
    values = grip(frames=700)
    values[600:, 3, 3] = np.random.default_rng(9).normal(9_000.0, 20.0, (100, 3))
    np.save(tmp_path / "grip.npy", values)
    keys = {said_by: "bandwidth = 10.0"}
    (tmp_path / "grip.toml").write_text(f"shape = [8, 8]\nrate = 100.0\n{keys.get('layout', '')}\n")
    scene = tmp_path / "scene.toml"
    text = (
        'needs = ["load_normal"]\n[array]\ndriver = "file"\npath = "grip.npy"\n'
        '[program]\nname = "contact"\n[program.parameters]\npush = 1.0\n[frames]\n'
    )
    scene.write_text(text + keys.get("scene", ""))
    seen = cnnum.load_scene(scene)
    masks = [one.masked for one in seen.results()]
    assert seen.summary().dropouts == 1
    assert np.argwhere(masks[-1]).tolist() == [[3, 3]]
    scene.write_text(text + "bandwidth = 0")
    with pytest.raises(SceneError, match=r"'frames.bandwidth' must be a positive number"):
        cnnum.load_scene(scene)


@pytest.mark.parametrize("name", ["anyskin", "anyskin-text"])
def test_a_lost_chip_leaves_the_frames_of_the_others(name):
    known = wire(name, Asked(shape=(1, 5)))
    rng, decoder, found = np.random.default_rng(4), known.decoder(), []
    for _ in range(60):
        values = np.concatenate(
            [np.full((1, 5, 1), 25.0), rng.normal(0.0, 1.0, (1, 5, 3))], axis=2
        ).astype(np.float32)
        values[0, 1] = np.nan
        scan = cnnum_scan(known, values)
        found += decoder.feed(known.encode(scan))
    assert len(found) >= 58
    assert all(np.isnan(scan.values[0, 1]).all() for scan in found)
    assert all(np.isfinite(scan.values[0, [0, 2, 3, 4]]).all() for scan in found)


def cnnum_scan(known, values):
    from cnnum.drivers.codecs.stream import Scan

    return Scan(values, known.form.channels, known.form.unit)


def test_a_taxel_without_numbers_costs_frames_until_it_is_masked():
    rng, watch, bad = np.random.default_rng(6), Dropouts((1, 5), quiet=True), 0
    for number in range(100):
        values = rng.normal(0.0, 1.0, (1, 5, 3))
        values[0, 2] = np.nan
        seen = watch.look(frame(values, number)).values
        bad += not np.isfinite(seen).all()
        if number > 20:
            assert watch.masked.tolist() == [[False, False, True, False, False]]
    assert bad == pytest.approx(10, abs=2)


def message(number, *taxels):
    def pad(sensor, count):
        numbers = ",".join(f"{32768 + n:04X}" for n in range(3 * count))
        return {
            "sensor": sensor, "time": 1.0 + 0.01 * number, "model": "x", "taxels": count,
            "data": numbers, "calibrated": None,
        }  # fmt: skip

    pads = {str(n): pad(n, count) for n, count in enumerate(taxels, 1)}
    return json.dumps({"message": number, **pads}).encode() + b"\n"


def test_pads_of_two_sizes_are_named_or_one_is_chosen():
    decoder = wire("xela").decoder()
    for number in range(5):
        assert decoder.feed(message(number, 16, 24)) == []
    assert "pads of 4×4 and 4×6 taxels" in decoder.trouble
    assert "shape = [4, 4]" in decoder.trouble
    for shape in ((4, 4), (4, 6)):
        chosen = wire("xela", Asked(shape=shape)).decoder()
        found = [scan for n in range(3) for scan in chosen.feed(message(n, 16, 24))]
        assert [scan.values.shape for scan in found] == [(*shape, 3)] * 3
        assert chosen.trouble == ""
    twice = wire("xela", Asked(shape=(4, 4))).decoder()
    assert twice.feed(message(0, 16, 16, 24)) == []
    assert "do not form one array" in twice.trouble
    # pads of one size among others are side by side, or as the shape has them
    assert "shape = [4, 8] for 2 pads of 4×4" in twice.trouble
    for shape in ((4, 8), (8, 4)):
        chosen = wire("xela", Asked(shape=shape)).decoder()
        (scan,) = chosen.feed(message(0, 16, 24, 16))
        assert scan.values.shape == (*shape, 3)


@pytest.mark.parametrize("name", ["anyskin", "anyskin-text"])
def test_a_chip_that_has_its_temperature_alone_costs_no_frame(name):
    known = wire(name)
    decoder, got = known.decoder(), []
    for n in range(30):
        values = np.random.default_rng(n).normal(20.0, 5.0, (1, 5, 4))
        values[0, 2, 1:] = np.nan
        got += decoder.feed(known.encode(Scan(values, known.form.channels, "uT")))
    assert len(got) >= 28
    assert np.isnan(got[0].values[0, 2, 1:]).all()


@pytest.mark.parametrize(("value", "lost"), [(np.nan, 4), (np.inf, 1)])
def test_packets_of_no_numbers_name_their_chips(value, lost):
    """Before, no frame came, and the sentence blamed the baud rate."""
    known = wire("anyskin")
    decoder = known.decoder()
    for n in range(10):
        values = np.random.default_rng(n).normal(20.0, 5.0, (1, 5, 4))
        values[0, :lost] = value
        assert decoder.feed(known.encode(Scan(values, known.form.channels, "uT"))) == []
    assert f"{lost} of their 5 taxels send NaN or infinity" in decoder.trouble
    values = np.full((1, 5, 4), 20.0)
    got = [
        scan
        for _ in range(5)
        for scan in decoder.feed(known.encode(Scan(values, known.form.channels, "uT")))
    ]
    assert got
    assert decoder.trouble == ""


@pytest.mark.parametrize("rate", [1.0, 2.0, 5.0, 100.0])
@pytest.mark.parametrize("shape", [(4, 4, 1), (1, 1, 1)])
def test_a_slow_array_of_few_levels_is_silent_when_it_is_frozen_alone(rate, shape):
    random = np.random.default_rng(int(rate))
    values = np.round(random.normal(2.0, 0.6, (600, *shape)))
    values[400:] = values[399]
    watch = Liveness(quiet=True)
    found = [
        (event.kind, number)
        for number in range(600)
        for event in watch.look(
            number, cnnum.Frame(values[number], ("normal",), "count", number, number / rate)
        )
    ]
    assert [kind for kind, _ in found] == ["silent"]
    assert 400 + 2 * rate <= found[0][1] + 4 <= 400 + max(2 * rate, 80)
