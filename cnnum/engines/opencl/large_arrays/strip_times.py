"""When the levels of large arrays' steps are, and their reads of earlier ones.

Couplings may vary in time. Delayed ones read the outputs with which the step a delay ago began:
a ring of arrays keeps those of all steps since, and delayed inputs change when the delay is over.
"""

import math
from dataclasses import dataclass

from cnnum import kernels as ir
from cnnum.engines.opencl.large_arrays.strip_couplings import NEXT, PART, PAST
from cnnum.engines.opencl.large_arrays.strip_rows import LATER, OUTPUTS, Rows
from cnnum.engines.opencl.transients import names
from cnnum.engines.opencl.transients.builder import TransientBuilder
from cnnum.engines.opencl.transients.nonlinear_couplings import gains
from cnnum.integrators.schemes import FixedSteps
from cnnum.templating.reads import delays_outputs, lag

RING = "strip_ring"
"""The outputs with which the last steps began."""


def gain_lines(
    text: TransientBuilder, since: str, within: tuple[str, str] | None = None
) -> list[str]:
    """Return the text that finds the varying factors, at a time since the start."""
    at = ir.Constant(since)  # no gain jumps
    step = None if within is None else (ir.Constant(within[0]), ir.Constant(within[1]))
    return text.tables.printer.lines(gains(text, at, at, step))


def uneven(scheme: FixedSteps) -> bool:
    """Return whether the last step is shorter."""
    return not math.isclose(scheme.step, scheme.last, rel_tol=1e-9)


@dataclass(frozen=True, slots=True)
class Moments:
    """When levels of fixed steps are.

    Attributes
    ----------
    rows : Rows
    scheme : FixedSteps
    stages : int
        Of a step: as many levels.
    before : str
        The steps before those that a launch counts, as an expression.
    """

    rows: Rows
    scheme: FixedSteps
    stages: int
    before: str = "0"

    @property
    def lag(self) -> int:
        """The delay in steps; 0 where there is none."""
        return lag(self.rows.text.template, self.scheme.step)

    @property
    def keeps(self) -> bool:
        """Whether outputs of earlier steps are kept."""
        return delays_outputs(self.rows.text.template)

    def head(self, stage: int) -> list[str]:
        """Return the statements on a stage's moment, before it takes its rows."""
        lines, literal = list[str](), self.rows.text.literal
        at, step = literal(self._place(stage)), literal(self.scheme.step)
        length = step
        if uneven(self.scheme):
            share = literal(self.scheme.last / self.scheme.step)
            last = f"steps == {self.scheme.count - 1} ? {share} : ONE"
            at += f" * ({last})"
            length += f" * ({last})"
            lines.append(f"const vec {PART.text} = (vec)({last});")
        # with a delay a step may hold bends of a gain, which counts by its mean
        delays = self.rows.text.template.delayed is not None
        within = (f"{step} * R(steps)", length) if delays else None
        lines += gain_lines(self.rows.text, f"{step} * (R(steps) + {at})", within)
        if self.keeps:
            # the outputs of a step's end are those that the next begins with
            late = int(self._place(stage) == 1.0 and not uneven(self.scheme))
            lines.append(self._outputs(PAST.text, late))
            if self.between(stage):
                lines.append(self._outputs(NEXT.text, 1))
        steps = f"const int steps = number / {self.stages} + {self.before};"
        return [steps, *lines] if lines else []

    def between(self, stage: int) -> bool:
        """Return whether the delayed time lies between the outputs of two steps."""
        return self.keeps and uneven(self.scheme) and self._place(stage) != 0.0

    def _place(self, stage: int) -> float:
        """Return when a stage is, in steps since its step's begin."""
        return float(sum(self.scheme.tableau.a[stage]))

    def _outputs(self, name: str, late: int) -> str:
        level = f"max(steps + {late} - {self.lag}, 0) * {self.stages}"
        return f"__global const scalar *const {name} = outputs_of(x, {level});"

    def keep_outputs(self, again: int) -> str:
        """Declare the ring that keeps outputs of earlier steps, and return the place of a `level`.

        Of these steps, `again` may be taken again.
        """
        turns = self.rows.by_turns(OUTPUTS)
        if not self.keeps:
            return turns
        # a level writes while one before it, a few rows ahead, reads outputs a delay old
        slots, size = self.lag + 2 + again, self.rows.layout.size
        self.rows.declare(RING, slots * size)
        ring = f"x + {self.rows.at(RING)} + (size_t)(level / {self.stages} % {slots}) * {size}"
        return ring if self.stages == 1 else f"level % {self.stages} ? {turns} : {ring}"

    @property
    def ahead(self) -> str:
        """The expression of the levels before those that a launch counts."""
        return f"{self.before} * {self.stages}"

    @property
    def driven(self) -> str:
        """The expression of the cells' drive at the level `number`."""
        if not self.rows.text.has_history:
            return "w"
        later = f"x + {self.rows.at(LATER)}"
        return f"number + {self.ahead} < {self.lag * self.stages} ? w : {later}"

    def later(self) -> list[str]:
        """Set the drive once a delay is over, and return the text that brings a row of it."""
        rows, text = self.rows, self.rows.text
        if not text.has_history:
            return []
        both = zip(text.each(names.LATER), text.each(names.W), strict=True)
        text.over_cells([ir.add(later, w) for later, w in both])
        return [rows.brought(LATER, names.LATER.text, rows.of_layer(rows.scales))]
