"""Print coupled templates that a search found; `python docs/figures/search_table.py [NAME…]`.

Each search starts from weights that know nothing. Its template is judged under draws of the
mismatch that it has never seen, the same for the published weights.
"""

import sys
import time
from dataclasses import dataclass

from cnnum.design.search import Search, compared, search
from cnnum.engine import Engine
from cnnum.templating.checks import run_check
from cnnum.templating.checks.robustness import wilson
from cnnum.templating.library import get_template

NAMES = (
    "CCD_HOR", "CCD_VERT", "HOLE", "SHADOW", "PATCHMAK", "SHADMASK", "ERASMASK", "CONCHOLL",
    "MAXLOC",
)  # fmt: skip
MISMATCH, DRAWS = 0.05, 400


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


def _rate(share: float) -> str:
    low, high = wilson(round(share * DRAWS), DRAWS)
    return f"{100 * share:.1f} % ({100 * low:.1f}–{100 * high:.1f})"


def main() -> None:
    """Search, and print a row for each template and the number that are as good."""
    engine, good = Engine("opencl"), 0
    names = sys.argv[1:] or NAMES
    for name in names:
        made = row(name, engine)
        good += made.found <= made.published
        print(
            f"{made.name}: flips {_rate(made.found)}, of the published {_rate(made.published)}; "
            f"check {'passed' if made.passed else 'failed'}; "
            f"{made.runs:,} templates run in {made.seconds:.1f} s",
            flush=True,
        )
    print(f"{good} of {len(names)} flip no more often than the published")


if __name__ == "__main__":
    main()
