"""The page of templates that were designed anew; `python docs/figures/design_table.py` writes it.

A test holds the page to the code.
"""

from collections.abc import Iterable
from pathlib import Path

from cnnum.design.found_again import Again, found_again

PAGE = Path(__file__).parents[1] / "design-library.md"

HEAD = """# Templates found again from their rules

`python docs/figures/design_table.py` writes this page; a test holds it to the code. Each template
below is uncoupled, and its check is a local rule of 3×3 cells. The design sees that rule alone,
never the published weights.

* *examples*: neighbourhoods that the rule distinguishes, cells that never decide left out.
* *margin*: the least drive of a cell towards its colour. The weights that decide are scaled to the
  same sum of sizes.
* *relative margin*: the margin over that sum. A mismatch of all weights below it flips no cell.
* *at most*: a bound that no weights exceed, by the multipliers of the linear program.

{count} templates; the margin is larger than the published one in {larger} of them, equal in {equal}
and smaller in {smaller}.

| template | examples | margin | published | relative margin | published | at most |
|---|--:|--:|--:|--:|--:|--:|
"""


def page(found: Iterable[Again]) -> str:
    """Return the page's text."""
    rows, signs = list[str](), list[int]()
    for one in found:
        gain = one.weights.relative - one.published_relative
        signs.append(0 if abs(gain) < 1e-9 else 1 if gain > 0.0 else -1)
        figures = (
            *(one.margin, one.published_margin),
            *(one.weights.relative, one.published_relative, one.weights.bound),
        )
        numbers = " | ".join(f"{figure:.4g}" for figure in figures)
        rows.append(f"| {one.name} | {len(one.table.signs)} | {numbers} |")
    counts = {"larger": signs.count(1), "equal": signs.count(0), "smaller": signs.count(-1)}
    return HEAD.format(count=len(rows), **counts) + "\n".join(rows) + "\n"


if __name__ == "__main__":
    PAGE.write_text(page(found_again()), encoding="utf-8")
