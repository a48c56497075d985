"""The suite of stiff and extreme cases: that it judges rightly, and some of its cases."""

import json
import multiprocessing
import time
from dataclasses import replace

import numpy as np
import pytest

import cnnum
from cnnum.errors import DeviceError, MethodError
from cnnum.lab.stability import all_cases, run, run_case, select
from cnnum.lab.stability.page import page
from cnnum.lab.stability.record import Case, Solved

GIVEN = Case(
    "invented", "extreme", "a case of the tests", lambda _: Solved(np.ones(3)), lambda: np.ones(3),
    1e-3, 1e-6, "as tests like it", refusal="too stiff",
)  # fmt: skip

QUICK = (
    "layers-1e+06", "diffusion-1e+06-standard", "coupled-feedback-1000", "bottleneck", "saddle",
    "pinned-front-8", "never-settles-2", "input-1e+30", "sum-beyond-float32", "edge-1x97",
    "cancelling-weights", "elastic-block-0.499", "relaxing-block-0.499", "form-zero-strain-ring",
    "late-2",
)  # fmt: skip


@pytest.fixture(scope="module")
def engine():
    return cnnum.Engine("opencl", precision="float32")


def raising(error):
    def solve(_):
        raise error

    return replace(GIVEN, solve=solve)


@pytest.mark.parametrize(
    ("case", "outcome", "passed"),
    [
        (GIVEN, "solved", True),
        (replace(GIVEN, solve=lambda _: Solved(np.ones(3) + 0.01)), "solved", False),
        (replace(GIVEN, solve=lambda _: Solved(np.array([1.0, np.nan, 1.0]))), "solved", False),
        (replace(GIVEN, solve=lambda _: Solved(np.ones(4))), "solved", False),
        (replace(GIVEN, solve=lambda _: Solved(np.ones(3) + 5e-4, 1e-5)), "solved", False),
        (replace(GIVEN, solve=lambda _: Solved(np.ones(3) + 5e-4, 1e-3)), "solved", True),
        (raising(MethodError("It is too stiff.")), "refused", True),
        (raising(MethodError("Another reason.")), "refused", False),
        (raising(ZeroDivisionError("raw")), "failed", False),
    ],
    ids=["right", "off", "nan", "shape", "overclaims", "claims", "refused", "wrongly", "raw"],
)
def test_a_case_passes_if_right_or_rightly_refused(engine, case, outcome, passed):
    row = run_case(case, engine)
    assert (row.outcome, row.passed) == (outcome, passed)


@pytest.mark.parametrize("name", QUICK)
def test_cases_pass(engine, name):
    (case,) = [case for case in all_cases() if case.name == name]
    row = run_case(case, engine)
    assert row.passed, row


def test_there_are_eighty_cases_with_names_of_their_own():
    names = [case.name for case in all_cases()]
    assert len(set(names)) == len(names) >= 80
    assert {case.family for case in select(())} == {"stiff", "marginal", "extreme", "precision"}


def test_what_hangs_is_ended(monkeypatch):
    """A case that is not done in no time at all is ended, and the next one runs."""
    monkeypatch.setattr("cnnum.lab.stability.runner.PATIENCE", 0.0)
    rows = list(run(select(["balanced"]), "numba", "float64"))
    assert [(row.outcome, row.passed) for row in rows] == [("failed", False)]
    assert "did not end" in rows[0].why


@pytest.mark.in_full("test_what_hangs_is_ended")
def test_a_process_that_dies_between_two_cases_is_no_fault_of_the_next():
    rows = run(select(["saddle", "growth-0"]), "reference", "float64")
    found = [next(rows)]
    for process in multiprocessing.active_children():
        process.kill()
        process.join()
    time.sleep(0.3)  # until the pool has seen it
    assert {row.outcome for row in [*found, *rows]} == {"solved"}


def test_the_page_holds_every_row(engine):
    rows = [run_case(case, engine) for case in select(["growth-0", "sum-beyond"])]
    text = page(rows)
    data = text[text.index('id="rows">') + len('id="rows">') : text.rindex("</script>")]
    assert [row["case"] for row in json.loads(data)] == [row.case for row in rows]
    assert "http:" not in text.replace("http://www.w3.org", "")


def test_an_engine_that_ends_the_process_that_opens_it_is_named(monkeypatch, tmp_path):
    (tmp_path / "ending.py").write_text("import os\ndef opened(*_):\n    os._exit(3)\n")
    monkeypatch.syspath_prepend(tmp_path)
    from ending import opened

    monkeypatch.setattr("cnnum.lab.stability.runner._opened", opened)
    with pytest.raises(DeviceError, match="Engine 'numba' ended the process that opened it"):
        list(run(select(["balanced"]), "numba", "float64"))
