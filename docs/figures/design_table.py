"""The page of templates that were designed anew; `python docs/figures/design_table.py` writes it.

A test holds the page to the code.
"""

import math
from collections import defaultdict
from collections.abc import Iterable
from pathlib import Path

from cnnum.design.found_again import Again, found_again
from cnnum.design.worst_case import worst_case

PAGE = Path(__file__).parents[1] / "design-library.md"

HEAD = """# Library templates redesigned from their rules

How robust are the published weights of a template, and could they be better? `cnnum templates
design` was given the local rules of {count} uncoupled templates, without their weights.

* The *relative margin* is the smallest drive of any cell towards its colour, divided by the sum of
  the absolute weights. That of the redesigned template is proven to be the largest possible; it is
  larger than that of the published one for {larger} templates, equal for {equal} and
  smaller for {smaller}.
* The *worst case* is the largest relative error of all weights at once at which no cell is wrong
  at the end of the run. It is larger for the redesigned template than for the published one in
  {safer} of the {count} templates.

`python docs/figures/design_table.py` writes this page.

| templates | relative margin | of the published | worst case | of the published |
|---|--:|--:|--:|--:|
"""


def page(found: Iterable[Again]) -> str:
    """Return the page's text."""
    alike, signs, safer = defaultdict[str, list[str]](list), list[int](), 0
    for one in found:
        gain = one.weights.relative - one.published_relative
        signs.append(0 if abs(gain) < 1e-9 else 1 if gain > 0.0 else -1)
        worst = [worst_case(each) for each in (one.template, one.published)]
        safer += bool(worst[0] and worst[1] and worst[0].share > worst[1].share)
        numbers = f"{one.weights.relative:.4g} | {one.published_relative:.4g}"
        numbers += "".join(f" | {'?' if w is None else _percent(w.share)}" for w in worst)
        alike[numbers].append(one.name)
    counts = {"larger": signs.count(1), "equal": signs.count(0), "smaller": signs.count(-1)}
    counts |= {"safer": safer, "count": len(signs)}
    rows = [f"| {', '.join(_short(names))} | {numbers} |" for numbers, names in alike.items()]
    return HEAD.format(**counts) + "\n".join(rows) + "\n"


def _short(names: Iterable[str]) -> Iterable[str]:
    """Yield the names, those that differ in their last digit alone as one: "SKELBW1, 3, 5"."""
    ends = defaultdict[str, list[str]](list)
    for name in names:
        stem = name[:-1] if name[-1].isdigit() else name
        ends[stem].append(name.removeprefix(stem))
    for stem, found in ends.items():
        run = len(found) > 2 and int(found[-1]) - int(found[0]) == len(found) - 1
        yield stem + (f"{found[0]} to {found[-1]}" if run else ", ".join(found))


def _percent(share: float) -> str:
    return f"{math.floor(1e4 * share) / 100.0:.2f} %"


if __name__ == "__main__":
    PAGE.write_text(page(found_again()), encoding="utf-8")
