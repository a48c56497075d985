"""A recording in memory goes to tables and back, and through a scene, as its file does."""

import numpy as np
import pytest

import cnnum
from cnnum.drivers import open_driver
from cnnum.drivers.recording_file import RecordingDriver, array_of
from cnnum.errors import ArrayError, RecordingWarning, SceneError
from cnnum.recordings.checking import checked
from cnnum.scenes.arrangement import bound, program_of
from cnnum.scenes.scene_file import read_scene
from cnnum.scenes.scene_record import SceneRecord

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


@pytest.mark.parametrize("zone", [None, "Europe/Budapest"])
@pytest.mark.parametrize("unit", ["ns", "us", "ms"])
def test_dates_and_durations_are_seconds(unit, zone):
    """As pandas and xarray hold times: read as numbers, they made 60 Hz of 6e-05 Hz."""
    steps = np.arange(30) * 16
    dates = pd.DatetimeIndex(pd.Timestamp("2024-10-27T00:59:59.9") + pd.to_timedelta(steps, "ms"))
    dates = (
        dates.tz_localize("UTC").tz_convert(zone) if zone else dates
    )  # the hour that comes twice
    values = np.zeros((30, 2, 2))
    wanted = cnnum.Recording(values, times=steps / 1e3)
    frame = wanted.to_dataframe().drop(columns="rate (Hz)").assign(time=dates.as_unit(unit))
    dataset = wanted.to_xarray()
    del dataset.attrs["rate"]
    plain = dates.tz_convert(None) if zone else dates
    for found in (
        cnnum.Recording(values, times=dates.as_unit(unit)),
        cnnum.Recording(values, times=(dates - dates[0]).to_numpy()),
        cnnum.Recording.from_dataframe(frame),
        cnnum.Recording.from_xarray(dataset.assign_coords(time=plain)),
    ):
        np.testing.assert_allclose(found.times, wanted.times, atol=1e-9)
        assert found.rate == pytest.approx(62.5)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda frame: frame.iloc[:0], "DataFrame without rows"),
        (lambda frame: list(frame), "got list"),
        (
            lambda frame: pd.concat([frame, frame["shear_y[0, 0]"]], axis=1),
            "two columns 'shear_y.0, 0.'",
        ),
        (
            lambda frame: frame.assign(**{"shear_y[0, 0]": "high"}),
            "'shear_y.0, 0.' must hold real numbers",
        ),
        (
            lambda frame: frame.assign(**{"shear_y[0, 0]": 1.0j}),
            "'shear_y.0, 0.' must hold real numbers",
        ),
    ],
)
def test_a_data_frame_of_something_else_is_refused(change, message):
    frame = cnnum.Recording(np.ones((5, 2, 2, 2)), rate=50.0, channels=("y", "z")).to_dataframe()
    with pytest.raises(ArrayError, match=message):
        cnnum.Recording.from_dataframe(change(frame))


def test_times_give_the_rate():
    values = np.zeros((40, 2, 2))
    times = np.arange(40) / 60.0
    times[20:] += 3600.0  # a pause is no step
    assert cnnum.Recording(values, times=times).rate == pytest.approx(60.0)
    with pytest.raises(ArrayError, match="needs its rate, and there are no times"):
        cnnum.Recording(values)
    with pytest.raises(ArrayError, match="times that give none"):
        cnnum.Recording(values, times=np.zeros(40))


@pytest.mark.parametrize("kind", ["a.npz", "a.csv", "a.h5", "a.mcap", "a data frame"])
def test_an_honest_slow_recording_is_not_questioned_in_any_own_file(kind, tmp_path):
    """0.1 Hz; times without their rate are, when they are given."""
    values = np.random.default_rng(0).normal(100.0, 1.0, (30, 2, 2, 3))
    with pytest.warns(RecordingWarning, match=r"10 s apart by their times: if the times are in ms"):
        assert cnnum.Recording(values, times=10.0 * np.arange(30), unit="V").unit == "V"
    recording = cnnum.Recording(values, rate=0.1)
    if kind == "a data frame":
        recording.to_dataframe().to_csv(tmp_path / "a.csv")
    else:
        recording.save(tmp_path / kind)
    path = tmp_path / (kind if "." in kind else "a.csv")
    table = array_of(path)
    with open_driver(str(table.pop("driver")), table) as driver:
        found = checked(cnnum.load_recording(path), timed=driver.timed)
    (rate,) = (finding for finding in found if finding.what == "rate")
    assert (rate.wrong, rate.sentence) == (
        False,
        "The rate is 0.1 Hz, and the times agree with it.",
    )


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


