"""The dissertation's numbers: every check passes, a wrong number would not."""

import math

import pytest

from cnnum.errors import PhysicsError, UnknownNameError
from cnnum.lab.reproduce.chapters import errata, inverse
from cnnum.lab.reproduce.record import Item
from cnnum.lab.reproduce.registry import CHAPTERS, beginnings, figure_makers, item_names, select
from cnnum.lab.reproduce.run import run, run_item

ITEMS = select([])
CHECKS = [item for item in ITEMS if item.kind == "check"]
COMPARISONS = [item for item in ITEMS if item.kind == "comparison"]

# Tables, figures and equations that must have a row, as the beginnings of names.
ASKED = [
    "table-3.I",
    "2.9",
    "fig-3.22",
    "table-3.II",
    *(f"fig-4.{n}" for n in (2, 3, 4, 5, 6, 7, 13, 17)),
    "W",
    "A",
    "56",
    "25√5/24",
    *(f"eq-5.{n}" for n in (3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15)),
    "fig-5.2",
    "fig-5.3",
    "fig-5.4",
    "hyperacuity",
    *(f"fig-6.{n}" for n in (5, 7, 9, 10, 11, 12, 14, 16, 17, 18, 19)),
    *(f"erratum-{n}" for n in ("3.6", "3.11", "5.11", "6.2", "6.3", "6.4")),
]
FIGURES = ["3.22", "4.2", "4.3", "4.4", "4.5", "4.6", "4.7", "4.13", "4.16", "4.17", "5.2", "5.3",
           "5.4", "6.5", "6.7", "6.9", "6.10", "6.11", "6.12", "6.14", "6.16", "6.17", "6.18",
           "6.19"]  # fmt: skip


def item(**changes: object) -> Item:
    values = {
        "name": "x",
        "title": "a number",
        "source": "nowhere",
        "expected": 2.0,
        "compute": lambda: 2.1,
        "tolerance": 0.2,
        "reason": "because",
    }
    return Item(**(values | changes))  # type: ignore[arg-type]


@pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.name)
def test_every_check_passes(check: Item) -> None:
    row = run_item(check)
    assert row.passed, f"{check.name}: expected {check.expected}, got {row.got} ({check.reason})"


def test_there_are_rows_for_all_that_is_asked() -> None:
    assert len(CHECKS) >= 45
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


def test_what_is_printed_wrong_would_not_pass() -> None:
    for one in errata.CHAPTER.items:
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
    ],
)
def test_an_item_that_is_wrong_refuses_to_exist(changes: dict[str, object]) -> None:
    with pytest.raises(PhysicsError):
        item(**changes)


def test_names_are_whole_parts() -> None:
    assert [one.name for one in select(["fig-5.4"])] == [
        "fig-5.4",
        "fig-5.4-measured",
        "fig-5.4-thin",
    ]
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
    with pytest.raises(UnknownNameError, match=r"'fig-4'.*'erratum-3'"):
        select(["§§"])


def test_chapters_hold_every_item_once() -> None:
    assert sum(len(chapter.items) for chapter in CHAPTERS) == len(ITEMS)
