"""Skins of hexagons, staggered and irregular ones, and a cross: closed-form loads, places in mm."""

import json
from threading import Event, Thread

import numpy as np
import pytest

import cnnum
from cnnum.drivers.codecs.stream import Scan
from cnnum.drivers.codecs.wire import Asked, described_wire, wire
from cnnum.drivers.geometry import Grid
from cnnum.drivers.virtual import VirtualArray, VirtualLine
from cnnum.errors import SceneError
from cnnum.frame import FORCE_AXES, Frame

RNG = np.random.default_rng(4)
SPREAD = np.array([(2.0 * c, 2.0 * r) for r in range(6) for c in range(6)])
SKINS = {  # shape of a frame, places (mm), distance of the taxels, how far off a bump may be
    "hexagons": (
        (6, 6),
        np.array([(2 * c + r % 2, np.sqrt(3) * r) for r in range(6) for c in range(6)]),
        2.0,
        0.25,
    ),
    "staggered": (
        (1, 36),
        np.array([(2 * c + r % 2, 2 * r) for r in range(6) for c in range(6)], float),
        2.0,
        0.25,
    ),
    "irregular": ((6, 6), SPREAD + RNG.uniform(-0.5, 0.5, SPREAD.shape), 2.0, 0.35),
    "cross": (
        (1, 5),
        np.array([(0, 0), (-7, 0), (7, 0), (0, -7), (0, 7)], float),
        7.0,
        2.33,
    ),
}
"""Places of a bump are off by linear interpolation: an eighth of the distance of the taxels, more
where they are irregular, and of five taxels that see a part of it alone, a third."""

skins = pytest.mark.parametrize("skin", SKINS)


def centres(grid):
    rows, cols = grid.shape
    return np.array([[grid.place(r, c) for c in range(cols)] for r in range(rows)])


def bump(places, centre, distance):
    """A bell 1.2 distances wide."""
    return np.exp(-((places - centre) ** 2).sum(axis=-1) / (2.0 * (1.2 * distance) ** 2))


@pytest.mark.parametrize("pitch", [2.0, 1.0, 20.0])
def test_positions_in_metres_are_asked_about_and_small_ones_can_be_said(pitch, tmp_path):
    """In layouts, scenes and descriptors they are mm; of an array of 0.05 mm its pitch says so."""
    places = pitch * np.array([(c, r) for r in range(3) for c in range(4)], float)
    Grid(places, (3, 4))
    with pytest.raises(SceneError, match=r"closer than taxels can be: if they are in metres"):
        Grid(1e-3 * places, (3, 4))
    with pytest.raises(SceneError, match="if they are in metres"):
        Grid(1e-3 * places, (3, 4), pitch=1e-3 * pitch)
    tiny = 0.05 * places / pitch
    assert Grid(tiny, (3, 4), pitch=0.05e-3).shape == (3, 4)
    np.save(tmp_path / "a.npy", np.zeros((9, 3, 4, 3)))
    text = f"shape = [3, 4]\nrate = 50.0\npositions = {(1e-3 * places).tolist()}\n"
    (tmp_path / "a.toml").write_text(text)
    with pytest.raises(SceneError, match="if they are in metres"):
        cnnum.load_recording(tmp_path / "a.npy")
    (tmp_path / "a.toml").write_text(
        text.replace(str((1e-3 * places).tolist()), str(tiny.tolist()))
    )
    with pytest.raises(SceneError, match="as in pitch = 5e-05"):
        cnnum.load_recording(tmp_path / "a.npy")
    (tmp_path / "a.toml").write_text((tmp_path / "a.toml").read_text() + "pitch = 5e-05\n")
    assert len(cnnum.load_recording(tmp_path / "a.npy")) == 9


@skins
def test_a_linear_load_is_exact_and_taxels_on_cells_keep_their_values(skin):
    shape, places, *_ = SKINS[skin]
    grid = Grid(places, shape)
    load = 3.0 + 0.7 * places[:, 0] - 1.3 * places[:, 1]
    found = grid.maps(load.reshape(*shape, 1))[..., 0]
    expected = 3.0 + centres(grid) @ [0.7, -1.3]
    np.testing.assert_allclose(found[grid.inside], expected[grid.inside], atol=1e-5)
    assert (found[~grid.inside] == 0.0).all()
    away = np.hypot(*np.moveaxis(places[:, None, None] - centres(grid), -1, 0))
    on = away.min(axis=(1, 2)) < 1e-9
    assert on.all() == (skin in ("staggered", "cross"))
    for taxel in np.flatnonzero(on):
        one = np.zeros((*shape, 1))
        one.flat[taxel] = 1.0
        made, cell = grid.maps(one)[..., 0], np.unravel_index(away[taxel].argmin(), grid.shape)
        assert made[cell] == made.max() == 1.0


@skins
def test_an_even_load_stays_even_and_the_rim_is_inside(skin):
    shape, places, *_ = SKINS[skin]
    grid = Grid(places, shape)
    np.testing.assert_allclose(grid.maps(np.ones((*shape, 1)))[grid.inside], 1.0, atol=1e-6)
    rim = [grid.place(0, 0), grid.place(grid.shape[0] - 1, grid.shape[1] - 1)]
    np.testing.assert_allclose(rim, [places.min(axis=0), places.max(axis=0)], atol=1e-9)


