"""The cost of operations by the way they run: answers without time steps, and loops."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from cnnum.arrays import Shape
from cnnum.graph.cost import node_flops
from cnnum.graph.nodes import Constant, ConstantMap, Loop, Node, Parameter, Pick, Transient
from cnnum.integrators.schemes import FixedSteps
from cnnum.integrators.solver import Linear, Solver

FREE = (Constant, ConstantMap, Parameter, Pick)
"""Operations that only name a value and do not run."""


@dataclass(frozen=True, slots=True)
class Work:
    """The work of nodes for one frame.

    A loop is an operation itself, and so is each in its body. A branch is a loop of one round. The
    test that ends a loop where no carried value changes is not counted as arithmetic.

    Attributes
    ----------
    ops, flops : int
        Operations and arithmetic, every body counted once.
    ops_most, flops_most : int
        With every loop at its limit; the limits of nested loops multiply.
    """

    ops: int
    ops_most: int
    flops: int
    flops_most: int


def work(nodes: Iterable[Node], solvers: Mapping[int, Solver], shape: Shape) -> Work:
    """Return the work of nodes and of the bodies of their loops for one frame."""
    ops = ops_most = flops = flops_most = 0
    for node in nodes:
        if isinstance(node.operation, FREE):
            continue
        own = operation_flops(node, solvers.get(node.index), shape)
        ops, ops_most = ops + 1, ops_most + 1
        flops, flops_most = flops + own, flops_most + own
        if isinstance(node.operation, Loop):
            body = work(node.operation.nodes, solvers, shape)
            ops, ops_most = ops + body.ops, ops_most + node.operation.limit * body.ops_most
            flops += body.flops
            flops_most += node.operation.limit * body.flops_most
    return Work(ops, ops_most, flops, flops_most)


def operation_flops(node: Node, solver: Solver | None, shape: Shape) -> int:
    """Return the arithmetic of an operation a frame; of a loop, without its body.

    Steps that follow the error, and whole pieces of a cell's way, count as one Euler step.
    """
    if not isinstance(node.operation, Transient) or solver is None:
        return node_flops(node, shape)
    scheme, template = solver.scheme, node.operation.template
    if isinstance(scheme, Linear):
        cells = shape[0] * shape[1]
        control = 2 * int(np.count_nonzero(template.B)) * cells
        return control + scheme.flops(template.layers * cells, shape)
    return node_flops(node, shape, scheme.count if isinstance(scheme, FixedSteps) else 1)
