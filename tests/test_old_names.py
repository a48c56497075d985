"""Old names work for one more version, and say the new one."""

import numpy as np
import pytest

import cnnum
from cnnum.drivers import open_driver
from cnnum.renamed import by_new_names
from cnnum.scenes.scene_file import read_scene

TAXELS = np.zeros((20, 2, 2, 3))


def test_the_old_order_of_stability_bound():
    with pytest.warns(DeprecationWarning, match=r"use \(template, shape, method\)"):
        old = cnnum.stability_bound("euler", "DIFFUS", (8, 8))  # type: ignore[arg-type]
    assert old == cnnum.stability_bound("DIFFUS", (8, 8), "euler")
    assert old != cnnum.stability_bound("DIFFUS", (8, 8), "rk4")


def test_old_names_of_channels():
    with pytest.warns(DeprecationWarning, match="use 'channels'"):
        old = cnnum.Recording(TAXELS, rate=9.0, axes=("z", "x", "y"))  # type: ignore[call-arg]
    with pytest.warns(DeprecationWarning, match="use Recording.channels"):
        assert old.axes == ("normal", "shear_x", "shear_y")
    assert old == cnnum.Recording(TAXELS, rate=9.0, channels=("z", "x", "y"))
    with pytest.raises(TypeError, match="both 'axes' and 'channels'"):
        cnnum.Recording(TAXELS, rate=9.0, axes="z", channels="z")  # type: ignore[call-arg]


def test_old_keys_of_a_layout(tmp_path):
    values = np.arange(24.0).reshape(2, 3, 2, 2)
    np.save(tmp_path / "own.npy", values)
    layout = 'shape = [2, 2]\naxes = ["x", "y", "z"]\nrate = 9\norder = "axis-first"\n'
    (tmp_path / "own.toml").write_text(layout)
    with pytest.warns(FutureWarning) as said:
        driver = open_driver("file", {"path": str(tmp_path / "own.npy")})
    assert [next(driver.frames()).values[0, 0].tolist()] == [values[0, :, 0, 0].tolist()]
    assert {str(each.message).partition(" is")[0] for each in said} == {
        "The key 'axes'",
        "'axis-first' of 'order'",
    }


def test_old_keys_of_a_scene(tmp_path):
    path = tmp_path / "own.toml"
    path.write_text('wants = ["contact"]\n[array]\ndriver = "simulated"\n')
    with pytest.warns(FutureWarning, match="'wants' is deprecated .* use 'needs'"):
        scene = cnnum.load_scene(path)
    assert scene.spec.needs == ("contact",)
    with pytest.warns(FutureWarning, match="use 'needs'"):
        assert read_scene("slip", changes={"wants": ["twist"]}).needs == ("twist",)


def test_the_old_name_of_an_events_time():
    event = cnnum.Event(0.5, "contact", 10)
    with pytest.warns(DeprecationWarning, match=r"use Event\.time"):
        assert event.t == event.time == 0.5


def test_old_keywords_of_shift():
    @cnnum.program
    def moved(frame):
        return {"moved": cnnum.shift(frame.normal, columns=1)}

    with pytest.warns(DeprecationWarning, match="use 'cols'"):
        plan = cnnum.Engine("numba").compile(moved, (2, 3))
    frame = np.zeros((2, 3, 3))
    frame[0, 0, 2] = 1.0
    assert np.argwhere(plan(frame)["moved"]).tolist() == [[0, 1]]


@pytest.mark.filterwarnings("ignore::FutureWarning")
def test_a_number_too_long_to_be_written_has_no_old_name():
    table = {"kind": 10**5000, "old": "a"}
    assert by_new_names(table, {"old": "new"}) == {"kind": 10**5000, "new": "a"}
