"""What `cnnum check` prints cures: in layouts, in scenes of own recordings, and in descriptors."""

from threading import Event, Thread

import h5py
import numpy as np
import pytest
from foreign_files import press

import cnnum
from cnnum.drivers.codecs.wire import Asked, described_wire
from cnnum.drivers.serial_array import SerialOptions
from cnnum.drivers.virtual import VirtualArray, VirtualLine
from cnnum.frame import FORCE_AXES, Frame

SHAPE = (6, 5)
TURNS = {
    "z, x, y for x, y, z": lambda v: v[..., [2, 0, 1]],
    "x mirrored": lambda v: v * [-1, 1, 1],
    "y mirrored": lambda v: v * [1, -1, 1],
    "rows and columns swapped": lambda v: v.swapaxes(1, 2).reshape(v.shape),
    "axis-first read as axis-last": lambda v: v.transpose(0, 3, 1, 2).reshape(v.shape),
    "upside down": lambda v: v[:, ::-1],
    "Fortran's order": lambda v: v.transpose(0, 3, 2, 1).reshape(v.shape),
    "z turned": lambda v: v * [1, 1, -1],
}
PLAIN = 'needs = ["load_normal"]\n[array]\ndriver = "simulated"\n[program]\nname = "contact"\n'


class Plain(VirtualArray):
    """Sends the very numbers, in place of loads that are fitted to the range of a cell."""

    def _values(self):
        return lambda number: self.frames[number % len(self.frames)].values


def wrong(turn):
    return np.ascontiguousarray(TURNS[turn](press(*SHAPE, offset=16_000)))


def agrees(values):
    """Whether the shear points away from the press: upside down, too, as its sign is turned."""
    from cnnum.recordings.checking import checked

    recording = cnnum.Recording(values, rate=100.0)
    (found,) = (one for one in checked(recording) if one.what == "order")
    return not found.wrong and "are right" in found.sentence


def cure_of(call, records, path):
    done = call("check", path, "--json")
    assert done.exit_code == 1
    (found,) = (one for one in records(done.stdout) if one["what"] == "order")
    assert found["wrong"]
    text = call("check", path).stdout
    for key, value in found["cure"].items():
        shown = ", ".join(f'"{v}"' for v in value) if isinstance(value, list) else f'"{value}"'
        assert f"{key} = [{shown}]" in text or f"{key} = {shown}" in text
    return found["cure"]


@pytest.mark.parametrize("turn", TURNS)
def test_the_toml_cures_a_file_with_a_layout(call, records, tmp_path, turn):
    np.save(tmp_path / "a.npy", wrong(turn))
    layout = tmp_path / "a.toml"
    layout.write_text(f"shape = {list(SHAPE)}\nrate = 100.0\n")
    cure = cure_of(call, records, tmp_path / "a.npy")
    lines = [f"{key} = {value!r}".replace("'", '"') for key, value in cure.items()]
    layout.write_text("\n".join([layout.read_text(), *lines]))
    assert call("check", tmp_path / "a.npy").exit_code == 0


@pytest.mark.parametrize("suffix", [".npz", ".mcap", ".csv"])
@pytest.mark.parametrize("turn", TURNS)
def test_the_toml_cures_an_own_recording_in_its_scene(call, records, tmp_path, turn, suffix):
    path = tmp_path / f"a{suffix}"
    cnnum.Recording(wrong(turn), rate=100.0).save(path)
    cure = cure_of(call, records, path)
    assert all(key.startswith("frames.") for key in cure)
    scene = tmp_path / "scene.toml"
    keys = [f"{k.removeprefix('frames.')} = {v!r}".replace("'", '"') for k, v in cure.items()]
    scene.write_text(PLAIN + "[frames]\n" + "\n".join(keys))
    driver = {".npz": "npz", ".mcap": "mcap", ".csv": "file"}[suffix]
    held = cnnum.load_scene(scene, changes={"array": {"driver": driver, "path": str(path)}})
    names = held.driver.channels
    values = np.stack([one.frame.values for one in held.results()])
    assert agrees(values[..., [names.index(name) for name in FORCE_AXES]])


@pytest.mark.parametrize(
    "turn", ["z, x, y for x, y, z", "y mirrored", "axis-first read as axis-last"]
)
def test_the_keys_cure_a_stream_in_its_descriptor(tmp_path, turn):
    keys = {
        "z, x, y for x, y, z": 'channels = ["z", "x", "y"]\n',
        "y mirrored": 'channels = ["x", "-y", "z"]\n',
        "axis-first read as axis-last": (
            'channels = ["x", "y", "z"]\norder = "frames channels rows cols"\n'
        ),
    }[turn]
    described = tmp_path / "m.toml"
    described.write_text(
        f'name = "m"\nshape = {list(SHAPE)}\nheader = "5a a5"\ncounter = "u16"\ncell = "f32"\n'
        f'check = "crc16-modbus"\nlimits = [-1e6, 1e6]\n{keys}'
    )
    known = described_wire(described, Asked())
    sent = wrong(turn)[-40:]
    names = known.form.channels
    frames = [Frame(v, names, "count", n, n / 100.0) for n, v in enumerate(sent)]
    line = VirtualLine(tmp_path / "port")
    stop = Event()
    array = Plain(known, line, frames, 200.0)
    thread = Thread(target=array.run, args=(stop,))
    thread.start()
    try:
        with SerialOptions(port=str(tmp_path / "port"), descriptor=described).open() as driver:
            got = next(iter(driver.frames()))
            names = driver.channels
    finally:
        stop.set()
        thread.join(30.0)
        line.close()
    right = press(*SHAPE, offset=16_000)[-40:]
    values = got.values[..., [names.index(name) for name in FORCE_AXES]]
    away = np.abs(right - values).max(axis=(1, 2, 3))
    assert away.min() < 1e-2  # float32 of 16,000


