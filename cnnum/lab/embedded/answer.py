"""Which configuration is the cheapest within bounds, or nearest to them."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf, isfinite

from cnnum.lab.embedded.costs import CostRow


@dataclass(frozen=True, slots=True)
class Bounds:
    """Bounds on a program's cost and loss.

    Attributes
    ----------
    error : float
    ram, flash : float
        Bytes.
    rate : float
        Frames a second that must be reached.
    """

    error: float = inf
    ram: float = inf
    flash: float = inf
    rate: float = 0.0

    @property
    def asked(self) -> bool:
        """Whether anything is bounded."""
        return self != Bounds()

    def excess(self, row: CostRow) -> dict[str, float]:
        """Return by how many times a row exceeds each bound that it does."""
        error = row.error if isfinite(row.error) else (inf if row.error == inf else 0.0)
        shares = {
            "error": error / self.error,
            "RAM": row.ram_bytes / self.ram,
            "flash": row.flash_bytes / self.flash,
            "frame rate": self.rate / row.frames_per_s,
        }
        return {name: share for name, share in shares.items() if share > 1.0}


def answers(rows: Sequence[CostRow], bounds: Bounds) -> list[str]:
    """Return a sentence for each program and shape: its cheapest configuration, or the nearest."""
    found = list[str]()
    for case, shape in dict.fromkeys((row.case, row.shape) for row in rows):
        mine = [row for row in rows if (row.case, row.shape) == (case, shape)]
        within = [row for row in mine if not bounds.excess(row)]
        at = f"{case} on {shape[0]}×{shape[1]}"
        if within:
            best = min(within, key=lambda row: (row.instructions, row.ram_bytes))
            found.append(f"{at}: the cheapest within the bounds is {_words(best)}.")
            continue
        near = min(mine, key=lambda row: max(bounds.excess(row).values()))
        over = ", ".join(f"{name} {share:.3g}×" for name, share in bounds.excess(near).items())
        found.append(
            f"{at}: none is within the bounds; nearest is {_words(near)}, over in {over} the bound."
        )
    return found


def _words(row: CostRow) -> str:
    return (
        f"{row.precision} by {row.method} on {row.core}, with {row.instructions:,} instructions a "
        f"frame, {row.ram_bytes:,} bytes of RAM, {row.flash_bytes:,} of flash, and an error of "
        f"{row.error:.2g} of '{row.output}' (at most {row.frames_per_s:,.0f} frames a second at "
        f"{row.clock_hz / 1e6:g} MHz, if each instruction took a cycle)"
    )


def front(rows: Sequence[CostRow]) -> list[CostRow]:
    """Return the rows of which no other one has both fewer instructions and a smaller error."""
    ordered = sorted(rows, key=lambda row: (row.instructions, row.error))
    kept = list[CostRow]()
    for row in ordered:
        if not kept or row.error < kept[-1].error:
            kept.append(row)
    return kept
