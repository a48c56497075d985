"""The dissertation's numbers: every check passes, and fails if its subject is broken."""

import math
import sys
from types import ModuleType

import numpy as np
import pytest

import cnnum.tactile.halfspace
import cnnum.tactile.taxel
from cnnum.errors import MissingExtraError, PhysicsError, UnknownNameError
from cnnum.lab.reproduce.chapters import fields, inverse
from cnnum.lab.reproduce.faults import Fault, changed, misled, mutant, mutants, scaled
from cnnum.lab.reproduce.record import Item
from cnnum.lab.reproduce.registry import (
    CHAPTERS,
    beginnings,
    figure_makers,
    item_names,
    run,
    run_item,
    select,
)

ITEMS = select([])
CHECKS = [item for item in ITEMS if item.kind == "check"]
COMPARISONS = [item for item in ITEMS if item.kind == "comparison"]

# Tables, figures and equations that must have a row, as the beginnings of names.
ASKED = [
    "table-2.I",
    "table-3.I",
    "2.9",
    "fig-3.22",
    "table-3.II",
    "fig-2.8",
    "section-2.3.3",
    "section-3.2.1",
    "fig-3.21",
    *(f"fig-4.{n}" for n in (2, 3, 4, 5, 6, 7, 9, 10, 11, 13, 15, 17)),
    "section-4.3.1",
    "section-5.3.1",
    "W",
    "A",
    "56",
    "25√5/24",
    *(f"eq-5.{n}" for n in (1, 2, 3, 4, 5, 6, 7, 8, 10, 12, 13, 14, 15)),
    "fig-5.2",
    "fig-5.3",
    "fig-5.4",
    "hyperacuity",
    *(f"fig-6.{n}" for n in (2, 5, 7, 9, 10, 11, 12, 14, 16, 17, 19)),
    *(f"erratum-{n}" for n in ("3.6", "5.11", "6.2", "6.3", "6.4")),
]
FIGURES = ["2.8", "3.22", "4.2", "4.3", "4.4", "4.5", "4.6", "4.7", "4.9", "4.10",
           "4.11", "4.13", "4.14", "4.15", "4.16", "4.17", "5.2", "5.3", "5.4", "6.5", "6.7",
           "6.9", "6.10", "6.11", "6.12", "6.14", "6.16", "6.17", "6.18", "6.19"]  # fmt: skip


BROKEN = (scaled(cnnum.tactile.halfspace.stress, 1.01),)


def item(**changes: object) -> Item:
    values = {
        "name": "x",
        "title": "a number",
        "source": "nowhere",
        "expected": 2.0,
        "compute": lambda: 2.1,
        "tolerance": 0.2,
        "reason": "because",
        "faults": BROKEN,
    }
    return Item(**(values | changes))  # type: ignore[arg-type]


@pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.name)
def test_every_check_passes(check: Item) -> None:
    row = run_item(check)
    assert row.passed, f"{check.name}: expected {check.expected}, got {row.got} ({check.reason})"


def test_there_are_rows_for_all_that_is_asked() -> None:
    assert len(CHECKS) >= 88
    assert len(set(item_names())) == len(item_names())
    for name in ASKED:
        assert select([name])


def test_every_item_says_where_it_is_from_and_why_it_may_be_off() -> None:
    for one in ITEMS:
        assert len(one.reason) > 5
        assert one.source
        assert one.figure is None or one.figure in figure_makers()


def test_figures_of_the_dissertation_are_there_and_belong_to_rows() -> None:
    shown = {one.figure for one in ITEMS}
    for number in FIGURES:
        assert f"fig-{number}" in figure_makers()
    assert set(figure_makers()) <= shown


@pytest.mark.parametrize("comparison", COMPARISONS, ids=lambda one: one.name)
def test_comparisons_neither_pass_nor_fail(comparison: Item) -> None:
    row = run_item(comparison)
    assert row.passed is None
    assert math.isfinite(row.got)


@pytest.mark.one_in(5)
@pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.name)
def test_every_check_fails_if_its_subject_is_broken(check: Item) -> None:
    """One in five; `cnnum reproduce --mutants` breaks them all in a minute."""
    for one in mutants([check]):
        assert one.fell, f"{check.name} passes with {one.fault.target}: {one.fault.what}"
    assert run_item(check).passed


def test_a_check_that_cannot_fail_is_found_out() -> None:
    deaf = item(compute=lambda: 2.0)
    (one,) = mutants([deaf])
    assert not one.fell
    assert one.record() == {
        "item": "x", "target": "tactile.halfspace.point:stress", "fault": "× 1.01", "expected": 2.0,
        "got": 2.0, "tolerance": 0.2, "fell": False, "missing": "",
    }  # fmt: skip


def test_a_check_that_a_fault_stops_has_fallen_and_one_without_its_package_is_not_run() -> None:
    """NumPy's error is not the library's, and a missing package ends no other check."""

    def without() -> float:
        raise MissingExtraError("Install the extra 'fem'.")

    def stopped() -> float:
        return float(np.zeros(2)[2])

    first, second, third = mutants([item(compute=f) for f in (without, stopped, lambda: 9.0)])
    assert (first.fell, first.passed, first.missing) == (False, False, "Install the extra 'fem'.")
    assert second.fell
    assert third.fell
    assert not third.missing


