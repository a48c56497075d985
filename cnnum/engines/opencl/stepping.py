"""The kernel text of time steps: explicit Runge–Kutta methods, fixed and adaptive."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from cnnum.engines.opencl.drive import arrive
from cnnum.engines.opencl.needs import delays_outputs, has_history
from cnnum.engines.opencl.rates import Instant, outputs, rates, rates_once, watch_change
from cnnum.engines.opencl.text import fill, indented
from cnnum.engines.opencl.transients import TransientText
from cnnum.integrators.choice import MAX_STEPS, AdaptiveSteps, FixedSteps
from cnnum.integrators.estimate import LOST, ROUNDINGS, SAFETY, SMALLEST_RATE, error_growth
from cnnum.integrators.tableau import Pair, Row

LARGEST_EXPONENT = 80.0
"""e to this is a number of single precision."""


def _combination(weights: Row, text: TransientText, at: str) -> str:
    terms = [
        f"{text.number(float(weight))} * k{stage}[{at}]"
        for stage, weight in enumerate(weights)
        if weight
    ]
    return " + ".join(terms) or "ZERO"


def _states(text: TransientText, array: str) -> list[str]:
    return [f"{array}[{text.at(layer)}]" for layer in range(text.layers)]


def _stage(text: TransientText, tableaux: tuple[Pair, ...], stage: int, instant: Instant) -> None:
    """Append one stage of step `h`: outputs at its state, then its rates in k."""
    if stage == 0:
        outputs(text, _states(text, "x"))
        _remember(text)
        rates(text, "x", ["k0[{at}] = rate;"], instant)
        return
    states = [
        f"x[{text.at(layer)}] + h * ({_combination(one.a[stage], text, text.at(layer))})"
        for layer, one in enumerate(tableaux)
    ]
    outputs(text, states, keep="xs")
    rates(text, "xs", [f"k{stage}[{{at}}] = rate;"], instant)


def _declare_stages(text: TransientText, stages: int) -> None:
    for stage in range(stages):
        text.array(f"k{stage}", text.layers * text.cells)
    if stages > 1:
        text.array("xs", text.layers * text.cells)


# delays: a ring of the outputs of the last steps


def _lag(text: TransientText, step: float) -> int:
    """Return the delay in steps."""
    return round(text.template.delayed.delay / step) if text.template.delayed else 0


def _remember(text: TransientText) -> None:
    """Append the text that keeps this step's outputs in the ring."""
    if delays_outputs(text):
        n = text.layers * text.cells
        text.over_grid(
            [
                f"ring[now_at * {n} + {text.at(layer)}] = y[{layer * text.padded} + p];"
                for layer in range(text.layers)
            ]
        )


def _past(text: TransientText, c: float) -> str:
    """Return the outputs a delay ago, at the start or the end of a step."""
    if not delays_outputs(text):
        return ""
    n = text.layers * text.cells
    first = f"ring[then_at * {n} + {{at}}]"
    if c == 0.0:
        return first
    return f"{first} + part * (ring[next_at * {n} + {{at}}] - {first})"


def _ring(text: TransientText, scheme: FixedSteps) -> list[str]:
    """Return the text at the head of a step that finds the ring's places."""
    lag = _lag(text, scheme.step)
    lines: list[str] = []
    if delays_outputs(text):
        size = lag + 1
        lines = [
            f"const int now_at = n % {size};",
            f"const int then_at = max(n - {lag}, 0) % {size};",
            f"const int next_at = max(n + 1 - {lag}, 0) % {size};",
            f"const real part = {_last(text, scheme, 1.0, scheme.last / scheme.step)};",
        ]
    if has_history(text):
        with text.aside() as change:
            arrive(text)
        lines += [f"if (n == {lag}) {{", *change, "}"]
    return lines


def _last(text: TransientText, scheme: FixedSteps, usual: float, last: float) -> str:
    """Return a number that is another one in the last step."""
    if math.isclose(usual, last, rel_tol=1e-9):
        return text.number(usual)
    return f"(n == {scheme.count - 1} ? {text.number(last)} : {text.number(usual)})"


def _instant(text: TransientText, step: float, c: float) -> Instant:
    time = f"{text.number(step)} * R(n) + {text.number(c)} * h" if text.template.gains else "ZERO"
    return Instant(time, _past(text, c))


def fixed(text: TransientText, scheme: FixedSteps) -> dict[str, str]:
    """Append steps of a fixed length and return the figures of the run."""
    if scheme.tableau.stages > 1:
        _declare_stages(text, scheme.tableau.stages)
    if delays_outputs(text):
        text.array("ring", (_lag(text, scheme.step) + 1) * text.layers * text.cells)
    head = _ring(text, scheme)
    with text.aside() as lines:
        if scheme.tableau.stages == 1:
            _euler_step(text, scheme)
        else:
            _several_stages(text, scheme)
    text.lines += fill(
        "settling_steps" if scheme.settle else "explicit_steps",
        method=scheme.tableau.name,
        count=scheme.count,
        step=f"{scheme.step:g}",
        h=_last(text, scheme, scheme.step, scheme.last),
        step_text=indented([*head, *lines], 3),
    ).splitlines()
    error = text.number(LOST)
    if scheme.settle:
        return {"time": "time", "steps": "steps", "settled": "settled", "error": error}
    time = text.number(text.solver.duration)
    return {"time": time, "steps": text.number(scheme.count), "error": error}


def _euler_step(text: TransientText, scheme: FixedSteps) -> None:
    outputs(text, _states(text, "x"))
    _remember(text)
    update = "x[{at}] + h * rate"
    then = watch_change(text, "x") if scheme.settle else []
    if text.template.output.limited:
        update = f"clamp({update}, -ONE, ONE)"
    instant = _instant(text, scheme.step, 0.0)
    rates(text, "x", [*then, f"x[{{at}}] = {update};"], instant)


