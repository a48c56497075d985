"""The page of coupled templates that a search found; `python docs/figures/search_table.py [NAME…]`.

Each search starts from weights that know nothing. Its template is judged under draws of the
mismatch that it has never seen, the same for the published weights. A page takes minutes.
"""

import sys
import time
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from cnnum.design.search import Search, compared, search
from cnnum.engine import Engine
from cnnum.report.environment import Environment
from cnnum.templating.checks import run_check
from cnnum.templating.checks.robustness import wilson
from cnnum.templating.library import get_template

PAGE = Path(__file__).parents[1] / "design-search.md"
NAMES = (
    "CCD_HOR", "CCD_VERT", "HOLE", "SHADOW", "PATCHMAK", "SHADMASK", "ERASMASK", "CONCHOLL",
    "MAXLOC",
)  # fmt: skip
MISMATCH, DRAWS = 0.05, 400

HEAD = """# Coupled templates found by search

Can a search find coupled templates that are as robust as the published ones? For {good} of the
{count} templates below, random errors of the weights lead to a wrong cell no more often in the
template found than in the published one. `cnnum templates design` searched with CMA-ES (`cma`,
extra `search`) within the pattern of each published template: zeros stay zeros, and equal weights
stay equal. Three searches run side by side. Each starts from a self-feedback of 2 with all other
weights 0, and ends when a template has no flip, even in 100 further draws, or after 25
generations.

* A *draw* gives each weight a random error, and is a *flip* if a cell of the result is then
  wrong. The table gives the share of flips, with its 95 % interval, in {draws} draws with errors
  of {mismatch:g} % (standard deviation). Both templates get the same draws, which no search has
  seen.
* *check*: whether the template found passes the published template's check at all sizes.
* *templates run* and *seconds* count all three searches.

`python docs/figures/search_table.py` writes this page; the times are from this machine: {machine}.

| template | flips, published | flips, found | check | templates run | seconds |
|---|--:|--:|---|--:|--:|
"""


@dataclass(frozen=True, slots=True)
class Row:
    """A search and its result."""

    name: str
    published: float
    found: float
    passed: bool
    runs: int
    seconds: float


def row(name: str, engine: Engine) -> Row:
    """Return the row of a template."""
    form, begin = get_template(name), time.perf_counter()
    found = search(Search(form, mismatch=MISMATCH), engine)
    seconds = time.perf_counter() - begin
    rates = compared(form, found.template, engine, mismatch=MISMATCH, draws=DRAWS)
    passed = run_check(found.template, engine, repeats=1).passed
    return Row(name, *rates, passed, found.evaluations, seconds)


def page(rows: Iterable[Row], machine: str) -> str:
    """Return the page's text."""
    lines = [
        f"| {one.name} | {_rate(one.published)} | {_rate(one.found)} | "
        f"{'passed' if one.passed else 'failed'} | {one.runs:,} | {one.seconds:.1f} |"
        for one in rows
    ]
    rows = list(rows)
    good = sum(one.found <= one.published for one in rows)
    head = HEAD.format(
        good=good, count=len(rows), draws=DRAWS, mismatch=100 * MISMATCH, machine=machine
    )
    return head + "\n".join(lines) + "\n"


def _rate(share: float) -> str:
    low, high = wilson(round(share * DRAWS), DRAWS)
    return f"{100 * share:.1f} % ({100 * low:.1f}–{100 * high:.1f})"


def main() -> None:
    """Search, print each row, and write the page of all."""
    engine, rows = Engine("opencl"), list[Row]()
    for name in sys.argv[1:] or NAMES:
        rows.append(row(name, engine))
        print(rows[-1], flush=True)
    if not sys.argv[1:]:
        PAGE.write_text(page(rows, Environment.here(engine.device).machine), encoding="utf-8")


if __name__ == "__main__":
    main()
