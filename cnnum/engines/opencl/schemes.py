"""The kernel text of each way to bring a transient to its end."""

from cnnum.engines.opencl.drive import constant_drive, drive, drive_of
from cnnum.engines.opencl.fused import fused_euler, fuses
from cnnum.engines.opencl.rates import Instant, declare_outputs, outputs, rates, watch_change
from cnnum.engines.opencl.start import start, start_of
from cnnum.engines.opencl.stepping import adaptive, fixed
from cnnum.engines.opencl.text import rename
from cnnum.engines.opencl.transients import TransientText
from cnnum.integrators.choice import AdaptiveSteps, FixedSteps
from cnnum.integrators.propagator import Decay, Propagator

Figures = dict[str, str]
"""Expressions for the figures of a run: time, steps, settled, error (−1: not known)."""


def run(text: TransientText) -> Figures:
    """Append the text that brings the state `x` to its end and return its figures."""
    drive(text)
    scheme = text.solver.scheme
    if isinstance(scheme, Decay):
        return _decay(text, scheme)
    if isinstance(scheme, Propagator):
        return _propagate(text, scheme)
    start(text)
    declare_outputs(text)
    if isinstance(scheme, FixedSteps):
        return fused_euler(text, scheme) if fuses(text, scheme) else fixed(text, scheme)
    return adaptive(text, scheme)


def settled_now(text: TransientText) -> None:
    """Append the text that finds in `change` whether the state `x` is at equilibrium.

    Delayed outputs are taken as those of now, as they are once nothing changes.
    """
    text.lines.append("real change = ZERO;")
    if not isinstance(text.solver.scheme, FixedSteps | AdaptiveSteps):
        declare_outputs(text)
    outputs(text, [f"x[{text.at(layer)}]" for layer in range(text.layers)])
    instant = Instant(text.number(text.solver.duration), _outputs_now(text))
    rates(text, "x", watch_change(text, "x"), instant)


def _outputs_now(text: TransientText) -> str:
    return rename(text.template.output.opencl, {"x": "x[{at}]"})


def _exact(text: TransientText) -> Figures:
    figures = {"time": text.number(text.solver.duration), "steps": "ZERO", "error": "ZERO"}
    return figures | ({"settled": "ONE"} if text.solver.settle else {})


def _decay(text: TransientText, scheme: Decay) -> Figures:
    text.array("x", text.layers * text.cells)
    body: list[str] = []
    for layer in range(text.layers):
        kept, to, origin = float(scheme.kept[layer]), drive_of(text, layer), start_of(text, layer)
        value = to if kept == 0.0 else f"{to} + {text.number(kept)} * ({origin} - {to})"
        if text.operands.mask is not None:
            value = f"PICK({text.operands.mask} != ZERO, {origin}, {value})"
        body.append(f"x[{text.at(layer)}] = {value};")
    text.over_cells(body)
    return _exact(text)


def _propagate(text: TransientText, scheme: Propagator) -> Figures:
    n = text.layers * text.cells
    text.lines.append(f"// exact after {text.solver.duration:g}: x = E x0 + D w + constant")
    offset = text.tables.data(scheme.constant)
    products: list[str] = []
    if scheme.state.any():
        start(text, "x0")
        at = text.tables.data(scheme.state)
        products.append(f"sum += R(data[{at} + i * {n} + j]) * x0[j];")
    constant = constant_drive(text)
    if constant is None or any(constant):
        if constant is not None:
            text.array("w", n)
            text.over_cells(
                [f"w[{text.at(layer)}] = {text.number(z)};" for layer, z in enumerate(constant)]
            )
        at = text.tables.data(scheme.drive)
        products.append(f"sum += R(data[{at} + i * {n} + j]) * w[j];")
    text.array("x", n)
    text.lines.append(f"for (int i = 0; i < {n}; ++i) {{")
    text.lines.append(f"    real sum = R(data[{offset} + i]);")
    text.lines.append(f"    for (int j = 0; j < {n}; ++j) {{ {' '.join(products)} }}")
    text.lines += ["    x[i] = sum;", "}"]
    return _exact(text)
