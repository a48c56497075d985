"""Scripts for other programs run, and give the picture that the template gives here."""

import importlib.util
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner

import cnnum
from cnnum.cli import main
from cnnum.errors import NotSupportedError, UnknownNameError
from cnnum.templating.files import Entry, load_template
from cnnum.templating.files.scripts import script
from cnnum.templating.library import get_entry, template_names

STAND_IN = '''
"""In place of PyCNN, which no package index has: its two public functions, written anew."""
import numpy as np
from scipy import signal


class PyCNN:
    def cnn(self, x):
        return np.clip(x, -1.0, 1.0)

    def f(self, t, x, Ib, Bu, tempA):
        state = x.reshape(self.n, self.m)
        return (-state + Ib + Bu + signal.convolve2d(self.cnn(state), tempA, "same")).ravel()
'''


@pytest.fixture
def picture():
    return np.where(np.random.default_rng(5).random((9, 11)) < 0.5, 1.0, -1.0)


@pytest.fixture
def stand_in(tmp_path, monkeypatch):
    (tmp_path / "pycnn.py").write_text(STAND_IN)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "pycnn", raising=False)
    yield
    sys.modules.pop("pycnn", None)


def module(tmp_path, text):
    path = tmp_path / "exported.py"
    path.write_text(text)
    spec = importlib.util.spec_from_file_location("exported", path)
    made = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(made)
    return made


WEST = cnnum.Template(
    "west",
    A=np.diag([0.0, 1.0, 0.0]),
    B=[[0, 0, 0], [2.0, 1.0, 0], [0.25, 0, 0]],
    z=-0.5,
    tau=2.0,
    boundary=-1.0,
    duration=6.0,
)
"""Neither kernel looks the same turned, and two time constants of 2 are not four."""
WAVE = replace(WEST, name="wave", A=[[0.5, 0, 0], [0, 1.2, 0], [0, 0, 0]], z=0.1, duration="settle")


@pytest.mark.parametrize("program", ["celnn", "pycnn"])
@pytest.mark.parametrize(
    "template",
    [
        WEST,
        WAVE,
        replace(WEST, boundary="zero-flux", input_boundary="zero-flux", initial="input"),
        replace(WAVE, B=None, name="no input", initial=0.2, duration=3.0),
        *map(cnnum.get_template, ("EDGE", "HOLE", "LOGAND", "SHADOW")),
    ],
    ids=lambda t: t.name,
)
def test_the_picture_is_the_same_there(program, template, picture, tmp_path, stand_in):
    if program == "celnn":
        pytest.importorskip("celnn")
    made = module(tmp_path, script(Entry(template), program))
    state = np.flipud(picture) if template.needs_state else None
    there = made.run(picture, state)
    if template.inputs:
        given = {"input": picture, "state": state}
    else:
        given = {"state": np.full(picture.shape, template.initial)}
    here = cnnum.Engine("reference").run(template, **given).output
    assert np.ptp(here) > 0.5
    # Euler's steps of at most 0.05 τ; the end of HOLE and of the others does not depend on them
    np.testing.assert_allclose(there, here, atol=0.03)


def test_the_script_reads_and_writes_pictures(picture, tmp_path):
    pytest.importorskip("celnn")
    path, given, made = (tmp_path / name for name in ("edge.py", "in.png", "out.png"))
    cnnum.save_picture(picture, given)
    said = CliRunner().invoke(main, ["templates", "export", "EDGE", str(path), "--for", "celnn"])
    assert said.exit_code == 0, said.output
    subprocess.run([sys.executable, path, given, made], check=True, timeout=120)
    here = cnnum.Engine("reference").run("EDGE", input=picture).output
    np.testing.assert_array_equal(cnnum.load_picture(made) > 0, here > 0)


def test_a_script_that_needs_two_pictures_says_so(picture, tmp_path, stand_in):
    made = module(tmp_path, script(get_entry("LOGAND"), "pycnn"))
    with pytest.raises(SystemExit, match="needs two pictures"):
        made.run(picture)


def test_the_script_of_matcnn_holds_the_template_and_its_run(tmp_path):
    """No MatCNN runs here: its kernels are binaries of MATLAB. What the script sets is read."""
    path = tmp_path / "hole.m"
    said = CliRunner().invoke(main, ["templates", "export", "HOLE", str(path), "--for", "matcnn"])
    assert said.exit_code == 0, said.output
    assert "2 time constants per cell" in " ".join(said.stdout.split())
    hole, text = cnnum.get_template("HOLE"), path.read_text()
    assert load_template(path).digest == hole.digest
    for line in (
        "mCNN.Atem = reshape([0.0 1.0 0.0; 1.0 3.0 1.0; 0.0 1.0 0.0], [], 1);",
        "mCNN.Btem = reshape([0.0 0.0 0.0; 0.0 4.0 0.0; 0.0 0.0 0.0], [], 1);",
        "mCNN.I = -1.0;",
        "mCNN.Boundary = -1.0;",
        "state = 1.0 * ones(size(picture));",
    ):
        assert line in text
    median = script(get_entry("MATCNN_MEDIAN"), "matcnn")
    assert "mCNN.TemType = 2;" in median
    assert "mCNN.nlin_d = MATCNN_MEDIAN_d;" in median


def test_what_a_program_cannot_run_is_refused(tmp_path):
    for name, program in (("MEDIAN", "celnn"), ("MOTDEPEN", "pycnn"), ("MOTDEPEN", "matcnn")):
        with pytest.raises(NotSupportedError, match=f"'{name}' has"):
            script(get_entry(name), program)
    with pytest.raises(NotSupportedError, match="boundary"):
        script(Entry(replace(WAVE, boundary="periodic")), "pycnn")
    with pytest.raises(UnknownNameError, match="celnn"):
        script(get_entry("EDGE"), "cellnn")
    wrong = ["templates", "export", "EDGE", str(tmp_path / "edge.m"), "--for", "celnn"]
    assert CliRunner().invoke(main, wrong).exit_code == 2


def test_most_of_the_library_goes_to_each_program():
    """Every script is Python that compiles, and as many templates are taken as were counted."""
    made = dict.fromkeys(("celnn", "pycnn", "matcnn"), 0)
    for name in template_names():
        for program in made:
            try:
                text = script(get_entry(name), program)
            except NotSupportedError:
                continue
            if program != "matcnn":
                compile(text, name, "exec")
            made[program] += 1
    assert made["celnn"] >= 190
    assert made["pycnn"] >= 150
    assert made["matcnn"] >= 190
