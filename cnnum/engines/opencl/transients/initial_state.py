"""Where the states start."""

from cnnum.engines.opencl.ir.expressions import Expression, Name, Number
from cnnum.engines.opencl.ir.statements import Assign
from cnnum.engines.opencl.transients.builder import TransientBuilder

X = Name("x")
"""The states."""


def start_of(text: TransientBuilder, layer: int) -> Expression:
    """Return the initial state in cell `i` of a layer."""
    if text.operands.states:
        return text.operands.states[layer]
    initial = text.template.initial
    return text.operands.inputs[layer] if initial == "input" else Number(float(initial))


def start(text: TransientBuilder, name: Name = X) -> None:
    """Append the array of states, set to where they start."""
    text.array(name, text.states)
    text.over_cells(
        [Assign(state, start_of(text, layer)) for layer, state in enumerate(text.each(name))]
    )
