"""The cost of an operation: arithmetic on cells, counted the same way in plans and benchmarks."""

import numpy as np

from cnnum.arrays import Shape
from cnnum.graph.nodes import Apply, Node, Product, Reduce, Transient
from cnnum.templating.template import Template


def step_flops(template: Template, shape: Shape) -> int:
    """Return the arithmetic of one evaluation of dx/dt plus one Euler update.

    Two a tap (multiply, add) and four a cell: −x, /τ, ·dt, +x. The output function is not counted.
    """
    taps = int(np.count_nonzero(template.A))
    return (2 * taps + 4 * template.layers) * shape[0] * shape[1]


def node_flops(node: Node, shape: Shape, steps: int = 1) -> int:
    """Return the arithmetic of an operation a frame; a transient counts `steps` steps.

    Zero weights cost nothing: they never reach a kernel.
    """
    cells = shape[0] * shape[1]
    if isinstance(node.operation, Transient):
        template = node.operation.template
        feedforward = 2 * int(np.count_nonzero(template.B)) * cells
        return feedforward + steps * step_flops(template, shape)
    if isinstance(node.operation, Product):
        return 2 * cells * cells * len(node.arguments)
    if isinstance(node.operation, Apply):
        return 1 if node.scalar else cells * node.maps
    return cells * node.arguments[0].maps if isinstance(node.operation, Reduce) else 0
