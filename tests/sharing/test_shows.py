"""Short texts, HTML, plots, tables and datasets of frames, recordings, events, results, plans."""

import re

import numpy as np
import pytest

import cnnum
from cnnum.frame import FORCE_AXES, Frame
from cnnum.scenes.frame_path import FrameResult
from cnnum.scenes.scene_record import SceneRecord
from cnnum.sharing import LIGHT, scale

RNG = np.random.default_rng(4)


def frame():
    return Frame(RNG.normal(size=(4, 5, 3)), FORCE_AXES, "count", 7, 0.25, cnnum.Quality.SATURATED)


def recording():
    return cnnum.Recording(RNG.normal(size=(6, 4, 5, 3)), rate=50.0, truth={"slip": np.arange(6)})


def events():
    return cnnum.EventList(
        [
            cnnum.Event(0.5, "contact", 10, where=(1.0, 2.0), strength=3.0, unit="N"),
            cnnum.Event(0.7, "slip", 14, phase="gross", direction=0.1),
        ]
    )


def result():
    return cnnum.Engine("numba").run("EDGE", input=np.sign(RNG.normal(size=(3, 8, 8))))


@cnnum.program
def touched(frame):
    return {"contact": (frame.normal > 0.1).any()}


def plan():
    return cnnum.Engine("numba").compile(touched, (8, 8))


def transient():
    return cnnum.Engine("numba").run("HOLE", input=-np.ones((3, 8, 8)), at=[0, 0.5, 1])


SHOWN = {
    "frame": (frame, "Frame(7 at 0.2500 s, 4×5, shear_x, shear_y, normal in count, SATURATED)"),
    "recording": (recording, "Recording(6 frames of 4×5, .* in count, 50 Hz, 0.100 s)"),
    "events": (events, "EventList(1 contact, 1 gross slip)"),
    "template": (lambda: cnnum.get_template("EDGE"), "Template('EDGE', layers=1, .*)"),
    "result": (result, "Result(output (3, 8, 8), time 5, .*method .*)"),
    "transient": (transient, "Result(output (3, 3, 8, 8), time 1, times 3, .*)"),
    "plan": (plan, "Plan(touched on 8×8 cells, numba float32: contact)"),
}


@pytest.mark.parametrize("name", SHOWN)
def test_texts_are_short_and_notebooks_get_html(name):
    make, text = SHOWN[name]
    made = make()
    assert re.fullmatch(text.replace("(", r"\(").replace(")", r"\)"), repr(made))
    assert len(repr(made)) < 160
    html = made._repr_html_()
    assert html.startswith("<div><b>")
    assert html.count("<table>") == 1
    assert len(html) < 60_000
    if name in ("frame", "recording", "template", "result"):
        assert "<svg" in html


@pytest.mark.parametrize("name", SHOWN)
def test_plots_draw_what_is_there(name):
    import matplotlib as mpl

    mpl.use("agg")
    import matplotlib.pyplot as plt

    axes = np.atleast_1d(np.asarray(SHOWN[name][0]().plot(), dtype=object))
    drawn = sum(
        len(ax.images) + len(ax.lines) + len(ax.collections) + len(ax.patches) for ax in axes
    )
    assert drawn >= 1
    assert axes[0].get_xlabel()
    plt.close("all")


def test_a_push_is_blue_in_strain_and_in_counts():
    """Strain counts a push as negative, counts that rise under a push as positive."""
    push = np.zeros((2, 2, 3))
    push[0, 0, 2] = 1.0
    of_counts = Frame(push, FORCE_AXES, "count", 0, 0.0)
    of_strain = Frame(-push, FORCE_AXES, "strain", 0, 0.0)
    for made in (of_counts, of_strain):
        *_, normal = made.maps().values()
        assert normal.tolist() == [[1.0, 0.0], [0.0, 0.0]]
    assert list(of_strain.maps()) == ["shear_x", "shear_y", "normal, compressive"]
    blue = scale(LIGHT)[-1]
    assert blue in of_strain._repr_html_()


