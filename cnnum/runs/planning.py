"""Plans from program graphs, and their operations by source line."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any

from cnnum.arrays import Shape
from cnnum.embedded.formats import is_integer
from cnnum.embedded.lowering.builder import whole_solver
from cnnum.engines.backend import Backend
from cnnum.engines.registry import first_that, open_record
from cnnum.graph.nodes import FIGURES, Graph, Loop, Node, RunSpec, Transient
from cnnum.graph.schedule import Schedule, everything, schedule
from cnnum.integrators.affine import fuse
from cnnum.integrators.choice import choose, in_one_sum, only_output_matters
from cnnum.integrators.cost import FREE, work
from cnnum.integrators.rosenbrock import ImplicitSteps
from cnnum.integrators.solver import Solver
from cnnum.plan import Plan
from cnnum.programs.fields import Field
from cnnum.programs.machine import FrameFields
from cnnum.programs.transients import Applied, added
from cnnum.safety.values import refuse_on_host
from cnnum.templating.template import Template

BYTES = 8
"""Bytes per number: results count as float64 in engines of either precision."""


@dataclass(frozen=True, slots=True)
class OpGroup:
    """Operations that one source line of a program requested.

    Attributes
    ----------
    program : str
        The function, and its module.
    line : int
        Line of the module; 0 where none is known, or for all lines of a function.
    count : int
        Operations, bodies of loops counted once.
    flops : int
        Arithmetic operations per frame, bodies of loops counted once.
    bytes : int
        Results, as float64.
    live_bytes : int
        Peak memory of live results, of all lines together, while these run.
    """

    program: str
    line: int
    count: int
    flops: int
    bytes: int
    live_bytes: int


def op_groups(schedule: Schedule, solvers: dict[int, Solver]) -> tuple[OpGroup, ...]:
    """Return the operations by line, in the order in which the lines first run."""
    live = _live_bytes(schedule)
    result: dict[tuple[str, int], OpGroup] = {}
    for node in schedule.nodes:
        if isinstance(node.operation, FREE):
            continue
        done = work([node], solvers, schedule.shape)
        key = _place(node)
        group = result.get(key, OpGroup(*key, 0, 0, 0, 0))
        result[key] = replace(
            group,
            count=group.count + done.ops,
            flops=group.flops + done.flops,
            bytes=group.bytes + _size(node, schedule),
            live_bytes=max(group.live_bytes, live[node.index]),
        )
    return tuple(result.values())


def by_function(groups: Sequence[OpGroup]) -> tuple[OpGroup, ...]:
    """Return one group per function, the costliest first."""
    result: dict[str, OpGroup] = {}
    for group in groups:
        known = result.get(group.program, OpGroup(group.program, 0, 0, 0, 0, 0))
        result[group.program] = OpGroup(
            group.program,
            0,
            known.count + group.count,
            known.flops + group.flops,
            known.bytes + group.bytes,
            max(known.live_bytes, group.live_bytes),
        )
    return tuple(sorted(result.values(), key=lambda group: -group.flops))


def _place(node: Node) -> tuple[str, int]:
    program, colon, line = node.origin.rpartition(":")
    return (program, int(line)) if colon else (node.origin or "the program itself", 0)


def _size(node: Node, schedule: Schedule) -> int:
    if isinstance(node.operation, Transient | Loop):
        return 0  # other operations pick its results
    return BYTES * (1 if node.scalar else schedule.cells * node.maps)


def _live_bytes(schedule: Schedule) -> dict[int, int]:
    """Return the bytes of live results while each operation runs."""
    last = {node.index: place for place, node in enumerate(schedule.nodes)}
    for place, node in enumerate(schedule.nodes):
        last |= {argument.index: place for argument in node.arguments}
    kept = (*schedule.outputs.values(), *(held.store for held in schedule.memories.values()))
    last |= {node.index: len(schedule.nodes) for node in kept}
    ends: dict[int, list[Node]] = {}
    for node in schedule.nodes:
        ends.setdefault(last[node.index], []).append(node)
    live, result = 0, dict[int, int]()
    for place, node in enumerate(schedule.nodes):
        live += _size(node, schedule)
        result[node.index] = live
        live -= sum(_size(gone, schedule) for gone in ends.get(place, []))
    return result


NOTHING: Mapping[str, Any] = MappingProxyType({})


def plan_of(
    name: str,
    graph: Graph,
    channels: Sequence[str],
    needs: Sequence[str] | None,
    engine: Backend,
    *,
    backend: Backend | None = None,
    overrides: Mapping[str, Any] = NOTHING,
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
        Names of the requested outputs; None for all.
    engine : Backend
        Engine that the plan is named after.
    backend : Backend, optional
        Backend that builds and runs it, if different: a chip, or fixed point with ranges.
    overrides : mapping of str to any
        Fields that override those of every transient's `RunSpec`.
    """
    whole = is_integer(engine.precision)
    wanted = schedule(graph, channels, needs)
    maps = len(wanted.channels_read) + sum(not n.scalar for n in wanted.outputs.values())
    refuse_on_host("A frame and its results", graph.shape, 8 * maps)
    backend = backend or engine

    every_node, record = tuple(everything(wanted.nodes)), backend.record
    chosen, solvers = dict[tuple[Transient, bool], Solver](), dict[int, Solver]()
    for node in wanted.transients:
        operation = node.operation
        assert isinstance(operation, Transient)
        # what others are held against keeps the states; whole numbers are those of the exported C
        ends = (whole or record.takes_steps) and only_output_matters(node, every_node)
        if (operation, ends) not in chosen:
            own = replace(operation, spec=replace(operation.spec, **overrides))
            if whole:
                solver = whole_solver(own, graph.shape, ends=ends)
            else:
                solver = choose(own, graph.shape)
            explained = backend.explained(operation.template, solver)
            chosen[operation, ends] = in_one_sum(explained) if ends else explained
        solvers[node.index] = chosen[operation, ends]
    implicit = any(isinstance(solver.scheme, ImplicitSteps) for solver in solvers.values())
    if implicit and not record.implicit:
        engine = backend = open_record(first_that(lambda candidate: candidate.implicit), None, None)
        record = engine.record
    built = fuse(wanted, solvers) if record.fuses and not whole else wanted
    record.refuse_beyond(built, solvers)
    labels = (name, engine.record.name, engine.device, engine.precision)
    return Plan(*labels, wanted, built, solvers, backend.build(built, solvers), backend)


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


def _applied(frame: FrameFields, template: Template, spec: RunSpec) -> Applied:
    def role(name: str) -> list[Field] | None:
        return [frame.channel(c) for c in frame.channels if c.startswith(name)] or None

    mask = role("mask")
    return added(
        template,
        input=role("input"),
        previous=role("previous"),
        state=role("state"),
        bias=role("bias"),
        mask=mask[0] > 0.0 if mask else None,
        weights=role("weights") or (),
        spec=spec,
    )
