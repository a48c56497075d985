"""The drive of the cells from outside: w = B∗u + z + bias, once a frame."""

from cnnum import kernels as ir
from cnnum.engines.opencl.large_arrays.lane_rows import keep_rows, lanes_fit
from cnnum.engines.opencl.text import comment
from cnnum.engines.opencl.transients.builder import TransientBuilder
from cnnum.engines.opencl.transients.names import LATER, NOW, SUM, U, W
from cnnum.engines.opencl.transients.nonlinear_couplings import nonlinear
from cnnum.templating.network import taps
from cnnum.templating.reads import delays_inputs, moving_inputs, reads_inputs, reads_inputs_around

THEN = ir.Name("then")


def constant_drive(text: TransientBuilder) -> tuple[float, ...] | None:
    """Return z of every layer where nothing else drives the cells."""
    if reads_inputs(text.template) or text.operands.biases:
        return None
    return tuple(float(z) for z in text.template.z)


def drive_of(text: TransientBuilder, layer: int) -> ir.Expression:
    """Return w in cell `i` of a layer."""
    constant = constant_drive(text)
    return W[text.at(layer)] if constant is None else ir.Number(constant[layer])


def drive(text: TransientBuilder) -> None:
    """Append the statements that compute w, where it is not just z."""
    text.body.append(comment(f"{text.template.name}: w = B * u + z"))
    if constant_drive(text) is not None:
        return
    template = text.template
    text.array(W, text.states)
    if reads_inputs_around(text.template):
        text.array(U, template.inputs * text.padded)
        if text.has_history:
            _history(text)
        _pad(text, text.operands.inputs)
    body: list[ir.Statement] = [ir.declare(SUM)]
    for layer in range(text.layers):
        start: ir.Expression = ir.Number(float(template.z[layer]))
        if text.operands.biases:
            start = start + text.operands.biases[layer]
        body.append(ir.Assign(SUM, start))
        body += _driven(text, layer)
        body += nonlinear(text, layer, static=True)
        if delays_inputs(template):
            body += _delayed(text, layer)
        body.append(ir.Assign(W[text.at(layer)], SUM))
    text.over_grid(body)
    if lanes_fit(text):  # steps by strips go on reading them
        for number in moving_inputs(text.template):
            keep_rows(text, number)


def _driven(text: TransientBuilder, layer: int) -> list[ir.Statement]:
    """Return statements that add B * u of a layer to `sum`."""
    found = taps(text.template.B, layer)
    if reads_inputs_around(text.template):
        return text.weighted(U, found)
    inputs = text.operands.inputs
    return [ir.add(SUM, ir.Number(tap.weight) * inputs[tap.source]) for tap in found]


def arrive(text: TransientBuilder) -> None:
    """Append the statements that let delayed inputs change: those since the start have arrived."""
    text.over_cells(
        [ir.add(w, change) for w, change in zip(text.each(W), text.each(LATER), strict=True)]
    )


def _pad(text: TransientBuilder, inputs: tuple[ir.Expression, ...]) -> None:
    boundary = text.template.input_boundary
    text.over_grid([ir.Assign(U[text.padded_at(m)], source) for m, source in enumerate(inputs)])
    text.fill_rims(U, text.template.inputs, boundary, boundary.constant)


def _delayed(text: TransientBuilder, layer: int) -> list[ir.Statement]:
    assert text.template.delayed is not None
    found, later = taps(text.template.delayed.B, layer), LATER[text.at(layer)]
    if not text.has_history:
        return text.weighted(U, found)
    # w starts from the inputs before the start; `later` is its change when the delay is over
    return [
        ir.block(
            ir.declare(NOW, ir.ZERO),
            *text.weighted(U, found, NOW),
            ir.fixed(THEN, later),
            ir.add(SUM, THEN),
            ir.Assign(later, NOW - THEN),
        )
    ]


def _history(text: TransientBuilder) -> None:
    """Append statements that leave in `later` the part of delayed inputs before the start."""
    assert text.template.delayed is not None
    text.array(LATER, text.states)
    _pad(text, text.operands.previous)
    body: list[ir.Statement] = [ir.declare(SUM)]
    for layer, later in enumerate(text.each(LATER)):
        found = text.weighted(U, taps(text.template.delayed.B, layer))
        body += [ir.Assign(SUM, ir.ZERO), *found, ir.Assign(later, SUM)]
    text.over_grid(body)
