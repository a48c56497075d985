"""Transients in whole numbers: one weighted sum, a product, modes, or explicit steps.

Uncoupled cells are a weighted sum of inputs and start, by any method: their answer is exact.
"""

from collections.abc import Sequence

from cnnum.embedded.arithmetic.fixed import Quantity, constant
from cnnum.embedded.lowering.builder import Builder
from cnnum.embedded.lowering.products import around_torus, propagated, rests, through_modes
from cnnum.embedded.lowering.stepping import stepped
from cnnum.embedded.lowering.transient_work import Given, TransientWork
from cnnum.embedded.program import Array
from cnnum.errors import NotSupportedError
from cnnum.graph.nodes import Node, Pick, Transient
from cnnum.integrators.exact_ends.circulant import Circulant
from cnnum.integrators.exact_ends.propagator import Decay, Propagator
from cnnum.integrators.exact_ends.spectral import Spectral
from cnnum.integrators.schemes import MAX_STEPS, FixedSteps
from cnnum.integrators.solver import Solver

FIGURES = ("time", "steps", "settled")
"""Numbers of a run; its error is not followed."""


def lower_transient(
    to: Builder, node: Node, solver: Solver, given: Given, picks: Sequence[Node]
) -> tuple[dict[int, Array], dict[int, Quantity]]:
    """Write a transient; return the arrays and figures that are read of it, by their nodes.

    Raises
    ------
    NotSupportedError
        If the template or the method has no form in whole numbers.
    """
    operation = node.operation
    assert isinstance(operation, Transient)
    read = [(one, one.operation) for one in picks if isinstance(one.operation, Pick)]
    wanted = {one.index: pick.what for one, pick in read if pick.what in FIGURES}
    maps = [one for one in picks if one.index not in wanted]
    work = TransientWork(to, operation.template, node.index, given, maps)
    exact = {"steps": 0.0, "settled": 1.0, "time": solver.duration}
    work.figures = {name: constant(exact[name]) for name in wanted.values()}
    steps = isinstance(solver.scheme, FixedSteps)
    work.watched = "settled" in work.figures and not (solver.settle or steps)
    work.check()
    found = _lowered(work, solver)
    if work.watched:
        work.figures["settled"] = rests(work, solver)
    return found, {index: work.figures[name] for index, name in wanted.items()}


def _lowered(work: TransientWork, solver: Solver) -> dict[int, Array]:
    scheme = solver.scheme
    if isinstance(scheme, Decay):
        return work.uncoupled(scheme.kept)
    if isinstance(scheme, Propagator):
        return propagated(work, scheme)
    if isinstance(scheme, Circulant):
        return around_torus(work, scheme)
    if isinstance(scheme, Spectral):
        return through_modes(work, scheme)
    if isinstance(scheme, FixedSteps) and scheme.count > MAX_STEPS:
        raise NotSupportedError(
            f"Template '{work.template.name}' may take {scheme.count:,} steps, and at most "
            f"{MAX_STEPS:,} are written: give it a duration, or leave out the outputs that need it."
        )
    if isinstance(scheme, FixedSteps):
        return stepped(work, scheme)
    raise NotSupportedError(
        f"Template '{work.template.name}' by {solver.method} is not exported: take "
        "method='euler', or leave out the outputs that need it."
    )
