"""The page and the command: everything in one file, every row in it, the exit code right."""

import json
import re
import xml.etree.ElementTree as ET
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import cnnum.lab.reproduce
import cnnum.tactile.halfspace
from cnnum.errors import MissingExtraError, RecordingError, UnknownNameError
from cnnum.lab.commands.reproduce import command
from cnnum.lab.reproduce.drawing import INK, draw
from cnnum.lab.reproduce.faults import scaled
from cnnum.lab.reproduce.figure import Arrows, Curve, Dots, Field, Matrix, Panel
from cnnum.lab.reproduce.page import figures_of, number, page, rows_table, write_page, written
from cnnum.lab.reproduce.record import Item
from cnnum.lab.reproduce.registry import run, select

NAMES = ("W", "fig-4.3", "fig-5.2", "erratum")
FIELDS = {"item", "source", "expected", "got", "error", "tolerance", "passed", "kind", "unit"}
BROKEN = (scaled(cnnum.tactile.halfspace.stress, 1.01),)
VOID = {"meta", "br", "link", "img", "input", "hr"}


class Balance(HTMLParser):
    """Follows the elements of a page."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.ids: list[str] = []
        self.links: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag not in VOID:
            self.open.append(tag)
        self.ids += [v for k, v in attrs if k == "id" and v and "svg" not in self.open]
        self.links += [v for k, v in attrs if k in {"src", "href"} and v]

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.links += [v for k, v in attrs if k in {"src", "href"} and v]

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


@pytest.fixture(scope="module")
def made() -> str:
    rows = list(run(select(NAMES)))
    return page(rows, figures_of(rows))


def test_page_is_whole_and_needs_nothing_else(made: str) -> None:
    seen = Balance()
    seen.feed(made)
    assert seen.open in ([], ["html"])  # </html> may be left out, nothing else
    assert len(set(seen.ids)) == len(seen.ids)
    assert not [link for link in seen.links if not link.startswith(("#", "data:"))]
    assert "@import" not in made
    assert "url(http" not in made


def test_page_has_every_row_and_figure(made: str) -> None:
    data = json.loads(made.split('id="rows">')[1].split("</script>")[0])
    assert [row["item"] for row in data] == [item.name for item in select(NAMES)]
    for row in data:
        assert f'id="{row["item"]}"' in made
    assert made.count("<svg") == 2 + 2 + 6  # Fig. 4.16, 4.3 and 5.2
    assert made.count('class="badge cmp"') == 1  # the measured slope of W
    assert "as printed" in made
    assert not re.search(r"\bnan\b|\binf\b|None", re.sub(r"<(svg|style|script).*?</\1>", "", made,
                                                         flags=re.DOTALL))  # fmt: skip


def test_failed_check_shows(made: str) -> None:
    wrong = Item(
        "x", "a number", "nowhere", 2.0, lambda: 3.0, 0.1, "because it must", faults=BROKEN
    )
    assert "✗ failed" not in made
    assert "✗ failed" in rows_table(list(run([wrong])))


def test_every_layer_is_drawn_as_sound_svg() -> None:
    line = np.linspace(1.0, 2.0, 5)
    layers = [
        Field(line, line, np.outer(line, line), "Pa", levels=3),
        Curve(line, line, "T_x & <b>"),
        Dots(line, line, line, line, "µm"),
        Arrows(line, line, line, line),
    ]
    text = draw(Panel("σ_zz", "x (mm)", "y (mm)", layers, log="x", marks=[(1.5, "here")]))
    root = ET.fromstring(text)
    assert INK not in text
    assert "currentColor" in text
    assert "width" not in root.attrib  # as wide as its place
    words = "".join(root.itertext())
    assert "T" in words
    assert "& <b>" in words
    assert "T_x" not in words


def test_a_matrix_shows_its_numbers() -> None:
    matrix = Matrix(np.array([[12.0, 3.0], [4.0, 56.0]]), ("a", "b"), ("c", "d"))
    words = set(ET.fromstring(draw(Panel("", "", "", [matrix]), wide=False)).itertext())
    assert {"12", "3", "4", "56", "a", "b", "c", "d"} <= words


def test_numbers_are_written_for_people() -> None:
    assert number(-2.0) == "−2"
    assert number(1e-12) == "10<sup>−12</sup>"
    assert number(2.5e-7) == "2.5\u00a0·\u00a010<sup>−7</sup>"
    assert number(float("nan")) == "–"
    assert written("T_x < 1") == "T<sub>x</sub> &lt; 1"


def test_page_is_written_to_a_file_or_a_folder(tmp_path: Path) -> None:
    rows = list(run(select(["eq-5.1"])))
    assert write_page(tmp_path / "deep" / "er", rows, ()) == tmp_path / "deep/er/reproduce.html"
    assert write_page(tmp_path / "a.html", rows, ()).read_text().startswith("<!doctype html>")
    with pytest.raises(RecordingError, match="cannot be written"):
        write_page(tmp_path / "a.html" / "b", rows, ())


def test_command_gives_records() -> None:
    result = CliRunner().invoke(command, ["W", "56", "--json"], standalone_mode=False)
    rows = [json.loads(line) for line in result.stdout.splitlines()]
    assert result.return_value == 0
    assert [row["item"] for row in rows] == ["W", "W-slope", "W-slope-measured", "56",
                                             "56-measured"]  # fmt: skip
    assert all(row.keys() >= FIELDS for row in rows)
    assert rows[0]["passed"] is True
    assert rows[2]["passed"] is None
    assert rows[2]["kind"] == "comparison"


def test_command_writes_the_page_and_a_table(tmp_path: Path) -> None:
    target = tmp_path / "page.html"
    result = CliRunner().invoke(command, ["fig-4.3", "--out", str(target)], standalone_mode=False)
    assert "1 of 1 checks passed" in result.stdout
    assert target.read_text().count("<svg") == 2


def test_command_fails_with_a_check(monkeypatch: pytest.MonkeyPatch) -> None:
    wrong = Item(
        "x", "a number", "nowhere", 2.0, lambda: 3.0, 0.1, "because it must", faults=BROKEN
    )
    monkeypatch.setattr(cnnum.lab.reproduce, "select", lambda names: (wrong,))
    result = CliRunner().invoke(command, [], standalone_mode=False)
    assert result.return_value == 1
    assert "FAILED" in result.stdout


def test_command_breaks_the_subjects_of_checks(monkeypatch: pytest.MonkeyPatch) -> None:
    result = CliRunner().invoke(command, ["W", "--mutants", "--json"], standalone_mode=False)
    made = [json.loads(line) for line in result.stdout.splitlines()]
    assert result.return_value == 0
    assert {one["item"] for one in made} == {"W", "W-slope"}
    assert all(one["fell"] for one in made)
    shown = CliRunner().invoke(command, ["W", "--mutants"], standalone_mode=False)
    said = " ".join(shown.stdout.split())
    assert "3 of 3 faults made their check fail, of 2 checks; comparisons cannot fail (1)" in said
    deaf = Item("x", "a number", "nowhere", 2.0, lambda: 2.0, 0.1, "because it must", faults=BROKEN)
    monkeypatch.setattr(cnnum.lab.reproduce, "select", lambda names: (deaf,))
    result = CliRunner().invoke(command, ["--mutants"], standalone_mode=False)
    assert result.return_value == 1
    assert "PASSED" in result.stdout


def test_a_page_of_mutants_is_refused(tmp_path: Path) -> None:
    result = CliRunner().invoke(
        command, ["W", "--mutants", "--out", str(tmp_path)], standalone_mode=False
    )
    assert "--mutants" in str(result.exception)


def test_command_refuses_unknown_items() -> None:
    result = CliRunner().invoke(command, ["fig-9.9"], standalone_mode=False)
    assert isinstance(result.exception, UnknownNameError)


def test_a_missing_package_is_said_and_is_no_failure(monkeypatch: pytest.MonkeyPatch) -> None:
    def missing() -> float:
        raise MissingExtraError("Install the extra 'texture'.")

    item = Item("x", "a number", "nowhere", 2.0, missing, 0.1, "because it must", figure="fig-6.19",
                faults=BROKEN)  # fmt: skip
    (row,) = run([item])
    assert row.passed is None
    assert row.missing == "Install the extra 'texture'."
    assert figures_of([row]) == ()
    assert "not run" in rows_table([row])
    monkeypatch.setattr(cnnum.lab.reproduce, "select", lambda names: (item,))
    result = CliRunner().invoke(command, [], standalone_mode=False)
    assert result.return_value == 0
    assert "Install the extra" in result.stdout
