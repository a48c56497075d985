"""From a program's graph to a plan, and the graph of a run: one transient and its maps."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import Any

from cnnum.arrays import Shape
from cnnum.embedded.formats import is_integer
from cnnum.embedded.lowering.solvers import whole_solver
from cnnum.engines.backend import Backend
from cnnum.engines.registry import first_that, open_record
from cnnum.graph.nodes import FIGURES, Graph, RunSpec, Transient
from cnnum.graph.schedule import schedule
from cnnum.integrators.affine import fuse
from cnnum.integrators.choice import choose
from cnnum.integrators.rosenbrock import ImplicitSteps
from cnnum.integrators.solver import Solver
from cnnum.plan import Plan
from cnnum.programs.fields import Field
from cnnum.programs.machine import FrameFields
from cnnum.programs.transients import Applied, transient
from cnnum.safety.memory import refuse_on_host
from cnnum.templating.template import Template

NOTHING: Mapping[str, Any] = MappingProxyType({})


def plan_of(
    name: str,
    graph: Graph,
    channels: Sequence[str],
    needs: Sequence[str] | None,
    engine: Backend,
    *,
    backend: Backend | None = None,
    asked: Mapping[str, Any] = NOTHING,
) -> Plan:
    """Return the plan of a graph.

    Parameters
    ----------
    name : str
        Name of the program.
    graph : Graph
    channels : sequence of str
        Channels of a frame, in the order of its last axis.
    needs : sequence of str or None
        Names of wanted outputs; None for all.
    engine : Backend
        That the plan is called after.
    backend : Backend, optional
        That builds and runs it, where that is another: a chip, or whole numbers with ranges.
    asked : mapping of str to any
        Fields of every transient's `RunSpec` that hold in place of its own.
    """
    whole = is_integer(engine.precision)
    wanted = schedule(graph, channels, needs)
    maps = len(wanted.channels_read) + sum(not n.scalar for n in wanted.outputs.values())
    refuse_on_host("A frame and its results", graph.shape, 8 * maps)
    backend = backend or engine

    def chosen_for(transient: Transient) -> Solver:
        own = replace(transient, spec=replace(transient.spec, **asked))
        return (whole_solver if whole else choose)(own, graph.shape)

    chosen = {
        operation: backend.explained(operation.template, chosen_for(operation))
        for operation in {node.operation for node in wanted.transients}
        if isinstance(operation, Transient)
    }
    solvers = {
        node.index: chosen[node.operation]
        for node in wanted.transients
        if isinstance(node.operation, Transient)
    }
    record = backend.record
    implicit = any(isinstance(solver.scheme, ImplicitSteps) for solver in solvers.values())
    if implicit and not record.implicit:
        engine = backend = open_record(first_that(lambda one: one.implicit), None, None)
        record = engine.record
    built = fuse(wanted, solvers) if record.fuses and not whole else wanted
    record.refuse_beyond(built, solvers)
    about = (name, engine.record.name, engine.device, engine.precision)
    return Plan(*about, wanted, built, solvers, backend.build(built, solvers), backend)


def graph_of(template: Template, shape: Shape, names: Sequence[str], spec: RunSpec) -> Graph:
    """Return the graph of a run.

    Parameters
    ----------
    template : Template
    shape : (rows, cols)
    names : sequence of str
        Names of its maps: a role, and a number.
    spec : RunSpec

    Returns
    -------
    Graph
        With the outputs "output N" and "state N" of every layer, and the figures of the run.
    """
    graph = Graph(shape)
    applied = _applied(FrameFields(graph, names), template, spec)
    for layer in range(template.layers):
        graph.outputs[f"output {layer}"] = applied.outputs[layer].node
        graph.outputs[f"state {layer}"] = applied.states[layer].node
    for figure in FIGURES:
        graph.outputs[figure] = getattr(applied, figure).node
    return graph


def output_names(template: Template) -> list[str]:
    """Return the names of the outputs of all layers."""
    return [f"output {layer}" for layer in range(template.layers)]


def _applied(frame: FrameFields, template: Template, spec: RunSpec) -> Applied:
    def role(name: str) -> list[Field] | None:
        return [frame.channel(c) for c in frame.channels if c.startswith(name)] or None

    mask = role("mask")
    return transient(
        template,
        input=role("input"),
        previous=role("previous"),
        state=role("state"),
        bias=role("bias"),
        mask=mask[0] > 0.5 if mask else None,
        weights=role("weights") or (),
        spec=spec,
    )
