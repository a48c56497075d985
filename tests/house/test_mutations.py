"""The list of `make mutate` fits the code, and its runner sees which faults survive."""

import importlib.util
import sys
from dataclasses import replace
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


def load():
    path = ROOT / "tests/mutations/run.py"
    spec = importlib.util.spec_from_file_location("mutations_run", path)
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


RUN = load()


def test_the_list_fits_the_code():
    listed = RUN.mutations()
    assert len(listed) >= 30
    assert not RUN.faults(listed)
    assert sum(not one.equivalent for one in listed) >= 30


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"old": "no such text"}, "stands in 'cnnum/errors.py' 0 times"),
        ({"file": "cnnum/none.py"}, "stands in 'cnnum/none.py' 0 times"),
        ({"new": "class SceneError("}, "changes nothing"),
        ({"tests": ()}, "needs tests, or a reason"),
        ({"tests": ("tests/house/none.py",)}, "no test 'tests/house/none.py'"),
        ({"tests": ("tests/house/test_house.py::test_none",)}, "no test"),
    ],
)
def test_an_entry_that_does_not_fit_is_named(change, said):
    one = RUN.Mutation(
        "one", "cnnum/errors.py", "class SceneError(", "class Other(", ("tests/house",)
    )
    assert not RUN.faults([one])
    (found,) = RUN.faults([replace(one, **change)])
    assert said in found


@pytest.mark.in_full("make mutate, which puts in all of them")
def test_a_fault_is_put_in_and_taken_out(tmp_path):
    (tmp_path / "a.py").write_text("x = 1\n")
    (tmp_path / "test_a.py").write_text("from a import x\n\ndef test_x():\n    assert x == 1\n")
    one = RUN.Mutation("one", "a.py", "x = 1", "x = 2", ("test_a.py",))
    assert RUN.run_tests(one.tests, tmp_path)[0]
    with RUN.broken(one, tmp_path):
        passes, by = RUN.run_tests(one.tests, tmp_path)
    assert not passes
    assert "test_x" in by
    assert (tmp_path / "a.py").read_text() == "x = 1\n"