def test_faults_reach_functions_methods_and_properties_and_leave_no_trace() -> None:
    place = (1e-4, 0.0, 2e-4, [0.0, 0.0, 1.0])
    taxel = cnnum.tactile.taxel

    def all_three() -> tuple[float, float, float]:
        return (
            float(fields.stress(*place)[2, 2]),
            float(taxel.Bridge().voltages([0.0, 0.0, 1e-3])[0]),
            taxel.Piezoresistor().transversal,
        )

    right = all_three()
    faults = (
        scaled(fields.stress, 3.0, entry=(2, 2)),
        scaled(taxel.Bridge.voltages, 3.0),
        changed(taxel.Piezoresistor.transversal, "three times", lambda pi: 3.0 * pi),
    )
    for n, fault in enumerate(faults):
        with fault.applied():
            wrong = all_three()
        assert wrong[n] == pytest.approx(3.0 * right[n])
        assert [wrong[k] for k in range(3) if k != n] == [right[k] for k in range(3) if k != n]
    with misled(fields.stress, 2, "z", factor=2.0, shift=1e-4).applied():
        assert fields.stress(*place)[2, 2] == all_three()[0] != right[0]
    assert all_three() == right


def test_modules_imported_and_results_remembered_with_a_fault_lose_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The module of a program is first imported when a check asks for it."""
    from cnnum.templates.tactile.shared import pressure

    right, late = pressure.rectangle_strain, ModuleType("cnnum.late")
    with scaled(right, 3.0).applied():
        vars(late)["rectangle_strain"] = pressure.rectangle_strain
        monkeypatch.setitem(sys.modules, "cnnum.late", late)
        wrong = pressure.shear_seen((1, 2), 1.0).own_x
    assert vars(late)["rectangle_strain"] is pressure.rectangle_strain is right
    assert wrong == pytest.approx(3.0 * pressure.shear_seen((1, 2), 1.0).own_x)


def test_a_refusal_of_the_library_is_a_fall() -> None:
    def refuse(*_: object) -> float:
        raise PhysicsError("No.")

    fault = Fault(fields.stress, "refused", lambda _: refuse)
    check = item(compute=lambda: float(fields.stress(0.0, 0.0, 1.0, [0.0, 0.0, 1.0])[2, 2]))
    one = mutant(check, fault)
    assert one.fell
    assert math.isnan(one.got)


def test_what_is_printed_wrong_would_not_pass() -> None:
    errata = [one for one in ITEMS if one.printed is not None]
    assert len(errata) == 7
    for one in errata:
        row = run_item(one)
        assert row.passed
        assert row.printed is not None
        assert one.error(row.printed) > one.tolerance, one.name


@pytest.mark.parametrize(
    ("rule", "expected", "got", "error"),
    [
        ("absolute", 2.0, 2.1, 0.1),
        ("absolute", 2.0, 1.9, 0.1),
        ("relative", 2.0, 2.1, 0.05),
        ("at least", 2.0, 1.5, 0.5),
        ("at least", 2.0, 9.0, 0.0),
        ("at most", 2.0, 2.5, 0.5),
        ("at most", 2.0, -9.0, 0.0),
        ("within", (1.0, 3.0), 2.0, 0.0),
        ("within", (1.0, 3.0), 0.5, 0.5),
        ("within", (1.0, 3.0), 4.0, 1.0),
        ("absolute", 2.0, float("nan"), float("inf")),
        ("at most", 2.0, float("-inf"), float("inf")),
    ],
)
def test_error_follows_its_rule(rule: str, expected: object, got: float, error: float) -> None:
    assert item(rule=rule, expected=expected).error(got) == pytest.approx(error)


def test_a_wrong_number_fails() -> None:
    rows = list(run([item(), item(tolerance=0.05), item(compute=lambda: float("nan"))]))
    assert [row.passed for row in rows] == [True, False, False]
    assert rows[1].record()["passed"] is False


@pytest.mark.parametrize(
    "changes",
    [
        {"rule": "nearly"},
        {"kind": "wish"},
        {"rule": "within"},
        {"expected": (1.0, 2.0)},
        {"tolerance": -1.0},
        {"tolerance": float("nan")},
        {"reason": ""},
        {"faults": ()},
        {"faults": (scaled(cnnum.tactile.halfspace.stress, 1.5),)},
        {"faults": (changed(cnnum.tactile.halfspace.stress, "sign", np.negative),)},
        {"kind": "comparison"},
    ],
)
def test_an_item_that_is_wrong_refuses_to_exist(changes: dict[str, object]) -> None:
    with pytest.raises(PhysicsError):
        item(**changes)


def test_names_are_whole_parts() -> None:
    assert [one.name for one in select(["fig-5.3"])] == [
        "fig-5.3-place",
        "fig-5.3-force",
        "fig-5.3-published",
        "fig-5.3-light",
        "hyperacuity",  # the figure shows it
    ]
    assert {"eq-4.15"} == {one.name for one in select(["fig-4.14"])}
    assert {one.name for one in select(["w"])} == {"W", "W-slope", "W-slope-measured"}
    assert len(select(["eq-5"])) == len(inverse.CHAPTER.items)
    assert len(select(["W", "eq-5"])) == 3 + len(inverse.CHAPTER.items)
    with pytest.raises(UnknownNameError, match=r"fig-4\.1'"):
        select(["fig-4.1"])


def test_unknown_names_are_answered_with_names_that_are_known() -> None:
    for name in beginnings():
        assert select([name])
    with pytest.raises(UnknownNameError, match="'hyperacuity'"):
        select(["hyperacurity"])
    with pytest.raises(UnknownNameError, match=r"'fig-2'.*'eq-3'"):
        select(["§§"])


def test_chapters_hold_every_item_once() -> None:
    assert sum(len(chapter.items) for chapter in CHAPTERS) == len(ITEMS)
