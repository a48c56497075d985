"""Surround inhibition by closed forms: `python -m cnnum.lab.bench.programs.surround`.

How far a bar lowers the reading of another one next to it (Love). How far strain around a point
load rises against the sign of its peak (Boussinesq).
"""

import numpy as np

from cnnum.tactile.halfspace import strain
from cnnum.tactile.indenters import Reads, Rectangle, two_bars

WIDTH, LENGTH, DEPTH = 1.5, 4.0, 0.5
"""Dimensions of the bars and depth of the cover above the taxels, cells."""

GAPS = (1.0, 1.5, 2.0, 3.0)


def lowering(gap: float, reads: Reads) -> float:
    """Return the relative fall of a bar's middle reading due to another bar."""
    bar = two_bars(WIDTH, LENGTH, gap).parts[0]
    assert isinstance(bar, Rectangle)
    x, y = (np.array(place) for place in bar.centre)
    alone = float(bar.normal(x, y, DEPTH, reads))
    return 1.0 - float(two_bars(WIDTH, LENGTH, gap).normal(x, y, DEPTH, reads)) / alone


def hat(depth: float = 1.0) -> float:
    """Return the peak of the normal strain under a point load over its largest opposite."""
    away = np.linspace(0.0, 10.0 * depth, 10001)
    normal = strain(away, 0.0, depth, [0.0, 0.0, 1.0], youngs_modulus=1.5)[..., 2, 2]
    return float(-normal.min() / normal.max())


def main() -> None:
    """Print the table and the ratio."""
    print("| gap, cells | strain, lowered by | stress, raised by |")
    for gap in GAPS:
        print(f"| {gap:.1f} | {lowering(gap, 'strain'):.1%} | {-lowering(gap, 'stress'):.1%} |")
    print(f"point load: 1/{hat():.1f} of the peak")


if __name__ == "__main__":
    main()
