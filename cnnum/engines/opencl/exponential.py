"""The kernel text of exponential steps: the decay exactly, couplings by their start or slope."""

import numpy as np

from cnnum.arrays import Floats
from cnnum.engines.opencl.rates import Instant, outputs, rates, watch_change
from cnnum.engines.opencl.text import fill, indented
from cnnum.engines.opencl.transients import TransientText
from cnnum.integrators.estimate import LOST
from cnnum.integrators.schemes import ExponentialSteps


def exponential(text: TransientText, scheme: ExponentialSteps) -> dict[str, str]:
    """Append the steps and return the figures of the run."""
    weights = scheme.method.weights(scheme.step, text.template.tau)
    kept, first, second = (_per_layer(text, values) for values in weights)
    tau = _per_layer(text, text.template.tau)
    if scheme.method.order == 2:
        text.array("k0", text.layers * text.cells)
    text.array("xs", text.layers * text.cells)
    with text.aside() as step:
        outputs(text, [f"x[{text.at(layer)}]" for layer in range(text.layers)])
        change = watch_change(text, "x") if scheme.settle else []
        # rate · τ + x is the coupling; where a mask holds, it is x, and so is the step's end
        then = [f"{{ const real coupled = {tau} * rate + x[{{at}}];", *change]
        if scheme.method.order == 2:
            then.append("k0[{at}] = coupled;")
        then.append(f"xs[{{at}}] = {_limited(text, f'{kept} * x[{{at}}] + {first} * coupled')}; }}")
        rates(text, "x", then, Instant())
        if scheme.method.order == 2:
            _correct(text, tau, second)
        moved = "PICK(running != ZERO, xs[i], x[i])" if scheme.settle else "xs[i]"
        n = text.layers * text.cells
        text.lines.append(f"for (int i = 0; i < {n}; ++i) {{ x[i] = {moved}; }}")
    text.lines += fill(
        "settling_steps" if scheme.settle else "explicit_steps",
        method=scheme.method.name,
        count=scheme.count,
        step=f"{scheme.step:g}",
        h=text.number(scheme.step),
        step_text=indented(step, 3),
    ).splitlines()
    error = text.number(LOST)
    if scheme.settle:
        return {"time": "time", "steps": "steps", "settled": "settled", "error": error}
    time = text.number(text.solver.duration)
    return {"time": time, "steps": text.number(scheme.count), "error": error}


def _per_layer(text: TransientText, values: Floats) -> str:
    """Return the expression of a number of the layer at hand."""
    if np.ptp(values) == 0.0:
        return text.number(float(values[0]))
    return f"R(data[{text.tables.data(np.asarray(values, dtype=np.float64))} + {{layer}}])"


def _limited(text: TransientText, value: str) -> str:
    return f"clamp({value}, -ONE, ONE)" if text.template.output.limited else value


def _correct(text: TransientText, tau: str, second: str) -> None:
    """Append the second stage: the slope of the couplings over the step."""
    text.lines.append("{")
    outputs(text, [f"xs[{text.at(layer)}]" for layer in range(text.layers)])
    moved = f"xs[{{at}}] + {second} * ({tau} * rate + xs[{{at}}] - k0[{{at}}])"
    rates(text, "xs", [f"xs[{{at}}] = {_limited(text, moved)};"], Instant())
    text.lines.append("}")