@pytest.mark.parametrize("kind", ["mcap", "npz", "csv", "h5", "frames", "table", "set"])
def test_pads_side_by_side_stay_so(tmp_path, kind):
    rng = np.random.default_rng(7)
    values = rng.normal(size=(9, 2, 3, 4, 3))  # frames, pads, rows, cols, channels
    marks = rng.random((9, 2, 3, 4)) < 0.1
    made = cnnum.Recording(values, rate=50.0, saturated=marks)
    assert (made.shape, made.pads) == ((3, 8), 2)
    # closed form: column c of pad p is column 4 p + c
    for pad, row, col in np.ndindex(2, 3, 4):
        np.testing.assert_array_equal(made.values[:, row, 4 * pad + col], values[:, pad, row, col])
        np.testing.assert_array_equal(
            made.saturated[:, row, 4 * pad + col], marks[:, pad, row, col]
        )
    if kind == "frames":
        again = cnnum.Recording.from_frames(made.frames(), rate=50.0, pads=2)
    elif kind == "table":
        again = cnnum.Recording.from_dataframe(made.to_dataframe())
    elif kind == "set":
        again = cnnum.Recording.from_xarray(made.to_xarray())
    elif kind == "mcap":
        again = cnnum.Recording.from_mcap(made.save(tmp_path / "pads.mcap"))
        assert again == cnnum.load_recording(tmp_path / "pads.mcap")
    else:
        if kind == "h5":
            pytest.importorskip("h5py")
        again = cnnum.load_recording(made.save(tmp_path / f"pads.{kind}"))
    for name in ("values", "pads", "saturated", "times"):
        np.testing.assert_array_equal(getattr(again, name), getattr(made, name))


def test_a_dataset_may_have_an_axis_of_pads():
    xarray = pytest.importorskip("xarray")
    values = np.random.default_rng(8).normal(size=(3, 5, 2, 2, 4))
    dims = ("axis", "time", "pad", "row", "col")
    found = cnnum.Recording.from_xarray(
        xarray.Dataset({"values": (dims, values)}, attrs={"rate": 9.0})
    )
    expected = cnnum.Recording(np.moveaxis(values, 0, -1), rate=9.0)
    assert found == expected
    assert found.pads == 2


def test_pads_that_do_not_fit_are_refused():
    with pytest.raises(ArrayError, match="'pads' must divide the 4 columns equally, got 3"):
        cnnum.Recording(np.zeros((3, 2, 4, 3)), rate=1.0, pads=3)
    with pytest.raises(ArrayError, match="'pads' is 3, but the values have 2 pads"):
        cnnum.Recording(np.zeros((3, 2, 4, 4, 3)), rate=1.0, pads=3)
    halves = [cnnum.Recording(np.zeros((2, 1, n, 1)), rate=9.0) for n in (1, 2)]
    with pytest.raises(ArrayError, match="got 2 kinds of 4 frames"):
        cnnum.Recording.from_frames(f for half in halves for f in half.frames())


def test_a_file_of_five_axes_is_read_by_its_pads(tmp_path):
    values = np.random.default_rng(9).normal(size=(7, 2, 3, 4, 3))
    layout = 'shape = [3, 8]\nrate = 50.0\nunit = "N"\npads = 2\n'
    for name, held, more in (
        ("plain", values, ""),
        ("flipped", values[:, :, :, ::-1], 'flip = ["cols"]\n'),
        ("said", np.moveaxis(values, 0, 1), 'order = "pads frames rows cols channels"\n'),
    ):
        np.save(tmp_path / f"{name}.npy", held)
        (tmp_path / f"{name}.toml").write_text(layout + more)
        found = cnnum.load_recording(tmp_path / f"{name}.npy")
        np.testing.assert_array_equal(found.values, cnnum.Recording(values, rate=50.0).values)
        assert found.pads == 2


def test_the_pads_of_a_recording_reach_the_program():
    spec = read_scene("contact")
    for pads in (1, 2):
        driver = RecordingDriver(cnnum.Recording(np.zeros((3, pads, 4, 4, 3)), rate=100.0))
        program = bound(program_of(spec), spec, driver, None, "count")
        assert dict(program.parameters)["pads"] == pads


def pressed():
    """Return counts of a skin that is pressed from 0.6 to 0.9 s."""
    rng = np.random.default_rng(4)
    times = np.arange(120) / 100.0
    bump = np.exp(-((np.indices((4, 4)) - 1.5) ** 2).sum(axis=0) / 3.0)
    force = ((times > 0.6) & (times < 0.9))[:, None, None] * 900.0 * bump
    axes = force[..., None] * np.array([0.1, 0.0, 1.0])
    return cnnum.Recording(axes + rng.normal(0.0, 2.0, axes.shape), rate=100.0)


RISES = {"program.parameters": {"push": 1.0}}


@pytest.mark.one_in(2)  # in whole numbers the ranges of the frames are measured first: a minute
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
    axes.figure.canvas.draw()  # the label is within the picture
    assert axes.yaxis.label.get_window_extent().height < axes.figure.bbox.height
    with pytest.raises(SceneError, match=r"must be a cnnum\.Recording, got ndarray"):
        cnnum.load_scene("contact", recording=np.zeros((9, 4, 4, 3)))
    assert len(axes.get_lines()) == len(record.names) > 1
    many = SceneRecord([f"field_{number}" for number in range(90)])
    assert "field_5 and 84 more" in repr(many)
