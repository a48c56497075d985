"""A recording in memory goes to tables and back, and through a scene, as its file does."""

import numpy as np
import pytest

import cnnum
from cnnum.errors import ArrayError

pd = pytest.importorskip("pandas")


def drawn(seed, channels=("x", "y", "z")):
    """Return a recording with all that one can have, or with little."""
    rng = np.random.default_rng(seed)
    frames, rows, cols = rng.integers(2, 30), rng.integers(1, 5), rng.integers(1, 5)
    parts = {"rate": 50.0}
    if seed % 2:
        times = 3.0 + np.arange(frames) / 50.0
        parts = {
            "times": times,
            "unit": "N",
            "truth": {"slip of a finger": rng.normal(size=frames)},
            "quality": rng.choice([0, 2], frames),
            "saturated": rng.random((frames, rows, cols)) < 0.1,
            "wall_ns": 1_700_000_000_000_000_000 + np.arange(frames) * 20_000_000,
        }
    values = rng.normal(size=(frames, rows, cols, len(channels)))
    return cnnum.Recording(values, channels=channels, **parts)


@pytest.mark.parametrize("seed", range(6))
def test_a_data_frame_gives_the_same_recording(seed):
    recording = drawn(seed, (("x", "y", "z"), ("heat",))[seed // 2 % 2])
    assert cnnum.Recording.from_dataframe(recording.to_dataframe()) == recording
    other = cnnum.Recording.from_dataframe(recording.to_dataframe(), unit="mV", rate=50.0)
    assert (other.unit, other.rate) == ("mV", 50.0)


@pytest.mark.parametrize("seed", range(4))
def test_a_dataset_gives_the_same_recording(seed):
    pytest.importorskip("xarray")
    recording = drawn(seed)
    found = cnnum.Recording.from_xarray(recording.to_xarray().transpose("axis", ...))
    for name in ("values", "times", "channels", "unit", "rate", "quality", "truth"):
        np.testing.assert_equal(getattr(found, name), getattr(recording, name))
    if seed % 2:
        np.testing.assert_array_equal(found.saturated, recording.saturated)


def test_times_give_the_rate():
    values = np.zeros((40, 2, 2))
    times = np.arange(40) / 60.0
    times[20:] += 3600.0  # a pause is no step
    assert cnnum.Recording(values, times=times).rate == pytest.approx(60.0)
    with pytest.raises(ArrayError, match="needs its rate, and there are no times"):
        cnnum.Recording(values)
    with pytest.raises(ArrayError, match="times that give none"):
        cnnum.Recording(values, times=np.zeros(40))


def test_tables_that_are_none_are_refused():
    table = drawn(1).to_dataframe()
    with pytest.raises(ArrayError, match=r"'normal.*is missing"):
        cnnum.Recording.from_dataframe(
            table.drop(columns=[n for n in table if n.startswith("normal[0")][:1])
        )
    with pytest.raises(ArrayError, match="'weight' is not part of a recording"):
        cnnum.Recording.from_dataframe(table.assign(weight=1.0))
    with pytest.raises(ArrayError, match=r"'z\[0, 0\]' is missing"):
        cnnum.Recording.from_dataframe(pd.DataFrame({"time": [0.0, 1.0]}))


def pressed():
    """Return counts of a skin that is pressed from 0.6 to 0.9 s."""
    rng = np.random.default_rng(4)
    times = np.arange(120) / 100.0
    bump = np.exp(-((np.indices((4, 4)) - 1.5) ** 2).sum(axis=0) / 3.0)
    force = ((times > 0.6) & (times < 0.9))[:, None, None] * 900.0 * bump
    axes = force[..., None] * np.array([0.1, 0.0, 1.0])
    return cnnum.Recording(axes + rng.normal(0.0, 2.0, axes.shape), rate=100.0)


RISES = {"program.parameters": {"push": 1.0}}


@pytest.mark.parametrize("precision", ["float32", "q15"])
def test_a_scene_runs_over_it_as_over_its_file(tmp_path, precision):
    recording = pressed()
    path = recording.save(tmp_path / "pressed.mcap")
    name = "reference" if precision == "q15" else "numba"
    changes = {"engine.precision": precision, "engine.name": name, **RISES}
    how = {"program": "contact", "changes": changes}
    with cnnum.load_scene("contact", recording=recording, **how) as scene:
        assert "memory" in repr(scene)
        found = scene.collect()
        summary = scene.summary()
        again = scene.collect()
    changes["array"] = {"driver": "mcap", "path": str(path)}
    with cnnum.load_scene("contact", **how) as scene:
        expected = scene.collect()
    kinds = [event.kind for event in found.events]
    assert kinds == ["contact", "release"]
    assert [event.time for event in found.events] == pytest.approx([0.6, 0.9], abs=0.06)
    assert found == again == expected
    assert summary.frames == 120


def test_a_record_draws_itself():
    pytest.importorskip("matplotlib").use("Agg")
    changes = {**RISES, "needs": ["contact", "load_normal", "contact_map"]}
    with cnnum.load_scene("contact", recording=pressed(), changes=changes) as scene:
        record = scene.collect()
    axes = record.plot()
    assert axes.get_xlabel() == "time (s)"
    assert len(axes.get_lines()) == len(record.names) > 1