def _several_stages(text: TransientText, scheme: FixedSteps) -> None:
    tableau = scheme.tableau
    for stage in range(tableau.stages):
        c = float(sum(tableau.a[stage]))
        text.lines.append("{")
        _stage(text, (tableau,) * text.layers, stage, _instant(text, scheme.step, c))
        text.lines.append("}")
    body: list[str] = []
    for layer in range(text.layers):
        at = text.at(layer)
        if scheme.settle:
            body.append(f"{{ const real rate = k0[{at}]; ")
            body += [line.replace("{at}", at) for line in watch_change(text, "x")] + ["}"]
        update = f"x[{at}] + h * ({_combination(tableau.b, text, at)})"
        if text.template.output.limited:
            update = f"clamp({update}, -ONE, ONE)"
        body.append(f"x[{at}] = {update};")
    text.over_cells(body)


@dataclass(frozen=True, slots=True)
class Attempt:
    """Statements of a step that may be refused.

    Attributes
    ----------
    begin : list of str
        Before all steps, once `k0` holds the rates at the start `x`.
    stages : list of str
        The stages, h long.
    judge : list of str
        What finds `worst`, `added`, `speed` and `change` (see `adaptive_steps.cl`).
    advance : list of str
        What takes the step over where `accept` is not 0.
    end : list of str
        After all steps: what brings the state back to `x`.
    """

    begin: list[str]
    stages: list[str]
    judge: list[str]
    advance: list[str]
    end: list[str]


def sweeps(text: TransientText, scheme: AdaptiveSteps) -> Attempt:
    """Return a step's statements as sweeps over all cells, a stage after the other."""
    tableau, last = scheme.tableau, scheme.tableau.stages - 1
    tableaux = tuple(scheme.of(layer) for layer in range(text.layers))
    for stage in range(1, tableau.stages):
        text.array(f"k{stage}", text.layers * text.cells)
    text.array("xs", text.layers * text.cells)
    with text.aside() as stages:
        for stage in range(1, tableau.stages):
            c = text.number(float(sum(tableau.a[stage])))
            text.lines.append("{")
            _stage(text, tableaux, stage, Instant(f"time + {c} * h"))
            text.lines.append("}")
    return Attempt([], stages, judge(text, tableaux), advance(text, last), [])


def advance(text: TransientText, last: int) -> list[str]:
    """Return statements that take a step over where `accept` is not 0."""
    return [
        f"for (int i = 0; i < {text.layers * text.cells}; ++i) {{",
        "    x[i] = PICK(accept != ZERO, xs[i], x[i]);",
        f"    k0[i] = PICK(accept != ZERO, k{last}[i], k0[i]);",
        "}",
    ]


def adaptive(
    text: TransientText,
    scheme: AdaptiveSteps,
    attempts: Callable[[TransientText, AdaptiveSteps], Attempt] = sweeps,
) -> dict[str, str]:
    """Append steps that follow the error estimate and return the figures of the run."""
    tableau = scheme.tableau
    text.array("k0", text.layers * text.cells)
    attempt = attempts(text, scheme)
    with text.aside() as first_rates:
        rates_once(text, "x", ["k0[{at}] = rate;"], Instant("time"))
    filled = fill(
        "adaptive_steps",
        method=tableau.name,
        first_step=text.number(scheme.first_step),
        longest=text.number(scheme.longest),
        duration=text.number(text.solver.duration),
        first_rates=indented(["{", *first_rates, "}", *attempt.begin], 2),
        states=text.layers * text.cells,
        limit=MAX_STEPS,
        stages=indented(attempt.stages, 3),
        judge=indented(attempt.judge, 3),
        advance=indented(attempt.advance, 3),
        settle=text.number(float(scheme.settle)),
        almost_one=text.number(1.0 - 1e-6),
        exponent=text.number(-1.0 / tableau.order),
        **growth_texts(text),
    )
    text.lines += [*filled.splitlines(), *attempt.end]
    figures = {"time": "time", "steps": "steps", "error": f"{text.number(SAFETY)} * error"}
    return figures | ({"settled": "settled"} if scheme.settle else {})


def growth_texts(text: TransientText) -> dict[str, str]:
    """Return what a kernel text needs to follow the error of the state from step to step."""
    return {
        "growth": text.number(error_growth(text.template)),
        "largest_exponent": text.number(LARGEST_EXPONENT),
        "smallest_rate": text.number(SMALLEST_RATE),
        "lost": text.number(LOST),
    }


def judge(text: TransientText, tableaux: tuple[Pair, ...]) -> list[str]:
    """Return statements that find the worst error of a step, and the change at its end."""
    last, body = tableaux[0].stages - 1, list[str]()
    tau = text.number(float(text.template.tau.max()))
    rounding = text.number(ROUNDINGS * float(np.finfo(text.tables.dtype).eps))
    for layer, tableau in enumerate(tableaux):
        at = text.at(layer)
        scale, at_end = text.scale(f"fmax(fabs(x[{at}]), fabs(xs[{at}]))"), text.scale(f"xs[{at}]")
        parts = " + ".join(f"fabs(h * ({_combination(d, text, at)}))" for d in tableau.truncation)
        body += [
            f"{{ const real e = fabs(h * ({_combination(tableau.error, text, at)}));",
            f"worst = greater(worst, e / {scale});",
            f"added = greater(added, {parts} + {rounding} * fabs(xs[{at}]));",
            f"speed = greater(speed, fabs(k{last}[{at}]));",
            f"change = greater(change, fabs({tau} * k{last}[{at}]) / {at_end}); }}",
        ]
    with text.aside() as lines:
        text.over_cells(body)
    return lines
