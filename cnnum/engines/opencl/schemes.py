"""The kernel text of each way to bring a transient to its end."""

from cnnum.engines.opencl.text import fill, indented
from cnnum.engines.opencl.transients import TransientText
from cnnum.integrators.choice import MAX_STEPS, AdaptiveSteps, FixedSteps
from cnnum.integrators.propagator import Decay, Propagator
from cnnum.integrators.tableau import ButcherTableau, Row

Figures = dict[str, str]
"""Expressions for the figures of a run: time, steps, settled, error (−1: not known)."""


def run(text: TransientText) -> Figures:
    """Append the text that brings the state `x` to its end and return its figures."""
    text.drive()
    scheme = text.solver.scheme
    if isinstance(scheme, Decay):
        return _decay(text, scheme)
    if isinstance(scheme, Propagator):
        return _propagate(text, scheme)
    text.start()
    text.declare_outputs()
    if isinstance(scheme, FixedSteps):
        return _fixed(text, scheme)
    return _adaptive(text, scheme)


def settled_now(text: TransientText) -> None:
    """Append the text that finds in `change` whether the state `x` is at equilibrium."""
    text.lines.append("real change = ZERO;")
    if not isinstance(text.solver.scheme, FixedSteps | AdaptiveSteps):
        text.declare_outputs()
    text.outputs(_states(text, "x"))
    text.rates("x", text.watch_change("x"))


def _exact(text: TransientText) -> Figures:
    figures = {"time": text.number(text.solver.duration), "steps": "ZERO", "error": "ZERO"}
    return figures | ({"settled": "ONE"} if text.solver.settle else {})


def _decay(text: TransientText, scheme: Decay) -> Figures:
    text.array("x", text.layers * text.cells)
    body: list[str] = []
    for layer in range(text.layers):
        kept, drive, start = float(scheme.kept[layer]), text.drive_of(layer), text.start_of(layer)
        value = drive if kept == 0.0 else f"{drive} + {text.number(kept)} * ({start} - {drive})"
        if text.operands.mask is not None:
            value = f"PICK({text.operands.mask} != ZERO, {start}, {value})"
        body.append(f"x[{layer * text.cells} + i] = {value};")
    text.over_cells(body)
    return _exact(text)


def _propagate(text: TransientText, scheme: Propagator) -> Figures:
    n = text.layers * text.cells
    text.lines.append(f"// exact after {text.solver.duration:g}: x = E x0 + D w + constant")
    offset = text.tables.data(scheme.constant)
    products: list[str] = []
    if scheme.state.any():
        text.start("x0")
        at = text.tables.data(scheme.state)
        products.append(f"sum += R(data[{at} + i * {n} + j]) * x0[j];")
    if text.constant_drive != (0.0,) * text.layers:
        if text.constant_drive is not None:
            text.array("w", n)
            text.over_cells(
                [
                    f"w[{layer * text.cells} + i] = {text.number(z)};"
                    for layer, z in enumerate(text.constant_drive)
                ]
            )
        at = text.tables.data(scheme.drive)
        products.append(f"sum += R(data[{at} + i * {n} + j]) * w[j];")
    text.array("x", n)
    text.lines.append(f"for (int i = 0; i < {n}; ++i) {{")
    text.lines.append(f"    real sum = R(data[{offset} + i]);")
    text.lines.append(f"    for (int j = 0; j < {n}; ++j) {{ {' '.join(products)} }}")
    text.lines += ["    x[i] = sum;", "}"]
    return _exact(text)


def _combination(weights: Row, text: TransientText, at: str) -> str:
    terms = [
        f"{text.number(float(weight))} * k{stage}[{at}]"
        for stage, weight in enumerate(weights)
        if weight
    ]
    return " + ".join(terms) or "ZERO"


def _states(text: TransientText, array: str) -> list[str]:
    return [f"{array}[{layer * text.cells} + i]" for layer in range(text.layers)]


def _stage(text: TransientText, tableau: ButcherTableau, stage: int, step: str) -> None:
    """Append one stage: outputs at its state, then its rates in k."""
    if stage == 0:
        text.outputs(_states(text, "x"))
        text.rates("x", ["k0[{at}] = rate;"])
        return
    states = [
        f"x[{layer * text.cells} + i] + {step} * "
        f"({_combination(tableau.a[stage], text, f'{layer * text.cells} + i')})"
        for layer in range(text.layers)
    ]
    text.outputs(states, keep="xs")
    text.rates("xs", [f"k{stage}[{{at}}] = rate;"])


