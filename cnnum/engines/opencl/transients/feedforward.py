"""What drives the cells from outside: w = B∗u + z + bias, once a frame."""

from cnnum.engines.opencl.ir.expressions import ZERO, Expression, Name, Number
from cnnum.engines.opencl.ir.statements import Assign, Statement, add, block, declare, fixed
from cnnum.engines.opencl.large_arrays.lane_rows import lanes_fit
from cnnum.engines.opencl.large_arrays.neighbourhood_sums import (
    Seen,
    line_of,
    rows_near,
    sums_by_rows,
    sweep_sums,
)
from cnnum.engines.opencl.large_arrays.strip_couplings import given, inputs_of, static_sums
from cnnum.engines.opencl.large_arrays.strip_inputs import keep_rows
from cnnum.engines.opencl.large_arrays.strip_rows import At
from cnnum.engines.opencl.text import comment
from cnnum.engines.opencl.transients.builder import NOW, SUM, TransientBuilder
from cnnum.engines.opencl.transients.dependencies import (
    has_history,
    inputs_read,
    pads_inputs,
    reads_inputs,
)
from cnnum.engines.opencl.transients.nonlinear_couplings import nonlinear
from cnnum.templating.network import taps

U, W, LATER = Name("u"), Name("w"), Name("later")
"""Padded inputs, what drives the cells, and what changes in it when a delay is over."""

THEN = Name("then")


def constant_drive(text: TransientBuilder) -> tuple[float, ...] | None:
    """Return z of every layer where nothing else drives the cells."""
    if reads_inputs(text) or text.operands.biases:
        return None
    return tuple(float(z) for z in text.template.z)


def drive_of(text: TransientBuilder, layer: int) -> Expression:
    """Return w in cell `i` of a layer."""
    constant = constant_drive(text)
    return W[text.at(layer)] if constant is None else Number(constant[layer])


def drive(text: TransientBuilder) -> None:
    """Append the statements that compute w, where it is not just z."""
    text.body.append(comment(f"{text.template.name}: w = B * u + z"))
    if constant_drive(text) is not None:
        return
    template = text.template
    text.array(W, text.states)
    seen = [input_seen(text, n) for n in range(template.inputs)]
    before = [input_seen(text, n, before=True) for n in range(template.inputs)]
    both = [*seen, *(before if has_history(text) else [])]
    if pads_inputs(text) and sums_by_rows(text):
        _drive_by_rows(text, both)
        _keep_inputs(text)
        return
    if pads_inputs(text):
        text.array(U, template.inputs * text.padded)
        if has_history(text):
            _history(text)
        _pad(text, text.operands.inputs)
    body: list[Statement] = [declare(SUM)]
    for layer in range(text.layers):
        start: Expression = Number(float(template.z[layer]))
        if text.operands.biases:
            start = start + text.operands.biases[layer]
        body.append(Assign(SUM, start))
        body += _driven(text, layer)
        body += [
            line
            for coupling in template.nonlinear
            if coupling.static and coupling.to == layer
            for line in nonlinear(text, coupling)
        ]
        if template.delayed is not None and template.delayed.B.any():
            body += _delayed(text, layer)
        body.append(Assign(W[text.at(layer)], SUM))
    text.over_grid(body)
    _keep_inputs(text)


def input_seen(text: TransientBuilder, number: int, *, before: bool = False) -> Seen:
    """Return an input, or what it was before the start, as neighbours see it."""
    given = text.operands.previous if before else text.operands.inputs
    name = inputs_before if before else inputs_of
    value = given[number] if number < len(given) else ZERO
    boundary = text.template.input_boundary
    return Seen(name(number), [[Assign(NOW, value)]], boundary, boundary.constant)


def inputs_before(number: int) -> str:
    """Return the name of what an input was before the start, in lanes."""
    return f"{inputs_of(number)}_before"


def _drive_by_rows(text: TransientBuilder, seen: list[Seen]) -> None:
    """Append what computes w, and what changes after a delay, from inputs in lanes."""
    template, layers = text.template, range(text.layers)
    rows = rows_near(text, len(seen), {one.name: place for place, one in enumerate(seen)})
    each, late = [At(layer, 0) for layer in layers], template.delayed
    sums = [[*given(rows, at, template.B, inputs_of), *static_sums(rows, at)] for at in each]
    body: list[Statement] = []
    for layer in layers:
        driven: Expression = line_of(layer) + Number(float(template.z[layer]))
        if text.operands.biases:
            driven = driven + text.operands.biases[layer]
        body.append(Assign(W[text.at(layer)], driven))
    if late is not None:
        name = inputs_before if has_history(text) else inputs_of
        for at, lines in zip(each, sums, strict=True):
            lines += given(rows, at, late.B, name)
    sweep_sums(text, seen, sums, body)
    if late is not None and has_history(text):
        text.array(LATER, text.states)
        changes = [
            [*given(rows, at, late.B, inputs_of), *given(rows, at, -late.B, inputs_before)]
            for at in each
        ]
        changed = [Assign(LATER[text.at(layer)], line_of(layer)) for layer in layers]
        sweep_sums(text, seen, changes, changed)


def _keep_inputs(text: TransientBuilder) -> None:
    """Append what keeps inputs that the cells go on reading, for steps by strips."""
    if lanes_fit(text):
        for number in inputs_read(text):
            keep_rows(text, input_seen(text, number))


def _driven(text: TransientBuilder, layer: int) -> list[Statement]:
    """Return statements that add B * u of a layer to `sum`."""
    found = taps(text.template.B, layer)
    if pads_inputs(text):
        return text.weighted(U, found)
    inputs = text.operands.inputs
    return [add(SUM, Number(tap.weight) * inputs[tap.source]) for tap in found]


def arrive(text: TransientBuilder) -> None:
    """Append the statements that let delayed inputs change: those since the start have arrived."""
    text.over_cells(
        [add(w, change) for w, change in zip(text.each(W), text.each(LATER), strict=True)]
    )


def _pad(text: TransientBuilder, inputs: tuple[Expression, ...]) -> None:
    boundary = text.template.input_boundary
    text.over_grid([Assign(U[text.padded_at(m)], source) for m, source in enumerate(inputs)])
    text.fill_rims(U, text.template.inputs, boundary, boundary.constant)


def _delayed(text: TransientBuilder, layer: int) -> list[Statement]:
    assert text.template.delayed is not None
    found, later = taps(text.template.delayed.B, layer), LATER[text.at(layer)]
    if not has_history(text):
        return text.weighted(U, found)
    # w starts from the inputs before the start; `later` is what changes when the delay is over
    return [
        block(
            declare(NOW, ZERO),
            *text.weighted(U, found, NOW),
            fixed(THEN, later),
            add(SUM, THEN),
            Assign(later, NOW - THEN),
        )
    ]


def _history(text: TransientBuilder) -> None:
    """Append what leaves in `later` what delayed inputs gave before the start."""
    assert text.template.delayed is not None
    text.array(LATER, text.states)
    _pad(text, text.operands.previous)
    body: list[Statement] = [declare(SUM)]
    for layer in range(text.layers):
        found = taps(text.template.delayed.B, layer)
        body += [Assign(SUM, ZERO), *text.weighted(U, found), Assign(LATER[text.at(layer)], SUM)]
    text.over_grid(body)