def recorded(folder, skin, centre, seconds=3.0, rate=100.0):
    """Write counts of a bump that is pressed and let go, with a layout; return them."""
    shape, places, distance, _ = SKINS[skin]
    t = np.arange(round(seconds * rate)) / rate
    load = np.clip((t - 1.0) / 0.1, 0, 1) * np.clip((2.0 - t) / 0.1, 0, 1)
    values = np.random.default_rng(1).normal(16_000.0, 3.0, (len(t), len(places), 3))
    values[..., 2] += 900.0 * load[:, None] * bump(places, centre, distance)
    values = np.round(values).reshape(len(t), *shape, 3)
    np.save(folder / "skin.npy", values)
    (folder / "skin.toml").write_text(
        f"shape = {list(shape)}\nrate = {rate}\npositions = {places.tolist()}\n"
    )
    return values


def scene(folder, more="", program="contact"):
    path = folder / "scene.toml"
    path.write_text(
        f'needs = ["everything"]\n[array]\ndriver = "file"\npath = "skin.npy"\n{more}\n'
        f'[program]\nname = "{program}"\n[program.parameters]\npush = 1.0\nreads = "force"\n'
    )
    return path


@skins
def test_a_users_file_has_contacts_in_mm(call, records, tmp_path, skin):
    _, places, distance, off = SKINS[skin]
    middle = places.mean(axis=0)
    for shift in ((0.0, 0.0), (0.4, -0.3)):
        centre = middle + distance * np.array(shift)
        recorded(tmp_path, skin, centre)
        out = call("run", scene(tmp_path), "--set", 'needs=["contact"]', "--json")
        begun, ended, _ = records(out.stdout)
        assert (begun["kind"], ended["kind"]) == ("contact", "release")
        assert begun["t"] == pytest.approx(1.0, abs=0.03)
        held = cnnum.load_scene(
            tmp_path / "scene.toml", changes={"needs": ["contact_row", "contact_column"]}
        )
        outputs = [one.outputs for one in held.results() if 1.3 < one.frame.time < 1.7]
        found = np.array([held.grid.place(o["contact_row"], o["contact_column"]) for o in outputs])
        np.testing.assert_allclose(found.mean(axis=0), centre, atol=off)
        # the place of the event is that of its first frame, where noise still counts
        np.testing.assert_allclose(begun["place_mm"], centre, atol=off + 0.3 * distance)
        text = call("run", scene(tmp_path), "--set", 'needs=["contact"]').stdout
        assert " mm, y " in text


@skins
def test_noise_is_no_contact_on_any_skin(tmp_path, skin):
    shape, places, *_ = SKINS[skin]
    recorded(tmp_path, skin, places.mean(axis=0))
    values = np.random.default_rng(2).normal(16_000.0, 3.0, (3000, *shape, 3))
    np.save(tmp_path / "skin.npy", np.round(values))
    assert not list(cnnum.load_scene(scene(tmp_path), changes={"needs": ["contact"]}).events())


def test_a_dead_taxel_is_left_out_and_a_lost_one_masked(tmp_path, caplog):
    values = recorded(tmp_path, "hexagons", (6.0, 5.2))
    values[:, 2, 3] = 65_535.0
    values[150:170, 0, 0] = np.nan
    np.save(tmp_path / "skin.npy", values)
    held = cnnum.load_scene(
        scene(tmp_path), changes={"needs": ["contact"], "frames.dead": [[2, 3]]}
    )
    begun, _ = list(held.events())
    assert begun.kind == "contact"
    np.testing.assert_allclose(begun.place, (6.0, 5.2), atol=0.8)
    assert "[0, 0] have dropped out" in caplog.text


def test_a_live_array_has_its_places_from_its_descriptor(tmp_path):
    shape, places, distance, off = SKINS["hexagons"]
    described = tmp_path / "skin.toml"
    described.write_text(
        f'name = "skin"\nshape = {list(shape)}\nchannels = ["x", "y", "z"]\nheader = "5a a5"\n'
        f'counter = "u16"\ncell = "f32"\ncheck = "crc16-modbus"\nrate = 100.0\n'
        f"positions = {places.tolist()}\n"
    )
    centre = places.mean(axis=0)
    values = np.random.default_rng(1).normal(0.0, 3.0, (150, *shape, 3))
    values[60:, ..., 2] += 900.0 * bump(places, centre, distance).reshape(shape)
    frames = [Frame(v, FORCE_AXES, "count", n, n / 100.0) for n, v in enumerate(values)]
    line = VirtualLine(tmp_path / "port")
    array = VirtualArray(described_wire(described, Asked()), line, frames, 100.0)
    stop = Event()
    thread = Thread(target=array.run, args=(stop,))
    thread.start()
    (tmp_path / "scene.toml").write_text(
        'needs = ["contact"]\n[array]\ndriver = "serial"\nport = "port"\n'
        f'descriptor = "{described}"\n[engine]\nname = "numba"\n[program]\nname = "contact"\n'
        '[program.parameters]\npush = 1.0\nreads = "force"\nrate = 100.0\n'
    )
    try:
        held = cnnum.load_scene(
            tmp_path / "scene.toml", changes={"array.port": str(tmp_path / "port")}
        )
        for event in held.events():
            np.testing.assert_allclose(event.place, centre, atol=off + 0.3 * distance)
            break
        held.close()
    finally:
        stop.set()
        thread.join(30.0)
        line.close()
    assert event.kind == "contact"


