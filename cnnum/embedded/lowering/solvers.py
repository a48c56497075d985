"""How transients run in whole numbers: exactly where that is a sum of products, else by steps."""

from dataclasses import replace

from cnnum.arrays import Shape
from cnnum.graph.nodes import Transient
from cnnum.graph.schedule import Schedule
from cnnum.integrators.choice import choose
from cnnum.integrators.exact_ends import SHIFTS, Circulant, Decay, Propagator, Spectral, circulant
from cnnum.integrators.schemes import FixedSteps
from cnnum.integrators.solver import Solver
from cnnum.templating.network import Network

EXPORTED = (Decay, Propagator, Spectral, Circulant, FixedSteps)
METHODS = ("auto", "euler")


def solvers_for(schedule: Schedule, method: str = "auto") -> dict[int, Solver]:
    """Return how each transient runs, by the index of its node.

    Uncoupled cells, and equilibria that are one product, are exact by any method.
    """
    found = dict[int, Solver]()
    for node in schedule.transients:
        operation = node.operation
        assert isinstance(operation, Transient)
        spec = replace(operation.spec, method=method)
        found[node.index] = whole_solver(replace(operation, spec=spec), schedule.shape)
    return found


def whole_solver(transient: Transient, shape: Shape) -> Solver:
    """Return how a transient runs in whole numbers, by the method of its specification."""
    method = transient.spec.method
    exact = _exact(transient, shape)
    steps = method not in ("auto", "propagator") or not isinstance(exact.scheme, EXPORTED)
    uncoupled = isinstance(exact.scheme, Decay)
    settled = exact.settle and isinstance(exact.scheme, Propagator | Spectral | Circulant)
    if uncoupled or settled or not steps:
        return exact
    asked = "euler" if method == "auto" else method
    return choose(replace(transient, spec=replace(transient.spec, method=asked)), shape)


def _exact(transient: Transient, shape: Shape) -> Solver:
    """Return the method that "auto" takes; on a torus the equilibrium as a product of shifts."""
    found = choose(replace(transient, spec=replace(transient.spec, method="auto")), shape)
    if (
        not found.settle
        or transient.has_mask
        or isinstance(found.scheme, Decay | Spectral | Circulant)
    ):
        return found
    around = circulant(Network(transient.template, shape))
    if around is None:
        return found
    return replace(found, method="propagator", reason=SHIFTS, scheme=around)
