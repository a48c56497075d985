"""Steps of a fixed length until nothing changes, by strips: a launch takes several of them.

Each step keeps, by strip and lane, whether a rate at its start is above the limit of rest. The
first step that saw no such rate may be amid a launch. Then the launch is taken again from its
begin, up to that step's end.
"""

from dataclasses import dataclass, replace

from cnnum import kernels as ir
from cnnum.engines.opencl.large_arrays.strip_kernel import StripText, apart, first_states
from cnnum.engines.opencl.large_arrays.strip_rows import CONTROL, FINDINGS, ONES, At, Rows
from cnnum.engines.opencl.transients.names import CHANGE, RUNNING, SETTLED, STEPS, STILL, TIME
from cnnum.integrators.schemes import FixedSteps
from cnnum.kernels.launch_plan import Strips
from cnnum.templating.reads import lag

BEFORE = "strip_before"
"""The array of the states with which a launch began."""

COUNT, STEPS_BEFORE = range(2)
"""Registers: how many levels a frame takes, and how many steps came before."""

TAKEN, LEVELS, AT, K, ANY = ir.names("taken levels at k changes")
"""Steps and levels of a launch; of its steps the first without a change, and whether any is."""


@dataclass(frozen=True, slots=True)
class Watch:
    """The watch over steps.

    Attributes
    ----------
    rows : Rows
        With places for the kept rates.
    stages : int
        Of a step.
    steps : int
        A launch takes; an even number of levels, so that outputs are where the next begins.
    """

    rows: Rows
    stages: int
    steps: int

    def sees(self, at: At, state: ir.Name) -> list[ir.Statement]:
        """Return statements that watch d of a row, and keep the state with which a launch began.

        A step finds 1 in `change` if any rate is more than none, else 0.
        """
        solver, empty, tau = self.rows.text.solver, self.rows.empty, self.rows.text.template.tau
        # with it, d is the rate times the longest τ
        factor = float(tau.max() / tau[at.layer]) / self.rows.scales[at.layer]
        limit = ir.Number(solver.atol) + ir.Number(solver.rtol) * ir.call("magnitude", state)
        # which is false of NaN
        rests = ir.Number(factor) * ir.call("magnitude", at.sum) <= limit
        rests = rests if empty is None else ir.Binary("|", rests, empty)
        return [
            ir.Branch(ir.Name("number").equals(0), (self.rows.store(BEFORE, at, state),)),
            ir.Assign(CHANGE, ir.Choice(rests, CHANGE, ONES)),
        ]

    def watched(self, own: StripText) -> StripText:
        """Return the text of steps that are watched, and that can be taken again."""
        before = f"x + {self.rows.at(BEFORE)} + ROW(row) + layer * {self.rows.layout.span}"
        shown = f"show_row(outputs_of(x, ahead) + p, {before});"
        return replace(
            own,
            findings=self.steps,
            count=f"min(most, (int){self.rows.register(COUNT)} - done)",
            again=(f"copy_lanes(x + p, {before});", shown, *first_states(self.rows.text)),
        )

    @property
    def before(self) -> str:
        """The expression of the steps before those of a launch."""
        return f"(int){self.rows.register(STEPS_BEFORE)}"

    def body(self, scheme: FixedSteps, strips: Strips) -> list[ir.Statement]:
        """Return the statements that launch the kernel until nothing changes."""
        about = f"at most {scheme.count} steps of {scheme.step:g}, until nothing changes any more"
        solver, (begin, levels, end) = self.rows.text.solver, apart(strips)
        left = ir.Integer(scheme.count) - ir.Cast("int", STEPS)
        rounds = (
            ir.declare(TAKEN, ir.call("min", self.steps, left), of="int"),
            ir.declare(LEVELS, TAKEN * self.stages, of="int"),
            ir.Assign(CONTROL[COUNT], ir.real(LEVELS)),
            ir.Assign(CONTROL[STEPS_BEFORE], STEPS),
            ir.StripSteps(levels, LEVELS),
            *self._find_end(scheme),
            ir.add(STEPS, ir.real(AT)),
            ir.Assign(SETTLED, ir.ONE - ANY),
            ir.Assign(RUNNING, ir.pick(STEPS < ir.real(scheme.count), ANY, ir.ZERO)),
            ir.Assign(LEVELS, AT * self.stages),
            ir.Assign(CONTROL[COUNT], ir.real(LEVELS)),
            ir.Branch(AT < TAKEN, (ir.StripSteps(replace(levels, again=True), LEVELS),)),
        )
        time = ir.call("fmin", STEPS * ir.Number(scheme.step), ir.Number(solver.duration))
        begun = (RUNNING, ir.ONE), *((name, ir.ZERO) for name in (STEPS, SETTLED, STILL))
        return [
            ir.Note(f"// {scheme.name}, by strips: {about}"),
            ir.Declare("real", begun),
            ir.Assign(CONTROL[STEPS_BEFORE], ir.ZERO),
            begin,
            ir.Counted(ir.ROUND, 0, -(-scheme.count // self.steps), RUNNING, rounds),
            end,
            ir.fixed(TIME, time),
        ]

    def _find_end(self, scheme: FixedSteps) -> list[ir.Statement]:
        """Return the search for the first step at whose start nothing changes, the last one.

        With a delay nothing has to change for longer than that.
        """
        each, late = self.rows.finding, lag(self.rows.text.template, scheme.step)
        again = (
            ir.Assign(ANY, ir.ZERO),
            ir.Loop(K, each, (ir.Accumulate(ANY, "fmax", FINDINGS[AT * each + K]),)),
            ir.Assign(AT, ir.Integer(1), "+="),
            ir.Assign(STILL, ir.pick(ANY.equals(ir.ZERO), STILL + ir.ONE, ir.ZERO)),
            ir.Assign(ANY, ir.pick(ir.Number(late + 0.5) <= STILL, ir.ZERO, ir.ONE)),
        )
        return [
            ir.declare(AT, 0, of="int"),
            ir.declare(ANY, ir.ONE),
            ir.While((AT < TAKEN) & ANY.differs(ir.ZERO), again),
        ]


def watch(rows: Rows, stages: int) -> Watch:
    """Declare the watch over steps of a number of stages, and return it."""
    steps = max(1, rows.levels // stages)
    if steps * stages % 2:
        steps += 1 if steps == 1 else -1
    rows.declare_findings(2, steps)
    return Watch(rows, stages, steps)
