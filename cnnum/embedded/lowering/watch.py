"""Steps one after the other, and whether the last one moved a cell: where it did not, they end."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from cnnum.embedded.arithmetic.fixed import Quantity, constant
from cnnum.embedded.formats import LONGEST
from cnnum.embedded.ir.expressions import Expression, Name, Real, Whole, call
from cnnum.embedded.ir.statements import Fold, Let, Repeat, Rounds, Set, Statement
from cnnum.embedded.lowering.builder import FINE
from cnnum.integrators.schemes import FixedSteps

if TYPE_CHECKING:
    from cnnum.embedded.lowering.transients import TransientWork

STILL = 1e-6
"""A step of reals that moves no cell by more is the last: ten roundings of float32 at 1."""


@dataclass(frozen=True, slots=True)
class Watch:
    """Variables that say how far the last step moved a cell, and how many steps there were.

    Attributes
    ----------
    moved, steps, running : str
    needed : bool
        Whether anything asks for them.
    """

    moved: str
    steps: str
    running: str
    needed: bool

    @classmethod
    def of(cls, work: "TransientWork", scheme: FixedSteps) -> "Watch":
        """Return those of a transient."""
        names = (f"{name}{work.index}" for name in ("moved", "steps", "running"))
        return cls(*names, needed=scheme.settle or "settled" in work.figures)

    def noted(self, new: Expression, old: Expression) -> Fold:
        """Return the statement that takes in by how much a cell moves."""
        return Fold(self.moved, "maximum", call("absolute", call("subtract", new, old)))

    def repeat(self, work: "TransientWork", scheme: FixedSteps, steps: Sequence[Statement]) -> None:
        """Write the steps and the figures of the run."""
        to, count = work.to, constant(float(scheme.count))
        # the difference of two words
        bounds = (0, 1 << LONGEST) if to.integer else None
        moves = call("greater", Name(self.moved, bounds), to.zero() if to.integer else Real(STILL))
        if self.needed:
            to.body.append(Let(self.moved, to.zero(), bounds))
            steps = (Set(self.moved, to.zero()), *steps)
        if scheme.settle:
            count = self._until_still(work, scheme, steps, moves)
            time = to.arithmetic.multiply(count, constant(scheme.step), FINE)
        else:
            to.body.append(Repeat(scheme.count, tuple(steps)))
            time = constant(scheme.step * scheme.count)
        known = {"steps": count, "time": time, "settled": Quantity(call("not", moves))}
        for name in work.figures:
            one = known[name]
            if one.exact is None:
                one = to.let(f"{name}_{work.index}", one)
            work.figures[name] = one

    def _until_still(
        self,
        work: "TransientWork",
        scheme: FixedSteps,
        steps: Sequence[Statement],
        moves: Expression,
    ) -> Quantity:
        many, to = (0, scheme.count), work.to
        more = call("add", Name(self.steps, many), Whole(1))
        counted = Set(self.steps, call("minimum", more, Whole(scheme.count)))
        body = (*steps, counted, Set(self.running, moves))
        to.body += [
            Let(self.steps, Whole(0), many),
            Let(self.running, Whole(1), (0, 1)),
            Rounds(self.running, scheme.count, body),
        ]
        found = Name(self.steps, many)
        return Quantity(found if to.integer else call("to_real", found))
