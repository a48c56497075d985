"""The kernel text of what drives the cells from outside: w = B∗u + z + bias, once a frame."""

from cnnum.engines.opencl.couplings import nonlinear
from cnnum.engines.opencl.transients import TransientText
from cnnum.network import taps


def reads_inputs(text: TransientText) -> bool:
    """Return whether anything reads the padded inputs."""
    template = text.template
    return bool(
        template.B.any()
        or (template.delayed is not None and template.delayed.B.any())
        or any("u" in (c.neighbour, c.centre) for c in template.nonlinear)
    )


def pads_inputs(text: TransientText) -> bool:
    """Return whether any cell is driven by what its neighbours are given."""
    template = text.template
    radius = template.B.shape[-1] // 2
    beside = template.B.copy()
    beside[..., radius, radius] = 0.0
    delays = template.delayed is not None and bool(template.delayed.B.any())
    couples = any("u" in (c.neighbour, c.centre) for c in template.nonlinear)
    return bool(beside.any()) or delays or couples


def constant_drive(text: TransientText) -> tuple[float, ...] | None:
    """Return z of every layer where nothing else drives the cells."""
    if reads_inputs(text) or text.operands.biases:
        return None
    return tuple(float(z) for z in text.template.z)


def drive_of(text: TransientText, layer: int) -> str:
    """Return the expression for w in cell `i` of a layer."""
    constant = constant_drive(text)
    return f"w[{text.at(layer)}]" if constant is None else text.number(constant[layer])


def drive(text: TransientText) -> None:
    """Append the text that computes w, where it is not just z."""
    text.lines.append(f"// {text.template.name}: w = B * u + z")
    if constant_drive(text) is not None:
        return
    template = text.template
    text.array("w", text.layers * text.cells)
    if pads_inputs(text):
        text.array("u", template.inputs * text.padded)
        if has_history(text):
            _history(text)
        _pad(text, text.operands.inputs)
    body: list[str] = ["real sum;"]
    for layer in range(text.layers):
        start = text.number(float(template.z[layer]))
        if text.operands.biases:
            start += f" + {text.operands.biases[layer]}"
        body.append(f"sum = {start};")
        body += _driven(text, layer)
        body += [
            line
            for coupling in template.nonlinear
            if coupling.static and coupling.to == layer
            for line in nonlinear(text, coupling)
        ]
        if template.delayed is not None and template.delayed.B.any():
            body += _delayed(text, layer)
        body.append(f"w[{text.at(layer)}] = sum;")
    text.over_grid(body)


def _driven(text: TransientText, layer: int) -> list[str]:
    """Return statements that add B * u of a layer to `sum`."""
    found = taps(text.template.B, layer)
    if pads_inputs(text):
        return text.weighted("u", found)
    inputs = text.operands.inputs
    return [f"sum += {text.number(tap.weight)} * {inputs[tap.source]};" for tap in found]


def has_history(text: TransientText) -> bool:
    """Return whether delayed inputs were others before the start."""
    delayed = text.template.delayed
    return delayed is not None and bool(delayed.B.any()) and bool(text.operands.previous)


def arrive(text: TransientText) -> None:
    """Append the text that lets delayed inputs change: those since the start have arrived."""
    text.over_cells(
        [f"w[{text.at(layer)}] += later[{text.at(layer)}];" for layer in range(text.layers)]
    )


def _pad(text: TransientText, inputs: tuple[str, ...]) -> None:
    boundary = text.template.input_boundary
    text.over_grid([f"u[{m * text.padded} + p] = {source};" for m, source in enumerate(inputs)])
    text.fill_rims("u", text.template.inputs, boundary, boundary.constant)


def _delayed(text: TransientText, layer: int) -> list[str]:
    assert text.template.delayed is not None
    found = taps(text.template.delayed.B, layer)
    if not has_history(text):
        return text.weighted("u", found)
    # w starts from the inputs before the start; `later` is what changes when the delay is over
    return [
        f"{{ real now = ZERO; {' '.join(text.weighted('u', found, 'now'))}",
        f"const real then = later[{text.at(layer)}];",
        f"sum += then; later[{text.at(layer)}] = now - then; }}",
    ]


def _history(text: TransientText) -> None:
    """Append the text that leaves in `later` what delayed inputs gave before the start."""
    assert text.template.delayed is not None
    text.array("later", text.layers * text.cells)
    _pad(text, text.operands.previous)
    body: list[str] = ["real sum;"]
    for layer in range(text.layers):
        found = taps(text.template.delayed.B, layer)
        body += ["sum = ZERO;", *text.weighted("u", found), f"later[{text.at(layer)}] = sum;"]
    text.over_grid(body)