@pytest.mark.parametrize("shape", [(4, 4), (6, 5)])
@pytest.mark.parametrize("turn", ["Fortran's order", "z turned"])
def test_events_are_those_of_the_right_order_with_the_cure(call, records, tmp_path, turn, shape):
    """`run` says the same as `check`, once, and with the keys it says nothing."""
    scene = tmp_path / "scene.toml"
    found = {}
    for name, change in (("right", np.asarray), ("wrong", TURNS[turn])):
        path = tmp_path / f"{name}.npz"
        values = np.ascontiguousarray(change(press(*shape, offset=900)))
        cnnum.Recording(values, rate=100.0).save(path)
        found[name] = path
    scene.write_text(
        'needs = ["contact"]\n[array]\ndriver = "npz"\n[program]\nname = "contact"\n'
        'parameters = { push = 1.0 }\n[engine]\nname = "numba"\n'
    )
    cure = cure_of(call, records, found["wrong"])
    keys = [text for k, v in cure.items() for text in ("--set", f"{k}={v}".replace("'", '"'))]
    seen = []
    for name, more in (("right", ()), ("wrong", ()), ("wrong", keys)):
        done = call("run", scene, "--set", f"array.path={found[name]}", *more, "--json")
        *events, _ = records(done.stdout)
        seen.append([(one["t"], one["kind"], one["where"]) for one in events])
        said = done.stderr.count("should")
        assert said == (name == "wrong" and not more)
        assert all(f"{k.removeprefix('frames.')} = " in done.stderr for k in cure) == bool(said)
    right, wrong, cured = seen
    assert [kind for _, kind, _ in right] == ["contact"]
    assert cured == right != wrong


def test_a_rest_under_a_load_has_a_time_for_its_tare(call, records, tmp_path):
    made = press(*SHAPE, offset=16_000)
    values = np.concatenate([made[-60:], made[:90], made[:90]])
    cnnum.Recording(values, rate=100.0).save(tmp_path / "a.npz")
    done = call("check", tmp_path / "a.npz", "--json")
    (found,) = (one for one in records(done.stdout) if one["what"] == "rest" and one["wrong"])
    (at,) = found["cure"]["frames.tare"]
    moved = np.abs(values - made[:50].mean(axis=0)).max(axis=(1, 2, 3)) > 60.0
    assert not moved[round(100 * at) :].any()
    assert moved[: round(100 * (at - 0.2))].any()


def unit_of(call, records, path):
    done = call("check", path, "--json")
    (found,) = (one for one in records(done.stdout) if one["what"] == "unit")
    return done.exit_code, found


@pytest.mark.parametrize(
    ("unit", "scale", "suffix"),
    [("strain", 1.0, ".npz"), ("N", 1.0, ".csv"), ("V", 0.37, ".npz"), ("N", 7.3, ".npy")],
)
def test_a_wrong_unit_is_cured_with_a_layout_and_without(
    call, records, tmp_path, unit, scale, suffix
):
    values = np.round(press(4, 4, offset=16_000)) * scale
    path, scene, keys = tmp_path / f"a{suffix}", tmp_path / "scene.toml", "frames.unit"
    if suffix == ".npy":
        np.save(path, values)
        keys, layout = "unit", tmp_path / "a.toml"
        layout.write_text(f'shape = [4, 4]\nrate = 100.0\nunit = "{unit}"\n')
    else:
        cnnum.Recording(values, rate=100.0, unit=unit).save(path)
    code, found = unit_of(call, records, path)
    assert (code, found["wrong"], found["cure"]) == (1, True, {keys: "count"})
    assert f'{keys} = "count"' in call("check", path).stdout
    driver = {".npz": "npz"}.get(suffix, "file")
    text = PLAIN.replace("simulated", f'{driver}"\npath = "{path.name}')
    text = text.replace("load_normal", "contact")
    scene.write_text(f'{text}parameters = {{ push = 1.0 }}\n[engine]\nname = "numba"\n')
    more = ()
    if suffix == ".npy":
        layout.write_text(layout.read_text().replace(unit, "count"))
        assert call("check", path).exit_code == 0
    else:
        more = ("--set", "frames.unit=count")
    for ask in (("run", scene), ("replay", path, "--scene", scene)):
        first, *rest = records(call(*ask, "--json", *more).stdout)
        assert (first["kind"], rest[-1]["refused"]) == ("contact", 0)
        assert 1.0 < first["t"] < 1.2


