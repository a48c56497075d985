"""Contact against plain NumPy over the whole recording, on every engine.

Where each taxel carries its own share of the load everything can be counted; loads through a cover
are held to closed forms in test_contact_loads.py.
"""

import numpy as np
import pytest

from cnnum.templates.tactile.contact import contact

RATE = 200.0
FIRST = 16  # frames of 0.08 s
COUNTED = contact.bind(reads="force", rate=RATE)


def touched_frames(strain):
    """Contact by its definition, with the loads above rest."""
    normal = -strain[..., 2]
    flags, loads, rest, noise, seen = [False], [0 * normal[0]], normal[0], 0.0, 0
    before, low, since = False, 0, 1
    for number in range(1, len(normal)):
        now = normal[number]
        peak, pull = max((now - rest).max(), 0.0), max((rest - now).max(), 0.0)
        high = number >= FIRST and peak > 6 * np.sqrt(noise)
        low = 0 if peak > 4 * np.sqrt(noise) else low + 1
        flag = (high and before) or (flags[-1] and low < 0.02 * RATE)
        since = 0 if flag else since + 1
        far = number >= FIRST and pull > 6 * np.sqrt(noise)
        if number < FIRST:  # without each taxel's two extremes
            known = np.sort(normal[: number + 1], axis=0)
            rest = known[1:-1].mean(axis=0) if number > 1 else normal[0]
        elif not (high or far or flags[-1]):
            rest = rest + max(1 / min(number + 1, since + 8), 1 / (4 * RATE)) * (now - rest)
        if not (high or far or flags[-1]):
            seen += 1
            change = ((now - normal[number - 1]) ** 2).mean() / 2
            noise += max(1 / seen, 1 / (4 * RATE)) * (change - noise)
        before = high
        flags.append(bool(flag))
        loads.append(now - rest)
    return np.array(flags), np.array(loads)


@pytest.mark.parametrize("shape", [(4, 4), (8, 8), (16, 16)])
def test_contact_is_what_numpy_says(engine, run, short_scene, shape):
    if engine.name == "reference" and shape != (8, 8):
        pytest.skip("the reference solves every threshold anew; one shape of it is enough")
    strain = short_scene(shape)[20:46] if engine.name == "reference" else short_scene(shape)
    flags, loads = touched_frames(strain)
    got = run(engine, COUNTED, strain)
    np.testing.assert_array_equal(got["contact"], flags)
    assert flags.any()
    assert not flags[:18].any()
    shear = [-(strain[..., k] - strain[:20, ..., k].mean(axis=0)) for k in (0, 1)]
    inside = got["contact_map"] > 0
    for name, map_ in (("load_normal", loads), ("load_x", shear[0]), ("load_y", shear[1])):
        expected = (map_ * inside).sum(axis=(1, 2))
        # shear's rest is known to a quarter of the noise, a few 1e-3 of the largest load
        assert got[name] == pytest.approx(expected, abs=0.02 * np.abs(loads).sum(axis=(1, 2)).max())
    noise = np.sqrt(np.diff(strain[:16, ..., 2], axis=0).var() / 2)
    top = loads.max(axis=(1, 2))
    level = np.maximum(0.1 * top, np.minimum(4 * noise, 0.5 * top))[:, None, None]
    # the noise of 16 small frames is known to 10 %; elsewhere rounding is all that can differ
    sure = np.abs(loads - level) > np.where(level > 5 * noise, 0.01, 0.15) * level
    assert ((loads > level) == inside)[flags][sure[flags]].all()
    np.testing.assert_array_equal(got["contact_area"], inside.sum(axis=(1, 2)))


def test_centroid_area_and_friction_used(fast, run):
    """A block of loads: everything can be counted by hand."""
    rng = np.random.default_rng(0)
    frames = 1e-3 * rng.normal(size=(60, 8, 8, 3))
    frames[30:, 2:5, 3:7, 2] -= 1.0
    frames[30:, 2:5, 3:7, 0] -= 0.3
    frames[30:, 2:5, 3:7, 1] += 0.4
    got = run(fast, COUNTED, frames)
    last = {name: values[-1] for name, values in got.items()}
    # sums of 12 cells of noise 1e-3, each again in the rest that was learned from 30 frames
    assert last["contact_area"] == 12
    assert last["contact_row"] == pytest.approx(3.0, abs=0.01)
    assert last["contact_column"] == pytest.approx(4.5, abs=0.01)
    assert last["load_normal"] == pytest.approx(12.0, abs=0.02)
    assert last["load_x"] == pytest.approx(3.6, abs=0.02)
    assert last["load_y"] == pytest.approx(-4.8, abs=0.02)
    assert last["friction_used"] == pytest.approx(0.5, abs=0.005)


def test_contact_begins_and_ends_with_the_load(fast, run, simulate):
    strain, truth = simulate(seed=5)
    got = run(fast, contact, strain, ["contact"])["contact"] > 0
    true = truth["contact"] > 0
    assert (np.diff(got.astype(int)) != 0).sum() == 2  # one touch, one release, no chatter
    # 5 frames: the time of the load to rise above 6 standard deviations, with room
    assert abs(int(np.argmax(got)) - int(np.argmax(true))) <= 5
    assert abs(int(got.sum()) - int(true.sum())) <= 5


def test_a_push_of_either_sign(fast, run, short_scene):
    strain = short_scene((8, 8))[:150]
    plus = run(fast, contact.bind(push=1.0), -strain)
    minus = run(fast, contact, strain)
    for name, values in plus.items():
        np.testing.assert_allclose(values, minus[name], rtol=1e-5, atol=1e-7)


def test_gain_does_not_matter(fast, run, short_scene):
    strain = short_scene((8, 8))[:200]
    small = run(fast, contact, strain, ["contact", "contact_row"])
    large = run(fast, contact, 1024.0 * strain, ["contact", "contact_row"])
    # a power of two: every float32 sum scales exactly, thresholds too
    np.testing.assert_array_equal(small["contact"], large["contact"])
    np.testing.assert_allclose(small["contact_row"], large["contact_row"], rtol=1e-5)


def test_a_constant_stream_is_no_contact(engine, run):
    frames = np.full((24, 4, 4, 3), 0.37)
    assert not run(engine, contact, frames, ["contact"])["contact"].any()


def test_a_batch_is_many_streams(fast, run, short_scene):
    strain = short_scene((8, 8))[:160]
    batch = np.stack([strain, 2.0 * strain, strain[:, ::-1]], axis=1)
    got = run(fast, contact, batch)
    alone = run(fast, contact, np.ascontiguousarray(strain[:, ::-1]))
    for name in ("contact", "contact_area", "load_normal", "contact_row"):
        np.testing.assert_allclose(got[name][:, 2], alone[name], rtol=1e-4, atol=1e-6)
    np.testing.assert_allclose(got["contact"][:, 0], got["contact"][:, 1])