def _declare_stages(text: TransientText, stages: int) -> None:
    for stage in range(stages):
        text.array(f"k{stage}", text.layers * text.cells)
    if stages > 1:
        text.array("xs", text.layers * text.cells)


def _fixed(text: TransientText, scheme: FixedSteps) -> Figures:
    step = text.number(scheme.step)
    if scheme.tableau.stages > 1:
        _declare_stages(text, scheme.tableau.stages)
    with text.aside() as lines:
        if scheme.tableau.stages == 1:
            _euler_step(text, step, scheme.settle)
        else:
            _several_stages(text, scheme.tableau, step, scheme.settle)
    values = {"count": scheme.count, "step": step[2:-1]}
    name = "settling_steps" if scheme.settle else "explicit_steps"
    text.lines += fill(name, step_text=indented(lines, 3), **values).splitlines()
    if scheme.settle:
        return {"time": "time", "steps": "steps", "settled": "settled", "error": "-ONE"}
    return {
        "time": text.number(text.solver.duration),
        "steps": text.number(scheme.count),
        "error": "-ONE",
    }


def _euler_step(text: TransientText, step: str, settle: bool) -> None:
    text.outputs(_states(text, "x"))
    update = f"x[{{at}}] + {'running * ' if settle else ''}{step} * rate"
    then = text.watch_change("x") if settle else []
    if text.template.output.limited:
        update = f"clamp({update}, -ONE, ONE)"
    text.rates("x", [*then, f"x[{{at}}] = {update};"])


def _several_stages(text: TransientText, tableau: ButcherTableau, step: str, settle: bool) -> None:
    for stage in range(tableau.stages):
        _stage(text, tableau, stage, step)
    body: list[str] = []
    for layer in range(text.layers):
        at = f"{layer * text.cells} + i"
        move = f"{'running * ' if settle else ''}{step} * ({_combination(tableau.b, text, at)})"
        update = f"x[{at}] + {move}"
        if settle:
            body.append(f"{{ const real rate = k0[{at}]; ")
            body += [line.replace("{at}", at) for line in text.watch_change("x")] + ["}"]
        if text.template.output.limited:
            update = f"clamp({update}, -ONE, ONE)"
        body.append(f"x[{at}] = {update};")
    text.over_cells(body)


def _adaptive(text: TransientText, scheme: AdaptiveSteps) -> Figures:
    tableau, last = scheme.tableau, scheme.tableau.stages - 1
    _declare_stages(text, tableau.stages)
    with text.aside() as first_rates:
        _stage(text, tableau, 0, "h")
    with text.aside() as stages:
        for stage in range(1, tableau.stages):
            _stage(text, tableau, stage, "h")
    with text.aside() as judge:
        _judge(text, tableau)
    advance = [
        f"for (int i = 0; i < {text.layers * text.cells}; ++i) {{",
        "    x[i] = PICK(accept != ZERO, xs[i], x[i]);",
        f"    k0[i] = PICK(accept != ZERO, k{last}[i], k0[i]);",
        "}",
    ]
    filled = fill(
        "adaptive_steps",
        method=tableau.name,
        first_step=text.number(scheme.first_step)[2:-1],
        duration=text.number(text.solver.duration)[2:-1],
        first_rates=indented(first_rates, 2),
        limit=MAX_STEPS,
        stages=indented(stages, 3),
        judge=indented(judge, 3),
        advance=indented(advance, 3),
        settle=int(scheme.settle),
        almost_one=text.number(1.0 - 1e-6)[2:-1],
        exponent=text.number(-1.0 / tableau.order)[2:-1],
    )
    text.lines += filled.splitlines()
    figures = {"time": "time", "steps": "steps", "error": "error"}
    return figures | ({"settled": "settled"} if scheme.settle else {})


def _judge(text: TransientText, tableau: ButcherTableau) -> None:
    """Append the text that finds the worst error of a step, and the change at its end."""
    last, body = tableau.stages - 1, list[str]()
    tau = text.number(float(text.template.tau.max()))
    for layer in range(text.layers):
        at = f"{layer * text.cells} + i"
        scale = text.scale(f"fmax(fabs(x[{at}]), fabs(xs[{at}]))")
        body += [
            f"{{ const real e = fabs(h * ({_combination(tableau.error, text, at)}));",
            "local_error = fmax(local_error, e);",
            f"worst = fmax(worst, e / {scale});",
            f"change = fmax(change, fabs({tau} * k{last}[{at}]) / {text.scale(f'xs[{at}]')}); }}",
        ]
    text.over_cells(body)