def test_an_axes_of_ones_own_is_drawn_on():
    import matplotlib as mpl

    mpl.use("agg")
    import matplotlib.pyplot as plt

    figure, ax = plt.subplots()
    assert events().plot(ax) is ax
    assert ax.collections
    plt.close(figure)


def test_data_frames_have_a_row_a_frame_an_event_or_a_cell():
    pytest.importorskip("pandas")
    table = recording().to_dataframe()
    assert table.shape == (6, 3 + 4 * 5 * 3 + 1 + 2)
    assert table["normal[1, 2]"].tolist() != []
    rows = events().to_dataframe()
    assert rows["kind"].tolist() == ["contact", "slip"]
    assert rows["row"].tolist()[0] == 1.0
    assert np.isnan(rows["row"].tolist()[1])
    made = result()
    cells = made.to_dataframe()
    assert len(cells) == made.output.size
    assert cells["output"].to_numpy() == pytest.approx(made.output.ravel())


def test_datasets_have_named_axes():
    pytest.importorskip("xarray")
    source = recording()
    made = source.to_xarray()
    assert dict(made.sizes) == {"time": 6, "row": 4, "col": 5, "axis": 3}
    assert np.array_equal(made["values"].sel(axis="normal"), source.values[..., 2])
    assert made.attrs["unit"] == "count"
    assert dict(result().to_xarray().sizes) == {"batch_0": 3, "row": 8, "col": 8}
    assert events().to_xarray().sizes["event"] == 2
    steps = transient().to_xarray()
    assert dict(steps.sizes) == {"tau": 3, "batch_0": 3, "row": 8, "col": 8}
    assert steps["output"].sel(tau=0).to_numpy() == pytest.approx(1.0)  # HOLE starts all black
    assert transient().to_dataframe()["tau"].unique().tolist() == [0.0, 0.5, 1.0]


def test_a_transient_is_shown_at_its_times():
    assert list(transient().maps()) == ["output at 0", "output at 0.5", "output at 1"]


def test_an_event_is_as_short_as_what_is_known_of_it():
    assert repr(events()[1]) == "Event(t=0.7, kind='slip', phase='gross', direction=0.1, frame=14)"


def test_a_library_that_is_missing_is_named(monkeypatch):
    from cnnum import sharing

    def missing(name):
        raise ImportError(name)

    monkeypatch.setattr(sharing, "import_module", missing)
    with pytest.raises(cnnum.CnnumError, match=r"'pandas'.*pip install '\.\[tables\]'"):
        events().to_dataframe()
    with pytest.raises(cnnum.CnnumError, match="'xarray'"):
        recording().to_xarray()


def moment(number, outputs, saturated=None):
    """Return the results of a frame."""
    shown = Frame(np.zeros((2, 2, 1)), ("normal",), "N", number, 0.1 * number)
    return FrameResult(number, shown, shown.values, outputs, (), 0.0, saturated=saturated)


def test_records_that_differ_in_their_bounds_differ():
    records = [SceneRecord(["load"]) for _ in range(3)]
    for record, at_end in zip(records, (None, None, np.eye(2, dtype=bool)), strict=True):
        record.add(moment(0, {"load": np.array(1.0)}, at_end))
    assert records[0] == records[1]
    assert records[0] != records[2]


def test_a_scene_record_knows_its_fields():
    record = SceneRecord(["map", "number"])
    for n in range(3):
        record.add(moment(n, {"map": np.full((2, 2), n), "number": np.array(n)}))
    record.add(moment(3, {}))
    assert len(record) == 3
    assert record["map"].shape == (3, 2, 2)
    with pytest.raises(cnnum.CnnumError, match=r"Unknown field 'mpa' .did you mean 'map'"):
        record["mpa"]
