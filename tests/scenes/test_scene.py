"""Scene files: their keys, and one sentence for each fault."""

import pytest

import cnnum
from cnnum.errors import SceneError
from cnnum.scenes.scene_file import read_scene, scene_names

GOOD = """
name = "grasp"
needs = ["contact", "slip"]
[array]
driver = "simulated"
seed = 3
[program]
name = "tactile"
[program.parameters]
threshold = 2.0
[engine]
precision = "float64"
"""


def written(tmp_path, text):
    path = tmp_path / "scene.toml"
    path.write_text(text)
    return path


def test_scene_says_what_it_says(tmp_path):
    spec = read_scene(written(tmp_path, GOOD))
    assert (spec.name, spec.needs, spec.driver) == ("grasp", ("contact", "slip"), "simulated")
    assert spec.driver_options == {"seed": 3}
    assert spec.parameters == {"threshold": 2.0}
    assert (spec.engine, spec.precision) == (None, "float64")
    assert spec.base == tmp_path


def test_changes_are_set_over_the_file(tmp_path):
    changes = {"array.seed": 9, "engine.name": "reference", "needs": ["twist"]}
    spec = read_scene(written(tmp_path, GOOD), changes=changes)
    assert (spec.driver_options["seed"], spec.engine, spec.needs) == (9, "reference", ("twist",))


def test_scenes_that_come_along_can_be_read():
    assert {"demo", "contact"} <= set(scene_names())
    for name in scene_names():
        assert read_scene(name).needs


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (GOOD.replace("needs", "want"), "Unknown key 'want'"),
        (GOOD.replace('["contact", "slip"]', '"contact"'), "'needs' must be a list"),
        (GOOD.replace('["contact", "slip"]', "[]"), "at least one"),
        (GOOD.replace('driver = "simulated"', ""), "'driver' must be a string"),
        (GOOD.replace("[array]", "array = 3\n[arrays]"), "Unknown key 'arrays'"),
        (GOOD.replace('precision = "float64"', "precision = 64"), "'precision' must be a string"),
        (GOOD.replace("[engine]", "[engine"), "not TOML"),
        (GOOD.replace('[program]\nname = "tactile"', '[program]\nnames = "x"'), "'program.names'"),
    ],
)
def test_bad_scenes_get_one_sentence(tmp_path, text, words):
    with pytest.raises(SceneError) as caught:
        read_scene(written(tmp_path, text))
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_program_may_lie_at_any_path(tmp_path):
    folder = tmp_path / "~ Bäume & #1 @home" / ("long" * 20)
    folder.mkdir(parents=True)
    code = "import cnnum\n\n@cnnum.program\ndef high(frame):\n    return {'a': frame.normal.max()}"
    (folder / "own.py").write_text(code)
    text = f"needs = ['a']\narray.driver = 'simulated'\nprogram.name = '{folder}/own.py:high'\n"
    (tmp_path / "own.toml").write_text(text)
    scene = cnnum.load_scene(tmp_path / "own.toml", trust=True)
    assert scene.collect(frames=2)["a"].shape == (2,)
    (tmp_path / "own.toml").write_text(text.replace("own.py:high", "own.py:hi@gh"))
    with pytest.raises(SceneError, match="name of the program"):
        cnnum.load_scene(tmp_path / "own.toml", trust=True)


def test_missing_scene_names_those_that_there_are():
    with pytest.raises(SceneError, match="demo"):
        read_scene("nowhere.toml")


def test_change_that_is_no_table_is_refused(tmp_path):
    with pytest.raises(SceneError, match="not a table"):
        read_scene(written(tmp_path, GOOD), changes={"name.x": 1})


def test_the_program_of_a_scene_is_traced_once():
    traces = []

    @cnnum.program
    def counted(frame):
        traces.append(frame)
        return {"shear": frame.channel("shear_x") * 2.0}

    scene = cnnum.load_scene("demo", engine=cnnum.Engine("numba"), program=counted)
    assert len(traces) == 1
    assert scene.plan.schedule.channels_read == ("shear_x",)
