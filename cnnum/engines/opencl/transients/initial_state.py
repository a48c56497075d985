"""Where the states start."""

from cnnum import kernels as ir
from cnnum.engines.opencl.transients.builder import TransientBuilder

X = ir.Name("x")
"""The states."""


def start_of(text: TransientBuilder, layer: int) -> ir.Expression:
    """Return the initial state in cell `i` of a layer."""
    if text.operands.states:
        return text.operands.states[layer]
    initial = text.template.initial
    return text.operands.inputs[layer] if initial == "input" else ir.Number(float(initial))


def start(text: TransientBuilder, name: ir.Name = X) -> None:
    """Append the array of states, set to where they start."""
    text.array(name, text.states)
    text.over_cells(
        [ir.Assign(state, start_of(text, layer)) for layer, state in enumerate(text.each(name))]
    )
