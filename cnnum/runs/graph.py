"""The graph of a run: one transient, whose maps are the channels of a frame."""

from collections.abc import Sequence

from cnnum.arrays import Shape
from cnnum.graph.nodes import Graph, RunSpec
from cnnum.programs.fields import Field
from cnnum.programs.machine import FrameFields
from cnnum.programs.transients import Applied, transient
from cnnum.templating.template import Template


def graph_of(template: Template, shape: Shape, names: Sequence[str], spec: RunSpec) -> Graph:
    """Return the graph of a run.

    Parameters
    ----------
    template : Template
    shape : (rows, cols)
    names : sequence of str
        Of its maps: a role, and a number.
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
    for figure in ("time", "steps", "settled", "error"):
        graph.outputs[figure] = getattr(applied, figure).node
    return graph


def output_names(template: Template) -> list[str]:
    """Return the names of the outputs of all layers."""
    return [f"output {layer}" for layer in range(template.layers)]


def _applied(frame: FrameFields, template: Template, spec: RunSpec) -> Applied:
    def role(name: str) -> list[Field] | None:
        return [frame.channel(c) for c in frame.channels if c.startswith(name)] or None

    mask, weights = role("mask"), role("weights")
    return transient(
        template,
        input=role("input"),
        previous=role("previous"),
        state=role("state"),
        bias=role("bias"),
        mask=mask[0] > 0.5 if mask else None,
        weights=weights[0] if weights else None,
        spec=spec,
    )
