"""The kernel text of where the states start."""

from cnnum.engines.opencl.transients import TransientText


def start_of(text: TransientText, layer: int) -> str:
    """Return the expression for the initial state in cell `i` of a layer."""
    if text.operands.states:
        return text.operands.states[layer]
    initial = text.template.initial
    return text.operands.inputs[layer] if initial == "input" else text.number(float(initial))


def start(text: TransientText, name: str = "x") -> None:
    """Append the array of states, set to where they start."""
    text.array(name, text.layers * text.cells)
    text.over_cells(
        [f"{name}[{text.at(layer)}] = {start_of(text, layer)};" for layer in range(text.layers)]
    )
