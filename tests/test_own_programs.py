"""A program in a Python file of one's own is loaded as a template or a scene is."""

import numpy as np
import pytest

import cnnum
from cnnum.errors import ProgramError, UnknownNameError

ONE = """
import cnnum

@cnnum.program
def doubled(frame):
    return {"twice": 2.0 * frame.normal}
"""
TWO = ONE + ONE.replace("doubled", "tripled").replace("2.0", "3.0")


def test_the_program_of_a_file_runs(tmp_path):
    (tmp_path / "one.py").write_text(ONE)
    (tmp_path / "two.py").write_text(TWO)
    frame = np.random.default_rng(0).normal(size=(3, 4, 3))
    engine = cnnum.Engine("numba", precision="float64")
    for factor, program in (
        (2.0, cnnum.load_program(tmp_path / "one.py")),
        (3.0, cnnum.load_program(str(tmp_path / "two.py"), "tripled")),
    ):
        plan = engine.compile(program, (3, 4))
        np.testing.assert_allclose(plan(frame)["twice"], factor * frame[..., 2], rtol=1e-15)


@pytest.mark.parametrize(
    ("text", "name", "kind", "words"),
    [
        (TWO, None, ProgramError, "doubled, tripled: name one"),
        (TWO, "doubbled", UnknownNameError, "doubled"),
        ("x = 1", None, ProgramError, "no program"),
        ("import nothing_of_that_name", None, ProgramError, "ModuleNotFoundError"),
        ("def (", None, ProgramError, "SyntaxError"),
    ],
)
def test_a_file_without_the_program_is_one_sentence(tmp_path, text, name, kind, words):
    (tmp_path / "own.py").write_text(text)
    with pytest.raises(kind, match=words):
        cnnum.load_program(tmp_path / "own.py", name)


def test_a_file_that_is_no_python_file_or_missing(tmp_path):
    (tmp_path / "own.txt").write_text(ONE)
    with pytest.raises(ProgramError, match="not a Python file"):
        cnnum.load_program(tmp_path / "own.txt")
    with pytest.raises(FileNotFoundError):
        cnnum.load_program(tmp_path / "none.py")
    with pytest.raises(ProgramError, match="a folder"):
        cnnum.load_program(tmp_path)
