"""The page on the dissertation: every item of it is there, and every command on it runs."""

import re
from pathlib import Path

from click.testing import CliRunner

import cnnum
from cnnum.cli.root import main
from cnnum.lab.reproduce.registry import figure_makers, item_names, select

ROOT = Path(__file__).parents[3]
PAGE = (ROOT / "docs" / "dissertation.md").read_text(encoding="utf-8")

SECTIONS = """
1.1 1.2 1.3 1.3.1 2.1 2.2 2.2.1 2.2.2 2.2.3 2.2.4 2.2.5 2.3 2.3.1 2.3.2 2.3.3 2.3.4 2.3.5 2.4 3.1
3.2 3.2.1 3.2.2 3.2.3 3.2.4 3.2.5 3.3 3.3.1 3.3.2 3.3.3 3.4 3.4.1 3.4.2 3.4.3 3.5 4.1 4.2 4.2.1
4.2.2 4.2.3 4.2.4 4.2.5 4.3 4.3.1 4.3.2 4.3.3 4.4 5.1 5.1.1 5.2 5.2.1 5.2.2 5.2.3 5.3 5.3.1 5.4
6.1 6.2 6.2.1 6.2.2 6.3 6.3.1 6.4 6.4.1 6.4.2 6.4.3 6.4.4 6.5 6.6 7.1 7.2 7.3 7.3.1 7.3.2
"""
FIGURES = {2: 11, 3: 22, 4: 17, 5: 4, 6: 19, 7: 1}
EQUATIONS = {3: 12, 4: 20, 5: 15, 6: 4}


def named(kind: str) -> set[str]:
    """Return the numbers of figures, or of equations, that the page names, ranges filled."""
    found = set[str]()
    if kind == "Fig.":
        texts = re.findall(r"Fig\. ((?:\d\.\d+(?:, | to |))+)", PAGE)
    else:
        texts = re.findall(r"(\(\d\.\d+\)(?: to \(\d\.\d+\))?)", PAGE)
    for text in texts:
        for first, last in re.findall(r"\(?(\d\.\d+)\)?(?: to \(?(\d\.\d+)\)?)?", text):
            chapter, low = first.split(".")
            high = (last or first).split(".")[1]
            found |= {f"{chapter}.{n}" for n in range(int(low), int(high) + 1)}
    return found


def numbers(counts: dict[int, int]) -> set[str]:
    return {f"{chapter}.{n + 1}" for chapter, count in counts.items() for n in range(count)}


def test_every_figure_equation_table_and_section_is_on_the_page() -> None:
    assert numbers(FIGURES) - named("Fig.") == set()
    assert numbers(EQUATIONS) - named("(") == set()
    for table in ("Table 2.I", "Table 3.I", "Table 3.II"):
        assert table in PAGE
    cells = " ".join(re.findall(r"^\| (.*?) \|", PAGE, flags=re.MULTILINE)) + PAGE[:2000]
    spread = re.sub(
        r"(\d\.\d\.)(\d) to \1(\d)",
        lambda m: " ".join(f"{m[1]}{n}" for n in range(int(m[2]), int(m[3]) + 1)),
        cells,
    )
    missing = [
        one for one in SECTIONS.split() if not re.search(rf"(?<![\d.]){one}(?![\d.]\d)", spread)
    ]
    assert missing == []


def test_the_page_counts_the_rows_and_their_faults():
    items = select([])
    checks = [item for item in items if item.kind == "check"]
    faults = sum(len(item.faults) for item in checks)
    words = r"There are (\d+) \*\*checks\*\*.* (\d+) \*\*comparisons\*\*.* in (\d+) ways"
    said = re.search(words, " ".join(PAGE.split()))
    assert said
    assert [int(n) for n in said.groups()] == [len(checks), len(items) - len(checks), faults]


def test_commands_on_the_page_name_rows_and_no_row_is_left_off_it() -> None:
    asked = [
        name
        for names in re.findall(r"`cnnum reproduce ([^`]*)`", PAGE)
        for name in names.split()
        if name not in ("NAME", "--out", "page.html", "--mutants")
    ]
    for name in asked:
        assert select([name])
    shown = {item.name for item in select(asked)}
    assert set(item_names()) - shown == set()


def test_every_figure_is_a_name_for_the_rows_that_it_shows() -> None:
    for figure in figure_makers():
        assert {item.figure for item in select([figure])} == {figure}


def test_other_commands_on_the_page_exist() -> None:
    commands = re.findall(r"`((?:cnnum|pytest) [^`]*)`", PAGE)
    others = [text.split() for text in commands if not text.startswith("cnnum reproduce")]
    assert len(others) >= 4
    for first, *words in others:
        if first == "pytest":
            assert all((ROOT / path).exists() for path in words)
        else:
            result = CliRunner().invoke(main, [*words, "--help"], standalone_mode=False)
            assert result.exception is None
    assert "halfspace_equilibrium" in cnnum.program_names()
