"""Print the library's templates beside those designed anew from their rules.

`python docs/figures/design_table.py`; a test holds the sentence of the page to `summary`.
"""

from collections.abc import Sequence

from cnnum.design.found_again import Again, found_again
from cnnum.design.worst_case import worst_case


def _worst(pair: Again) -> list[float]:
    """Return the worst case of the design and of the published weights; NaN where there is none."""
    worst = [worst_case(template) for template in (pair.template, pair.published)]
    return [case.share if case else float("nan") for case in worst]


def summary(found: Sequence[Again]) -> dict[str, int]:
    """Return how many designs have a larger, equal or smaller margin, and a larger worst case."""
    gains = [pair.weights.relative - pair.published_relative for pair in found]
    signs = [0 if abs(gain) < 1e-9 else 1 if gain > 0.0 else -1 for gain in gains]
    counts = {name: signs.count(sign) for name, sign in zip(NAMES, (1, 0, -1), strict=True)}
    worst = map(_worst, found)
    return counts | {"safer": sum(own > published for own, published in worst)}


NAMES = ("larger", "equal", "smaller")


if __name__ == "__main__":
    library = list(found_again())
    print("template: relative margin, published; worst case, published")
    for pair in library:
        worst = ", ".join(f"{100.0 * share:.2f} %" for share in _worst(pair))
        margins = f"{pair.weights.relative:.4g}, {pair.published_relative:.4g}"
        print(f"{pair.name}: {margins}; {worst}")
    print(summary(library))