def test_anyskin_lies_on_a_cross():
    for name in ("anyskin", "anyskin-text"):
        known = wire(name)
        grid = Grid(known.positions, known.form.shape)
        assert grid.shape == (3, 3)
        assert grid.inside.tolist() == [[False, True, False], [True] * 3, [False, True, False]]


def test_positions_of_a_recording_stand_in_the_scene(tmp_path):
    values = recorded(tmp_path, "cross", (0.0, 0.0))
    cnnum.Recording(values, rate=100.0).save(tmp_path / "own.npz")
    changes = {
        "array": {"driver": "npz", "path": str(tmp_path / "own.npz")},
        "needs": ["contact"],
        "frames.positions": SKINS["cross"][1].tolist(),
    }
    begun, _ = cnnum.load_scene(scene(tmp_path), changes=changes).events()
    assert json.loads(json.dumps(begun.record()))["place_mm"] == pytest.approx([0, 0], abs=2.0)


BAD = {
    "as many as taxels": ([[0, 0], [1, 0]], "each of the 5 taxels, row by row, got 2"),
    "two at one place": (
        [[0, 0], [1, 0], [0, 1], [1, 0], [5, 5]],
        "taxels 1 and 3 are at the same",
    ),
    "on a slanted line": ([[n, n] for n in range(5)], "one slanted line"),
    "three axes": ([[0, 0, 0]] * 5, "must be a list of 2 items"),
    "uneven": ([[0, 0], [0.01, 0], [0, 0.01], [50, 50], [50.01, 50]], "larger 'pitch'"),
    "not finite": ([[0, 0], [1, 0], [0, 1], [1, 1], [1e9, 5]], "below 10000 mm"),
}


@pytest.mark.parametrize("what", BAD)
def test_places_that_make_no_grid_are_refused(call, tmp_path, what):
    places, said = BAD[what]
    recorded(tmp_path, "cross", (0.0, 0.0))
    text = (tmp_path / "skin.toml").read_text().splitlines()
    text[-1] = f"positions = {places}"
    (tmp_path / "skin.toml").write_text("\n".join(text))
    done = call("run", scene(tmp_path), "--set", 'needs=["contact"]')
    assert done.exit_code == 2
    assert said in done.stderr
    assert done.stderr.count("\n") == 1


def test_a_program_of_bumps_is_refused(tmp_path):
    recorded(tmp_path, "hexagons", (5.0, 5.0))
    changes = {"needs": ["bump"], "program": {"name": "localize"}}
    with pytest.raises(SceneError, match="reads one bump per taxel"):
        cnnum.load_scene(scene(tmp_path), changes=changes)


def test_taxels_in_one_line_are_a_line():
    grid = Grid([(0.0, 3.0), (1.0, 3.0), (2.5, 3.0)], (1, 3))
    assert grid.shape[0] == 1
    line = grid.maps(np.array([0.0, 1.0, 2.5]).reshape(1, 3, 1))[0, :, 0]
    np.testing.assert_allclose(line, [grid.place(0, c)[0] for c in range(grid.shape[1])])
    assert Grid([(2.0, 3.0)], (1, 1)).place(0, 0) == (2.0, 3.0)


def test_packets_of_an_anyskin_lie_on_its_cross(call, records, tmp_path):
    known, centre = wire("anyskin"), np.array([2.0, -1.5])
    places = np.array(known.positions)
    t = np.arange(300) / 100.0
    load = 300.0 * np.clip((t - 1.0) / 0.1, 0, 1)
    values = np.random.default_rng(1).normal(0.0, 0.5, (300, 1, 5, 4))
    values[:, 0, :, 3] += load[:, None] * bump(places, centre, 7.0)
    sent = [known.encode(Scan(one, known.form.channels, "uT")) for one in values]
    (tmp_path / "skin.bin").write_bytes(b"".join(sent))
    (tmp_path / "skin.toml").write_text(
        'shape = [1, 5]\nprotocol = "anyskin"\nchannels = ["temperature", "x", "y", "z"]\n'
        'unit = "uT"\nrate = 100.0\n'
    )
    path = scene(tmp_path, '[engine]\nname = "numba"')
    out = call("run", path, "--set", "array.path=skin.bin", "--set", 'needs=["contact"]', "--json")
    first, *_ = records(out.stdout)
    assert first["kind"] == "contact"
    np.testing.assert_allclose(first["place_mm"], centre, atol=2.33 + 0.3 * 7.0)
