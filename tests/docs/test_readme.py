"""The examples of the README and the docs run as they stand."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
BLOCKS = [
    pytest.param(code, id=f"{page.relative_to(ROOT)}-{number}")
    for page in PAGES
    for number, code in enumerate(re.findall(r"```python\n(.*?)```", page.read_text(), re.DOTALL))
]

QUICKER = {
    "side, runs = 1024, 6": "side, runs = 24, 2",
    "for more in couplings:": "for more in couplings[::2]:",
}
"""Of code that times itself: a small array, one run after the first, and three of five kinds of
coupling, each with three kernels to build. That it runs is asked here: names, arguments, results.
Steps of large arrays with every kind are the job of large_arrays/test_couplings.py."""


def test_code_that_is_run_quicker_is_there():
    for whole in QUICKER:
        assert sum(whole in block.values[0] for block in BLOCKS) == 1


@pytest.mark.parametrize("code", BLOCKS)
def test_code_runs_as_shown(code, capsys):
    for whole, quicker in QUICKER.items():
        code = code.replace(whole, quicker)
    exec(compile(code, "page", "exec"), {"__name__": "page"})


def test_readme_has_code():
    assert len(BLOCKS) >= 2


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_lead_somewhere(page):
    for target in re.findall(r"\]\(([^)#]+?)(?:#[^)]*)?\)", page.read_text()):
        if not target.startswith(("http:", "https:")):
            assert (page.parent / target).exists(), f"{page.name} links to {target}"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_no_line_is_lost_as_a_comment(page):
    """The site leaves out a line that begins with a percent sign: one that is wrapped there."""
    prose = re.sub(r"```.*?```", "", page.read_text(), flags=re.DOTALL)
    assert not re.findall(r"^ {0,3}%.*", prose, re.MULTILINE)


def test_first_template_finds_the_corners():
    """The README's template on its picture: the four corners of a rectangle."""
    import numpy as np

    import cnnum

    code = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(), re.DOTALL)[0]
    names = {}
    exec(compile(code, "README", "exec"), names)
    found = {tuple(cell) for cell in np.argwhere(names["result"].output > 0).tolist()}
    assert found == {(2, 2), (2, 6), (5, 2), (5, 6)}
    assert cnnum.get_template("CORNER").z[0] == -5.0


def test_engines_page_has_every_limit():
    from cnnum.engines.limits import LIMITS

    page = (ROOT / "docs" / "engines.md").read_text()
    rows = {f"| {limit.engine} | {limit.what} | {limit.why} |" for limit in LIMITS}
    assert rows <= set(page.splitlines())