@pytest.mark.parametrize(("unit", "scale"), [("ms", 1e3), ("us", 1e6), ("ns", 1e9)])
def test_times_in_another_unit_are_a_fault_with_a_cure(call, records, tmp_path, unit, scale):
    values = press(4, 4, offset=900)
    np.savez(tmp_path / "a.npz", tactile=values, t=scale * np.arange(len(values)) / 100.0)
    layout = tmp_path / "a.toml"
    layout.write_text('shape = [4, 4]\nvalues = "tactile"\ntime = "t"\n')
    done = call("check", tmp_path / "a.npz", "--json")
    (found,) = (one for one in records(done.stdout) if one["what"] == "rate")
    assert (done.exit_code, found["wrong"], found["cure"]) == (1, True, {"time_unit": unit})
    layout.write_text(f'{layout.read_text()}time_unit = "{unit}"\n')
    assert call("check", tmp_path / "a.npz").exit_code == 0
    assert cnnum.load_recording(tmp_path / "a.npz").rate == pytest.approx(100.0)


@pytest.mark.parametrize(("suffix", "unit"), [(".csv", "ms"), (".npz", "us"), (".h5", "ms")])
def test_times_of_an_own_recording_have_a_cure_in_its_scene(call, records, tmp_path, suffix, unit):
    """It is said by `check`, `run` and `replay` where times contradict the rate of the file."""
    size = {"ms": 1e-3, "us": 1e-6}[unit]
    values = np.round(press(4, 4, offset=900))
    t, path, scene = np.arange(len(values)) / 100.0, tmp_path / f"a{suffix}", tmp_path / "s.toml"
    cnnum.Recording(values, times=t).save(path)
    if suffix == ".csv":
        head, *rows = [line.split(",") for line in path.read_text().splitlines()]
        at = head.index("time (s)")
        for row in rows:
            row[at] = repr(float(row[at]) / size)
        path.write_text("".join(",".join(line) + "\n" for line in [head, *rows]))
    elif suffix == ".npz":
        with np.load(path) as held:
            arrays = dict(held)
        np.savez(path, **arrays | {"time": arrays["time"] / size})
    elif suffix == ".h5":
        with h5py.File(path, "r+") as held:
            held["time"][:] /= size
    done = call("check", path, "--json")
    (found,) = (one for one in records(done.stdout) if one["what"] == "rate")
    assert (done.exit_code, found["cure"]) == (1, {"frames.time_unit": unit})
    text = PLAIN.replace("load_normal", "contact").replace(
        "simulated", f'file"\npath = "{path.name}'
    )
    scene.write_text(f'{text}parameters = {{ push = 1.0 }}\n[engine]\nname = "numba"\n')
    for ask in (("run", scene), ("replay", path, "--scene", scene)):
        done = call(*ask, "--json")
        assert f"set time_unit = '{unit}' in [frames] of the scene" in done.stderr
        assert done.exit_code == (0 if unit == "ms" else 2)  # of 1e-4 Hz there is no program
        cured = call(*ask, "--json", "--set", f"frames.time_unit={unit}")
        assert "seem to be in" not in cured.stderr
        first, *_ = records(cured.stdout)
        assert first["kind"] == "contact"
        assert 1.0 < first["t"] < 1.2


def test_loads_in_their_unit_and_unknown_ones_are_no_fault(call, records, tmp_path):
    loads = press(4, 4, noise=0.01, size=4.0)
    for unit, wrong in (("N", False), ("count", False), ("strain", True)):
        path = tmp_path / f"{unit}.npz"
        cnnum.Recording(loads, rate=100.0, unit=unit).save(path)
        done = call("check", path, "--json")
        found = [one for one in records(done.stdout) if one["what"] == "unit"]
        assert done.exit_code == int(wrong)
        assert [one["cure"] for one in found] == {
            "N": [], "count": [{"frames.unit": "N"}], "strain": [{"frames.unit": "count"}]
        }[unit]  # fmt: skip
    whole = np.round(press(4, 4, size=400.0))
    cnnum.Recording(whole, rate=100.0, unit="Pa").save(tmp_path / "pa.npz")
    assert call("check", tmp_path / "pa.npz").exit_code == 0


def test_wrong_keys_are_refused(tmp_path):
    scene = tmp_path / "scene.toml"
    for line, said in (
        ('channels = ["x", "y"]', "a name for each of the 4 channels"),
        ('order = "rows cols"', "axes from the slowest to the fastest"),
        ('flip = ["up"]', "'flip"),
        ('channels = ["x", "x", "z", "y"]', "once"),
        ('unit = "N\\u001b"', "a unit"),
        ('time_unit = "min"', "time_unit"),
    ):
        scene.write_text(f"{PLAIN}[frames]\n{line}\n")
        with pytest.raises(cnnum.CnnumError, match=said):
            cnnum.load_scene(scene)
