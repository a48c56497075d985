"""The kernel text of what drives the cells from outside: w = B∗u + z + bias, once a frame."""

from cnnum.engines.opencl.couplings import nonlinear
from cnnum.engines.opencl.needs import has_history, inputs_read, pads_inputs, reads_inputs
from cnnum.engines.opencl.row_sums import Seen, rows_near, sums_by_rows, sweep_sums
from cnnum.engines.opencl.strip_couplings import given, inputs_of, static_sums
from cnnum.engines.opencl.strip_inputs import keep_rows
from cnnum.engines.opencl.strip_lanes import lanes_fit
from cnnum.engines.opencl.strip_rows import At
from cnnum.engines.opencl.text import comment
from cnnum.engines.opencl.transients import TransientText
from cnnum.templating.network import taps


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
    text.lines.append(comment(f"{text.template.name}: w = B * u + z"))
    if constant_drive(text) is not None:
        return
    template = text.template
    text.array("w", text.layers * text.cells)
    seen = [input_seen(text, n) for n in range(template.inputs)]
    before = [input_seen(text, n, before=True) for n in range(template.inputs)]
    both = [*seen, *(before if has_history(text) else [])]
    if pads_inputs(text) and sums_by_rows(text):
        _drive_by_rows(text, both)
        _keep_inputs(text)
        return
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
    _keep_inputs(text)


def input_seen(text: TransientText, number: int, *, before: bool = False) -> Seen:
    """Return an input, or what it was before the start, as neighbours see it."""
    given = text.operands.previous if before else text.operands.inputs
    name = inputs_before if before else inputs_of
    value = given[number] if number < len(given) else "ZERO"
    boundary = text.template.input_boundary
    return Seen(name(number), [[f"now = {value};"]], boundary, boundary.constant)


def inputs_before(number: int) -> str:
    """Return the name of what an input was before the start, in lanes."""
    return f"{inputs_of(number)}_before"


def _drive_by_rows(text: TransientText, seen: list[Seen]) -> None:
    """Append the text that computes w, and what changes after a delay, from inputs in lanes."""
    template, layers = text.template, range(text.layers)
    rows = rows_near(text, len(seen), {one.name: place for place, one in enumerate(seen)})
    each, late = [At(layer, 0) for layer in layers], template.delayed
    sums = [[*given(rows, at, template.B, inputs_of), *static_sums(rows, at)] for at in each]
    body = [
        f"w[{text.at(layer)}] = line{layer}[c] + {text.number(float(template.z[layer]))}"
        + (f" + {text.operands.biases[layer]};" if text.operands.biases else ";")
        for layer in layers
    ]
    if late is not None:
        name = inputs_before if has_history(text) else inputs_of
        for at, lines in zip(each, sums, strict=True):
            lines += given(rows, at, late.B, name)
    sweep_sums(text, seen, sums, body)
    if late is not None and has_history(text):
        text.array("later", text.layers * text.cells)
        changes = [
            [*given(rows, at, late.B, inputs_of), *given(rows, at, -late.B, inputs_before)]
            for at in each
        ]
        then = [f"later[{text.at(layer)}] = line{layer}[c];" for layer in layers]
        sweep_sums(text, seen, changes, then)


def _keep_inputs(text: TransientText) -> None:
    """Append the text that keeps inputs that the cells go on reading, for steps by strips."""
    if lanes_fit(text):
        for number in inputs_read(text):
            keep_rows(text, input_seen(text, number))


def _driven(text: TransientText, layer: int) -> list[str]:
    """Return statements that add B * u of a layer to `sum`."""
    found = taps(text.template.B, layer)
    if pads_inputs(text):
        return text.weighted("u", found)
    inputs = text.operands.inputs
    return [f"sum += {text.number(tap.weight)} * {inputs[tap.source]};" for tap in found]


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
