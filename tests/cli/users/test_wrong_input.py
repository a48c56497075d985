"""Faults of the input are said in one sentence on standard error, with exit code 2."""

import pytest


def sentence(result) -> str:
    assert result.exit_code == 2, result.output
    assert result.stdout == ""
    assert result.stderr.startswith("cnnum: ")
    assert result.stderr.count("\n") == 1
    return result.stderr


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["runn", "demo"], "did you mean 'run'?"),
        (["run"], "Missing argument 'SCENE'"),
        (["run", "nowhere"], "There is no scene 'nowhere': expected a TOML file or one of"),
        (["run", "demo", "--set", "array.sed=3"], "unknown option 'sed'"),
        (["run", "demo", "--set", "arry.seed=3"], "Unknown key 'arry'"),
        (["run", "demo", "--set", "array.seed"], "Expected KEY=VALUE"),
        (["run", "demo", "--set", "array.seed=many"], "must be a whole number, got 'many'"),
        (["run", "demo", "--set", 'array.driver="seral"'], "Unknown driver 'seral'"),
        (["run", "demo", "--set", "needs=[]"], "must name at least one event"),
        (["plan", "demo", "--engine", "cuda"], "Unknown engine 'cuda': expected one of 'opencl'"),
        (["plan", "demo", "--precision", "half"], "Unknown precision 'half'"),
        (["plan", "demo", "--set", "program.name=nothing"], "Unknown program 'nothing'"),
        (["templates", "show", "EDG"], "did you mean 'EDGE'"),
        (["templates", "check", "EDGE", "NONE_SUCH"], "Unknown template 'NONE_SUCH'"),
        (["templates", "check", "EDGE", "--engine", "cuda"], "Unknown engine 'cuda'"),
        (["templates", "check", "EDGE", "--shape", "8by8"], "expected ROWSxCOLS, as in 8x8"),
        (["templates", "wash"], "No such command 'wash'"),
        (["probe", "nothing"], "expected one of the drivers simulated, serial"),
        (["probe", "serial"], "The option 'port' is missing".lower()),
        (["probe", "serial", "--set", "port=/dev/ttyNONE9"], "There is no port '/dev/ttyNONE9'"),
        (["record", "simulated", "taps.wav"], "Unknown kind of recording '.wav'"),
        (["record", "simulated", "no/such/folder/taps.npz"], "choose a folder that exists"),
        (["replay", "missing.npz"], "There is no recording 'missing.npz'"),
        (["demo", "--out", "no/such/folder/report.html"], "no/such/folder"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)
def test_one_sentence(call, arguments, said):
    assert said in sentence(call(*arguments)).replace("the option", "The option".lower())


@pytest.mark.parametrize("arguments", [["plan", "demo"], ["devices"]], ids=" ".join)
def test_a_device_that_is_not_there(call, opencl, arguments):
    said = sentence(call(*arguments, "--device", "abacus"))
    assert "No OpenCL device matches 'abacus'" in said


def test_scene_that_is_not_toml(call, tmp_path):
    scene = tmp_path / "torn.toml"
    scene.write_text('name = "torn"\nneeds = [')
    assert f"Scene '{scene}' is not TOML" in sentence(call("run", scene))


def test_scene_that_is_not_text(call, tmp_path):
    scene = tmp_path / "noise.toml"
    scene.write_bytes(bytes(range(256)))
    assert "cannot be read" in sentence(call("run", scene))


def test_recording_that_is_none(call, tmp_path):
    for name, content in (("a.npz", b"PK\x03\x04 cut off"), ("b.npz", b""), ("c.npz", b"hello")):
        (tmp_path / name).write_bytes(content)
        said = sentence(call("replay", tmp_path / name))
        assert f"'{tmp_path / name}' is not a NumPy archive" in said
    (tmp_path / "trial.csv").write_text("1,2\n3,4\n")
    assert "There is no layout" in sentence(call("replay", tmp_path / "trial.csv"))
    (tmp_path / "trial.wav").write_text("1,2\n")
    assert "is not a recording" in sentence(call("replay", tmp_path / "trial.wav"))


def test_a_folder_that_cannot_be_made_is_refused_before_the_export(call, tmp_path, monkeypatch):
    monkeypatch.setattr("cnnum.scenes.exporting.made", lambda *_: pytest.fail("it worked on"))
    (tmp_path / "file").write_text("")
    said = sentence(call("export", "slip", "--out", tmp_path / "file" / "folder"))
    assert f"no files can be created in '{tmp_path / 'file'}'" in said


@pytest.mark.parametrize("name", ["Makefile", "twist.c", "vector.c"])
def test_an_export_replaces_no_file_of_other_work(name, call, tmp_path):
    (tmp_path / name).write_bytes(b"all:\n\techo \xff\n")
    said = sentence(call("export", "twist", "--out", tmp_path))
    assert (
        f"'{tmp_path}' contains the file '{name}', which is not from an export of 'twist'" in said
    )
    assert [one.name for one in tmp_path.iterdir()] == [name]


def test_no_traceback_in_a_real_shell(shell):
    done = shell("run", "nowhere")
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith("cnnum: There is no scene 'nowhere'")
    assert done.stderr.count("\n") == 1


def test_letters_that_the_terminal_lacks(shell):
    done = shell("templates", "show", "EDGE", PYTHONIOENCODING="ascii", PYTHONUTF8="0")
    assert done.returncode == 0, done.stderr
    assert "boundary" in done.stdout
