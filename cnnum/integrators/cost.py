"""What operations cost by the way they run: arithmetic of answers without time steps."""

import numpy as np

from cnnum.arrays import Shape
from cnnum.graph.cost import node_flops
from cnnum.graph.nodes import Node, Transient
from cnnum.integrators.propagator import Decay, Propagator
from cnnum.integrators.schemes import FixedSteps
from cnnum.integrators.solver import Solver
from cnnum.integrators.spectral import Spectral
from cnnum.template import Template


def operation_flops(node: Node, solver: Solver | None, shape: Shape) -> int:
    """Return the arithmetic of an operation a frame.

    Steps that follow the error, and whole pieces of a cell's way, count as one Euler step.
    """
    if not isinstance(node.operation, Transient) or solver is None:
        return node_flops(node, shape)
    scheme, template = solver.scheme, node.operation.template
    if isinstance(scheme, Decay | Propagator | Spectral):
        control = 2 * int(np.count_nonzero(template.B)) * shape[0] * shape[1]
        return control + _exact(scheme, template, shape)
    return node_flops(node, shape, scheme.count if isinstance(scheme, FixedSteps) else 1)


def _exact(scheme: Decay | Propagator | Spectral, template: Template, shape: Shape) -> int:
    """Return the arithmetic from what drives the cells, and where they begin, to their end."""
    n = template.layers * shape[0] * shape[1]
    if isinstance(scheme, Decay):
        return 3 * n
    parts = int(scheme.state.any()) + int(scheme.drive.any())
    if isinstance(scheme, Propagator):
        return 2 * n * n * parts
    # into the modes along both axes, their factors, and the way back
    along = 2 * n * (shape[0] + shape[1])
    return along * (parts + 1) + 2 * n * template.layers * parts
