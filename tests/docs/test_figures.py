"""A figure that stands on several pages is that of the file that a command wrote."""

import json
import re
from pathlib import Path

import pytest

import cnnum

DOCS = Path(__file__).parents[2] / "docs"
ROWS = {
    row["case"]: row for row in json.loads((DOCS / "bench/epyc/latency.json").read_text())["rows"]
}

# of a frame, in microseconds: where a page says it, and of which program
STATED = [
    ("../README.md", r"through slip and twist in ([\d.]+) µs", "slip and twist"),
    ("programs/halfspace.md", r"transform, and takes ([\d.]+) µs", "halfspace_stress"),
    ("programs/halfspace.md", r"transform and takes ([\d.]+) µs", "halfspace_layers"),
    ("programs/halfspace.md", r"8×8 taxels takes ([\d.]+) µs", "halfspace_equilibrium"),
    ("programs/edges.md", r"8×8 taxels takes ([\d.]+) µs", "edges"),
]


@pytest.mark.parametrize(("page", "words", "case"), STATED)
def test_a_page_says_the_time_that_was_measured(page, words, case):
    (stated,) = re.findall(words, " ".join((DOCS / page).read_text().split()))
    assert abs(float(stated) - ROWS[case]["p50_us"]) <= 0.051  # rounded once, from any digit


def test_the_table_of_latencies_is_that_of_its_file():
    page = (DOCS / "latency.md").read_text()
    rows = re.findall(r"^\| ([a-z_ ]+) \| ([\d.]+) µs \| ([\d.]+) µs \|", page, re.MULTILINE)
    assert {case for case, *_ in rows} == ROWS.keys()
    for case, median, tail in rows:
        assert abs(float(median) - ROWS[case]["p50_us"]) <= 0.051
        assert abs(float(tail) - ROWS[case]["p99_us"]) <= 0.051


def test_the_readme_counts_the_checks_of_the_library():
    checks = [cnnum.get_template(name).check for name in cnnum.template_names()]
    finer = sum(check is not None and check.name.startswith("refined") for check in checks)
    page = " ".join((DOCS.parent / "README.md").read_text().split())
    closed = len(checks) - finer
    assert (
        f"{closed} of the {len(checks)} against a closed form, and the other {finer}, whose" in page
    )
    assert all(check is not None for check in checks)


def test_the_skin_of_the_first_page_is_that_of_its_script():
    """But for the code in it, which a full run of the script makes."""
    from docs.figures.browser_skin import COLS, PAGE, RATE, ROWS

    said = {"ROWS": str(ROWS), "COLS": str(COLS), "RATE": str(RATE)}
    said |= {"SCALE": r"\{[a-z_':0-9, ]+\}", "WASM": "[A-Za-z0-9+/=]{9999,}"}
    said |= {"COLOURS": r"[\[\], 0-9]+", "GRADIENT": r"[rgb(), 0-9]+"}
    parts = re.split("@([A-Z]+)@", PAGE)
    pattern = "".join(
        said[part] if place % 2 else re.escape(part) for place, part in enumerate(parts)
    )
    assert re.fullmatch(pattern, (DOCS / "skin.html").read_text())
