"""The page of templates that were designed anew; `python docs/figures/design_table.py` writes it.

A test holds the page to the code.
"""

import math
from collections.abc import Iterable
from pathlib import Path

from cnnum.design.found_again import Again, found_again
from cnnum.design.worst_case import worst_case

PAGE = Path(__file__).parents[1] / "design-library.md"

HEAD = """# Templates found again from their rules

`python docs/figures/design_table.py` writes this page; a test holds it to the code. Each template
below is uncoupled, and its check is a local rule of 3×3 cells. The design sees that rule alone,
never the published weights.

* *examples*: neighbourhoods that the rule distinguishes, cells that never decide left out.
* *margin*: the least drive of a cell towards its colour. The weights that decide are scaled to the
  same sum of sizes.
* *relative*: the margin over that sum, the relative margin, which the design makes as large as it
  can be.
* *at most*: a bound that no relative margin exceeds, by the multipliers of the linear program.
* *worst*: the worst case. With all weights off by less than this share of themselves, each by
  itself, no cell is wrong at the end of the template's own run. A little more of the worst mismatch
  makes one wrong. It is smaller than the relative margin, because the own feedback is off as well,
  and because a run ends.

{count} templates; the relative margin is larger than the published one in {larger} of them, equal
in {equal} and smaller in {smaller}. The worst case is larger in {safer}.

| template | examples | margin | published | relative | published | at most | worst | published |
|---|--:|--:|--:|--:|--:|--:|--:|--:|
"""


def page(found: Iterable[Again]) -> str:
    """Return the page's text."""
    rows, signs, safer = list[str](), list[int](), 0
    for one in found:
        gain = one.weights.relative - one.published_relative
        signs.append(0 if abs(gain) < 1e-9 else 1 if gain > 0.0 else -1)
        figures = (
            *(one.margin, one.published_margin),
            *(one.weights.relative, one.published_relative, one.weights.bound),
        )
        numbers = " | ".join(f"{figure:.4g}" for figure in figures)
        worst = [worst_case(each) for each in (one.template, one.published)]
        safer += bool(worst[0] and worst[1] and worst[0].share > worst[1].share)
        numbers += "".join(f" | {'?' if w is None else _percent(w.share)}" for w in worst)
        rows.append(f"| {one.name} | {len(one.table.signs)} | {numbers} |")
    counts = {"larger": signs.count(1), "equal": signs.count(0), "smaller": signs.count(-1)}
    counts["safer"] = safer
    return HEAD.format(count=len(rows), **counts) + "\n".join(rows) + "\n"


def _percent(share: float) -> str:
    return f"{math.floor(1e4 * share) / 100.0:.2f} %"


if __name__ == "__main__":
    PAGE.write_text(page(found_again()), encoding="utf-8")
